//! Where scenarios come from and results go: what a trainer asks of the service, and the words it is said in.
//!
//! Answers are read leniently: what a newer service adds is ignored.

use std::collections::BTreeMap;

use env_core::ActionLog;
use serde::ser::{SerializeSeq, SerializeTuple, Serializer};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::designs::Designs;

/// Most episodes the service takes in one report.
pub(super) const MAX_RESULTS: usize = 5000;
/// Bytes of one report that are aimed at: the service takes 16 MiB.
const MAX_BYTES: usize = 12 << 20;

/// Operations of the service that the training loop uses.
pub(super) trait Feed {
    /// Leases up to `groups` groups.
    async fn lease(&self, groups: usize, policy_version: u32) -> anyhow::Result<Lease>;
    /// Reports finished episodes and returns their receipts.
    async fn report(&self, policy_version: u32, results: Vec<Finished>) -> anyhow::Result<Receipts>;
    /// Fetches the mastery of each task.
    async fn mastery(&self) -> anyhow::Result<Vec<TaskMastery>>;
    /// Fetches the designs of the run.
    async fn designs(&self) -> anyhow::Result<Designs>;
}

/// Groups of scenarios, handed out for a time.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct Lease {
    pub(super) recipes: Vec<Value>,
    pub(super) groups: Vec<LeasedGroup>,
}

/// Episodes of one scenario.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct LeasedGroup {
    /// Which of the lease's recipes.
    pub(super) recipe: usize,
    pub(super) seed: u64,
    pub(super) task: String,
    #[serde(default)]
    pub(super) contested: bool,
    pub(super) episodes: Vec<String>,
}

/// Finished episode with its actions.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Finished {
    pub(super) episode: String,
    pub(super) status: &'static str,
    pub(super) actions: Actions,
}

impl Finished {
    pub(super) const fn new(episode: String, log: ActionLog) -> Self {
        Self { episode, status: "finished", actions: Actions(log) }
    }

    /// Returns an upper bound of the episode's size as JSON, in bytes.
    fn most_bytes(&self) -> usize {
        /// Of a number with its comma: a sign, 17 digits, a point, and an exponent of three with its sign.
        const NUMBER: usize = 25;
        /// Of names and punctuation around the steps.
        const FRAME: usize = 100;
        let log = &self.actions.0;
        let entries: usize = log.steps().map(|step| step.agents.len()).sum();
        FRAME + self.episode.len() + 3 * log.len() + entries * (3 + 10 + log.dim() * NUMBER)
    }
}

/// Splits a report into those that the service takes: by the bytes of their logs, since an episode of one world may have
/// a hundred times the actions of another's. Each `whole` episodes that follow each other stay together, as siblings of a
/// group do.
pub(super) fn batches(finished: Vec<Finished>, whole: usize) -> Vec<Vec<Finished>> {
    let mut batches: Vec<Vec<Finished>> = Vec::new();
    let mut bytes = 0;
    let mut finished = finished.into_iter().peekable();
    while finished.peek().is_some() {
        let group: Vec<Finished> = finished.by_ref().take(whole.max(1)).collect();
        let size = group.iter().map(Finished::most_bytes).sum::<usize>();
        match batches.last_mut() {
            Some(batch) if bytes + size <= MAX_BYTES && batch.len() + group.len() <= MAX_RESULTS => {
                bytes += size;
                batch.extend(group);
            }
            _ => {
                bytes = size;
                batches.push(group);
            }
        }
    }
    batches
}

/// An action log as it is sent: `{"precision": "f64", "steps": [[[agent, value, …], …], [], …]}`.
#[derive(Debug, Clone)]
pub(super) struct Actions(pub(super) ActionLog);

impl Serialize for Actions {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Wire<'a> {
            precision: &'static str,
            steps: Steps<'a>,
        }
        // The demo's policies act in double precision.
        Wire { precision: "f64", steps: Steps(&self.0) }.serialize(serializer)
    }
}

struct Steps<'a>(&'a ActionLog);

impl Serialize for Steps<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut steps = serializer.serialize_seq(Some(self.0.len()))?;
        let dim = self.0.dim();
        for step in self.0.steps() {
            let entries = step.agents.iter().zip(step.values.chunks(dim.max(1)));
            steps.serialize_element(
                &entries.map(|(&agent, values)| Entry { agent, values }).collect::<Vec<_>>(),
            )?;
        }
        steps.end()
    }
}

struct Entry<'a> {
    agent: u32,
    values: &'a [f64],
}

impl Serialize for Entry<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut cells = serializer.serialize_tuple(1 + self.values.len())?;
        cells.serialize_element(&self.agent)?;
        for value in self.values {
            cells.serialize_element(value)?;
        }
        cells.end()
    }
}

/// What became of a report.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct Receipts {
    pub(super) results: Vec<Receipt>,
    #[serde(default)]
    pub(super) moves: Vec<Move>,
}

/// What became of one episode.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct Receipt {
    pub(super) episode: String,
    pub(super) status: String,
    pub(super) detail: Option<String>,
    pub(super) score: Option<f64>,
    pub(super) skill: Option<f64>,
    pub(super) success: Option<bool>,
}

/// A change of level.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct Move {
    pub(super) task: String,
    pub(super) from: Option<u32>,
    pub(super) to: u32,
    #[serde(default)]
    pub(super) evidence: Evidence,
}

/// Why a level changed.
#[derive(Debug, Clone, Default, Deserialize)]
pub(super) struct Evidence {
    #[serde(default)]
    pub(super) sentence: String,
}

