//! The search for windows: the quick one against the one that BSK-RL performs, and the windows that BSK-RL loses.

use super::samples::Draws;
use crate::tasking::access::candidates::{Candidate, Crossings, find_candidates};
use crate::tasking::access::trajectory::{SampleRange, SearchedTrajectory};
use crate::tasking::access::window_search::WindowSearch;
use crate::tasking::access::{AccessWindow, Locations};
use crate::tasking::constants::{EARTH_MU, EARTH_RADIUS_M};
use crate::tasking::orbit::{GravityModel, Orbit, OrbitalElements, Sky};
use crate::tasking::vector3::{Vector3, dot, norm, scale, sub};

/// Largest difference of the times of two searches, s.
const SAME_S: f64 = 1e-3;

/// Orbit of a height of the perigee, m, and an eccentricity; the rest is drawn.
fn elements(perigee_m: f64, eccentricity: f64, draws: &mut Draws) -> OrbitalElements {
    let mut angle = |largest: f64| largest * draws.uniform();
    let turn = 2.0 * std::f64::consts::PI;
    OrbitalElements {
        semi_major_axis_m: (EARTH_RADIUS_M + perigee_m) / (1.0 - eccentricity),
        eccentricity,
        inclination_rad: angle(0.5 * turn),
        ascending_node_rad: angle(turn),
        periapsis_rad: angle(turn),
        true_anomaly_rad: angle(turn),
    }
}

fn trajectory(elements: &OrbitalElements, samples: usize) -> SearchedTrajectory {
    let (position, velocity) = elements.state(EARTH_MU);
    let mut sky = Sky::new(0.0);
    let mut orbit = Orbit::new(GravityModel::J2, position, velocity, &sky, 1.0);
    let mut trajectory = SearchedTrajectory::default();
    trajectory.extend_to(samples, &mut orbit, &mut sky);
    trajectory
}

/// Places on the ground, evenly distributed.
fn places(count: usize, draws: &mut Draws) -> Vec<Vector3<f64>> {
    let mut place = || {
        let direction = [0; 3].map(|_| 2.0 * draws.uniform() - 1.0);
        scale(&direction, EARTH_RADIUS_M / norm(&direction))
    };
    (0..count).map(|_| place()).collect()
}

fn are_same(one: Crossings, other: Crossings) -> bool {
    let near = |a: f64, b: f64| (a - b).abs() < SAME_S;
    match (one, other) {
        (Crossings::None, Crossings::None) => true,
        (Crossings::One(a), Crossings::One(b)) => near(a, b),
        (Crossings::Two([a, b]), Crossings::Two([c, d])) => near(a, c) && near(b, d),
        _ => false,
    }
}

/// Compares both searches of all candidates. Returns the share of those that the quick search knows.
fn compare_searches(
    locations: &Locations,
    trajectory: &SearchedTrajectory,
    block: SampleRange,
) -> [usize; 2] {
    let search = WindowSearch::new(locations, trajectory, block);
    let candidates = find_candidates(locations, trajectory, block);
    let mut known = 0;
    for candidate in &candidates {
        if let Some(quick) = search.quick_crossings(candidate) {
            let slow = search.slow_crossings(candidate);
            assert!(are_same(quick, slow), "{candidate:?}: {quick:?}, by BSK-RL's method {slow:?}");
            known += 1;
        }
    }
    [known, candidates.len()]
}

#[test]
fn the_quick_search_finds_what_the_search_of_bsk_rl_finds() {
    let mut draws = Draws::new(11);
    for round in 0..120 {
        let perigee_m = [300e3, 400e3, 500e3, 800e3, 2000e3][draws.index(5)];
        let eccentricity = [0.0, 0.001, 0.01, 0.05, 0.3][draws.index(5)];
        let samples = 4 + draws.index(700);
        let trajectory = trajectory(&elements(perigee_m, eccentricity, &mut draws), samples);
        let degrees: f64 = [0.0, 1.0, 5.0, 10.0, 30.0, 45.0, 60.0, 80.0][draws.index(8)];
        let locations = Locations::new(places(60, &mut draws), degrees.to_radians());
        let first = draws.index(samples / 2);
        let block = if round % 2 == 0 {
            SampleRange { first: 0, last: samples - 1 }
        } else {
            SampleRange { first, last: first + 1 + draws.index(samples - first - 1) }
        };
        compare_searches(&locations, &trajectory, block);
    }
}

