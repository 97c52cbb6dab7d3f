//! Set-up of an episode: everything that determines the simulation.

use super::actions::ActionSpec;
use crate::tasking::clock::TickLength;
use crate::tasking::constants::EARTH_RADIUS_M;
use crate::tasking::error::TaskingError;
use crate::tasking::observation::property::Property;
use crate::tasking::observation::spec::ObservationSpec;
use crate::tasking::orbit::GravityModel;
use crate::tasking::satellite::SatelliteSpec;
use crate::tasking::time::Epoch;
use crate::tasking::vector3::Vector3;

/// Longest time limit, and longest time for which opportunities are computed: a year, s.
pub const MAX_TIME_S: f64 = 366.0 * 86_400.0;

/// Shortest block of opportunities, s.
const MIN_BLOCK_S: f64 = 0.001;
/// Longest block of opportunities: ten days, s.
const MAX_BLOCK_S: f64 = 10.0 * 86_400.0;

/// A satellite with its tasking: an agent.
#[derive(Debug, Clone, PartialEq)]
pub struct AgentSetup {
    /// Name, models and arguments.
    pub satellite: SatelliteSpec,
    /// Class of the satellite.
    pub class: SatelliteClass,
    /// True if events of this satellite end the step.
    pub variable_interval: bool,
    /// Actions in the order of their indices.
    pub actions: Vec<ActionSpec>,
    /// Observation, item by item.
    pub observation: ObservationSpec,
}

/// Class of a satellite in BSK-RL.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SatelliteClass {
    /// `Satellite`: knows no opportunities.
    Plain,
    /// `AccessSatellite`: knows opportunities of access.
    Access(GenerationTimes),
    /// `ImagingSatellite`: images targets as well.
    Imaging(GenerationTimes),
}

impl SatelliteClass {
    /// Times for which opportunities are computed.
    #[must_use]
    pub const fn generation(&self) -> Option<GenerationTimes> {
        match self {
            Self::Plain => None,
            Self::Access(times) | Self::Imaging(times) => Some(*times),
        }
    }
}

/// Times for which opportunities are computed, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GenerationTimes {
    /// Length of a block (`generation_duration`).
    pub block_s: f64,
    /// Time at the start; `None` is the time limit, or nothing if that is infinite.
    pub initial_s: Option<f64>,
    /// Largest time beyond the initial one.
    pub max_beyond_s: f64,
}

impl Default for GenerationTimes {
    fn default() -> Self {
        Self { block_s: 600.0, initial_s: None, max_beyond_s: f64::INFINITY }
    }
}

/// A target on the ground.
#[derive(Debug, Clone, PartialEq)]
pub struct Target {
    /// Name of the target.
    pub name: String,
    /// Position in the planet-fixed frame, m.
    pub position: Vector3<f64>,
    /// Value of an image.
    pub priority: f64,
}

/// A ground station that receives data.
#[derive(Debug, Clone, PartialEq)]
pub struct GroundStation {
    /// Name of the station.
    pub name: String,
    /// Position in the planet-fixed frame, m.
    pub position: Vector3<f64>,
    /// Minimum elevation of access, rad.
    pub min_elevation_rad: f64,
    /// Largest range, m; negative for no limit.
    pub max_range_m: f64,
}

impl GroundStation {
    /// Creates a station at a latitude and longitude, degrees, and a height, m, above a spherical planet.
    #[must_use]
    pub fn at(name: &str, degrees: [f64; 2], height_m: f64, planet_radius_m: f64) -> Self {
        let (sin_latitude, cos_latitude) = libm::sincos(degrees[0].to_radians());
        let (sin_longitude, cos_longitude) = libm::sincos(degrees[1].to_radians());
        let radius = planet_radius_m + height_m;
        Self {
            name: name.to_owned(),
            position: [
                radius * (cos_latitude * cos_longitude),
                radius * (cos_latitude * sin_longitude),
                radius * sin_latitude,
            ],
            min_elevation_rad: 10.0_f64.to_radians(),
            max_range_m: -1.0,
        }
    }

    /// The seven stations of BSK-RL.
    #[must_use]
    pub fn defaults() -> Vec<Self> {
        DEFAULT_STATIONS
            .map(|station| Self::at(station.name, station.degrees, station.height_m, EARTH_RADIUS_M))
            .to_vec()
    }
}

