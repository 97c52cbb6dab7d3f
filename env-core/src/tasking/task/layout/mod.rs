//! Layouts of the world: the parts of an episode's start that are given instead of drawn.
//!
//! `tables` reads them from the tables of a recipe. Whatever a layout leaves out is drawn from the seed, by the same draws as without it.

mod sun_orbit;
mod tables;

use std::collections::BTreeMap;

pub use self::sun_orbit::SunOrbit;
use crate::error::ScenarioError;
use crate::scene::Point;
use crate::task::{Layout, LayoutMode, Recipe};
use crate::tasking::constants::EARTH_RADIUS_M;
use crate::tasking::orbit::OrbitalElements;
use crate::tasking::setup::environment::{Setup, Target};
use crate::tasking::setup::{InitialOrbit, SatelliteArgs};
use crate::tasking::time::Epoch;

/// Largest speed of a wheel in a layout, rpm. A wheel at 6000 rpm ends an episode.
pub const MAX_LAYOUT_WHEEL_RPM: f64 = 5900.0;
/// Smallest charge in a layout, as a share of the battery.
pub const MIN_LAYOUT_CHARGE: f64 = 0.01;
/// First and last year of epochs: those of the drawn ones.
pub const LAYOUT_YEARS: [u32; 2] = [2000, 2021];
/// Largest number of a day in a layout: that of all years.
pub const MAX_LAYOUT_DAY: u32 = 365;
/// Seconds of a day.
const DAY_S: f64 = 86_400.0;

/// Given parts of an episode's start.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TaskingLayout {
    /// Start of the episode.
    pub epoch: Option<EpochDay>,
    /// Start of every satellite.
    pub satellites: Option<Vec<SatelliteStart>>,
    /// Numbers of the ground stations that are out of service, in the order of BSK-RL's list.
    pub outages: Vec<usize>,
    /// Targets of the layout.
    pub targets: Option<Vec<TargetPlace>>,
    /// True if the layout's targets are added to the drawn ones, false if they replace them.
    pub keeps_drawn_targets: bool,
}

/// Start of an episode as a day and a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EpochDay {
    /// Year within [`LAYOUT_YEARS`], both included.
    pub year: u32,
    /// Day of the year, from 1 to 365.
    pub day: u32,
    /// Time of the day in UTC, s.
    pub second: f64,
}

/// Start of a satellite. Altitude and inclination of its circular orbit are those of the task.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SatelliteStart {
    /// Right ascension of the ascending node, degrees.
    pub node_deg: f64,
    /// Angle along the orbit from the ascending node, degrees.
    pub anomaly_deg: f64,
    /// Charge of the battery as a share of its capacity.
    pub charge: f64,
    /// Speeds of the wheels, rpm.
    pub wheels_rpm: [f64; 3],
    /// Data in the storage as a share of its capacity.
    pub fill: f64,
}

/// A target on the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetPlace {
    /// Geocentric latitude, degrees, −90 to 90.
    pub latitude_deg: f64,
    /// Longitude, degrees, −180 to 180.
    pub longitude_deg: f64,
    /// Value of an image, 0 to 1.
    pub priority: f64,
}

impl TaskingLayout {
    /// Reads the layout of a recipe; `None` if it has none.
    ///
    /// # Errors
    /// Returns the first table or cell that is unknown or out of bounds.
    pub fn of_recipe(recipe: &Recipe) -> Result<Option<Self>, ScenarioError> {
        recipe.layout().map(|layout| tables::read(layout, recipe)).transpose()
    }

    /// Returns the tables of the layout, without provenance.
    #[must_use]
    pub fn to_layout(&self) -> Layout {
        let mut bodies = BTreeMap::new();
        if let Some(epoch) = &self.epoch {
            let row = vec![f64::from(epoch.year), f64::from(epoch.day), epoch.second];
            bodies.insert(tables::EPOCH.to_owned(), vec![row]);
        }
        if let Some(satellites) = &self.satellites {
            bodies.insert(
                tables::SATELLITES.to_owned(),
                satellites.iter().map(|start| start.to_row()).collect(),
            );
        }
        if !self.outages.is_empty() {
            let rows = self.outages.iter().map(|station| vec![*station as f64]);
            bodies.insert(tables::OUTAGES.to_owned(), rows.collect());
        }
        if let Some(targets) = &self.targets {
            let rows =
                targets.iter().map(|target| vec![target.latitude_deg, target.longitude_deg, target.priority]);
            bodies.insert(tables::TARGETS.to_owned(), rows.collect());
        }
        let mode = if self.keeps_drawn_targets { LayoutMode::Extend } else { LayoutMode::Replace };
        Layout { mode, bodies, provenance: None }
    }

