//! [`Refusal`]: the reason why the gate refuses a layout, and the checks of the gate.
//!
//! Messages of refusals are part of the prompts that repair a layout: changing one changes the prompt.

use env_core::ScenarioError;
use env_core::bracket::MIN_GAP;

use crate::FieldError;

/// Minimum distance of a design from every design in the archive. In kessler, differences of 15° in bearing, 4 steps and 1 LU/TU
/// in all encounters are a distance of 0.06.
pub const MIN_NOVELTY: f64 = 0.05;

/// Words of one world in the refusals of its layouts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RefusalWords {
    /// Agents of the world, in the plural.
    pub agents: &'static str,
    /// Problem of a layout that threatens no agent, and how to fix it.
    pub harmless: &'static str,
    /// How to fix a layout in which the planner fails.
    pub solvable_fix: &'static str,
    /// How to fix a layout in which acting well does not matter.
    pub contested_fix: &'static str,
    /// How to fix a design that is too similar to another one.
    pub new_fix: &'static str,
}

/// Check of the gate. The order is the order in which the gate applies them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum GateCheck {
    /// Fields and numbers are within bounds.
    Schema,
    /// Bodies can be placed as the design requires.
    Compiles,
    /// The design matches its aim.
    Aim,
    /// No agent is lost before it can act or see a threat.
    Fair,
    /// The reference planner succeeds.
    Solvable,
    /// Holding and most blind plans fail in a threat.
    Contested,
    /// A decoy is safe to ignore and tempts a naive agent.
    Decoy,
    /// The layout differs from all known ones.
    New,
}

impl GateCheck {
    /// All checks, in order.
    pub const ALL: [Self; 8] = [
        Self::Schema,
        Self::Compiles,
        Self::Aim,
        Self::Fair,
        Self::Solvable,
        Self::Contested,
        Self::Decoy,
        Self::New,
    ];

    /// Returns the name of the check in the API, the store and prompts.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Schema => "schema",
            Self::Compiles => "compiles",
            Self::Aim => "aim",
            Self::Fair => "fair",
            Self::Solvable => "solvable",
            Self::Contested => "contested",
            Self::Decoy => "decoy",
            Self::New => "new",
        }
    }

    /// Returns the check with a name; `None` if there is none.
    #[must_use]
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|check| check.as_str() == name)
    }

    /// Returns the defect of a layout that fails the check, for counts in text, such as "3 duplicates".
    #[must_use]
    pub const fn defect(self) -> &'static str {
        match self {
            Self::Schema => "invalid",
            Self::Compiles => "not placeable",
            Self::Aim => "off target",
            Self::Fair => "unfair",
            Self::Solvable => "unsolvable",
            Self::Contested => "not contested",
            Self::Decoy => "ineffective decoy",
            Self::New => "duplicate",
        }
    }

    /// Returns the condition that a layout must satisfy, as listed in the documentation.
    #[must_use]
    pub const fn description(self) -> &'static str {
        match self {
            Self::Schema => "its fields and numbers are within bounds",
            Self::Compiles => "bodies can be placed as the design says",
            Self::Aim => "the design matches its aim",
            Self::Fair => "no agent is lost before it can act",
            Self::Solvable => "the reference planner succeeds",
            Self::Contested => "a threat: holding fails, and so do most blind plans",
            Self::Decoy => "a decoy: holding succeeds, and a naive agent wastes fuel",
            Self::New => "it differs from all known layouts",
        }
    }
}

/// Reason why the gate refuses a layout.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// A field is missing, unknown or out of bounds.
    #[error("{0}")]
    Schema(FieldError),
    /// A body cannot be placed.
    #[error("{0}")]
    Compiles(FieldError),
    /// The design does not match its aim.
    #[error("{0}")]
    Aim(FieldError),
    /// An agent is lost before it can act.
    #[error("{0}")]
    Unfair(ScenarioError),
    /// An agent sees a threat too late to act, see [`crate::DesignLanguage::check_reaction`].
    #[error("{0}")]
    TooLate(FieldError),
    /// The reference planner does not succeed.
    #[error(
        "the planner cannot succeed: its best score is {reference:.3}, with {lost} {} lost; {}", .words.agents, .words.solvable_fix
    )]
    Unsolvable {
        /// Best score of the planner.
        reference: f64,
        /// Number of agents that the planner loses.
        lost: u32,
        /// Words of the world.
        words: &'static RefusalWords,
    },
    /// A layout of threats threatens no agent, see [`crate::DesignLanguage::is_harmless`].
    #[error("{}", .words.harmless)]
    Harmless {
        /// Words of the world.
        words: &'static RefusalWords,
    },
    /// Too many blind plans succeed, or the reference is too close to the floor.
    #[error(
        "acting well must matter: {blind} of {panel} blind plans succeed (at most {most} may), and the reference is \
         {gap:.3} above the floor (at least {MIN_GAP} is required); {}", .words.contested_fix
    )]
    Uncontested {
        /// Number of blind plans that succeed.
        blind: usize,
        /// Maximum number of blind plans that may succeed.
        most: usize,
        /// Number of blind plans in the panel.
        panel: usize,
        /// Score of the reference minus the floor.
        gap: f64,
        /// Words of the world.
        words: &'static RefusalWords,
    },
    /// A decoy is not safe to ignore, or tempts no agent.
    #[error("{0}")]
    Decoy(FieldError),
    /// A similar design is in the archive.
    #[error(
        "the design is too similar to {like:?}: its distance is {distance:.3}, at least {MIN_NOVELTY} is required; {}",
        .words.new_fix
    )]
    Known {
        /// Name of the nearest design.
        like: String,
        /// Distance of the nearest design, see [`crate::DesignLanguage::distance`].
        distance: f64,
        /// Words of the world.
        words: &'static RefusalWords,
    },
    /// The same scenario was admitted before.
    #[error("the scenario was admitted before; change a body or the seed")]
    Duplicate,
    /// The gate of another process refused the layout.
    #[error("{message}")]
    Reported {
        /// Check of the gate that failed.
        check: GateCheck,
        /// Message of the refusal.
        message: String,
    },
}

impl Refusal {
    /// Returns the check that failed.
    #[must_use]
    pub const fn check(&self) -> GateCheck {
        match self {
            Self::Schema(_) => GateCheck::Schema,
            Self::Compiles(_) => GateCheck::Compiles,
            Self::Aim(_) => GateCheck::Aim,
            Self::Unfair(_) | Self::TooLate(_) => GateCheck::Fair,
            Self::Unsolvable { .. } => GateCheck::Solvable,
            Self::Harmless { .. } | Self::Uncontested { .. } => GateCheck::Contested,
            Self::Decoy(_) => GateCheck::Decoy,
            Self::Known { .. } | Self::Duplicate => GateCheck::New,
            Self::Reported { check, .. } => *check,
        }
    }
}
