//! Recordings of BSK-RL, and episodes of tasking through all options.

use env_core::Seed;
use env_core::World;
use env_core::episode_rng::{EpisodeRng, RngStream, SeededRng};
use env_core::tasking::TASKING;
use env_core::tasking::clock::TickLength;
use env_core::tasking::environments::{
    ConstellationParams, ImagingParams, ScanningParams, TaskingEnvironment,
};
use env_core::tasking::error::TaskingError;
use env_core::tasking::orbit::GravityModel;
use env_core::tasking::setup::DesatAttitude;
use env_core::tasking::setup::Setup;
use env_core::tasking::setup::environment::{
    Communicator, EnvironmentMode, GenerationTimes, Links, Rewarder, SatelliteClass,
};
use env_core::tasking::simulation::{AgentAction, StepResult, TaskingSim};
use serde_json::{Value, json};

use crate::target::{Target, json_seeds, with_json};

/// Targets that run simulations, with a part of the inputs of others.
pub(super) const TARGETS: &[Target] = &[
    Target::new("tasking_recording", recording, recording_seeds).divided_by(50),
    Target::new("tasking_episode", episode, episode_seeds).divided_by(50),
];

/// Steps of an episode.
const STEPS: usize = 10;
/// Steps and targets that are kept of the recording.
const KEPT: usize = 3;
/// A recording with deaths of imaging satellites.
const RECORDING: &[u8] =
    include_bytes!("../../../env-core/fixtures/tasking/recorded/deaths_constellation.json.gz");

/// A recording is replayed or refused with one sentence.
fn recording(bytes: &[u8]) -> bool {
    with_json(bytes, |value| match TASKING.compare_recording(&value, 0.0) {
        None => false,
        Some(Ok(compared)) => {
            assert!(compared.steps <= KEPT + 1, "{} steps", compared.steps);
            assert!(compared.worst.iter().all(|worst| !worst.difference.is_nan()));
            true
        }
        Some(Err(error)) => {
            let length = error.to_string().len();
            assert!(length < 8192, "the error has {length} bytes");
            false
        }
    })
}

/// The first steps of a recording, with few targets and without windows.
fn recording_seeds() -> Vec<Vec<u8>> {
    let mut value: Value =
        serde_json::from_reader(flate2::read::GzDecoder::new(RECORDING)).expect("the fixture is a recording");
    for list in ["steps", "targets"] {
        if let Some(items) = value[list].as_array_mut() {
            items.truncate(KEPT);
        }
    }
    value["opportunities"] = json!({});
    json_seeds([value])
}

/// Options of an episode, read from bytes; zeros follow the last one.
struct Options<'a>(&'a [u8]);

impl Options<'_> {
    fn byte(&mut self) -> u8 {
        match self.0.split_first() {
            Some((first, rest)) => {
                self.0 = rest;
                *first
            }
            None => 0,
        }
    }

    /// A number from `low` to `high`.
    fn number(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(self.byte()) / 255.0
    }

    fn choose<T: Copy, const N: usize>(&mut self, choices: [T; N]) -> T {
        choices[usize::from(self.byte()) % N]
    }

    fn is_set(&mut self) -> bool {
        self.byte() % 2 == 1
    }
}

/// In an episode through any options, all numbers are finite, resources and rewards stay within their bounds, and the battery is the
/// sum of the net power.
fn episode(bytes: &[u8]) -> bool {
    let mut options = Options(bytes);
    let setup = read_setup(&mut options);
    let mut sim = match TaskingSim::new(setup.clone()) {
        Ok(sim) => sim,
        Err(error) => {
            assert!(error.to_string().len() < 8192);
            return false;
        }
    };
    for _ in 0..STEPS {
        let actions = read_actions(&sim, &mut options);
        match step(&mut sim, &actions) {
            Ok(result) => {
                check_step(&setup, &sim, &result);
                if result.truncated || (0..sim.len()).all(|index| !sim.is_alive(index)) {
                    break;
                }
            }
            Err(TaskingError::NoOpportunity { .. } | TaskingError::EndlessStep) => break,
            // Unlimited torques or long ticks make control unstable.
            Err(TaskingError::Diverged { .. }) => break,
            Err(error) => panic!("{error}"),
        }
        check_observations(&mut sim);
    }
    true
}

