//! Interface to the service that hands out scenarios and receives results.

use api_types::{
    ActionPrecision, EpisodeActions, EpisodeResult, EpisodeResultStatus, Lease, MasteryEstimate,
    ResultsResponse, TaskMastery,
};
use env_core::ActionLog;
use env_core::frames::wire_step;

use super::designs::Designs;

/// Largest number of episodes that the service accepts in one report.
pub(super) const MAX_RESULTS: usize = 5000;
/// Largest size of one report in bytes; the service accepts 16 MiB.
const MAX_BYTES: usize = 12 << 20;

/// Operations of the service that the training loop uses.
pub(super) trait Feed {
    /// Leases up to `groups` groups.
    async fn lease(&self, groups: usize, policy_version: u32) -> anyhow::Result<Lease>;
    /// Reports finished episodes and returns their receipts.
    async fn report(
        &self,
        policy_version: u32,
        results: Vec<FinishedEpisode>,
    ) -> anyhow::Result<ResultsResponse>;
    /// Fetches the mastery of each task.
    async fn mastery(&self) -> anyhow::Result<Vec<TaskMastery>>;
    /// Fetches the designs of the run.
    async fn designs(&self) -> anyhow::Result<Designs>;
}

/// A finished episode with its action log.
#[derive(Debug, Clone)]
pub(super) struct FinishedEpisode {
    pub(super) id: String,
    pub(super) log: ActionLog,
}

impl FinishedEpisode {
    /// Returns the result as it is reported. The demo's policies act in double precision.
    pub(super) fn into_result(self) -> EpisodeResult {
        let steps = self.log.steps().map(|step| wire_step(&self.log, step)).collect();
        EpisodeResult {
            episode: self.id,
            status: EpisodeResultStatus::Finished,
            actions: Some(EpisodeActions { steps, precision: ActionPrecision::F64, stopped: None }),
            reason: None,
            policy_version: None,
            metrics: None,
        }
    }

    /// Returns an upper bound of the episode's size as JSON, in bytes.
    fn max_bytes(&self) -> usize {
        /// Bytes of a number with its comma: a sign, 17 digits, a point, and an exponent of three digits with its sign.
        const NUMBER: usize = 25;
        /// Bytes of the names and the punctuation around the steps.
        const FRAME: usize = 100;
        let log = &self.log;
        let entries: usize = log.steps().map(|step| step.agents.len()).sum();
        FRAME + self.id.len() + 3 * log.len() + entries * (3 + 10 + log.dim() * NUMBER)
    }
}

/// Splits a report by size into reports that the service accepts, since an episode of one world may have a hundred times the
/// actions of another's. Groups of `group_size` consecutive episodes stay together.
pub(super) fn batches(finished: Vec<FinishedEpisode>, group_size: usize) -> Vec<Vec<FinishedEpisode>> {
    let mut batches: Vec<Vec<FinishedEpisode>> = Vec::new();
    let mut bytes = 0;
    let mut finished = finished.into_iter().peekable();
    while finished.peek().is_some() {
        let group: Vec<FinishedEpisode> = finished.by_ref().take(group_size.max(1)).collect();
        let size = group.iter().map(FinishedEpisode::max_bytes).sum::<usize>();
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

/// Returns the mastery of a task's current level, or `None` if it is only the prior.
pub(super) fn mastery_evidence(task: &TaskMastery) -> Option<MasteryEstimate> {
    task.mastery.filter(|mastery| mastery.n > 0)
}

#[cfg(test)]
mod tests {
    use env_core::log::Precision;
    use env_core::{Recipe, Scenario, Seed, rollout};

    use super::*;

    fn json(episode: &FinishedEpisode) -> String {
        serde_json::to_string(&episode.clone().into_result()).unwrap()
    }

    #[test]
    fn sent_actions_replay_to_the_same_score() {
        for (seed, task) in (0..).zip(env_core::tasks()) {
            let recipe = Recipe::at_level(task, 4).unwrap();
            let scenario = Scenario::new(std::sync::Arc::new(recipe), Seed::user(seed).unwrap());
            let mut policy = task.policy("random", &scenario, seed).unwrap();
            let env_core::rollout::Rollout { outcome: flown, log } =
                rollout::roll_out(&scenario, &mut *policy).unwrap();
            let sent = serde_json::to_string(
                &FinishedEpisode { id: "ep_1-a_0".to_owned(), log: log.clone() }.into_result(),
            )
            .unwrap();
            let read: serde_json::Value = serde_json::from_str(&sent).unwrap();
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
            FinishedEpisode { id: format!("ep_1-abcdef_{name}"), log }
        };
        let long: Vec<FinishedEpisode> = (0..36).map(|name| flown(2000, name)).collect();
        let sizes: Vec<usize> = long.iter().map(|one| json(one).len()).collect();
        for (one, size) in long.iter().zip(&sizes) {
            assert!(one.max_bytes() >= *size && one.max_bytes() < size + size / 10 + 100, "{size}");
        }
        let split = batches(long, 6);
        assert!(split.len() > 2, "{} bytes in all", sizes.iter().sum::<usize>());
        for batch in &split {
            assert!(
                batch.len() % 6 == 0
                    && batch.iter().map(|one| json(one).len() + 1).sum::<usize>() < MAX_BYTES
            );
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
        let sent =
            serde_json::to_value(FinishedEpisode { id: String::new(), log }.into_result().actions).unwrap();
        assert_eq!(sent, serde_json::json!({"precision": "f64", "steps": [[[2, 0.25, -0.5]], []]}));
    }
}
