//! Flies the policies of runs, a group at a time each, as long as their feeds have room. Whatever goes wrong with a policy,
//! its run goes on, and says what it was.

mod flight;

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;
use std::time::{Duration, Instant};

use sqlx::SqlitePool;
use tokio::sync::Notify;
use tokio::task::{Id, JoinError, JoinSet};

use self::flight::Ended;
use crate::clock::Clock;
use crate::ids::RunId;
use crate::store::run_policies::{self, RunPolicy, RunPolicyRow};
use crate::store::{from_json, runs, trajectories};
use crate::rollouts::feed::MOST_WAITING;
use crate::rollouts::settings::ReportTrouble;
use crate::rollouts::rollout_lease::ReturnAbandonedLeases;
use crate::rollouts::{Endpoint, PolicySettings};
use crate::engine::error::ServiceError;
use crate::leases::lease_service::LeaseService;
use crate::runs::settings::RunSettings;

/// How often it looks whether anything may be flown, if nobody rings.
const EVERY: Duration = Duration::from_secs(1);
/// How long it waits after a failure of its own.
const PAUSE: Duration = Duration::from_secs(2);
/// Groups of built-in policies that are flown at once: one is replayed and stored while another is flown.
const BUILT_IN_AT_ONCE: usize = 2;
/// The first pause after a group that nothing came of; it doubles to the longest.
const FIRST_REST: Duration = Duration::from_secs(1);
const LONGEST_REST: Duration = Duration::from_secs(60);

/// What the worker needs.
#[derive(Debug, Clone)]
pub struct RolloutWorkers {
    /// Where leases come from and results go.
    pub desk: LeaseService,
    /// Where policies and feeds are looked at.
    pub readers: SqlitePool,
    /// Where the time is read.
    pub clock: Clock,
    /// Rung when there may be something to fly.
    pub wake: Arc<Notify>,
    /// The model that flies, where there is one.
    pub endpoint: Option<Endpoint>,
    /// Threads of its own, in the background.
    pub pool: Arc<rayon::ThreadPool>,
}

/// A group that is being flown.
struct Flying {
    run: String,
    /// When its policy was set.
    set: i64,
    /// Episodes that ask the model at once; none of a built-in policy.
    asking: Option<u32>,
}

/// A run that is left alone for a while.
struct Rest {
    until: Instant,
    pause: Duration,
    /// When the policy was set that failed: another is tried at once.
    set: i64,
}

#[derive(Default)]
struct Underway {
    jobs: JoinSet<Ended>,
    of: HashMap<Id, Flying>,
    rests: BTreeMap<String, Rest>,
    /// The run that was served last: the next one comes first.
    last: String,
}

impl RolloutWorkers {
    /// Works until the writer is gone.
    pub async fn run(self) {
        let mut underway = Underway::default();
        let mut picked_up = false;
        loop {
            match self.turn(&mut underway, &mut picked_up).await {
                Ok(()) => {}
                Err(ServiceError::Stopping) => return,
                Err(ServiceError::Busy) => tokio::time::sleep(PAUSE).await,
                Err(error) => {
                    tracing::error!(error = %error, "Policies could not be flown; trying again soon.");
                    tokio::time::sleep(PAUSE).await;
                }
            }
            tokio::select! {
                Some(done) = underway.jobs.join_next_with_id() => underway.ended(done),
                () = self.wake.notified() => {}
                () = tokio::time::sleep(EVERY) => {}
            }
        }
    }

    /// Begins what may be begun, run by run in turn.
    async fn turn(&self, underway: &mut Underway, picked_up: &mut bool) -> Result<(), ServiceError> {
        if !*picked_up {
            let given = self.desk.writer.change(ReturnAbandonedLeases).await?;
            *picked_up = true;
            if given > 0 {
                tracing::info!(
                    given,
                    "Groups that were being flown when the server went away are offered again."
                );
            }
        }
        loop {
            let mut rows = {
                let mut conn = self.readers.acquire().await?;
                run_policies::active(&mut conn).await?
            };
            let first = rows.partition_point(|row| row.run <= underway.last);
            rows.rotate_left(first);
            let mut begun = false;
            for row in rows {
                if let Some(asking) = self.may(underway, &row).await? {
                    underway.last.clone_from(&row.run);
                    self.begin(underway, &row, asking)?;
                    begun = true;
                }
            }
            if !begun {
                return Ok(());
            }
        }
    }

