//! An episode of satellite tasking: the environment of BSK-RL.
//!
//! A step gives actions to the satellites, runs ticks until an event ends it, and then collects data, rewards and knowledge.
//! [`actions`] gives actions, [`events`] ends steps, [`run`] runs the ticks of one or many episodes side by side.

pub mod access_filter;
pub mod actions;
mod agent;
pub mod communication;
mod drive;
mod events;
pub mod forks;
pub mod journal;
pub mod observe;
mod queries;
mod rewards;
pub mod run;
mod scratch;
pub mod step;
pub mod target_set;

use std::sync::Arc;

use self::agent::{ActionKey, Agent};
use self::target_set::TargetSet;
use super::access::{AccessLimit, LocationSet, Locations, Opportunity, OpportunityList};
use super::error::TaskingError;
use super::orbit::Sky;
use super::satellite::{Environment, TaskedSatellite};
use super::setup::actions::ActionSpec;
use super::setup::environment::{
    ClockSetup, Communicator, EnvironmentMode, GroundStation, Rewarder, Setup, Target,
};

pub use self::actions::AgentAction;
pub(crate) use self::drive::{DrivenEpisodes, drive};
pub use self::run::{RunSet, run_all, run_one};
pub use self::step::{StepResult, step_all};

/// An episode of satellite tasking.
#[derive(Debug, Clone)]
pub struct TaskingSim {
    agents: Vec<Agent>,
    sky: Sky,
    setup: Arc<EpisodeRules>,
    /// The last tick that was run.
    now: u64,
    /// Tick at which the current step began.
    step_start: u64,
    /// Last tick of the current step by its longest duration; `None` if it is never reached.
    step_limit: Option<u64>,
    /// Tick of the time limit; `None` if there is none.
    time_limit: Option<u64>,
    /// Targets whose image was rewarded.
    rewarded: TargetSet,
    last_communication_s: f64,
    /// Sums of the rewards of each satellite, without penalties.
    totals: Vec<f64>,
    steps: u32,
    /// Memory for the opportunities that an observation or action needs.
    found: Vec<Opportunity>,
    /// True if a missing opportunity is no error.
    tolerates_missing: bool,
}

/// Parts of a set-up that belong to the episode rather than to a satellite.
#[derive(Debug, Clone)]
struct EpisodeRules {
    targets: Vec<Target>,
    stations: Vec<GroundStation>,
    rewarders: Vec<Rewarder>,
    communicator: Communicator,
    clock: ClockSetup,
    failure_penalty: f64,
    mode: EnvironmentMode,
}

impl TaskingSim {
    /// Starts an episode.
    ///
    /// # Errors
    /// Returns [`TaskingError`] if the parts of the set-up do not fit together.
    pub fn new(setup: Setup) -> Result<Self, TaskingError> {
        setup.check()?;
        let sky = Sky::new(setup.epoch.tdb_s());
        let tick = setup.clock.tick;
        let environment = Environment { gravity: setup.gravity, full_thrust: setup.full_thrust, tick };
        let time_limit_s = setup.clock.whole_limit_s();
        let positions: Vec<_> = setup.targets.iter().map(|target| target.position).collect();
        let hides_imaged = setup.rewarders == [Rewarder::UniqueImages];
        let mut agents = Vec::with_capacity(setup.agents.len());
        let has_stations = setup.agents.iter().any(|agent| agent.satellite.dynamics.ground_stations);
        let listed = if has_stations { &setup.stations[..] } else { &[] };
        // The ranges limit the data link; the opportunities of BSK-RL do not know them.
        let [stations, searched] =
            [true, false].map(|has_ranges| Arc::new(station_locations(listed, has_ranges)));
        let no_stations = Arc::new(station_locations(&[], false));
        let mut shared: Option<Arc<Locations>> = None;
        for agent in setup.agents {
            let spec = agent.satellite.clone();
            let min_elevation = spec.args.target_min_elevation_rad;
            let targets = match &shared {
                Some(targets) if targets.min_elevation_rad() == min_elevation => Arc::clone(targets),
                _ => Arc::new(Locations::new(positions.clone(), min_elevation)),
            };
            shared = Some(Arc::clone(&targets));
            let [linked, searched] =
                if spec.dynamics.ground_stations { [&stations, &searched] } else { [&no_stations; 2] };
            let satellite =
                TaskedSatellite::new(spec, environment, LocationSet::new(Arc::clone(linked)), &sky);
            let places = [targets, Arc::clone(searched)];
            agents.push(Agent::new(agent, satellite, places, time_limit_s, hides_imaged));
        }
        let mut sim = Self {
            rewarded: TargetSet::new(positions.len()),
            totals: vec![0.0; agents.len()],
            agents,
            setup: Arc::new(EpisodeRules {
                targets: setup.targets,
                stations: setup.stations,
                rewarders: setup.rewarders,
                communicator: setup.communicator,
                clock: ClockSetup { time_limit_s, ..setup.clock },
                failure_penalty: setup.failure_penalty,
                mode: setup.mode,
            }),
            now: 0,
            step_start: 0,
            step_limit: None,
            time_limit: time_limit_s.is_finite().then(|| tick.first_tick_at(time_limit_s)).flatten(),
            last_communication_s: 0.0,
            steps: 0,
            found: Vec::new(),
            tolerates_missing: false,
            sky,
        };
        for agent in &mut sim.agents {
            agent.compute_initial(&mut sim.sky)?;
        }
        sim.log_resources();
        Ok(sim)
    }