fn read_setup(options: &mut Options<'_>) -> Setup {
    let seed = Seed::new(u64::from(options.byte())).expect("a byte is a seed");
    let mut rng = SeededRng::new(seed);
    let mut setup = read_environment(options).setup(&mut rng);
    setup.gravity = options.choose([GravityModel::Ggm10, GravityModel::J2, GravityModel::Kepler]);
    setup.full_thrust = options.is_set();
    setup.clock.tick =
        TickLength::from_seconds(options.choose([1.0, 2.0, 0.5, 5.0])).expect("it is in range");
    setup.clock.time_limit_s = options.choose([3000.0, f64::INFINITY, 777.7, 9000.0]);
    setup.clock.max_step_s = options.choose([600.0, 1e9, 33.0, 0.4]);
    setup.clock.terminate_on_time_limit = options.is_set();
    setup.mode = options.choose([EnvironmentMode::General, EnvironmentMode::Constellation]);
    setup.communicator = Communicator {
        links: options.choose([Links::None, Links::Free, Links::LineOfSight]),
        multi_degree: options.is_set(),
        broadcast: options.is_set(),
        min_period_s: options.choose([0.0, 300.0, 1e12]),
    };
    let times = GenerationTimes {
        block_s: options.choose([600.0, 60.0, 1000.0, 0.1]),
        initial_s: options.choose([None, Some(0.0), Some(2000.0), Some(90.0)]),
        max_beyond_s: options.choose([f64::INFINITY, 0.0, 5000.0]),
    };
    for agent in &mut setup.agents {
        agent.variable_interval = options.is_set();
        agent.class = match agent.class {
            SatelliteClass::Plain => SatelliteClass::Plain,
            SatelliteClass::Access(_) => SatelliteClass::Access(times),
            SatelliteClass::Imaging(_) => SatelliteClass::Imaging(times),
        };
        let args = &mut agent.satellite.args;
        args.desat_attitude = options.choose([DesatAttitude::Nadir, DesatAttitude::Sun, DesatAttitude::None]);
        args.wheel_mech_to_elec = options.choose([-1.0, 0.0, 0.5]);
        args.servo_ki = options.number(-1.0, 5.0);
        args.feedback_ki = options.number(-1.0, 1.0);
        args.omega_init_rad_s = [options.number(-0.3, 0.3), 0.0, options.number(-1e-3, 1e-3)];
        args.sigma_init = [options.number(-2.0, 2.0), options.number(0.0, 1.0), 0.0];
        args.storage_valid_check = options.is_set();
        args.transmitter_packet_bits = options.choose([None, Some(1e3), Some(-1.0)]);
        args.target_max_range_m = options.choose([-1.0, 1e6, 0.0]);
        args.link_max_range_m = options.choose([-1.0, 1e6]);
    }
    setup
}

fn read_environment(options: &mut Options<'_>) -> TaskingEnvironment {
    let imaging = ImagingParams {
        targets: 60,
        priority_power: options.number(1.0, 4.0),
        omega_max_rad_s: options.number(0.01, 0.2),
        u_max_n_m: options.number(0.0, 0.5),
        attitude_error: options.number(0.0, 0.1),
        battery_wh: options.number(0.5, 100.0),
        charge_min: 0.0,
        panel_m2: options.number(0.0, 2.0),
        storage_images: u32::from(options.byte() % 20),
        ..ImagingParams::default()
    };
    let scanning = ScanningParams {
        battery_wh: imaging.battery_wh,
        charge_min: 0.0,
        panel_m2: imaging.panel_m2,
        storage_gbit: options.number(0.0, 10.0),
        wheel_rpm: options.number(0.0, 6500.0),
        disturbance_mnm: options.number(0.0, 5.0),
        stations: u32::from(options.byte() % 9),
        ..ScanningParams::default()
    };
    let satellites = 1 + u32::from(options.byte() % 9);
    let spacing_deg = options.number(0.0, 120.0);
    let constellation =
        ConstellationParams { satellites, spacing_deg, imaging, ..ConstellationParams::default() };
    match options.byte() % 3 {
        0 => TaskingEnvironment::Scanning(scanning),
        1 => TaskingEnvironment::Imaging(imaging),
        _ => TaskingEnvironment::Constellation(constellation),
    }
}

