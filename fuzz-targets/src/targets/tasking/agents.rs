//! Satellites of any models, classes, arguments, actions and observations.

use env_core::tasking::access::OpportunityKind;
use env_core::tasking::observation::opportunity::OpportunityProperty;
use env_core::tasking::observation::property::Property;
use env_core::tasking::observation::spec::{Normalised, ObservationItem, ObservationSpec};
use env_core::tasking::setup::actions::{ActionSpec, SoftwareAction, UNLIMITED_S};
use env_core::tasking::setup::environment::{AgentSetup, GenerationTimes, SatelliteClass};
use env_core::tasking::setup::{DesatAttitude, DynamicsModel, SoftwareModel};

use super::options::ByteOptions;

/// Dynamics models, of which some are composed of several.
const DYNAMICS: [&[&str]; 7] = [
    &["BasicDynamicsModel"],
    &["LOSCommDynModel"],
    &["ImagingDynModel"],
    &["GroundStationDynModel"],
    &["ContinuousImagingDynModel"],
    &["ContinuousImagingDynModel", "GroundStationDynModel"],
    &["FullFeaturedDynModel"],
];
/// Names of the flight software models.
const SOFTWARE: [&str; 5] = [
    "BasicFSWModel",
    "SteeringFSWModel",
    "ImagingFSWModel",
    "SteeringImagerFSWModel",
    "ContinuousImagingFSWModel",
];

/// Changes a satellite of an environment: its arguments, and for some everything else. `is_limited` is true if the episode has a
/// time limit.
pub(super) fn change_agent(
    agent: &mut AgentSetup,
    times: GenerationTimes,
    is_limited: bool,
    options: &mut ByteOptions<'_>,
) {
    agent.variable_interval = options.is_set();
    agent.class = match agent.class {
        SatelliteClass::Plain => SatelliteClass::Plain,
        SatelliteClass::Access(_) => SatelliteClass::Access(times),
        SatelliteClass::Imaging(_) => SatelliteClass::Imaging(times),
    };
    change_args(agent, options);
    if options.is_set() {
        agent.class = options.choose([
            SatelliteClass::Plain,
            SatelliteClass::Access(times),
            SatelliteClass::Imaging(times),
            SatelliteClass::Imaging(times),
        ]);
        change_models(agent, options);
        agent.actions = read_actions(agent, options);
        agent.observation = read_observation(agent, is_limited, options);
    }
}

fn change_args(agent: &mut AgentSetup, options: &mut ByteOptions<'_>) {
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

/// Draws models that fit together; flight software may need less than its dynamics have.
fn change_models(agent: &mut AgentSetup, options: &mut ByteOptions<'_>) {
    let names = options.choose(DYNAMICS);
    let dynamics = DynamicsModel::compose(names.iter().copied()).expect("the names are known");
    let fitting = match (dynamics.instrument, dynamics.continuous) {
        (false, _) => &SOFTWARE[..2],
        (true, false) => &SOFTWARE[..4],
        (true, true) => &SOFTWARE[..],
    };
    let name = fitting[options.index(fitting.len())];
    agent.satellite.dynamics = dynamics;
    agent.satellite.software = SoftwareModel::compose([name]).expect("the name is known");
}

/// Draws one to five actions that the models have.
fn read_actions(agent: &AgentSetup, options: &mut ByteOptions<'_>) -> Vec<ActionSpec> {
    let (dynamics, software) = (agent.satellite.dynamics, agent.satellite.software);
    let mut functions = vec!["action_charge", "action_desat", "action_nadir_point", "action_drift"];
    if software.imaging {
        functions.push("action_downlink");
    }
    if software.continuous {
        functions.push("action_nadir_scan");
    }
    let has_images = software.imaging && !dynamics.continuous;
    let has_images = has_images && matches!(agent.class, SatelliteClass::Imaging(_));
    let count = 1 + options.index(5);
    (0..count)
        .map(|number| {
            let duration_s = options.choose([60.0, 20.0, 1.0, 180.0, 700.0, UNLIMITED_S]);
            match options.byte() % 4 {
                0 => ActionSpec::Broadcast { name: format!("broadcast {number}"), duration_s },
                1 if has_images => ActionSpec::Image {
                    name: format!("image {number}"),
                    targets: 1 + options.index(4),
                    max_duration_s: duration_s,
                },
                _ => {
                    let function = functions[options.index(functions.len())];
                    ActionSpec::Software {
                        name: format!("{function} {number}"),
                        action: SoftwareAction::from_function(function).expect("the name is known"),
                        duration_s,
                        reset_task: options.is_set(),
                    }
                }
            }
        })
        .collect()
}

/// Draws up to four items of an observation.
fn read_observation(agent: &AgentSetup, is_limited: bool, options: &mut ByteOptions<'_>) -> ObservationSpec {
    let has_opportunities = !matches!(agent.class, SatelliteClass::Plain);
    let count = options.index(5);
    let items = (0..count).map(|_| {
        let norm = options.choose([1.0, 5700.0, 0.5, -3.0]);
        let item = match options.byte() % 5 {
            0 => ObservationItem::Eclipse { norm_s: norm },
            1 => ObservationItem::ResourceWeights { norm },
            2 => ObservationItem::Time {
                norm_s: options.choose([None, Some(norm)]),
                // The remaining time of an episode without a limit is infinite.
                is_remaining: is_limited && options.is_set(),
            },
            3 if has_opportunities => ObservationItem::Opportunities {
                kind: options.choose([OpportunityKind::Target, OpportunityKind::GroundStation]),
                count: 1 + options.index(4),
                properties: (0..=options.index(4))
                    .map(|_| options.choose(OpportunityProperty::ALL))
                    .map(|property| Normalised::new(property, property.name(), norm))
                    .collect(),
            },
            _ => ObservationItem::Properties(
                (0..=options.index(6))
                    .map(|_| Property::ALL[options.index(Property::ALL.len())])
                    .map(|property| Normalised::new(property, property.name(), norm))
                    .collect(),
            ),
        };
        ("item".to_owned(), item)
    });
    ObservationSpec::new(items.collect())
}
