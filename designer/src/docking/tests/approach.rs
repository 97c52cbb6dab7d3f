//! Closed-form quantities agree with the simulation of docking.

use env_core::docking::constants::{DOCKING_RADIUS_M, DOCKING_SPEED_M_S, MASS_KG};
use env_core::docking::relative_motion::{RelativeState, StepTransition, distance, speed, speed_limit};
use proptest::prelude::*;

use crate::angles::angle_between;
use crate::docking::DeputyStart;
use crate::docking::approach::{
    StartApproach, distance_at_limit, excess_for_penalty, nearest_pass, separation_on_arrival,
    step_out_of_bounds, time_at_limit,
};
use crate::docking::vocabulary::{AZIMUTH, CLOSING, CROSS, CROSS_DIRECTION, DISTANCE, ELEVATION};

/// Any deputy within the bounds of the language.
pub(super) fn any_deputy() -> impl Strategy<Value = DeputyStart> {
    let any = |bound: crate::Bound<i32>| bound.min..=bound.max;
    (any(DISTANCE), any(AZIMUTH), any(ELEVATION), any(CLOSING), any(CROSS), any(CROSS_DIRECTION)).prop_map(
        |(distance, azimuth_deg, elevation_deg, closing_speed, cross_speed, cross_deg)| DeputyStart {
            distance,
            azimuth_deg,
            elevation_deg,
            closing_speed,
            cross_speed,
            cross_deg,
        },
    )
}

proptest! {
    /// A state has the distance, the bearing and the speeds that the design says.
    #[test]
    fn state_has_the_geometry_of_its_deputy(deputy in any_deputy()) {
        let state = deputy.state();
        let meters = DISTANCE.value(deputy.distance);
        let limit = speed_limit(meters);
        prop_assert!((distance(&state) - meters).abs() < 1e-9);
        let approach = StartApproach::new(&state, 1.0);
        let closing = CLOSING.value(deputy.closing_speed) / 100.0 * limit;
        prop_assert!((approach.closing - closing).abs() < 1e-9);
        let cross = CROSS.value(deputy.cross_speed) / 100.0 * limit;
        prop_assert!((speed(&state) - (closing * closing + cross * cross).sqrt()).abs() < 1e-9);
        if deputy.elevation_deg.abs() < 90 {
            let azimuth = libm::atan2(state[1], state[0]).to_degrees();
            prop_assert!(angle_between(azimuth, AZIMUTH.value(deputy.azimuth_deg)) < 1e-9);
        }
    }

    #[test]
    fn distance_at_limit_inverts_the_time(meters in 0.6f64..2000.0) {
        let back = distance_at_limit(time_at_limit(meters));
        prop_assert!((back - meters).abs() < 1e-6 * meters, "{back}");
    }

    #[test]
    fn excess_inverts_the_penalty(penalty in 0.1f64..4.0, thrust in 0.05f64..1.0) {
        let excess = excess_for_penalty(penalty, thrust / MASS_KG);
        let start = DeputyStart {
            distance: 1000, azimuth_deg: 0, elevation_deg: 0, closing_speed: 0, cross_speed: 0, cross_deg: 0,
        };
        let mut state = start.state();
        state[4] = speed_limit(100.0) + excess;
        let approach = StartApproach::new(&state, thrust);
        prop_assert!((approach.braking_penalty() - penalty).abs() < 1e-9);
    }
}

/// Advances a deputy without the relative motion of orbits: a straight line to the chief.
fn fly(mut way: f64, speeds: impl Fn(f64) -> f64) -> f64 {
    let mut seconds = 0.0;
    while way > DOCKING_RADIUS_M {
        way -= 0.01 * speeds(way);
        seconds += 0.01;
    }
    seconds
}

#[test]
fn time_at_limit_is_that_of_a_straight_flight() {
    for meters in [5.0, 60.0, 150.0, 900.0] {
        let (flown, closed) = (fly(meters, speed_limit), time_at_limit(meters));
        assert!((flown - closed).abs() < 0.1, "{meters}: {flown} {closed}");
    }
}

