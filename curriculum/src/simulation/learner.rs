//! Learners that attempt synthetic scenarios. Success is a logistic curve over the difference between the learner's
//! ability and the scenario's difficulty.

use std::collections::BTreeMap;

use env_core::KeyedRng;

use super::scenario::SyntheticScenario;

/// Width of the logistic curve, in rows. Fitted to the look-ahead policies, which win every episode of level 0 and one
/// to three in ten of level 9.
pub const SUCCESS_WIDTH: f64 = 1.5;
/// Ability of an untrained learner: 12 % success on contested scenarios of level 0.
pub(super) const UNTRAINED_ABILITY: f64 = -3.0;
/// Highest ability: about one half on a row above the last.
const MAX_ABILITY: f64 = 10.0;
/// Gain on other tasks, as a share of the gain on the trained one.
const TRANSFER: f64 = 0.2;
/// Rows above its ability up to which a learner with prerequisites gains: there it succeeds in a tenth of the episodes.
const PREREQUISITE_ROWS: f64 = 3.3;
/// Failure rate of a learner on uncontested scenarios, which need no action.
const NEEDLESS_FAILURE_RATE: f64 = 0.05;

/// Kind of simulated learner.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum LearnerKind {
    /// Gains a row of the level table in four thousand episodes or more.
    Slow,
    /// Gains a row in a thousand episodes or more.
    Fast,
    /// Learns as `Fast`, and forgets four rows every 10 000 episodes.
    Forgetful,
    /// Learns as `Fast`, and a coin decides three in ten of its outcomes.
    Noisy,
    /// Learns as `Fast`; scenarios differ so much that the episodes of a group mostly have the same result.
    Correlated,
    /// Learns as `Fast`, but each row only once it succeeds sometimes on the rows below.
    Chain,
    /// Never acts and never learns.
    Hold,
    /// Follows a plan that ignores observations.
    Blind,
    /// Learns as `Slow`, and reports half of its failures as lost.
    Drops,
}

impl LearnerKind {
    /// All kinds of learner.
    pub const ALL: [Self; 9] = [
        Self::Slow,
        Self::Fast,
        Self::Forgetful,
        Self::Noisy,
        Self::Correlated,
        Self::Chain,
        Self::Hold,
        Self::Blind,
        Self::Drops,
    ];

    /// Name of the kind on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Slow => "slow",
            Self::Fast => "fast",
            Self::Forgetful => "forgetful",
            Self::Noisy => "noisy",
            Self::Correlated => "correlated",
            Self::Chain => "chain",
            Self::Hold => "hold",
            Self::Blind => "blind",
            Self::Drops => "drops",
        }
    }

    /// Description of the kind in a few words.
    #[must_use]
    pub const fn description(self) -> &'static str {
        match self {
            Self::Slow => "gains a row of the level table in four thousand episodes or more",
            Self::Fast => "gains a row in a thousand episodes or more",
            Self::Forgetful => "learns like fast, and forgets four rows every 10 000 episodes",
            Self::Noisy => "learns like fast, and a coin decides three in ten of its outcomes",
            Self::Correlated => "learns like fast, and the episodes of a group mostly end alike",
            Self::Chain => "learns like fast, but each row only once it succeeds sometimes on those below",
            Self::Hold => "never acts",
            Self::Blind => "follows a plan that ignores observations",
            Self::Drops => "learns like slow, and reports half of its failures as lost",
        }
    }

    /// Rows gained by an episode that teaches most.
    const fn learning_rate(self) -> f64 {
        match self {
            Self::Slow | Self::Drops => 0.0008,
            Self::Fast | Self::Forgetful | Self::Noisy | Self::Correlated | Self::Chain => 0.0025,
            Self::Hold | Self::Blind => 0.0,
        }
    }

    /// Standard deviation of the difficulty of scenarios with the same params, in rows.
    const fn difficulty_spread(self) -> f64 {
        if matches!(self, Self::Correlated) { 3.0 } else { 0.5 }
    }
}

/// Episode counts of a group, as the learner reports them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GroupResult {
    /// Number of episodes reported as finished.
    pub finished: u32,
    /// Number of finished episodes that succeeded.
    pub successes: u32,
    /// Number of episodes reported as failed.
    pub failed: u32,
}

impl GroupResult {
    /// A group without any result.
    pub const NONE: Self = Self { finished: 0, successes: 0, failed: 0 };
}