/// Actions of all satellites that need one, and now and then of others.
fn read_actions(sim: &TaskingSim, options: &mut Options<'_>) -> Vec<Option<AgentAction>> {
    (0..sim.len())
        .map(|index| {
            let byte = options.byte();
            let acts = sim.needs_action(index) || byte > 200;
            acts.then(|| AgentAction::Index(usize::from(byte) % sim.action_count(index)))
        })
        .collect()
}

/// Runs a step tick by tick, and compares the battery of the first satellite with the sum of its net power.
fn step(sim: &mut TaskingSim, actions: &[Option<AgentAction>]) -> Result<StepResult, TaskingError> {
    let capacity = sim.satellite(0).spec().args.battery_capacity_ws;
    let mut charge = sim.satellite(0).battery_ws();
    let mut before = sim.time_s();
    sim.step_traced(actions, &mut |sim| {
        let satellite = sim.satellite(0);
        if !satellite.is_finite() {
            return;
        }
        // Lengths of ticks are whole numbers of nanoseconds.
        let step_s = sim.time_s() - before;
        before = sim.time_s();
        charge = (charge + satellite.net_power_w() * step_s).clamp(0.0, capacity);
        let difference = (charge - satellite.battery_ws()).abs();
        assert!(difference <= 1e-6 * capacity.max(1.0), "the battery differs by {difference} J");
        charge = satellite.battery_ws();
    })
}

fn check_step(setup: &Setup, sim: &TaskingSim, result: &StepResult) {
    assert!(result.elapsed_s >= 0.0 && result.elapsed_s.is_finite(), "{}", result.elapsed_s);
    for index in 0..sim.len() {
        let satellite = sim.satellite(index);
        let args = &satellite.spec().args;
        let battery = satellite.battery_ws();
        assert!((0.0..=args.battery_capacity_ws).contains(&battery), "battery {battery}");
        let stored: f64 = satellite.stored().iter().sum();
        assert!((0.0..=args.storage_capacity_bits).contains(&stored), "stored {stored}");
        let (reward, penalty) = (result.rewards[index], result.penalties[index]);
        let most = if setup.rewarders.contains(&Rewarder::UniqueImages) { 1.0 } else { result.elapsed_s };
        assert!((0.0..=most).contains(&reward), "reward {reward}");
        assert!(penalty == 0.0 || penalty == setup.failure_penalty, "penalty {penalty}");
    }
}

fn check_observations(sim: &mut TaskingSim) {
    let mut values = Vec::new();
    for index in 0..sim.len() {
        values.clear();
        match sim.observe(index, &mut values) {
            Ok(()) => assert_eq!(values.len(), sim.observation_columns(index).len()),
            Err(TaskingError::NoOpportunity { .. }) => {}
            Err(error) => panic!("{error}"),
        }
        assert!(values.iter().all(|value| value.is_finite()), "{values:?}");
    }
}

/// Bytes drawn at random.
fn episode_seeds() -> Vec<Vec<u8>> {
    (0..40)
        .map(|number| {
            let mut rng = SeededRng::new(Seed::new(number).expect("the number is a seed"));
            (0..200).map(|_| (rng.uniform(RngStream::Policy) * 256.0) as u8).collect::<Vec<u8>>()
        })
        // Some set-ups have a storage without capacity, or satellites without links.
        .filter(|bytes| TaskingSim::new(read_setup(&mut Options(bytes))).is_ok())
        .collect()
}
