//! Rungs of the latest proposals of each task, and success there, under every strategy.
//!
//! They decide nothing: a sampler keeps what it needs in its own state. As mastery, they belong to the curriculum and outlast a
//! change of the strategy.

use std::collections::{BTreeMap, VecDeque};

use serde::{Deserialize, Serialize};

use super::decayed_success::DecayedSuccess;
use super::outcome::GroupOutcome;
use super::proposal::Proposal;
use super::rungs::RungKind;

/// Number of a task's latest proposals that are remembered.
const WINDOW: usize = 256;
/// Share of the earlier results of a rung that each episode of it replaces: about 64 episodes count.
const FORGET: f64 = 1.0 / 64.0;

/// Latest draws and successes of every task.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub(crate) struct RungTracker {
    tasks: BTreeMap<String, TaskRungs>,
}

/// Latest draws of a task, and its success at each start rung and level.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct TaskRungs {
    /// Latest proposals, oldest first.
    draws: VecDeque<DrawnRung>,
    starts: BTreeMap<u32, DecayedSuccess>,
    levels: BTreeMap<u32, DecayedSuccess>,
}

/// Start rung and level of a proposal. Stored as `[start_rung, level]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "[Option<u32>; 2]", into = "[Option<u32>; 2]")]
struct DrawnRung {
    start_rung: Option<u32>,
    level: Option<u32>,
}

impl RungTracker {
    /// Records the rung of a proposal.
    pub(crate) fn record_draw(&mut self, proposal: &Proposal) {
        let draws = &mut self.tasks.entry(proposal.task.clone()).or_default().draws;
        if draws.len() >= WINDOW {
            draws.pop_front();
        }
        draws.push_back(DrawnRung { start_rung: proposal.start_rung, level: proposal.level });
    }

    /// Records the finished episodes of a group, if strategies may use them.
    pub(crate) fn observe(&mut self, outcome: &GroupOutcome) {
        // A designed layout shows success on the layout, not at the rung.
        if !outcome.usable || outcome.finished == 0 || outcome.is_designed {
            return;
        }
        let task = self.tasks.entry(outcome.task.clone()).or_default();
        let successes = outcome.successes.min(outcome.finished);
        let failures = outcome.finished - successes;
        if let Some(rung) = outcome.start_rung {
            task.starts.entry(rung).or_default().add(successes, failures, FORGET);
        }
        if let Some(level) = outcome.level {
            task.levels.entry(level).or_default().add(successes, failures, FORGET);
        }
    }

    /// Drops everything about a task.
    pub(crate) fn forget(&mut self, task: &str) {
        self.tasks.remove(task);
    }

    /// Draws and successes of a task; `None` before its first proposal.
    pub(crate) fn task(&self, task: &str) -> Option<&TaskRungs> {
        self.tasks.get(task)
    }
}

impl TaskRungs {
    /// Number of proposals that are remembered, at most 256.
    pub(crate) fn proposals(&self) -> u32 {
        u32::try_from(self.draws.len()).unwrap_or(u32::MAX)
    }

    /// Number of them at a rung.
    pub(crate) fn draws(&self, kind: RungKind, rung: u32) -> u32 {
        let drawn = self.draws.iter().filter(|draw| draw.rung(kind) == Some(rung)).count();
        u32::try_from(drawn).unwrap_or(u32::MAX)
    }

    /// Latest results at a rung.
    pub(crate) fn success(&self, kind: RungKind, rung: u32) -> DecayedSuccess {
        let rungs = match kind {
            RungKind::Start => &self.starts,
            RungKind::Level => &self.levels,
        };
        rungs.get(&rung).copied().unwrap_or_default()
    }
}

impl DrawnRung {
    const fn rung(self, kind: RungKind) -> Option<u32> {
        match kind {
            RungKind::Start => self.start_rung,
            RungKind::Level => self.level,
        }
    }
}

impl From<[Option<u32>; 2]> for DrawnRung {
    fn from([start_rung, level]: [Option<u32>; 2]) -> Self {
        Self { start_rung, level }
    }
}

impl From<DrawnRung> for [Option<u32>; 2] {
    fn from(draw: DrawnRung) -> Self {
        [draw.start_rung, draw.level]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::proposal::ProposalRole;
    use crate::core::settings::TaskPlan;
    use crate::tests::{SURVIVAL, outcome};

    #[test]
    fn draws_are_those_of_the_latest_256_proposals() {
        let plan = TaskPlan::standard(SURVIVAL).unwrap();
        let mut tracker = RungTracker::default();
        for at in 0..300 {
            let level = if at < 100 { 0 } else { 1 };
            tracker.record_draw(&Proposal::fresh(&plan, Some(level), ProposalRole::Rung));
        }
        let task = tracker.task(SURVIVAL).unwrap();
        assert_eq!(task.proposals(), 256);
        assert_eq!([0, 1, 2].map(|level| task.draws(RungKind::Level, level)), [56, 200, 0]);
        assert_eq!(task.draws(RungKind::Start, 0), 0);
    }

    #[test]
    fn success_fades_with_each_episode_of_the_rung() {
        let mut tracker = RungTracker::default();
        let observe = |tracker: &mut RungTracker, level, finished, successes| {
            tracker.observe(&outcome(SURVIVAL, Some(level), finished, successes));
        };
        observe(&mut tracker, 3, 4, 4);
        observe(&mut tracker, 3, 2, 0);
        observe(&mut tracker, 5, 1000, 250); // another rung changes nothing
        let success = tracker.task(SURVIVAL).unwrap().success(RungKind::Level, 3);
        let kept = (63.0 / 64.0) * (63.0 / 64.0);
        assert!((success.successes - 4.0 * kept).abs() < 1e-12, "{success:?}");
        assert!((success.attempts() - (4.0 * kept + 2.0)).abs() < 1e-12, "{success:?}");
        for _ in 0..2000 {
            observe(&mut tracker, 3, 1, 1);
        }
        let success = tracker.task(SURVIVAL).unwrap().success(RungKind::Level, 3);
        assert!((success.attempts() - 64.0).abs() < 1e-6 && success.failures < 1e-6, "{success:?}");
        let unusable = GroupOutcome { usable: false, ..outcome(SURVIVAL, Some(7), 5, 5) };
        tracker.observe(&unusable);
        assert_eq!(tracker.task(SURVIVAL).unwrap().success(RungKind::Level, 7), DecayedSuccess::default());
    }
}
