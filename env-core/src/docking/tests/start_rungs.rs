//! Start rungs: starts near the chief with shorter time limits.

use super::at_level;
use crate::admission::admit;
use crate::docking::DOCKING_TASKS;
use crate::docking::relative_motion::{distance, speed, speed_limit};
use crate::docking::setup::{DeputyStarts, DockingSetup};
use crate::episode_rng::SeededRng;
use crate::log::{ActionLog, Precision};
use crate::rollout::{replay, roll_out};
use crate::task::{Recipe, Scenario, TaskSpec};

/// A scenario of a level at a start scale.
fn scaled(task: &str, level: usize, scale: f64, seed: u64) -> Scenario {
    let full = at_level(task, level, seed);
    let recipe = Recipe::clone(full.recipe()).with_param("start_scale", scale).unwrap();
    Scenario::new(recipe, full.seed())
}

fn starts(scenario: &Scenario) -> (DockingSetup, DeputyStarts) {
    let setup = DockingSetup::read(scenario.recipe()).unwrap();
    let start = setup.sample_starts(&mut SeededRng::new(scenario.seed())).unwrap();
    (setup, start)
}

#[test]
fn rungs_are_geometric_and_end_at_the_full_start() {
    for task in &DOCKING_TASKS {
        let rungs = task.start_rungs();
        assert_eq!((rungs.len(), rungs[15]), (16, 1.0));
        for (rung, scale) in rungs.iter().enumerate() {
            let exact = libm::pow(0.01, 1.0 - rung as f64 / 15.0);
            assert!((scale / exact - 1.0).abs() < 0.005, "{scale} {exact}");
        }
    }
}

/// Distances, speeds and time limits follow the formulas, and directions stay.
#[test]
fn scaled_starts_keep_directions_and_shrink_the_rest() {
    for task in ["docking/single", "docking/multiagent"] {
        for (level, seed) in (0..10).zip(100..) {
            let (_, full) = starts(&at_level(task, level, seed));
            for scale in [0.01, 0.05, 0.2, 0.7] {
                let scenario = scaled(task, level, scale, seed);
                let (setup, start) = starts(&scenario);
                let farthest = start.states[..start.deputies].iter().map(distance).fold(0.0, f64::max);
                let limit = libm::ceil(10.0 * farthest).max(40.0).min(f64::from(setup.recipe_time_limit));
                assert_eq!(f64::from(start.time_limit), limit);
                // Deputies that were drawn again, because they started too near each other, have other draws.
                for (near, far) in start.states.iter().zip(&full.states).take(1) {
                    let (d, whole) = (distance(near), distance(far));
                    assert!((d - (scale * whole).max(0.8)).abs() < 1e-9, "{d} {whole}");
                    (0..3).for_each(|axis| assert!((near[axis] / d - far[axis] / whole).abs() < 1e-12));
                    let ratio = (4.0 * scale).min(1.0) * speed(far) / speed_limit(whole);
                    assert!((speed(near) / speed_limit(d) - ratio).abs() < 1e-12);
                }
                // The space of observations and logs is that of the level.
                assert_eq!(DOCKING_TASKS[0].horizon(scenario.recipe()), setup.recipe_time_limit);
            }
        }
    }
}

/// A scale of one is the original start, to the bit and to the id.
#[test]
fn full_scale_is_no_scale() {
    for task in ["docking/single", "docking/multiagent"] {
        let (one, none) = (scaled(task, 5, 1.0, 8), at_level(task, 5, 8));
        assert_eq!((one.id(), starts(&one).1), (none.id(), starts(&none).1));
    }
}

/// Coasting ends at the episode's own limit, in a batch as in an episode, and its log replays.
#[test]
fn scaled_time_limits_end_episodes() {
    let scenario = scaled("docking/single", 3, 0.05, 12);
    let (_, start) = starts(&scenario);
    let mut policy = DOCKING_TASKS[0].policy("hold", &scenario, 0).unwrap();
    let flown = roll_out(&scenario, policy.as_mut()).unwrap();
    assert_eq!(flown.outcome.steps, start.time_limit);
    assert!(start.time_limit < 200);
    assert_eq!(replay(&scenario, &flown.log).unwrap(), flown.outcome);
    let mut short = ActionLog::new(3, Precision::F64);
    (1..start.time_limit).for_each(|_| short.end_step());
    assert!(replay(&scenario, &short).is_err());
}

/// The reference docks nearly always on every rung of every level, up to the limits of the level itself.
#[test]
fn success_is_reachable_on_every_rung() {
    for task in &DOCKING_TASKS {
        let rungs = task.start_rungs();
        let mut docked = vec![0; rungs.len()];
        for (rung, scale) in rungs.iter().enumerate() {
            for level in 0..10 {
                for seed in 0..4 {
                    let scenario = scaled(task.id(), level, *scale, 500 + seed);
                    let admission = admit(&scenario);
                    docked[rung] += u32::from(admission.contested);
                }
            }
        }
        assert!(docked.iter().all(|&docked| docked >= 38), "{}: {docked:?} of 40", task.id());
    }
}
