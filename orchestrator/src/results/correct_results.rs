//! Corrects stored results that a worker on another machine computed wrongly.
//!
//! Score, skill, success and outcome of the episodes are replaced. The effects of the wrong results stay: level moves, mastery and
//! counters. Every run with a corrected episode gets a warning.

use std::collections::BTreeMap;

use env_core::admission::is_success;
use env_core::{ActionLog, EpisodeOutcome, Scenario};
use store::brackets::{self, StoredOutcome};
use store::corrections::{self, CorrectedResult};
use store::episodes::StoredLog;
use store::{from_json, runs, to_json};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::write_tx::WriteTx;
use crate::runs::settings::RunSettings;

/// A replay of the server that contradicts a worker's.
#[derive(Debug, Clone)]
pub struct ServerReplay {
    /// Scenario of the episode.
    pub scenario: Scenario,
    /// Actions of the episode.
    pub log: ActionLog,
    /// Outcome of the server's replay.
    pub outcome: EpisodeOutcome,
}

/// Corrects the episodes of replays. Returns their number.
#[derive(Debug)]
pub struct CorrectResults(pub Vec<ServerReplay>);

impl Change for CorrectResults {
    type Output = usize;
    const IS_BULK: bool = true;

    async fn apply(self, tx: &mut WriteTx) -> Result<usize, ServiceError> {
        let mut corrected: BTreeMap<String, usize> = BTreeMap::new();
        for ServerReplay { scenario, log, outcome } in &self.0 {
            let id = scenario.id().0;
            let digest = StoredLog::of(log).digest;
            let Some(bracket) = brackets::newest(&mut tx.conn, &id).await? else { continue };
            for row in corrections::episodes_of(&mut tx.conn, &id, &digest).await? {
                let stored = runs::get(&mut tx.conn, &row.run).await?;
                let Some(stored) = stored.filter(|_| row.score != Some(outcome.score)) else { continue };
                let settings: RunSettings = from_json("a run's settings", &stored.settings)?;
                let rule = settings.rule(scenario.task().id());
                let result = CorrectedResult {
                    score: outcome.score,
                    is_success: is_success(scenario, rule, &bracket, outcome),
                    skill: bracket.skill(outcome.score),
                    outcome: to_json(&StoredOutcome::from(*outcome))?,
                };
                corrections::correct(&mut tx.conn, row.key, &result).await?;
                *corrected.entry(row.run).or_default() += 1;
            }
        }
        for (run, count) in &corrected {
            let message = format!(
                "{count} results of a worker were wrong and are corrected. Level moves and mastery that they caused stay."
            );
            tx.emit(run, &RunEvent::Warning { task: None, message: &message })?;
        }
        Ok(corrected.values().sum())
    }
}

#[cfg(test)]
mod tests {
    use api_types::RunRequest;
    use clock::Clock;
    use env_core::admission::admit;
    use env_core::rollout::roll_out;
    use env_core::{Recipe, SeedSpace};
    use jobs::seeds::seed_of;
    use store::episodes::{self, EpisodeRow, EpisodeState};
    use store::groups::{GroupRole, GroupRow};
    use store::keys::EpisodeKey;
    use store::leases::{self, Disclosure, LeaseForm, LeaseRow, LeaseStatus, Purpose};
    use store::scenarios;

    use super::*;
    use crate::engine::signals::WorkerSignals;
    use crate::engine::writer::Writer;
    use crate::results::audit_outcome::{AuditOutcome, ReplayedEpisode};
    use crate::results::episode_row::episode_row;
    use crate::runs::create_run::CreateRun;
    use crate::shards::Shards;

    const RUN: &str = "run";
    const TASK: &str = "kessler/survival";

    /// Stores a lease of one group of two episodes with different logs, and a wrong score for each.
    struct StoreWrong {
        replays: Vec<ServerReplay>,
    }

    fn lease_row() -> LeaseRow {
        LeaseRow {
            is_compacted: false,
            owner: None,
            id: 1,
            id_suffix: "aaaaaa".to_owned(),
            run: RUN.to_owned(),
            purpose: Purpose::Train,
            form: LeaseForm::Groups,
            status: LeaseStatus::Active,
            groups: 1,
            group_size: 2,
            policy_version: 0,
            ttl_ms: 1000,
            created_at: 0,
            expires_at: 1000,
            first_expires_at: 0,
            disclosure: Disclosure::Lease,
        }
    }