#[test]
fn the_quick_search_knows_most_windows_of_targets() {
    let mut draws = Draws::new(12);
    let (mut known, mut all) = (0, 0);
    for _ in 0..10 {
        let trajectory = trajectory(&elements(500e3, 0.0, &mut draws), 571);
        let locations = Locations::new(places(300, &mut draws), 45.0_f64.to_radians());
        let counts = compare_searches(&locations, &trajectory, SampleRange { first: 0, last: 570 });
        known += counts[0];
        all += counts[1];
    }
    assert!(all > 500 && known * 10 > all * 9, "{known} of {all}");
}

/// Times in a range of samples at which samples are above a minimum elevation.
fn visible_samples(
    trajectory: &SearchedTrajectory,
    place: &Vector3<f64>,
    sine: f64,
    range: SampleRange,
) -> Vec<bool> {
    let is_visible = |sample: usize| {
        let away = sub(&trajectory.samples()[sample], place);
        dot(&away, place) / (norm(place) * norm(&away)) > sine
    };
    (range.first..=range.last).map(is_visible).collect()
}

#[test]
fn windows_are_lost_as_in_bsk_rl() {
    // The satellite passes over the place in the middle of the block.
    let elements = OrbitalElements {
        semi_major_axis_m: EARTH_RADIUS_M + 800e3,
        eccentricity: 0.0,
        inclination_rad: 1.0,
        ascending_node_rad: 0.0,
        periapsis_rad: 0.0,
        true_anomaly_rad: 0.0,
    };
    let trajectory = trajectory(&elements, 41);
    let below = trajectory.samples()[20];
    let place = scale(&below, EARTH_RADIUS_M / norm(&below));
    let windows = |degrees: f64, first: usize, last: usize| -> Vec<AccessWindow> {
        let locations = Locations::new(vec![place], degrees.to_radians());
        WindowSearch::new(&locations, &trajectory, SampleRange { first, last }).windows()
    };
    let [whole] = windows(30.0, 0, 40)[..] else { panic!("one pass has one window") };
    assert!((whole.open_s + whole.close_s - 1200.0).abs() < 2.0, "{whole:?}");
    // Visible at both ends of the block: lost.
    assert!(
        visible_samples(&trajectory, &place, 0.5, SampleRange { first: 17, last: 23 }).iter().all(|v| *v)
    );
    assert_eq!(windows(30.0, 17, 23), []);
    // The block ends within the pass, and the candidate begins within the block: the window is cut.
    let [cut] = windows(30.0, 0, 20)[..] else { panic!("the pass begins in the block") };
    assert!((cut.open_s - whole.open_s).abs() < SAME_S && cut.close_s == 600.0, "{cut:?}");
    // The candidate begins with the block: the window is the time before the opening.
    let [before] = windows(30.0, 13, 20)[..] else { panic!("the pass begins in the block") };
    assert!(before.open_s == 390.0 && (before.close_s - whole.open_s).abs() < SAME_S, "{before:?}");
    // A minimum elevation below the horizon has no candidates.
    assert_eq!(windows(-1.0, 0, 40), []);
}

#[test]
fn a_candidate_has_a_sample_more_at_each_end() {
    let mut draws = Draws::new(13);
    let trajectory = trajectory(&elements(600e3, 0.01, &mut draws), 400);
    let places = places(200, &mut draws);
    let locations = Locations::new(places.clone(), 40.0_f64.to_radians());
    let block = SampleRange { first: 31, last: 367 };
    let highest = trajectory.samples()[31..=367].iter().map(norm).fold(0.0, f64::max);
    let near_m = 1.1 * (highest - EARTH_RADIUS_M) / libm::sin(40.0_f64.to_radians());
    let mut expected = Vec::new();
    for (location, place) in places.iter().enumerate() {
        let is_near = |sample: &usize| norm(&sub(&trajectory.samples()[*sample], place)) < near_m;
        let mut sample = 31;
        while let Some(first) = (sample..=367).find(is_near) {
            let last = (first..=367).take_while(is_near).last().unwrap();
            let samples = SampleRange { first: (first - 1).max(31), last: (last + 1).min(367) };
            expected.push(Candidate { location, samples });
            sample = last + 1;
        }
    }
    assert!(expected.len() > 20);
    assert_eq!(find_candidates(&locations, &trajectory, block), expected);
}