    /// Whether a group may be begun for this policy, and how many of its episodes ask a model at once.
    async fn may(
        &self,
        underway: &mut Underway,
        row: &RunPolicyRow,
    ) -> Result<Option<Option<u32>>, ServiceError> {
        let chat = row.policy == RunPolicy::Chat;
        if underway.rests(row) || (!chat && underway.built_in() >= BUILT_IN_AT_ONCE) {
            return Ok(None);
        }
        let settings = PolicySettings::of(row)?;
        let mut conn = self.readers.acquire().await?;
        let feed = trajectories::counts(&mut conn, &row.run, self.clock.now()).await?;
        let held = feed.waiting + feed.delivered + underway.of_run(&row.run);
        if held >= i64::from(settings.ahead) || feed.bytes >= MOST_WAITING {
            return Ok(None);
        }
        if !chat {
            return Ok(Some(None));
        }
        let Some(endpoint) = &self.endpoint else {
            drop(conn);
            let words = "this server was started without a language model that flies (--policy-url)";
            return self.rest(underway, row, words.to_owned()).await;
        };
        let health = endpoint.llm.health();
        if health.retry_in_s.is_some_and(|left| left > 0.0) {
            drop(conn);
            let words = format!("the model is left alone for a while: {}", health.why.unwrap_or_default());
            return self.rest(underway, row, words).await;
        }
        // A few more than may be asked at once, so that none of them waits for the slowest of a group.
        if underway.asking() >= endpoint.llm.config().concurrency {
            return Ok(None);
        }
        let run = runs::get(&mut conn, &row.run).await?;
        let run = run.ok_or_else(|| ServiceError::UnknownRun(row.run.clone()))?;
        let size = from_json::<RunSettings>("a run's settings", &run.settings)?.group_size;
        Ok(Some(Some(size)))
    }

    /// Leaves a run alone for a while, and says why.
    async fn rest(
        &self,
        underway: &mut Underway,
        row: &RunPolicyRow,
        words: String,
    ) -> Result<Option<Option<u32>>, ServiceError> {
        underway.rest(&row.run, row.changed_at);
        if row.trouble.as_ref() != Some(&words) {
            self.desk.writer.change(ReportTrouble { run: row.run.clone(), words }).await?;
        }
        Ok(None)
    }

    fn begin(
        &self,
        underway: &mut Underway,
        row: &RunPolicyRow,
        asking: Option<u32>,
    ) -> Result<(), ServiceError> {
        let run: RunId = row
            .run
            .parse()
            .map_err(|error: crate::ids::InvalidId| ServiceError::invalid("run", error.to_string()))?;
        let pilots = self.clone();
        let job = underway.jobs.spawn(async move { pilots.fly(run).await });
        underway.of.insert(job.id(), Flying { run: row.run.clone(), set: row.changed_at, asking });
        Ok(())
    }
}

impl Underway {
    fn built_in(&self) -> usize {
        self.of.values().filter(|flying| flying.asking.is_none()).count()
    }

    fn asking(&self) -> usize {
        self.of.values().filter_map(|flying| flying.asking).map(|size| size as usize).sum()
    }

    fn of_run(&self, run: &str) -> i64 {
        self.of.values().filter(|flying| flying.run == run).count() as i64
    }

    /// Whether a run is left alone now.
    fn rests(&mut self, row: &RunPolicyRow) -> bool {
        match self.rests.get(&row.run) {
            Some(rest) if rest.set != row.changed_at => {
                self.rests.remove(&row.run);
                false
            }
            Some(rest) => rest.until > Instant::now(),
            None => false,
        }
    }

    fn rest(&mut self, run: &str, set: i64) {
        let known = self.rests.get(run).filter(|rest| rest.set == set);
        if known.is_some_and(|rest| rest.until > Instant::now()) {
            return; // several groups failed of one cause
        }
        let pause = known.map_or(FIRST_REST, |rest| (rest.pause * 2).min(LONGEST_REST));
        self.rests.insert(run.to_owned(), Rest { until: Instant::now() + pause, pause, set });
    }

    fn ended(&mut self, done: Result<(Id, Ended), JoinError>) {
        let (id, ended) = match done {
            Ok(done) => done,
            Err(error) => {
                tracing::error!(error = %error, "What flew a group ended; its lease ends by itself.");
                (error.id(), Ended::Badly)
            }
        };
        let Some(flying) = self.of.remove(&id) else { return };
        match ended {
            Ended::Well => {
                self.rests.remove(&flying.run);
            }
            Ended::Badly => self.rest(&flying.run, flying.set),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_that_fails_is_left_alone_for_longer_and_longer_until_its_policy_is_another() {
        let row = |changed_at| RunPolicyRow {
            run: "r".to_owned(),
            policy: RunPolicy::Chat,
            version: 0,
            settings: String::new(),
            groups: 0,
            episodes: 0,
            failed: 0,
            trouble: None,
            trouble_at: None,
            changed_at,
        };
        let mut underway = Underway::default();
        let mut pauses = Vec::new();
        for _ in 0..9 {
            underway.rest("r", 1);
            underway.rest("r", 1); // at the same time: one cause
            assert!(underway.rests(&row(1)));
            let rest = underway.rests.get_mut("r").unwrap();
            pauses.push(rest.pause.as_secs());
            rest.until = Instant::now();
        }
        assert_eq!(pauses, [1, 2, 4, 8, 16, 32, 60, 60, 60]);
        assert!(!underway.rests(&row(1)), "its time is over");
        underway.rest("r", 1);
        assert!(!underway.rests(&row(2)), "another policy is tried at once");
        underway.rest("r", 2);
        assert_eq!(underway.rests["r"].pause, FIRST_REST);
    }
}