/// Place of a ground station.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StationPlace {
    /// Name of the station.
    pub name: &'static str,
    /// Latitude and longitude, degrees.
    pub degrees: [f64; 2],
    /// Height above the spherical Earth, m.
    pub height_m: f64,
}

/// The seven stations of BSK-RL.
pub const DEFAULT_STATIONS: [StationPlace; 7] = [
    StationPlace { name: "Boulder", degrees: [40.009_971, -105.243_895], height_m: 1624.0 },
    StationPlace { name: "Merritt", degrees: [28.3181, -80.6660], height_m: 0.9144 },
    StationPlace { name: "Singapore", degrees: [1.3521, 103.8198], height_m: 15.0 },
    StationPlace { name: "Weilheim", degrees: [47.8407, 11.1421], height_m: 563.0 },
    StationPlace { name: "Santiago", degrees: [-33.4489, -70.6693], height_m: 570.0 },
    StationPlace { name: "Dongara", degrees: [-29.2452, 114.9326], height_m: 34.0 },
    StationPlace { name: "Hawaii", degrees: [19.8968, -155.5828], height_m: 9.0 },
];

/// A rule that pays rewards.
#[derive(Debug, Clone, PartialEq)]
pub enum Rewarder {
    /// Pays nothing at all (`NoReward`).
    None,
    /// Pays a value for each second of scanned data (`ScanningTimeReward` with `UniformNadirScanning`).
    ScanningTime {
        /// Value of a second.
        value_per_second: f64,
    },
    /// Pays the priority of each target for its first image (`UniqueImageReward`).
    UniqueImages,
    /// Pays the change of a property of the satellite (`ResourceReward`).
    Resource {
        /// Property of the satellite.
        property: Property,
        /// Reward for a unit of change.
        weight: f64,
    },
}

/// Which satellites share data at the end of a step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Communicator {
    /// Links along which satellites share data.
    pub links: Links,
    /// True if data travel along paths of links within a step (`MultiDegreeCommunication`).
    pub multi_degree: bool,
    /// True if only satellites send that broadcast in this step (`BroadcastCommunication`).
    pub broadcast: bool,
    /// Least time between two communications, s.
    pub min_period_s: f64,
}

/// Links along which satellites share data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Links {
    /// No satellite is linked (`NoCommunication`).
    #[default]
    None,
    /// All satellites are linked (`FreeCommunication`).
    Free,
    /// Satellites are linked that saw each other in the step (`LOSCommunication`).
    LineOfSight,
}

/// Set-up of an episode.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// Satellites in the order of their indices.
    pub agents: Vec<AgentSetup>,
    /// Start of the episode.
    pub epoch: Epoch,
    /// Gravity model of the orbits.
    pub gravity: GravityModel,
    /// True if thrusters deliver their whole impulse, false for Basilisk's rule.
    pub full_thrust: bool,
    /// Ground stations of the world.
    pub stations: Vec<GroundStation>,
    /// Targets of the scene.
    pub targets: Vec<Target>,
    /// Rules that pay rewards.
    pub rewarders: Vec<Rewarder>,
    /// Communication of the satellites.
    pub communicator: Communicator,
    /// Times of the simulation.
    pub clock: ClockSetup,
    /// Reward of a satellite's death.
    pub failure_penalty: f64,
    /// Behaviour with more than one satellite.
    pub mode: EnvironmentMode,
}

/// Times of the simulation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockSetup {
    /// Length of a tick (`sim_rate`).
    pub tick: TickLength,
    /// Longest duration of a step, s.
    pub max_step_s: f64,
    /// Time limit of the episode, s; may be infinite.
    pub time_limit_s: f64,
    /// True if the time limit terminates the episode as well as truncating it.
    pub terminate_on_time_limit: bool,
}

/// Behaviour of an environment class of BSK-RL.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum EnvironmentMode {
    /// `GeneralSatelliteTasking`: the episode ends with the first death, and each step with a dead satellite pays the penalty.
    #[default]
    General,
    /// `ConstellationTasking`: a dead satellite leaves, pays the penalty once, and ends no step any more.
    Constellation,
}