/// From rest, a deputy that accelerates at full thrust along one axis until the limit needs about the time of the closed form.
#[test]
fn needed_time_contains_the_acceleration() {
    let deputy = DeputyStart {
        distance: 1500,
        azimuth_deg: 90,
        elevation_deg: 0,
        closing_speed: 0,
        cross_speed: 0,
        cross_deg: 0,
    };
    let acceleration = 0.1 / MASS_KG;
    let approach = StartApproach::new(&deputy.state(), 0.1);
    let (mut way, mut velocity, mut seconds) = (150.0_f64, 0.0_f64, 0.0_f64);
    while way > DOCKING_RADIUS_M {
        velocity = f64::min(velocity + 0.01 * acceleration, speed_limit(way));
        way -= 0.01 * velocity;
        seconds += 0.01;
    }
    let closed = approach.needed_time();
    // The limit falls while the deputy accelerates, so that it is reached a little earlier.
    assert!(seconds <= closed && closed < 1.03 * seconds, "{seconds} {closed}");
}

/// A deputy that brakes with the share of its way that the closed form says reaches the chief at the docking speed.
#[test]
fn braking_share_is_the_way_that_braking_takes() {
    let (closing, way, thrust): (f64, f64, f64) = (0.8, 60.0, 0.1);
    let state: RelativeState = [0.0, way, 0.0, 0.0, -closing, 0.0];
    let share = StartApproach::new(&state, thrust).braking_share();
    let mut braked = (way - DOCKING_RADIUS_M) * share;
    let mut velocity = closing;
    while braked > 0.0 && velocity > DOCKING_SPEED_M_S {
        braked -= 0.001 * velocity;
        velocity -= 0.001 * thrust / MASS_KG;
    }
    assert!((velocity - DOCKING_SPEED_M_S).abs() < 0.01, "{velocity}");
    let receding: RelativeState = [0.0, way, 0.0, 0.0, closing, 0.0];
    assert_eq!(StartApproach::new(&receding, thrust).braking_share(), 0.0);
}

#[test]
fn coasting_deputies_meet_where_the_simulation_says() {
    // Two deputies fly towards the middle between them.
    let a: RelativeState = [0.0, 80.0, 10.0, 0.0, 0.0, -0.25];
    let b: RelativeState = [0.0, 80.0, -10.0, 0.0, 0.0, 0.25];
    let pass = nearest_pass(&a, &b, 100);
    assert!(pass.separation < 0.5 && (38..=42).contains(&pass.step), "{pass:?}");
    let mut states = [a, b];
    for _ in 0..pass.step {
        states = states.map(|state| StepTransition::world_step().advance(&state, [0.0; 3]));
    }
    let apart = env_core::docking::relative_motion::separation(&states[0], &states[1]);
    assert!((apart - pass.separation).abs() < 1e-9);
    assert_eq!(nearest_pass(&a, &b, 0).step, 0);
}

#[test]
fn arrivals_at_one_time_from_near_directions_conflict() {
    let approach = |meters: f64| StartApproach::new(&[meters, 0.0, 0.0, 0.0, 0.0, 0.0], 1.0);
    let separation = |angle_deg: f64| separation_on_arrival(&approach(100.0), &approach(100.0), angle_deg);
    // At the docking radius, two lines at 60° are one radius apart.
    assert!((separation(60.0) - DOCKING_RADIUS_M).abs() < 1e-9);
    assert!(separation(20.0) < 0.2 && separation(180.0) > 0.9);
    let late = separation_on_arrival(&approach(100.0), &approach(120.0), 0.0);
    assert!(late > 3.0, "{late}");
}

#[test]
fn departure_leads_out_of_bounds() {
    let leaving: RelativeState = [900.0, 0.0, 0.0, 10.0, 0.0, 0.0];
    let step = step_out_of_bounds(&leaving, 1500).unwrap();
    let mut state = leaving;
    for _ in 0..step {
        state = StepTransition::world_step().advance(&state, [0.0; 3]);
    }
    assert!(distance(&state) > 10_000.0);
    assert_eq!(step_out_of_bounds(&leaving, step - 1), None);
}
