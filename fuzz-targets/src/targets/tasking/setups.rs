//! Set-ups of episodes from any options.

use env_core::Seed;
use env_core::episode_rng::SeededRng;
use env_core::tasking::clock::TickLength;
use env_core::tasking::environments::{
    ConstellationParams, ImagingParams, ScanningParams, TaskingEnvironment,
};
use env_core::tasking::observation::property::Property;
use env_core::tasking::orbit::GravityModel;
use env_core::tasking::setup::Setup;
use env_core::tasking::setup::environment::{
    Communicator, EnvironmentMode, GenerationTimes, Links, Rewarder,
};
use env_core::tasking::simulation::TaskingSim;

use super::agents::change_agent;
use super::options::ByteOptions;

/// True if the set-up of these bytes is valid.
pub(super) fn is_valid(bytes: &[u8]) -> bool {
    TaskingSim::new(read_setup(&mut ByteOptions(bytes))).is_ok()
}

pub(super) fn read_setup(options: &mut ByteOptions<'_>) -> Setup {
    let seed = Seed::new(u64::from(options.byte())).expect("a byte is a seed");
    let mut rng = SeededRng::new(seed);
    let mut setup = read_environment(options).setup(&mut rng);
    setup.gravity = options.choose([GravityModel::Ggm10, GravityModel::J2, GravityModel::Kepler]);
    setup.full_thrust = options.is_set();
    setup.clock.tick =
        TickLength::from_seconds(options.choose([1.0, 2.0, 0.5, 5.0])).expect("it is in range");
    setup.clock.time_limit_s = options.choose([3000.0, f64::INFINITY, 777.7, 9000.0, 20.0, 301.0]);
    setup.clock.max_step_s = options.choose([600.0, 1e9, 33.0, 0.4]);
    setup.clock.terminate_on_time_limit = options.is_set();
    setup.mode = options.choose([EnvironmentMode::General, EnvironmentMode::Constellation]);
    setup.communicator = Communicator {
        links: options.choose([Links::None, Links::Free, Links::LineOfSight]),
        multi_degree: options.is_set(),
        broadcast: options.is_set(),
        min_period_s: options.choose([0.0, 0.0, 300.0, 1e12]),
    };
    setup.rewarders = read_rewarders(options, setup.rewarders);
    let times = GenerationTimes {
        block_s: options.choose([600.0, 60.0, 1000.0, 0.1]),
        initial_s: options.choose([None, Some(0.0), Some(2000.0), Some(90.0)]),
        max_beyond_s: options.choose([f64::INFINITY, 0.0, 5000.0]),
    };
    let needs_links = setup.communicator.links == Links::LineOfSight && options.byte() > 20;
    let is_limited = setup.clock.time_limit_s.is_finite();
    for agent in &mut setup.agents {
        change_agent(agent, times, is_limited, options);
        agent.satellite.dynamics.line_of_sight |= needs_links;
    }
    setup
}

/// Rules of the rewards: those of the environment, none, others, or several.
fn read_rewarders(options: &mut ByteOptions<'_>, own: Vec<Rewarder>) -> Vec<Rewarder> {
    let kind = options.byte() % 7;
    let mut resource = || Rewarder::Resource {
        property: Property::ALL[options.index(Property::ALL.len())],
        weight: options.number(-5.0, 5.0),
    };
    let scanning = Rewarder::ScanningTime { value_per_second: 0.01 };
    match kind {
        0 => vec![Rewarder::None],
        1 => vec![resource()],
        2 => vec![Rewarder::UniqueImages, resource()],
        3 => vec![scanning, Rewarder::UniqueImages],
        4 => vec![resource(), scanning, resource(), Rewarder::None],
        5 => Vec::new(),
        _ => own,
    }
}

fn read_environment(options: &mut ByteOptions<'_>) -> TaskingEnvironment {
    let imaging = ImagingParams {
        targets: 60,
        are_cities: options.is_set(),
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
