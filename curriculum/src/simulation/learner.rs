//! Who flies synthetic scenarios: success is a logistic curve over how much better than the scenario is hard a learner is.

use std::collections::BTreeMap;

use env_core::Draws;

use super::synthetic::Synthetic;

/// How slowly success falls with rows: by the look-ahead pilots, which win all of level 0 and one to three in ten of level 9.
pub const WIDTH: f64 = 1.5;
/// Where an untrained learner begins: 12 % on contested scenarios of level 0.
const UNTRAINED: f64 = -3.0;
/// No learner gets better than this: about one half a row above the last.
const BEST: f64 = 10.0;
/// What a learner gains on other tasks of what it gains on one.
const TRANSFER: f64 = 0.2;
/// How often who has learnt something fails a scenario on which doing nothing would do.
const FIDGETS: f64 = 0.05;

/// The kinds of learner.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum LearnerKind {
    /// Gains a row of the table in four thousand episodes or more.
    Slow,
    /// Gains a row in a thousand or more.
    Fast,
    /// As fast, and forgets four rows every 10 000 episodes.
    Forgetful,
    /// As fast, and three in ten of its outcomes are a toss of a coin.
    Noisy,
    /// As fast, and scenarios differ so much that the episodes of a group mostly end alike.
    Correlated,
    /// Never acts.
    Hold,
    /// Flies a plan that looks at nothing.
    Blind,
    /// As slow, and half of its failures are reported as lost.
    Drops,
}

impl LearnerKind {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Slow,
        Self::Fast,
        Self::Forgetful,
        Self::Noisy,
        Self::Correlated,
        Self::Hold,
        Self::Blind,
        Self::Drops,
    ];

    /// Its name.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Slow => "slow",
            Self::Fast => "fast",
            Self::Forgetful => "forgetful",
            Self::Noisy => "noisy",
            Self::Correlated => "correlated",
            Self::Hold => "hold",
            Self::Blind => "blind",
            Self::Drops => "drops",
        }
    }

    /// What it is, in a few words.
    #[must_use]
    pub const fn about(self) -> &'static str {
        match self {
            Self::Slow => "gains a row of the table in four thousand episodes or more",
            Self::Fast => "gains a row in a thousand or more",
            Self::Forgetful => "as fast, and forgets four rows every 10 000 episodes",
            Self::Noisy => "as fast, and three in ten of its outcomes are a toss of a coin",
            Self::Correlated => "as fast, and the episodes of a group mostly end alike",
            Self::Hold => "never acts",
            Self::Blind => "flies a plan that looks at nothing",
            Self::Drops => "as slow, and half of its failures are reported as lost",
        }
    }

    /// Rows gained by an episode that teaches most.
    const fn rate(self) -> f64 {
        match self {
            Self::Slow | Self::Drops => 0.0008,
            Self::Fast | Self::Forgetful | Self::Noisy | Self::Correlated => 0.0025,
            Self::Hold | Self::Blind => 0.0,
        }
    }

    /// Standard deviation of how hard scenarios of the same params are, rows.
    const fn spread(self) -> f64 {
        if matches!(self, Self::Correlated) { 3.0 } else { 0.5 }
    }
}

/// How the episodes of a group went.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Flown {
    /// Episodes that are reported as finished.
    pub finished: u32,
    /// Of these, successes.
    pub successes: u32,
    /// Episodes that are reported as failed.
    pub failed: u32,
}

/// A learner at work.
#[derive(Debug, Clone)]
pub struct Learner {
    kind: LearnerKind,
    /// By task, in rows: it succeeds half the time on contested scenarios of that row.
    skill: BTreeMap<String, f64>,
    /// Set where it succeeds alike on all contested scenarios, whatever their params, and learns nothing.
    constant: Option<f64>,
    episodes: u64,
}

impl Learner {
    /// An untrained learner.
    #[must_use]
    pub fn new(kind: LearnerKind, tasks: &[String]) -> Self {
        let skill = tasks.iter().map(|task| (task.clone(), UNTRAINED)).collect();
        Self { kind, skill, constant: None, episodes: 0 }
    }

    /// One that succeeds on this share of contested scenarios for ever.
    #[must_use]
    pub fn constant(success: f64) -> Self {
        Self { kind: LearnerKind::Slow, skill: BTreeMap::new(), constant: Some(success), episodes: 0 }
    }

    /// How good it is at a task, in rows.
    #[must_use]
    pub fn skill(&self, task: &str) -> f64 {
        self.skill.get(task).copied().unwrap_or(UNTRAINED)
    }

    /// How likely an episode succeeds.
    #[must_use]
    pub fn success(&self, task: &str, scenario: &Synthetic) -> f64 {
        if !scenario.solvable {
            return 0.0;
        }
        let able = match (self.constant, scenario.contested) {
            (Some(success), true) => success,
            (Some(_), false) => 1.0,
            (None, contested) => match (self.kind, contested) {
                (LearnerKind::Hold, contested) => f64::from(u8::from(!contested)),
                (LearnerKind::Blind, _) => scenario.panel,
                (_, true) => {
                    let hard = scenario.params + self.kind.spread() * scenario.luck;
                    1.0 / (1.0 + libm::exp(-(self.skill(task) - hard) / WIDTH))
                }
                (_, false) => 1.0 - FIDGETS,
            },
        };
        if self.kind == LearnerKind::Noisy { 0.7 * able + 0.15 } else { able }
    }

    /// Flies a group, and learns from it where it may.
    pub fn fly(
        &mut self,
        task: &str,
        scenario: &Synthetic,
        (episodes, train): (u32, bool),
        draws: &mut Draws,
    ) -> Flown {
        let success = self.success(task, scenario);
        let mut flown = Flown { finished: 0, successes: 0, failed: 0 };
        for _ in 0..episodes {
            let succeeded = draws.chance(success);
            let dropped = self.kind == LearnerKind::Drops && !succeeded && draws.chance(0.5);
            flown.failed += u32::from(dropped);
            flown.finished += u32::from(!dropped);
            flown.successes += u32::from(succeeded);
            if train {
                self.learn(task, scenario, success);
            }
            self.forget();
        }
        flown
    }

    /// Most is learnt where success is one half, and hardly anything where nothing need be done.
    fn learn(&mut self, task: &str, scenario: &Synthetic, success: f64) {
        let teaches = if scenario.contested { 4.0 * success * (1.0 - success) } else { 0.02 };
        // A first success by luck is where learning begins.
        let gain = self.kind.rate() * teaches.max(if scenario.solvable { 0.02 } else { 0.0 });
        for (known, skill) in &mut self.skill {
            let gain = if known == task { gain } else { TRANSFER * gain };
            *skill = (*skill + gain).min(BEST);
        }
    }

    fn forget(&mut self) {
        self.episodes += 1;
        if self.kind == LearnerKind::Forgetful && self.episodes.is_multiple_of(10_000) {
            self.skill.values_mut().for_each(|skill| *skill = (*skill - 4.0).max(UNTRAINED));
        }
    }
}
