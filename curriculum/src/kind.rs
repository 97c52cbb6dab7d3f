//! The strategies there are.

use serde::{Deserialize, Serialize};

use super::tuning::Hyper;
use super::{adr, alp_gmm, learnability, replay};

/// How proposals are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StrategyKind {
    /// Climbs each task's table of levels on evidence. The default.
    Ladder,
    /// Levels drawn uniformly: domain randomisation (Tobin et al. 2017).
    Uniform,
    /// The tasks in turn, at their default params.
    Fixed,
    /// Each param drawn up to a bound that moves by itself (Akkaya et al. 2019).
    Adr,
    /// Scenarios that succeed now and then (Rutherford et al. 2024).
    Learnability,
    /// Scenarios that the agent falls short on, again (Jiang et al. 2021).
    Plr,
    /// The same, learning from those alone (Jiang et al. 2021b).
    PlrRobust,
    /// The same, and edits of them (Parker-Holder et al. 2022).
    Accel,
    /// Params drawn where success changes (Portelas et al. 2019).
    AlpGmm,
}

impl StrategyKind {
    /// All of them.
    pub const ALL: [Self; 9] = [
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

    /// Its name on the wire.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
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

    /// What it does, in a few words.
    #[must_use]
    pub const fn about(self) -> &'static str {
        match self {
            Self::Ladder => "climbs each task's table of levels on evidence",
            Self::Uniform => "any level at any time: domain randomisation",
            Self::Fixed => "the tasks in turn at their default params",
            Self::Adr => "each param drawn up to a bound that moves by itself",
            Self::Learnability => "half from scenarios that succeed now and then, half new",
            Self::Plr => "scenarios that the agent falls short on, again",
            Self::PlrRobust => "the same, and learnt from those alone",
            Self::Accel => "the same, and edits of them",
            Self::AlpGmm => "params drawn where success has been changing",
        }
    }

    /// The settings of its own.
    #[must_use]
    pub const fn hypers(self) -> &'static [Hyper] {
        match self {
            Self::Ladder | Self::Uniform | Self::Fixed => &[],
            Self::Adr => adr::HYPERS,
            Self::Learnability => learnability::HYPERS,
            Self::Plr | Self::PlrRobust => replay::PLR,
            Self::Accel => replay::ACCEL,
            Self::AlpGmm => alp_gmm::HYPERS,
        }
    }

    /// Whether only what is faced again is learnt from.
    #[must_use]
    pub const fn learns_from_replays(self) -> bool {
        matches!(self, Self::PlrRobust | Self::Accel)
    }

    /// Whether it faces single scenarios again, so that they must be handed out one by one.
    #[must_use]
    pub const fn returns(self) -> bool {
        matches!(self, Self::Learnability | Self::Plr | Self::PlrRobust | Self::Accel)
    }
}

impl std::fmt::Display for StrategyKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.word())
    }
}