    /// Replaces the drawn parts of a set-up by those of the layout.
    pub(super) fn apply(&self, setup: &mut Setup) {
        if let Some(epoch) = &self.epoch {
            setup.epoch = epoch.to_epoch();
        }
        for (agent, start) in setup.agents.iter_mut().zip(self.satellites.iter().flatten()) {
            start.apply(&mut agent.satellite.args);
        }
        let mut number = 0;
        setup.stations.retain(|_| {
            number += 1;
            !self.outages.contains(&(number - 1))
        });
        if let Some(targets) = &self.targets {
            if !self.keeps_drawn_targets {
                setup.targets.clear();
            }
            let placed = targets.iter().enumerate().map(|(index, place)| place.to_target(index));
            setup.targets.extend(placed);
        }
    }
}

impl EpochDay {
    /// Day and time of an epoch of a drawn scenario.
    pub(super) fn of_epoch(epoch: &Epoch) -> Self {
        Self {
            year: epoch.year.unsigned_abs(),
            day: epoch.day_of_year().min(MAX_LAYOUT_DAY),
            second: epoch.second_of_day(),
        }
    }

    fn to_epoch(self) -> Epoch {
        Epoch::of_day(self.year as i32, self.day, self.second)
    }
}

impl SatelliteStart {
    /// Reads the start of a satellite on a circular orbit.
    pub(super) fn of_args(args: &SatelliteArgs) -> Self {
        let (position, velocity) = args.orbit.state(args.mu);
        let elements = match args.orbit {
            InitialOrbit::Elements(elements) => elements,
            InitialOrbit::State(..) => OrbitalElements::from_state(args.mu, &position, &velocity),
        };
        Self {
            node_deg: elements.ascending_node_rad.to_degrees(),
            anomaly_deg: (elements.periapsis_rad + elements.true_anomaly_rad).to_degrees(),
            charge: args.stored_charge_ws / args.battery_capacity_ws,
            wheels_rpm: args.wheel_speeds_rpm,
            fill: args.storage_init_bits / args.storage_capacity_bits,
        }
    }

    fn apply(&self, args: &mut SatelliteArgs) {
        if let InitialOrbit::Elements(elements) = &mut args.orbit {
            elements.ascending_node_rad = self.node_deg.to_radians();
            elements.periapsis_rad = 0.0;
            elements.true_anomaly_rad = self.anomaly_deg.to_radians();
        }
        args.stored_charge_ws = self.charge * args.battery_capacity_ws;
        args.wheel_speeds_rpm = self.wheels_rpm;
        args.storage_init_bits = (self.fill * args.storage_capacity_bits).floor();
    }

    fn to_row(self) -> Vec<f64> {
        let [x, y, z] = self.wheels_rpm;
        vec![self.node_deg, self.anomaly_deg, self.charge, x, y, z, self.fill]
    }
}

impl TargetPlace {
    /// Creates a target at longitude and latitude, degrees.
    #[must_use]
    pub const fn at((longitude_deg, latitude_deg): Point, priority: f64) -> Self {
        Self { latitude_deg, longitude_deg, priority }
    }

