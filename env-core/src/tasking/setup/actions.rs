//! Actions of a satellite: `action_spec` of BSK-RL.

use crate::tasking::error::TaskingError;

/// Duration of an action without one, s: another event ends its step.
pub const UNLIMITED_S: f64 = 1e9;

/// A function of the flight software that an action calls.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SoftwareAction {
    /// Scans the ground below.
    Scan,
    /// Points the panel at the Sun.
    Charge,
    /// Sends data to ground stations.
    Downlink,
    /// Desaturates the wheels with thrusters.
    Desaturate,
    /// Aligns with the Hill frame.
    NadirPoint,
    /// Stops controlling the wheels.
    Drift,
}

impl SoftwareAction {
    /// Name of the function in BSK-RL.
    #[must_use]
    pub const fn function(self) -> &'static str {
        match self {
            Self::Scan => "action_nadir_scan",
            Self::Charge => "action_charge",
            Self::Downlink => "action_downlink",
            Self::Desaturate => "action_desat",
            Self::NadirPoint => "action_nadir_point",
            Self::Drift => "action_drift",
        }
    }

    /// The action of a function's name.
    ///
    /// # Errors
    /// Returns [`TaskingError::NotSupported`] if the function is not one of the supported ones.
    pub fn from_function(name: &str) -> Result<Self, TaskingError> {
        [Self::Scan, Self::Charge, Self::Downlink, Self::Desaturate, Self::NadirPoint, Self::Drift]
            .into_iter()
            .find(|action| action.function() == name)
            .ok_or_else(|| TaskingError::NotSupported(format!("the flight software action `{name}`")))
    }
}

/// An action or a series of actions.
#[derive(Debug, Clone, PartialEq)]
pub enum ActionSpec {
    /// Calls a function of the flight software for a time.
    Software {
        /// Name of the action.
        name: String,
        /// Function of the flight software.
        action: SoftwareAction,
        /// Time after which the action ends, s.
        duration_s: f64,
        /// True if the function is called again when the action follows itself.
        reset_task: bool,
    },
    /// Images one of the next targets: as many actions as targets.
    Image {
        /// Name of the actions, to which their index is appended.
        name: String,
        /// Number of upcoming targets.
        targets: usize,
        /// Longest time for an image, s.
        max_duration_s: f64,
    },
    /// Sends known data to other satellites at the end of the step; the flight software goes on.
    Broadcast {
        /// Name of the action.
        name: String,
        /// Time after which the action ends, s.
        duration_s: f64,
    },
}

impl ActionSpec {
    /// An action of the flight software under BSK-RL's default name.
    #[must_use]
    pub fn software(action: SoftwareAction, duration_s: f64) -> Self {
        Self::Software {
            name: action.function().to_owned(),
            action,
            duration_s,
            reset_task: action == SoftwareAction::Desaturate,
        }
    }

    /// Actions that image the next `targets` targets.
    #[must_use]
    pub fn image(targets: usize) -> Self {
        Self::Image { name: "action_image".to_owned(), targets, max_duration_s: UNLIMITED_S }
    }

    /// Number of actions of the item.
    #[must_use]
    pub const fn count(&self) -> usize {
        match self {
            Self::Image { targets, .. } => *targets,
            _ => 1,
        }
    }

    /// Names of the actions (`action_description` of BSK-RL).
    #[must_use]
    pub fn names(&self) -> Vec<String> {
        match self {
            Self::Image { name, targets, .. } if *targets != 1 => {
                (0..*targets).map(|i| format!("{name}_{i}")).collect()
            }
            Self::Software { name, .. } | Self::Image { name, .. } | Self::Broadcast { name, .. } => {
                vec![name.clone()]
            }
        }
    }
}
