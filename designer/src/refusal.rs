//! [`Refusal`]: the reason why the gate refuses a layout, and the checks of the gate.
//!
//! Messages of refusals are part of the prompts that repair a layout: changing one changes the prompt.

use env_core::ScenarioError;
use env_core::bracket::MIN_GAP;

use crate::FieldError;

/// Minimum distance of a design from every design in the archive. Differences of 15° in bearing, 4 steps and 1 LU/TU in all
/// encounters are a distance of 0.05.
pub const MIN_NOVELTY: f64 = 0.05;

/// Check of the gate. The order is the order in which the gate applies them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum GateCheck {
    /// Fields and numbers are within bounds.
    Schema,
    /// Bodies can be placed as the encounters require.
    Compiles,
    /// Encounters match the aim.
    Aim,
    /// No contact happens before an agent can act or see it.
    Fair,
    /// The reference planner succeeds.
    Solvable,
    /// A threat is lost by holding and by most blind plans.
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
            Self::Compiles => "bodies can be placed where its encounters say",
            Self::Aim => "its encounters match its aim",
            Self::Fair => "no contact happens before an agent can act",
            Self::Solvable => "the reference planner succeeds within the fuel limit",
            Self::Contested => "a threat: holding loses a satellite, and most blind plans fail",
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
    /// No body can be placed for an encounter.
    #[error("{0}")]
    Compiles(FieldError),
    /// The encounters do not match the aim.
    #[error("{0}")]
    Aim(FieldError),
    /// A satellite is lost before an agent can act.
    #[error("{0}")]
    Unfair(ScenarioError),
    /// A satellite is hit by debris that agents see too late to avoid.
    #[error("{0}")]
    Unseen(FieldError),
    /// The reference planner does not succeed.
    #[error(
        "the planner cannot succeed: its best score is {reference:.3}, with {lost} satellites lost; choose fewer or later \
         threats, or more fuel"
    )]
    Unsolvable {
        /// Best score of the planner.
        reference: f64,
        /// Number of agents that the planner loses.
        lost: u32,
    },
    /// A layout of threats loses no satellite if all hold.
    #[error("no satellite is lost if no satellite burns; add a threat that hits")]
    Harmless,
    /// Too many blind plans succeed, or the reference is too close to the floor.
    #[error(
        "acting well must matter: {blind} of {panel} blind plans succeed (at most {most} may), and the reference is \
         {gap:.3} above the floor (at least {MIN_GAP} is required); choose more threats, to more satellites"
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
    },
    /// A decoy is not safe to ignore, or tempts no agent.
    #[error("{0}")]
    Decoy(FieldError),
    /// A similar design is in the archive.
    #[error(
        "the design is too similar to {like:?}: its distance is {distance:.3}, at least {MIN_NOVELTY} is required; change \
         bearings, steps or satellites"
    )]
    Known {
        /// Name of the nearest design.
        like: String,
        /// Distance of the nearest design, see [`crate::DesignLanguage::distance`].
        distance: f64,
    },
    /// The same scenario was admitted before.
    #[error("the scenario was admitted before; change a body or the seed")]
    Duplicate,
}

impl Refusal {
    /// Returns the check that failed.
    #[must_use]
    pub const fn check(&self) -> GateCheck {
        match self {
            Self::Schema(_) => GateCheck::Schema,
            Self::Compiles(_) => GateCheck::Compiles,
            Self::Aim(_) => GateCheck::Aim,
            Self::Unfair(_) | Self::Unseen(_) => GateCheck::Fair,
            Self::Unsolvable { .. } => GateCheck::Solvable,
            Self::Harmless | Self::Uncontested { .. } => GateCheck::Contested,
            Self::Decoy(_) => GateCheck::Decoy,
            Self::Known { .. } | Self::Duplicate => GateCheck::New,
        }
    }
}