    fn to_target(self, index: usize) -> Target {
        let (sin_latitude, cos_latitude) = libm::sincos(self.latitude_deg.to_radians());
        let (sin_longitude, cos_longitude) = libm::sincos(self.longitude_deg.to_radians());
        Target {
            name: format!("placed-{index}"),
            position: [
                EARTH_RADIUS_M * (cos_latitude * cos_longitude),
                EARTH_RADIUS_M * (cos_latitude * sin_longitude),
                EARTH_RADIUS_M * sin_latitude,
            ],
            priority: self.priority,
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;
    use crate::bracket::Bracket;
    use crate::episode_rng::SeededRng;
    use crate::registry;
    use crate::rollout::replay;
    use crate::seed::Seed;
    use crate::task::{Scenario, TaskSpec};
    use crate::tasking::task::task_setup::TaskSetup;

    const TASKS: [&str; 3] = ["tasking/scanning", "tasking/imaging", "tasking/constellation"];

    fn task(id: &str) -> &'static dyn TaskSpec {
        registry::task(id).unwrap()
    }

    fn parse(id: &str, layout: &Value) -> Result<Recipe, ScenarioError> {
        let params = if id == "tasking/scanning" {
            json!({"time_limit_s": 1200, "stations": 5})
        } else {
            json!({"time_limit_s": 1200, "targets": 20})
        };
        Recipe::from_json(&json!({"task": id, "params": params, "layout": layout}))
    }

    fn scenario(recipe: Recipe) -> Scenario {
        Scenario::new(recipe, Seed::user(7).unwrap())
    }

    /// A layout that gives everything, in JSON.
    fn whole_layout(id: &str) -> Value {
        let satellites = if id == "tasking/constellation" { 3 } else { 1 };
        let row = |index: usize| json!([10.0, 40.0 + 20.0 * index as f64, 0.5, 100.0, -200.0, 300.0, 0.25]);
        let rows: Vec<Value> = (0..satellites).map(row).collect();
        let mut bodies = json!({"epoch": [[2010, 172, 43_200.5]], "satellites": rows, "outages": [[0], [3]]});
        if id != "tasking/scanning" {
            bodies["targets"] = json!([[10.0, 20.0, 0.5], [-30.0, 170.0, 1.0]]);
        }
        json!({"mode": "replace", "bodies": bodies})
    }

    #[test]
    fn a_layout_decides_the_start() {
        for id in TASKS {
            let scenario = scenario(parse(id, &whole_layout(id)).unwrap());
            let setup =
                TaskSetup::read(scenario.recipe()).unwrap().draw(&mut SeededRng::new(scenario.seed()));
            assert_eq!(setup.epoch.to_string(), "2010 JUN 21 12:00:00.500 (UTC)");
            let names: Vec<_> = setup.stations.iter().map(|station| station.name.as_str()).collect();
            assert_eq!(names[..3], ["Merritt", "Singapore", "Santiago"], "{id}");
            let args = &setup.agents[0].satellite.args;
            assert_eq!(args.stored_charge_ws, 0.5 * args.battery_capacity_ws);
            assert_eq!(args.storage_init_bits, (0.25 * args.storage_capacity_bits).floor());
            assert_eq!(args.wheel_speeds_rpm, [100.0, -200.0, 300.0]);
            let InitialOrbit::Elements(elements) = args.orbit else { panic!("elements") };
            assert_eq!(elements.ascending_node_rad, 10_f64.to_radians());
            assert_eq!(setup.targets.len(), if id == "tasking/scanning" { 0 } else { 2 });
            // Reading the start gives the layout again, up to the rounding of angles.
            let read = TaskingLayout::of_scenario(&scenario).unwrap();
            let given = TaskingLayout::of_recipe(scenario.recipe()).unwrap().unwrap();
            assert_eq!(
                (&read.epoch, &read.outages, &read.targets),
                (&given.epoch, &given.outages, &given.targets)
            );
            let [read, given] = [&read, &given].map(|layout| layout.satellites.clone().unwrap());
            assert!((read[0].anomaly_deg - given[0].anomaly_deg).abs() < 1e-9);
            assert_eq!(read[0].wheels_rpm, given[0].wheels_rpm);
        }
    }

    /// A part that is not given is drawn as without a layout, so that a mutation changes one part at a time.
    #[test]
    fn other_parts_are_drawn_as_without_a_layout() {
        for id in TASKS {
            let draw = |layout: &Value| {
                let scenario = scenario(parse(id, layout).unwrap());
                TaskSetup::read(scenario.recipe()).unwrap().draw(&mut SeededRng::new(scenario.seed()))
            };
            let drawn = draw(&Value::Null);
            let moved = draw(&json!({"mode": "replace", "bodies": {"epoch": [[2010, 172, 0]]}}));
            assert_ne!(drawn.epoch, moved.epoch);
            assert_eq!(drawn, Setup { epoch: drawn.epoch, ..moved });
            if id != "tasking/scanning" {
                let bodies = json!({"targets": [[10.0, 20.0, 0.5]]});
                let extended = draw(&json!({"mode": "extend", "bodies": bodies}));
                assert_eq!(extended.targets.len(), 21);
                assert_eq!(extended.targets[..20], drawn.targets[..]);
            }
        }
    }

    #[test]
    fn tables_round_trip() {
        for id in TASKS {
            let recipe = parse(id, &whole_layout(id)).unwrap();
            let layout = TaskingLayout::of_recipe(&recipe).unwrap().unwrap();
            assert_eq!(layout.to_layout(), *recipe.layout().unwrap());
            assert_eq!(Recipe::from_json(&recipe.to_json()).unwrap(), recipe);
        }
    }

    #[test]
    fn wrong_layouts_are_refused_by_field() {
        let of = |table: &str, rows: Value| json!({"mode": "replace", "bodies": {table: rows}});
        let start = |cell: usize, value: f64| {
            let mut row = vec![0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0];
            row[cell] = value;
            of("satellites", json!([row]))
        };
        let cases = [
            ("tasking/scanning", of("debris", json!([])), "layout.bodies.debris"),
            ("tasking/scanning", of("targets", json!([[0, 0, 1]])), "layout.bodies.targets"),
            ("tasking/scanning", of("epoch", json!([])), "layout.bodies.epoch"),
            ("tasking/scanning", of("epoch", json!([[2010, 172]])), "layout.bodies.epoch.0"),
            ("tasking/scanning", of("epoch", json!([[1999, 172, 0]])), "layout.bodies.epoch.0.0"),
            ("tasking/scanning", of("epoch", json!([[2010, 366, 0]])), "layout.bodies.epoch.0.1"),
            ("tasking/scanning", of("epoch", json!([[2010, 1.5, 0]])), "layout.bodies.epoch.0.1"),
            ("tasking/scanning", of("epoch", json!([[2010, 1, 86_400]])), "layout.bodies.epoch.0.2"),
            ("tasking/scanning", start(0, 400.0), "layout.bodies.satellites.0.0"),
            ("tasking/scanning", start(2, 0.0), "layout.bodies.satellites.0.2"),
            ("tasking/scanning", start(4, -6000.0), "layout.bodies.satellites.0.4"),
            ("tasking/scanning", start(6, 1.5), "layout.bodies.satellites.0.6"),
            ("tasking/constellation", start(6, 0.5), "layout.bodies.satellites"),
            ("tasking/scanning", of("outages", json!([[5]])), "layout.bodies.outages.0.0"),
            ("tasking/scanning", of("outages", json!([[1], [1]])), "layout.bodies.outages.1.0"),
            ("tasking/scanning", of("outages", json!([[0], [1], [2], [3], [4]])), "layout.bodies.outages"),
            ("tasking/imaging", of("targets", json!([])), "layout.bodies.targets"),
            ("tasking/imaging", of("targets", json!([[91, 0, 1]])), "layout.bodies.targets.0.0"),
            ("tasking/imaging", of("targets", json!([[0, 0, 2]])), "layout.bodies.targets.0.2"),
            ("tasking/imaging", of("targets", json!(vec![[0, 0, 1]; 513])), "layout.bodies.targets"),
        ];
        for (id, layout, field) in cases {
            let error = parse(id, &layout).unwrap_err();
            assert_eq!(error.field(), field, "{id} {layout} {error}");
        }
    }

    /// The plan of the bracket has its score again when it is replayed from the recipe's JSON.
    #[test]
    fn brackets_of_layouts_hold_in_replays() {
        for id in TASKS {
            let recipe = parse(id, &whole_layout(id)).unwrap();
            let scenario = scenario(recipe);
            let Bracket { reference, reference_plan, .. } = task(id).bracket(&scenario).unwrap();
            let again = Scenario::from_json(&scenario.to_json()).unwrap();
            let outcome = replay(&again, &reference_plan).unwrap();
            assert_eq!(outcome.score.to_bits(), reference.score.to_bits(), "{id}");
        }
    }
}
