//! The strategies that a run can choose from.

use serde::{Deserialize, Serialize};

use super::hyperparameters::spec::Hyperparameter;
use super::hyperparameters::{adr, alp_gmm, bandit, controller, learnability, replay, staircase};

/// Strategy that makes the proposals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StrategyKind {
    /// Takes for each task the sampler that a table names.
    Auto,
    /// Climbs the rungs of each task by many chains, up after a success and down after a failure (Levitt 1971).
    Staircase,
    /// Moves one position on the rungs towards a success rate of one half (Shi et al. 2025).
    Controller,
    /// Draws rungs by p(1 − p) of their success rate.
    Bandit,
    /// Moves up and down each task's level table on evidence. The default.
    Ladder,
    /// Draws levels uniformly: domain randomisation (Tobin et al. 2017).
    Uniform,
    /// Takes the tasks in turn, at their default params.
    Fixed,
    /// Draws each param up to a bound that adapts to success (Akkaya et al. 2019).
    Adr,
    /// Repeats scenarios that succeed sometimes (Rutherford et al. 2024).
    Learnability,
    /// Repeats scenarios on which the agent falls short (Jiang et al. 2021).
    Plr,
    /// As `Plr`, but trains only on repeated scenarios (Jiang et al. 2021b).
    PlrRobust,
    /// As `PlrRobust`, and edits the repeated scenarios (Parker-Holder et al. 2022).
    Accel,
    /// Samples params where success has been changing (Portelas et al. 2019).
    AlpGmm,
}

impl StrategyKind {
    /// All strategies, samplers first.
    pub const ALL: [Self; 13] = [
        Self::Auto,
        Self::Staircase,
        Self::Controller,
        Self::Bandit,
        Self::Ladder,
        Self::Uniform,
        Self::Fixed,
        Self::Adr,
        Self::Learnability,
        Self::Plr,
        Self::PlrRobust,
        Self::Accel,
        Self::AlpGmm,
    ];

    /// Name of the strategy in JSON and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Staircase => "staircase",
            Self::Controller => "controller",
            Self::Bandit => "bandit",
            Self::Ladder => "ladder",
            Self::Uniform => "uniform",
            Self::Fixed => "fixed",
            Self::Adr => "adr",
            Self::Learnability => "learnability",
            Self::Plr => "plr",
            Self::PlrRobust => "plr_robust",
            Self::Accel => "accel",
            Self::AlpGmm => "alp_gmm",
        }
    }

    /// Description of the strategy in a few words.
    #[must_use]
    pub const fn description(self) -> &'static str {
        match self {
            Self::Auto => "takes for each task the sampler that a table names",
            Self::Staircase => "climbs rungs by many chains, up after a success and down after a failure",
            Self::Controller => "follows a success rate of one half with one position on the rungs",
            Self::Bandit => "draws rungs by p(1 − p) of their success rate",
            Self::Ladder => "moves up and down each task's level table on evidence",
            Self::Uniform => "draws levels uniformly: domain randomisation",
            Self::Fixed => "takes the tasks in turn, at their default params",
            Self::Adr => "draws each param up to a bound that adapts to success",
            Self::Learnability => "repeats scenarios that succeed sometimes, beside fresh ones",
            Self::Plr => "repeats scenarios on which the agent falls short",
            Self::PlrRobust => "like plr, but trains only on repeated scenarios",
            Self::Accel => "like plr_robust, and edits the repeated scenarios",
            Self::AlpGmm => "samples params where success has been changing",
        }
    }

    /// Hyperparameters of the strategy.
    #[must_use]
    pub const fn hyperparameters(self) -> &'static [Hyperparameter] {
        match self {
            Self::Auto | Self::Ladder | Self::Uniform | Self::Fixed => &[],
            Self::Staircase => staircase::ALL,
            Self::Controller => controller::ALL,
            Self::Bandit => bandit::ALL,
            Self::Adr => adr::ALL,
            Self::Learnability => learnability::ALL,
            Self::Plr | Self::PlrRobust => replay::PLR,
            Self::Accel => replay::ACCEL,
            Self::AlpGmm => alp_gmm::ALL,
        }
    }

    /// True if the agent learns only from repeated scenarios.
    #[must_use]
    pub const fn trains_on_replays_only(self) -> bool {
        matches!(self, Self::PlrRobust | Self::Accel)
    }

    /// True if the strategy samples rungs, and so reacts to every group.
    #[must_use]
    pub const fn samples_rungs(self) -> bool {
        matches!(self, Self::Auto | Self::Staircase | Self::Controller | Self::Bandit)
    }

    /// True if leases of columns suit the strategy. They report the outcomes of few groups, and many groups share a proposal.
    #[must_use]
    pub const fn supports_columns(self) -> bool {
        !(self.replays_scenarios() || self.samples_rungs())
    }

    /// True if the strategy repeats single scenarios, which must therefore be handed out one by one.
    #[must_use]
    pub const fn replays_scenarios(self) -> bool {
        matches!(self, Self::Learnability | Self::Plr | Self::PlrRobust | Self::Accel)
    }
}

impl std::fmt::Display for StrategyKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}