    /// Number of satellites in the episode.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.agents.len()
    }

    /// True if there are no satellites, which no set-up allows.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.agents.is_empty()
    }

    /// Time since the start, s.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.setup.clock.tick.time_s(self.now)
    }

    /// The last tick that was run.
    #[must_use]
    pub const fn now(&self) -> u64 {
        self.now
    }

    /// Number of steps so far.
    #[must_use]
    pub const fn steps(&self) -> u32 {
        self.steps
    }

    /// The satellite of an index.
    #[must_use]
    pub fn satellite(&self, index: usize) -> &TaskedSatellite {
        &self.agents[index].satellite
    }

    /// True if a satellite needs a new action.
    #[must_use]
    pub fn needs_action(&self, index: usize) -> bool {
        self.agents[index].needs_action
    }

    /// True if a satellite was alive at the end of the last step.
    #[must_use]
    pub fn is_alive(&self, index: usize) -> bool {
        self.agents[index].is_alive
    }

    /// Numbers of images and of missed windows of a satellite.
    #[must_use]
    pub fn image_counts(&self, index: usize) -> [u32; 2] {
        [self.agents[index].images, self.agents[index].misses]
    }

    /// Targets that a satellite knows to be imaged.
    #[must_use]
    pub fn known_images(&self, index: usize) -> &TargetSet {
        &self.agents[index].imaged
    }

    /// Opportunities of a satellite so far, in order, and the time up to which they are computed, s.
    #[must_use]
    pub fn opportunities(&self, index: usize) -> &OpportunityList {
        &self.agents[index].opportunities
    }

    /// Number of actions of a satellite.
    #[must_use]
    pub fn action_count(&self, index: usize) -> usize {
        self.agents[index].setup.actions.iter().map(ActionSpec::count).sum()
    }

    /// Target of the last action of a satellite, if that was an image.
    #[must_use]
    pub fn tasked_target(&self, index: usize) -> Option<usize> {
        match self.agents[index].last_action {
            Some(ActionKey::Target(target)) => Some(target),
            _ => None,
        }
    }

    /// Ground stations of the episode.
    #[must_use]
    pub fn stations(&self) -> &[GroundStation] {
        &self.setup.stations
    }

    /// Targets of the episode.
    #[must_use]
    pub fn targets(&self) -> &[Target] {
        &self.setup.targets
    }

    /// Sum of the rewards of a satellite, without penalties.
    #[must_use]
    pub fn total_reward(&self, index: usize) -> f64 {
        self.totals[index]
    }

    /// A digest of every bit of the satellites' states.
    #[must_use]
    pub fn state_hash(&self) -> [u8; 32] {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&self.now.to_le_bytes());
        for agent in &self.agents {
            let state = &agent.satellite.state;
            let vectors = [
                state.attitude.sigma,
                state.attitude.omega,
                state.attitude.wheels,
                state.motor,
                state.command,
                state.previous_sigma,
                state.integral,
                state.position,
            ];
            let numbers = [
                state.battery,
                state.net_power,
                state.stored,
                agent.satellite.stored()[1],
                state.is_commanded,
                state.is_imaged,
            ];
            for number in vectors.iter().flatten().chain(&numbers) {
                hasher.update(&number.to_bits().to_le_bytes());
            }
        }
        *hasher.finalize().as_bytes()
    }
}

/// Locations of ground stations with their minimum elevations, and with their largest ranges if `has_ranges`.
fn station_locations(stations: &[GroundStation], has_ranges: bool) -> Locations {
    let limit = |station: &GroundStation| {
        let is_limited = has_ranges && station.max_range_m >= 0.0;
        AccessLimit::new(
            station.min_elevation_rad,
            if is_limited { station.max_range_m } else { f64::INFINITY },
        )
    };
    Locations::with_limits(
        stations.iter().map(|station| station.position).collect(),
        stations.iter().map(limit).collect(),
    )
}
