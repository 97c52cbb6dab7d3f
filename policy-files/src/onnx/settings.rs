//! Settings of a model, as its metadata declare them.

use env_core::TaskSpec;
use env_core::batch::ObservationMode;
use env_core::space::{ActionGrid, Axes};
use tract_onnx::prelude::*;

/// Default number of threats of *tracks*, as in the Python package.
const DEFAULT_THREATS: u32 = 8;
/// Default number of steps over which *tracks* predicts threats, as in the Python package.
const DEFAULT_LOOK_AHEAD: u32 = 15;

/// Observations that a model declares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum DeclaredObservation {
    Tracks,
    State,
    ExtendedState,
    Telemetry,
}

/// Actions that a model declares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DeclaredActions {
    /// Numbers within the bounds.
    Continuous,
    /// Indices of the task's grid.
    Discrete,
    /// Indices of the task's few actions.
    Few,
}

/// Settings of a model. An undeclared setting has the default of the task.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct ModelSettings {
    /// World and its version, such as `kessler@1`.
    world: Option<String>,
    observation: Option<DeclaredObservation>,
    axes: Option<Axes>,
    /// Actions that the model declares.
    pub(super) actions: Option<DeclaredActions>,
    threats: Option<u32>,
    look_ahead: Option<u32>,
    bodies: Option<u32>,
}

impl ModelSettings {
    /// Reads the metadata with the prefix `sparring.`.
    ///
    /// # Errors
    /// Returns a reason that names the property if a value is unknown.
    pub(super) fn read(model: &InferenceModel) -> Result<Self, String> {
        let text = |key: &str| {
            let value = model.properties.get(&format!("onnx.metadata_props.sparring.{key}"))?;
            value.to_plain_array_view::<String>().ok()?.iter().next().cloned()
        };
        let number = |key: &str| {
            let parse = |text: String| {
                text.parse::<u32>()
                    .map_err(|_| format!("the property sparring.{key} must be an integer >= 0, got {text:?}"))
            };
            text(key).map(parse).transpose()
        };
        if let Some(format) = text("format").filter(|format| format != "1") {
            return Err(format!(
                "the property sparring.format is {format:?}, and this program reads format 1; export the model with a \
                 package of this version"
            ));
        }
        Ok(Self {
            world: text("world"),
            observation: choose(
                text("observation"),
                "observation",
                &[
                    ("tracks", DeclaredObservation::Tracks),
                    ("state", DeclaredObservation::State),
                    ("extended_state", DeclaredObservation::ExtendedState),
                    ("telemetry", DeclaredObservation::Telemetry),
                ],
            )?,
            axes: choose(text("axes"), "axes", &[("agent", Axes::Agent), ("world", Axes::World)])?,
            actions: choose(
                text("actions"),
                "actions",
                &[
                    ("continuous", DeclaredActions::Continuous),
                    ("discrete", DeclaredActions::Discrete),
                    ("few", DeclaredActions::Few),
                ],
            )?,
            threats: number("threats")?,
            look_ahead: number("look_ahead")?,
            bodies: number("bodies")?,
        })
    }

    /// Checks that the model is one for the task's world.
    ///
    /// # Errors
    /// Returns a reason if it declares another world or version.
    pub(super) fn check_task(&self, task: &dyn TaskSpec) -> Result<(), String> {
        match &self.world {
            Some(world) if world != task.world() => {
                Err(format!("the model declares the world {world}, and the task is of {}", task.world()))
            }
            _ => Ok(()),
        }
    }

    /// Observations of the environment. By default they are *tracks* in a world where agents have axes of their own.
    pub(super) fn observation(&self, task: &dyn TaskSpec) -> ObservationMode {
        let default = match task.agent_axes() {
            Some(_) => DeclaredObservation::Tracks,
            None => DeclaredObservation::State,
        };
        match self.observation.unwrap_or(default) {
            DeclaredObservation::Tracks => ObservationMode::Tracks {
                threats: self.threats.unwrap_or(DEFAULT_THREATS),
                look_ahead: self.look_ahead.unwrap_or(DEFAULT_LOOK_AHEAD),
            },
            DeclaredObservation::ExtendedState => ObservationMode::Extended,
            DeclaredObservation::State | DeclaredObservation::Telemetry => {
                ObservationMode::All { bodies: self.bodies }
            }
        }
    }

    /// Actions that a discrete action chooses from.
    pub(super) fn grid(&self, task: &dyn TaskSpec) -> ActionGrid {
        if self.actions == Some(DeclaredActions::Few) { task.few_actions() } else { task.action_grid() }
    }

    /// Axes of the environment's actions. A discrete action is along the axes of the task's grid.
    pub(super) fn axes(&self, task: &dyn TaskSpec, discrete: bool) -> Axes {
        if discrete {
            return self.grid(task).axes;
        }
        let default = match self.observation(task) {
            ObservationMode::Tracks { .. } => Axes::Agent,
            ObservationMode::All { .. } | ObservationMode::Extended => Axes::World,
        };
        self.axes.unwrap_or(default)
    }
}

/// Finds the value of a property among its choices.
fn choose<T: Copy>(text: Option<String>, key: &str, choices: &[(&str, T)]) -> Result<Option<T>, String> {
    let Some(text) = text else { return Ok(None) };
    let found = choices.iter().find(|(name, _)| *name == text);
    found.map(|(_, value)| Some(*value)).ok_or_else(|| {
        let names: Vec<&str> = choices.iter().map(|(name, _)| *name).collect();
        format!("the property sparring.{key} must be one of {}, got {text:?}", names.join(", "))
    })
}
