//! A recipe as the settings of an episode.

use std::sync::Arc;

use super::layout::TaskingLayout;
use crate::episode_rng::SeededRng;
use crate::error::ScenarioError;
use crate::space::START_SCALE;
use crate::task::Recipe;
use crate::tasking::environments::{ConstellationParams, ImagingParams, ScanningParams, TaskingEnvironment};
use crate::tasking::orbit::GravityModel;
use crate::tasking::setup::Setup;
use crate::tasking::setup::environment::{Links, SatelliteClass};

/// Largest number of satellites of a task.
pub(super) const MAX_SATELLITES: usize = 8;
/// Metres of a kilometre.
const M_PER_KM: f64 = 1000.0;
/// Shortest time limit of an episode with a scaled start, s.
const MIN_SCALED_TIME_S: f64 = 600.0;

/// Settings of an episode, read from a recipe.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TaskSetup {
    environment: TaskingEnvironment,
    gravity: GravityModel,
    full_thrust: bool,
    /// Largest distance of a link, m.
    link_range_m: Option<f64>,
    /// True if satellites that are busy accept actions.
    pub(super) retasks_busy: bool,
    /// Parts of the start that are given instead of drawn.
    layout: Option<Arc<TaskingLayout>>,
}

impl TaskSetup {
    /// Reads a recipe of one of the tasks.
    ///
    /// # Errors
    /// Returns an error if params contradict each other, or the layout is invalid.
    pub(super) fn read(recipe: &Recipe) -> Result<Self, ScenarioError> {
        let params = Params(recipe);
        let (low, high) = (params.get("charge_min"), params.get("charge_max"));
        if low > high {
            return Err(ScenarioError::OutOfRange {
                field: "params.charge_min".to_owned(),
                value: low,
                min: 0.01,
                max: high,
            });
        }
        let option = |name: &str| recipe.option(name);
        Ok(Self {
            environment: params.environment(),
            gravity: option("gravity").and_then(GravityModel::from_name).unwrap_or_default(),
            full_thrust: option("thrusters") == Some("full"),
            link_range_m: recipe.param("link_km").map(|km| km * M_PER_KM),
            retasks_busy: option("retasking") == Some("any"),
            layout: TaskingLayout::of_recipe(recipe)?.map(Arc::new),
        })
    }

    /// Replaces the layout of the recipe.
    pub(super) fn with_layout(self, layout: TaskingLayout) -> Self {
        Self { layout: Some(Arc::new(layout)), ..self }
    }

    /// Number of targets of the layout.
    pub(super) fn placed_targets(&self) -> usize {
        self.layout.as_ref().and_then(|layout| layout.targets.as_ref()).map_or(0, Vec::len)
    }

    /// Number of satellites of an episode.
    pub(super) const fn satellites(&self) -> usize {
        match self.environment {
            TaskingEnvironment::Constellation(params) => params.satellites as usize,
            _ => 1,
        }
    }

    /// Draws a scenario, and replaces the parts that the layout gives. Opportunities are computed to the time limit at the start and never again: in BSK-RL observations compute
    /// more of them, which changes when windows close.
    pub(super) fn draw(&self, rng: &mut SeededRng) -> Setup {
        let mut setup = self.environment.setup(rng);
        if let Some(layout) = &self.layout {
            layout.apply(&mut setup);
        }
        for agent in &mut setup.agents {
            if let SatelliteClass::Access(times) | SatelliteClass::Imaging(times) = &mut agent.class {
                times.max_beyond_s = 0.0;
            }
        }
        setup.gravity = self.gravity;
        setup.full_thrust = self.full_thrust;
        if let Some(range) = self.link_range_m {
            setup.agents.iter_mut().for_each(|agent| agent.satellite.args.link_max_range_m = range);
        }
        setup
    }
}

/// Params of a recipe by name.
struct Params<'a>(&'a Recipe);

impl Params<'_> {
    fn get(&self, name: &str) -> f64 {
        self.0.param(name).unwrap_or_default()
    }

    fn whole(&self, name: &str) -> u32 {
        self.get(name) as u32
    }

    /// Factor by which the start is easier, at most 1.
    fn start_scale(&self) -> f64 {
        self.0.param(START_SCALE.name).unwrap_or(START_SCALE.default)
    }

    /// Time limit of the episode, s: a scaled start has its share of the recipe's, in whole seconds.
    fn time_limit_s(&self) -> f64 {
        let limit = self.get("time_limit_s");
        limit.min(libm::ceil(limit * self.start_scale()).max(MIN_SCALED_TIME_S))
    }

    /// Bound of the initial charge: a scaled start has its share of what a full battery has more.
    fn charge(&self, name: &str) -> f64 {
        let (bound, scale) = (self.get(name), self.start_scale());
        // A scale of 1 keeps every bit.
        if scale < 1.0 { 1.0 - scale * (1.0 - bound) } else { bound }
    }

    fn environment(&self) -> TaskingEnvironment {
        match self.0.task().id() {
            "tasking/scanning" => TaskingEnvironment::Scanning(self.scanning()),
            "tasking/imaging" => TaskingEnvironment::Imaging(self.imaging()),
            _ => TaskingEnvironment::Constellation(self.constellation()),
        }
    }

    fn scanning(&self) -> ScanningParams {
        ScanningParams {
            battery_wh: self.get("battery_wh"),
            charge_min: self.charge("charge_min"),
            charge_max: self.charge("charge_max"),
            panel_m2: self.get("panel_m2"),
            storage_gbit: self.get("storage_gbit"),
            storage_fill: self.get("storage_fill") * self.start_scale(),
            wheel_rpm: self.get("wheel_rpm") * self.start_scale(),
            disturbance_mnm: self.get("disturbance_mnm"),
            stations: self.whole("stations"),
            time_limit_s: self.time_limit_s(),
        }
    }

    fn imaging(&self) -> ImagingParams {
        ImagingParams {
            targets: self.whole("targets"),
            are_cities: self.0.option("targets") == Some("cities"),
            priority_power: self.get("priority_power"),
            omega_max_rad_s: self.get("omega_max_rad_s"),
            u_max_n_m: self.get("u_max_n_m"),
            attitude_error: self.get("attitude_error"),
            battery_wh: self.get("battery_wh"),
            charge_min: self.charge("charge_min"),
            charge_max: self.charge("charge_max"),
            panel_m2: self.get("panel_m2"),
            storage_images: self.whole("storage_images"),
            time_limit_s: self.time_limit_s(),
        }
    }

    fn constellation(&self) -> ConstellationParams {
        let (links, multi_degree) = match self.0.option("communication") {
            Some("none") => (Links::None, false),
            Some("free") => (Links::Free, false),
            Some("los_multi") => (Links::LineOfSight, true),
            _ => (Links::LineOfSight, false),
        };
        ConstellationParams {
            satellites: self.whole("satellites"),
            spacing_deg: self.get("spacing_deg"),
            links,
            multi_degree,
            imaging: self.imaging(),
        }
    }
}
