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
