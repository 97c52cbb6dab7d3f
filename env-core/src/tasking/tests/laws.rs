//! Laws that hold in every episode.

use super::samples::{Draws, random_actions, recorded_setups, redraw};
use crate::tasking::clock::TickLength;
use crate::tasking::constants::WHEEL_INERTIA_KG_M2;
use crate::tasking::orbit::OrbitalElements;
use crate::tasking::satellite::TaskedSatellite;
use crate::tasking::setup::Setup;
use crate::tasking::setup::environment::Rewarder;
use crate::tasking::setup::{ArgValue, DynamicsModel, SatelliteArgs, SoftwareModel};
use crate::tasking::simulation::{AgentAction, StepResult, TaskingSim};
use crate::tasking::tick::attitude::body_from_inertial;
use crate::tasking::tick::dispatch::InstructionSet;
use crate::tasking::vector3::{Vector3, norm, rotate_back, sub};

/// Angular momentum of body and wheels in the inertial frame, N·m·s.
fn momentum(satellite: &TaskedSatellite) -> Vector3<f64> {
    let attitude = &satellite.state.attitude;
    let inertia = satellite.spec().args.inertia();
    let in_body =
        [0, 1, 2].map(|i| inertia[i] * attitude.omega[i] + WHEEL_INERTIA_KG_M2 * attitude.wheels[i]);
    rotate_back(&body_from_inertial(&attitude.sigma), &in_body)
}

#[test]
fn angular_momentum_is_conserved_without_torques() {
    let mut setup = recorded_setups().into_iter().find(|setup| setup.agents.len() == 1).unwrap();
    setup.agents[0].satellite.args.disturbance_n_m = [0.0; 3];
    setup.agents[0].satellite.args.omega_init_rad_s = [0.002, -0.001, 0.003];
    // With short ticks, RK4 conserves what the equations conserve.
    setup.clock.tick = TickLength::from_seconds(0.02).unwrap();
    setup.clock.max_step_s = 4.0;
    let mut sim = TaskingSim::new(setup).unwrap();
    let before = momentum(sim.satellite(0));
    sim.step(&[None], InstructionSet::detect()).unwrap();
    let drift = norm(&sub(&momentum(sim.satellite(0)), &before)) / norm(&before);
    assert!(drift < 1e-12, "{drift:e}");
}

#[test]
fn random_episodes_stay_within_bounds() {
    let mut draws = Draws::new(7);
    for base in recorded_setups() {
        let setup = redraw(&base, &mut draws);
        let mut sim = TaskingSim::new(setup.clone()).unwrap();
        for _ in 0..40 {
            let actions = random_actions(&sim, &mut draws);
            let before = resource_values(&setup, &mut sim);
            // A scan without a pass left has no opportunity to observe; steps do not depend on it.
            let result = sim.step(&actions, InstructionSet::detect()).unwrap();
            assert!(result.elapsed_s >= 0.0 && result.elapsed_s.is_finite());
            let after = resource_values(&setup, &mut sim);
            for index in 0..sim.len() {
                assert_bounds(sim.satellite(index));
                assert_reward(&setup, &result, index, [&before[index], &after[index]]);
            }
            if result.truncated {
                break;
            }
        }
    }
}

fn assert_bounds(satellite: &TaskedSatellite) {
    let (state, args) = (&satellite.state, &satellite.spec().args);
    assert!((0.0..=args.battery_capacity_ws).contains(&state.battery), "battery {}", state.battery);
    let stored: f64 = satellite.stored().iter().sum();
    assert!((0.0..=args.storage_capacity_bits).contains(&stored), "stored {stored}");
    assert!(norm(&state.attitude.sigma) <= 1.0 + 1e-12);
    let numbers =
        [state.attitude.sigma, state.attitude.omega, state.attitude.wheels, state.motor, state.command];
    assert!(numbers.iter().flatten().all(|x| x.is_finite()), "{numbers:?}");
    assert!(state.motor.iter().all(|torque| torque.abs() <= args.u_max_n_m), "{:?}", state.motor);
}

/// Values of the rewarded properties of each satellite.
fn resource_values(setup: &Setup, sim: &mut TaskingSim) -> Vec<Vec<f64>> {
    let properties = setup.rewarders.iter().filter_map(|rewarder| match rewarder {
        Rewarder::Resource { property, .. } => Some(*property),
        _ => None,
    });
    let properties: Vec<_> = properties.collect();
    let mut values = vec![Vec::new(); sim.len()];
    for (index, values) in values.iter_mut().enumerate() {
        let moment = sim.moment(index);
        properties.iter().for_each(|property| property.write(&sim.view(index, &moment), values));
    }
    values
}

/// A reward is the changes of resources by their weights, and between nothing and all of what data can pay.
fn assert_reward(setup: &Setup, result: &StepResult, index: usize, [before, after]: [&Vec<f64>; 2]) {
    let mut changes = after.iter().zip(before).map(|(after, before)| after - before);
    let (mut resources, mut most) = (0.0, 0.0);
    for rewarder in &setup.rewarders {
        match rewarder {
            Rewarder::None => {}
            Rewarder::Resource { weight, .. } => resources += weight * changes.next().unwrap(),
            Rewarder::UniqueImages => most += 1.0,
            Rewarder::ScanningTime { value_per_second } => {
                // An image of a tick, of half a second at least, has the data of a second.
                most += 2.0 * value_per_second * result.elapsed_s;
            }
        }
    }
    let paid = result.rewards[index] - resources;
    assert!((-1e-9..=most + 1e-9).contains(&paid), "{paid} beside {resources}, at most {most}");
}