impl Setup {
    /// Checks that the parts fit together.
    ///
    /// # Errors
    /// Returns [`TaskingError::Composition`] if they do not, and [`TaskingError::InvalidArgument`] if an argument of a satellite is
    /// out of range.
    pub fn check(&self) -> Result<(), TaskingError> {
        let fail = |reason: String| Err(TaskingError::Composition(reason));
        if self.agents.is_empty() {
            return fail("an episode needs at least one satellite".to_owned());
        }
        self.clock.check().or_else(fail)?;
        for agent in &self.agents {
            agent.check().or_else(fail)?;
            agent.satellite.args.check()?;
        }
        if self.communicator.links == Links::LineOfSight
            && let Some(agent) = self.agents.iter().find(|agent| !agent.satellite.dynamics.line_of_sight)
        {
            return fail(format!(
                "satellite {} must have a LOSCommDynModel for communication by lines of sight",
                agent.satellite.name
            ));
        }
        Ok(())
    }
}

impl ClockSetup {
    /// Time limit in whole ticks, s, as BSK-RL rounds it.
    #[must_use]
    pub fn whole_limit_s(&self) -> f64 {
        (self.time_limit_s / self.tick.seconds()).ceil() * self.tick.seconds()
    }

    /// Checks the longest step and the time limit.
    fn check(&self) -> Result<(), String> {
        let limit = self.time_limit_s;
        if self.max_step_s.is_nan() || self.max_step_s <= 0.0 {
            return Err(format!("max_step_duration must be greater than 0, got {}", self.max_step_s));
        }
        if !(0.0..=MAX_TIME_S).contains(&limit) && limit != f64::INFINITY {
            return Err(format!("time_limit must be from 0 to {MAX_TIME_S} s, or infinite, got {limit}"));
        }
        let whole = self.whole_limit_s();
        if let Some(last) = whole.is_finite().then_some((whole * 1e9 + 0.5) as u64)
            && self.tick.last_time_s(last) < whole
        {
            return Err(format!(
                "time_limit {limit} s is {whole} s in ticks of {} s, which no tick reaches by rounding: change either",
                self.tick.seconds()
            ));
        }
        Ok(())
    }
}

impl GenerationTimes {
    /// Checks that the times are within bounds.
    fn check(&self) -> Result<(), String> {
        let Self { block_s, initial_s, max_beyond_s } = *self;
        if !(MIN_BLOCK_S..=MAX_BLOCK_S).contains(&block_s) {
            return Err(format!(
                "generation_duration must be from {MIN_BLOCK_S} to {MAX_BLOCK_S} s, got {block_s}"
            ));
        }
        if let Some(initial) = initial_s.filter(|initial| !(0.0..=MAX_TIME_S).contains(initial)) {
            return Err(format!(
                "initial_generation_duration must be from 0 to {MAX_TIME_S} s, got {initial}"
            ));
        }
        if max_beyond_s.is_nan() || max_beyond_s < 0.0 {
            return Err(format!("max_generation_duration must not be negative, got {max_beyond_s}"));
        }
        Ok(())
    }
}

impl AgentSetup {
    /// Checks that models and actions fit together; the error says which do not.
    fn check(&self) -> Result<(), String> {
        use super::actions::SoftwareAction::{Downlink, Scan};
        let (name, dynamics, software) =
            (&self.satellite.name, self.satellite.dynamics, self.satellite.software);
        if software.imaging && !dynamics.instrument {
            return Err(format!("satellite {name}: an imaging flight software needs an ImagingDynModel"));
        }
        if software.continuous && !dynamics.continuous {
            return Err(format!(
                "satellite {name}: a ContinuousImagingFSWModel needs a ContinuousImagingDynModel"
            ));
        }
        if let Some(times) = self.class.generation() {
            times.check().map_err(|reason| format!("satellite {name}: {reason}"))?;
        }
        if self.actions.is_empty() {
            return Err(format!("satellite {name} needs at least one action"));
        }
        for action in &self.actions {
            match action {
                ActionSpec::Software { action: Scan, .. } if !software.continuous => {
                    return Err(format!("satellite {name}: Scan needs a ContinuousImagingFSWModel"));
                }
                ActionSpec::Software { action: Downlink, .. } if !software.imaging => {
                    return Err(format!("satellite {name}: Downlink needs an ImagingFSWModel"));
                }
                ActionSpec::Image { .. }
                    if !software.imaging
                        || dynamics.continuous
                        || !matches!(self.class, SatelliteClass::Imaging(_)) =>
                {
                    return Err(format!(
                        "satellite {name}: Image needs an ImagingSatellite with an ImagingFSWModel, and an ImagingDynModel that is not \
                         continuous"
                    ));
                }
                _ => {}
            }
        }
        Ok(())
    }
}