/// Learner with its current ability.
#[derive(Debug, Clone)]
pub struct Learner {
    kind: LearnerKind,
    /// Ability by task, in rows: the learner succeeds half the time on contested scenarios of that row.
    ability: BTreeMap<String, f64>,
    /// Success rate on all contested scenarios, for a learner that never changes.
    constant_success: Option<f64>,
    episodes: u64,
}

impl Learner {
    /// An untrained learner for these tasks.
    #[must_use]
    pub fn new(kind: LearnerKind, tasks: &[String]) -> Self {
        let ability = tasks.iter().map(|task| (task.clone(), UNTRAINED_ABILITY)).collect();
        Self { kind, ability, constant_success: None, episodes: 0 }
    }

    /// A learner with this success rate on all contested scenarios, which never changes.
    #[must_use]
    pub fn constant(success_rate: f64) -> Self {
        let kind = LearnerKind::Slow;
        Self { kind, ability: BTreeMap::new(), constant_success: Some(success_rate), episodes: 0 }
    }

    /// Ability at a task, in rows.
    #[must_use]
    pub fn ability(&self, task: &str) -> f64 {
        self.ability.get(task).copied().unwrap_or(UNTRAINED_ABILITY)
    }

    /// Probability that an episode succeeds.
    #[must_use]
    pub fn success_probability(&self, task: &str, scenario: &SyntheticScenario) -> f64 {
        if !scenario.solvable {
            return 0.0;
        }
        let by_ability = match (self.constant_success, scenario.contested) {
            (Some(success_rate), true) => success_rate,
            (Some(_), false) => 1.0,
            (None, contested) => match (self.kind, contested) {
                (LearnerKind::Hold, contested) => f64::from(u8::from(!contested)),
                (LearnerKind::Blind, _) => scenario.panel,
                (_, true) => {
                    let offset = self.kind.difficulty_spread() * scenario.difficulty_offset;
                    let difficulty = scenario.difficulty + offset;
                    1.0 / (1.0 + libm::exp(-(self.ability(task) - difficulty) / SUCCESS_WIDTH))
                }
                (_, false) => 1.0 - NEEDLESS_FAILURE_RATE,
            },
        };
        if self.kind == LearnerKind::Noisy { 0.7 * by_ability + 0.15 } else { by_ability }
    }

    /// Runs a group of episodes, and learns from them if `train` is true.
    pub fn run_group(
        &mut self,
        task: &str,
        scenario: &SyntheticScenario,
        episodes: u32,
        train: bool,
        rng: &mut KeyedRng,
    ) -> GroupResult {
        let success_probability = self.success_probability(task, scenario);
        let mut result = GroupResult::NONE;
        for _ in 0..episodes {
            let succeeded = rng.bernoulli(success_probability);
            let dropped = self.kind == LearnerKind::Drops && !succeeded && rng.bernoulli(0.5);
            result.failed += u32::from(dropped);
            result.finished += u32::from(!dropped);
            result.successes += u32::from(succeeded);
            if train {
                self.learn(task, scenario, success_probability);
            }
            self.count_episode();
        }
        result
    }

    /// Raises the ability by one episode: most at a success rate of one half, and little on an uncontested scenario.
    fn learn(&mut self, task: &str, scenario: &SyntheticScenario, success: f64) {
        let signal = if scenario.contested { 4.0 * success * (1.0 - success) } else { 0.02 };
        // The minimum stands for a first success by luck, with which learning begins.
        let has_prerequisite =
            self.kind != LearnerKind::Chain || self.ability(task) >= scenario.difficulty - PREREQUISITE_ROWS;
        let luck = if scenario.solvable { 0.02 } else { 0.0 };
        let gain = if has_prerequisite { self.kind.learning_rate() * signal.max(luck) } else { 0.0 };
        for (known, ability) in &mut self.ability {
            let gain = if known == task { gain } else { TRANSFER * gain };
            *ability = (*ability + gain).min(MAX_ABILITY);
        }
    }

    /// Counts an episode; a forgetful learner loses ability at every ten-thousandth.
    fn count_episode(&mut self) {
        self.episodes += 1;
        if self.kind == LearnerKind::Forgetful && self.episodes.is_multiple_of(10_000) {
            self.ability.values_mut().for_each(|ability| *ability = (*ability - 4.0).max(UNTRAINED_ABILITY));
        }
    }
}