    impl Change for StoreWrong {
        type Output = ();

        async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
            let scenario = &self.replays[0].scenario;
            scenarios::insert(&mut tx.conn, &[scenario]).await?;
            let bracket = admit(scenario).bracket.expect("a fair start");
            let id = scenario.id().0;
            brackets::insert(&mut tx.conn, &[(id.as_slice(), &bracket)]).await?;
            let group = GroupRow::open(0, GroupRole::Frontier, TASK.to_owned(), id.to_vec());
            leases::insert(&mut tx.conn, &lease_row(), &[group]).await?;
            let mut rows: Vec<(EpisodeRow, Option<StoredLog>)> = Vec::new();
            for (number, replay) in (0..).zip(&self.replays) {
                let log = StoredLog::of(&replay.log);
                let replayed = ReplayedEpisode {
                    outcome: EpisodeOutcome { score: replay.outcome.score + 1.0, ..replay.outcome },
                    skill: Some(1.0),
                    is_success: true,
                    floor: bracket.floor,
                    reference: bracket.reference.score,
                    planner: bracket.planner_version,
                    log: log.clone(),
                };
                let digest = log.digest.to_vec();
                let outcome = AuditOutcome::Replayed(replayed);
                let key = EpisodeKey { lease: 1, number };
                rows.push((episode_row(key, &outcome, false, digest, 0)?, Some(log)));
            }
            assert!(rows.iter().all(|(row, _)| row.state == EpisodeState::Finished));
            Ok(episodes::insert(&mut tx.conn, &rows).await?)
        }
    }

    struct ReadScores(Vec<u8>, Vec<[u8; 16]>);

    impl Change for ReadScores {
        type Output = Vec<Option<f64>>;

        async fn apply(self, tx: &mut WriteTx) -> Result<Self::Output, ServiceError> {
            let mut scores = Vec::new();
            for digest in self.1 {
                let rows = corrections::episodes_of(&mut tx.conn, &self.0, &digest).await?;
                scores.extend(rows.into_iter().map(|row| row.score));
            }
            Ok(scores)
        }
    }

    #[tokio::test]
    async fn only_episodes_with_the_scenario_and_log_are_corrected() {
        let folder = tempfile::tempdir().unwrap();
        let connection = store::open_writer(&folder.path().join("x.sqlite3")).await.unwrap();
        let clock = Clock::manual(1_000).clock;
        let (writer, _) = Writer::start(connection, None, clock, WorkerSignals::default());
        let request = RunRequest {
            id: Some(RUN.to_owned()),
            tasks: Some(vec![TASK.to_owned()]),
            ..RunRequest::default()
        };
        writer.change(CreateRun::from_request(&request, &Shards::default()).unwrap()).await.unwrap();
        let task = env_core::task(TASK).unwrap();
        let scenario = Scenario::new(Recipe::new(task).unwrap(), seed_of(SeedSpace::Training, 1, 2, 3));
        let replay = |policy: &str| {
            let mut policy = task.policy(policy, &scenario, 5).unwrap();
            let rollout = roll_out(&scenario, &mut *policy).unwrap();
            ServerReplay { scenario: scenario.clone(), log: rollout.log, outcome: rollout.outcome }
        };
        let replays = vec![replay("hold"), replay("random")];
        let scores: Vec<f64> = replays.iter().map(|replay| replay.outcome.score).collect();
        let digests = || replays.iter().map(|replay| StoredLog::of(&replay.log).digest).collect::<Vec<_>>();
        writer.change(StoreWrong { replays: replays.clone() }).await.unwrap();
        let read = || writer.change(ReadScores(scenario.id().0.to_vec(), digests()));
        assert_eq!(read().await.unwrap(), [Some(scores[0] + 1.0), Some(scores[1] + 1.0)]);
        let first = || vec![replays[0].clone()];
        assert_eq!(writer.change(CorrectResults(first())).await.unwrap(), 1);
        assert_eq!(read().await.unwrap(), [Some(scores[0]), Some(scores[1] + 1.0)]);
        assert_eq!(writer.change(CorrectResults(first())).await.unwrap(), 0, "it is right already");
    }
}