/// Where a task stands.
#[derive(Debug, Clone, Deserialize)]
pub(super) struct TaskMastery {
    pub(super) task: String,
    /// None where the strategy has no levels.
    pub(super) level: Option<u32>,
    #[serde(default)]
    pub(super) params: BTreeMap<String, f64>,
    /// At the current level; see [`TaskMastery::evidence`].
    pub(super) mastery: Option<Posterior>,
    #[serde(default)]
    pub(super) plain: Plain,
    #[serde(default)]
    pub(super) warnings: Vec<String>,
}

impl TaskMastery {
    /// Returns the mastery of the current level, or `None` if it is only the prior.
    pub(super) fn evidence(&self) -> Option<Posterior> {
        self.mastery.filter(|mastery| mastery.n > 0)
    }
}

/// Success on contested scenarios, with bounds.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub(super) struct Posterior {
    pub(super) n: u32,
    pub(super) mean: f64,
    pub(super) q10: f64,
    pub(super) q90: f64,
}

/// All episodes, contested or not.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(default)]
pub(super) struct Plain {
    pub(super) episodes: u64,
    pub(super) success: Option<f64>,
    pub(super) score: Option<f64>,
    pub(super) skill: Option<f64>,
}

#[cfg(test)]
mod tests {
    use env_core::log::Precision;
    use env_core::{Recipe, Scenario, Seed, rollout};

    use super::*;

    #[test]
    fn what_is_sent_replays_to_the_same_score() {
        for (seed, task) in (0..).zip(env_core::tasks()) {
            let recipe = Recipe::at_level(task, 4).unwrap();
            let scenario = Scenario::new(std::sync::Arc::new(recipe), Seed::user(seed).unwrap());
            let mut pilot = task.policy("random", &scenario, seed).unwrap();
            let env_core::rollout::Rollout { outcome: flown, log } =
                rollout::roll_out(&scenario, &mut *pilot).unwrap();
            let sent = serde_json::to_string(&Finished::new("ep_1-a_0".to_owned(), log.clone())).unwrap();
            let read: Value = serde_json::from_str(&sent).unwrap();
            assert_eq!(read["actions"]["precision"], "f64");
            let steps = read["actions"]["steps"].as_array().unwrap();
            let back = rollout::read_log(&scenario, steps, Precision::F64, None).unwrap();
            assert_eq!(back, log);
            assert_eq!(rollout::replay(&scenario, &back).unwrap(), flown);
        }
    }

    #[test]
    fn reports_are_split_by_their_bytes_and_siblings_stay_together() {
        let flown = |steps: usize, name: usize| {
            let mut log = ActionLog::new(3, Precision::F64);
            for _ in 0..steps {
                (0..5)
                    .for_each(|agent| log.push_entry(u32::MAX - agent, &[-1.234_567_890_123_456_7e-101; 3]));
                log.end_step();
            }
            Finished::new(format!("ep_1-abcdef_{name}"), log)
        };
        let long: Vec<Finished> = (0..36).map(|name| flown(2000, name)).collect();
        let sizes: Vec<usize> = long.iter().map(|one| serde_json::to_string(one).unwrap().len()).collect();
        for (one, size) in long.iter().zip(&sizes) {
            assert!(one.most_bytes() >= *size && one.most_bytes() < size + size / 10 + 100, "{size}");
        }
        let split = batches(long, 6);
        assert!(split.len() > 2, "{} bytes in all", sizes.iter().sum::<usize>());
        for batch in &split {
            assert!(batch.len() % 6 == 0 && serde_json::to_string(batch).unwrap().len() < MAX_BYTES);
        }
        assert_eq!(split.iter().flatten().count(), 36);
        assert_eq!(batches((0..288).map(|name| flown(1, name)).collect(), 12).len(), 1);
        let many = batches((0..MAX_RESULTS + 7).map(|name| flown(0, name)).collect(), 1);
        assert_eq!(many.iter().map(Vec::len).collect::<Vec<_>>(), [MAX_RESULTS, 7]);
        assert!(batches(Vec::new(), 12).is_empty());
    }

    #[test]
    fn a_step_without_actions_is_an_empty_list() {
        let mut log = ActionLog::new(2, Precision::F64);
        log.push_entry(2, &[0.25, -0.5]);
        log.end_step();
        log.end_step();
        let sent = serde_json::to_value(Actions(log)).unwrap();
        assert_eq!(sent, serde_json::json!({"precision": "f64", "steps": [[[2, 0.25, -0.5]], []]}));
    }

    #[test]
    fn answers_of_a_newer_service_are_read() {
        let lease = r#"{"lease": "42-x7k2p9", "run": "r", "new": 1, "recipes": [{}], "groups":
            [{"group": 0, "recipe": 0, "seed": 3, "task": "t", "level": null, "episodes": ["a"], "bracket": {}}]}"#;
        let lease: Lease = serde_json::from_str(lease).unwrap();
        assert_eq!((lease.groups[0].seed, lease.groups[0].contested), (3, false));
        let receipts = r#"{"results": [{"episode": "a", "status": "late"}], "moves":
            [{"task": "t", "kind": "up", "from": 0, "to": 1, "evidence": {"sentence": "s", "blocks": []}}]}"#;
        let receipts: Receipts = serde_json::from_str(receipts).unwrap();
        assert_eq!(receipts.moves[0].evidence.sentence, "s");
        let task =
            r#"{"task": "t", "level": null, "mastery": null, "plain": {"episodes": 0, "success": null}}"#;
        assert!(serde_json::from_str::<TaskMastery>(task).unwrap().evidence().is_none());
        let prior = r#"{"task": "t", "level": 1, "mastery": {"n": 0, "mean": 0.5, "q10": 0.1, "q90": 0.9}}"#;
        assert!(serde_json::from_str::<TaskMastery>(prior).unwrap().evidence().is_none());
    }
}
