//! Setup of an episode: a recipe parsed into kessler's types. `layout` parses the bodies that a layout gives,
//! `initial_state` draws the rest.

mod fair_start;
mod initial_state;
mod layout;

pub(super) use self::initial_state::StateBuffers;
pub use self::initial_state::{InitialState, RogueArrival};
use super::constants::{RADAR_NONE, SATELLITES};
use super::kernel::{Body, Gravity};
use super::reward::Objective;
use crate::error::ScenarioError;
use crate::space::START_SCALE;
use crate::task::Recipe;

/// Contact model of an episode: the effect of debris on satellites.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ContactModel {
    /// Debris within the contact distance at the end of a step destroys a satellite.
    EndOfStep,
    /// Debris within the contact distance at any time of a step destroys a satellite.
    Swept,
    /// Debris destroys nothing. Every closest approach multiplies survival by 1 − Pc, for this standard
    /// deviation of the relative position, LU.
    Probability(f64),
}

/// Physics options of an episode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Physics {
    /// True if the arithmetic of the public kessler-env applies.
    pub upstream_compat: bool,
    /// Gravity model of all bodies.
    pub gravity: Gravity,
    /// Contact model of satellites and debris.
    pub contact: ContactModel,
}

impl Physics {
    /// Physics with every option at its default. Policies that see only telemetry assume it.
    pub const DEFAULT: Self =
        Self { upstream_compat: false, gravity: Gravity::Point, contact: ContactModel::EndOfStep };
}

/// Conjunction warnings in the observation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WarningMode {
    /// The observation has no warnings.
    None,
    /// Warnings are forecast by the true dynamics.
    Exact,
    /// Warnings have errors that grow with the time to closest approach.
    Noisy,
}

/// Parameters, options and layout of a recipe, parsed.
#[derive(Debug, Clone, PartialEq)]
pub struct KesslerSetup {
    /// True if satellites start in a triangle.
    starts_in_formation: bool,
    /// Number of debris bodies that the generator draws.
    pub debris: usize,
    /// Initial fuel of each satellite, in fuel units.
    pub fuel: f64,
    /// Velocity spread of debris, LU/TU.
    pub spread: f64,
    /// Probability that a rogue arrives in a step.
    pub rogue_probability: f64,
    /// Speed of a rogue over circular speed.
    pub rogue_speed: f64,
    /// Radar range, LU; `None` hides nothing.
    pub radar_range: Option<f64>,
    /// True if bodies that would touch a satellite in the first steps are drawn again.
    pub fair: bool,
    /// Physics options of the episode.
    pub physics: Physics,
    /// Conjunction warnings in the observation.
    pub warnings: WarningMode,
    /// Standard deviation of relative positions, LU.
    pub sigma: f64,
    /// Factor of the distance between satellite 0 and the target radius at the start, at most 1.
    pub start_scale: f64,
    /// Satellites of the layout, if it gives them.
    layout_satellites: Option<[Body; SATELLITES]>,
    /// Debris of the layout.
    layout_debris: Vec<Body>,
    /// Rogues of the layout, ordered by step.
    layout_rogues: Vec<RogueArrival>,
    /// True if the layout's rogues replace random ones.
    replaces_rogues: bool,
}

impl KesslerSetup {
    /// Parses a recipe.
    ///
    /// # Errors
    /// Returns [`ScenarioError`] if options exclude each other, or if the layout is invalid or contradicts
    /// the params.
    pub fn from_recipe(recipe: &Recipe) -> Result<Self, ScenarioError> {
        let param = |name: &str| recipe.param(name).unwrap_or(0.0);
        let radar = param("radar_range");
        let mut setup = Self {
            starts_in_formation: Objective::of_task(recipe.task().id()) == Some(Objective::Formation),
            debris: param("debris") as usize,
            fuel: param("fuel"),
            spread: param("spread"),
            rogue_probability: param("rogue_probability"),
            rogue_speed: param("rogue_speed"),
            radar_range: (radar < RADAR_NONE).then_some(radar),
            fair: recipe.option("start") == Some("fair"),
            physics: parse_physics(recipe)?,
            warnings: match recipe.option("warnings") {
                Some("exact") => WarningMode::Exact,
                Some("noisy") => WarningMode::Noisy,
                _ => WarningMode::None,
            },
            sigma: param("sigma"),
            start_scale: recipe.param(START_SCALE.name).unwrap_or(START_SCALE.default),
            layout_satellites: None,
            layout_debris: Vec::new(),
            layout_rogues: Vec::new(),
            replaces_rogues: false,
        };
        if let Some(layout) = recipe.layout() {
            setup.read_layout(layout)?;
        }
        Ok(setup)
    }
}

/// Parses the physics options and rejects combinations that contradict each other.
fn parse_physics(recipe: &Recipe) -> Result<Physics, ScenarioError> {
    let is = |option: &str, choice: &str| recipe.option(option) == Some(choice);
    let physics = Physics {
        upstream_compat: is("compat", "upstream"),
        gravity: if is("gravity", "j2") { Gravity::J2 } else { Gravity::Point },
        contact: match (is("contact", "swept"), is("risk", "pc")) {
            (_, true) => ContactModel::Probability(recipe.param("sigma").unwrap_or(0.0)),
            (true, false) => ContactModel::Swept,
            (false, false) => ContactModel::EndOfStep,
        },
    };
    let conflict = |option: &str, with: &str, why: &str| {
        Err(ScenarioError::layout(
            format!("physics.{option}"),
            format!("cannot be combined with {with}: {why}"),
        ))
    };
    if is("contact", "swept") && is("risk", "pc") {
        return conflict(
            "contact",
            "risk: pc",
            "its contacts are not destructive, so contact: swept has no effect",
        );
    }
    if physics.upstream_compat {
        let why = "that choice reproduces the public kessler-env bit by bit";
        if physics.gravity == Gravity::J2 {
            return conflict("gravity", "compat: upstream", why);
        }
        if is("contact", "swept") {
            return conflict("contact", "compat: upstream", why);
        }
        if is("risk", "pc") {
            return conflict("risk", "compat: upstream", why);
        }
    }
    Ok(physics)
}