#[test]
fn the_battery_is_the_sum_of_net_power() {
    let mut draws = Draws::new(3);
    for base in recorded_setups().into_iter().filter(|setup| setup.agents.len() == 1).take(6) {
        let mut sim = TaskingSim::new(redraw(&base, &mut draws)).unwrap();
        let step_s = base.clock.tick.seconds();
        for _ in 0..6 {
            let actions = random_actions(&sim, &mut draws);
            let capacity = sim.satellite(0).spec().args.battery_capacity_ws;
            let mut charge = sim.satellite(0).state.battery;
            sim.step_traced(&actions, &mut |sim| {
                let state = &sim.satellite(0).state;
                charge = (charge + state.net_power * step_s).clamp(0.0, capacity);
                assert_eq!(charge.to_bits(), state.battery.to_bits());
            })
            .unwrap();
        }
    }
}

#[test]
fn invalid_actions_change_nothing() {
    let setup = recorded_setups().into_iter().find(|setup| setup.agents.len() == 2).unwrap();
    let mut sim = TaskingSim::new(setup).unwrap();
    let before = sim.state_hash();
    let set = InstructionSet::detect();
    let last = AgentAction::Index(1_000);
    let error = sim.step(&[None, Some(last)], set).unwrap_err().to_string();
    assert!(error.contains("it must be from 0 to"), "{error}");
    assert!(
        sim.step(&[None], set).unwrap_err().to_string().contains("one action for each of the 2 satellites")
    );
    assert_eq!(sim.state_hash(), before);
    assert_eq!(sim.now(), 0);
}

#[test]
fn a_step_that_nothing_ends_is_an_error() {
    let mut setup = recorded_setups().into_iter().find(|setup| setup.agents.len() == 1).unwrap();
    (setup.clock.time_limit_s, setup.clock.max_step_s) = (f64::INFINITY, f64::INFINITY);
    let mut sim = TaskingSim::new(setup).unwrap();
    let error = sim.step(&[None], InstructionSet::detect()).unwrap_err().to_string();
    assert!(error.starts_with("no event ends this step"), "{error}");
    // The end of an action ends no step of a satellite with fixed intervals.
    let mut setup = recorded_setups().into_iter().find(|setup| setup.agents.len() == 1).unwrap();
    (setup.clock.time_limit_s, setup.clock.max_step_s) = (f64::INFINITY, f64::INFINITY);
    setup.agents[0].variable_interval = false;
    let mut sim = TaskingSim::new(setup).unwrap();
    let error = sim.step(&[Some(AgentAction::Index(0))], InstructionSet::detect()).unwrap_err();
    assert!(error.to_string().starts_with("no event ends this step"), "{error}");
}

#[test]
fn orbits_without_a_finite_start_are_rejected() {
    let read = |values: Vec<(&str, ArgValue)>| {
        SatelliteArgs::read(values, DynamicsModel::default(), SoftwareModel::default())
    };
    let elements = |semi_major_axis_m: f64, true_anomaly_rad: f64| {
        ArgValue::Elements(OrbitalElements {
            semi_major_axis_m,
            eccentricity: 0.0,
            inclination_rad: 0.8,
            ascending_node_rad: 0.0,
            periapsis_rad: 0.0,
            true_anomaly_rad,
        })
    };
    assert!(read(vec![("oe", elements(7e6, 0.0))]).is_ok());
    for (axis, anomaly) in [(f64::NAN, 0.0), (-7e6, 0.0), (0.0, 0.0), (f64::INFINITY, 0.0), (7e6, f64::NAN)] {
        let error = read(vec![("oe", elements(axis, anomaly))]).unwrap_err();
        assert!(error.to_string().starts_with("`oe` must start at least 1000 km"), "{error}");
    }
    let state = |position: [f64; 3]| {
        vec![("rN", ArgValue::Numbers(position.to_vec())), ("vN", ArgValue::Numbers(vec![0.0, 7e3, 0.0]))]
    };
    assert!(read(state([7e6, 0.0, 0.0])).is_ok());
    assert!(read(state([0.0; 3])).is_err());
}

#[test]
fn a_time_limit_that_no_tick_reaches_is_refused() {
    let mut setup = recorded_setups().into_iter().find(|setup| setup.agents.len() == 1).unwrap();
    setup.clock.tick = TickLength::from_seconds(1.1).unwrap();
    // BSK-RL's limit is 100 · 1.1 = 110.00000000000001 s, and its last tick is at 110 s.
    setup.clock.time_limit_s = 110.0;
    let error = setup.check().unwrap_err().to_string();
    assert!(error.contains("which no tick reaches"), "{error}");
    setup.clock.time_limit_s = 111.0;
    assert_eq!(setup.check(), Ok(()));
}

#[test]
fn a_storage_with_negative_data_is_empty() {
    for mut setup in recorded_setups().into_iter().take(12) {
        for agent in &mut setup.agents {
            agent.satellite.args.storage_init_bits = -5.0;
        }
        let sim = TaskingSim::new(setup).unwrap();
        assert!((0..sim.len()).all(|index| sim.satellite(index).stored() == [0.0; 2]));
    }
}
