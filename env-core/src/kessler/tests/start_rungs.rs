//! Start rungs of the rendezvous task: starts near the target radius.

use super::staging::start_sim;
use crate::admission::{SuccessRule, admit, is_success};
use crate::kessler::KESSLER_TASKS;
use crate::kessler::constants::{GM, TARGET_RADIUS};
use crate::rollout::roll_out;
use crate::task::{Recipe, Scenario, TaskSpec};
use crate::testing::at_level;

const RENDEZVOUS: &str = "kessler/rendezvous";

fn scaled(level: usize, scale: f64, seed: u64) -> Scenario {
    let full = at_level(RENDEZVOUS, level, seed);
    let recipe = Recipe::clone(full.recipe()).with_param("start_scale", scale).unwrap();
    Scenario::new(recipe, full.seed())
}

#[test]
fn only_rendezvous_has_start_rungs() {
    for task in &KESSLER_TASKS {
        let rungs = task.start_rungs();
        assert_eq!(!rungs.is_empty(), task.id() == RENDEZVOUS);
        assert_eq!(task.params().iter().any(|param| param.name == "start_scale"), task.id() == RENDEZVOUS);
        for (rung, scale) in rungs.iter().enumerate() {
            let exact = libm::pow(0.05, 1.0 - rung as f64 / (rungs.len() - 1) as f64);
            assert!((scale / exact - 1.0).abs() < 0.005, "{scale} {exact}");
        }
    }
}

/// Satellite 0 starts on a circular orbit nearer to its target; all other draws stay.
#[test]
fn scaled_starts_move_satellite_0_only() {
    for (level, seed) in (0..10).zip(40..) {
        let full = start_sim(&scaled(level, 1.0, seed));
        assert_eq!(scaled(level, 1.0, seed).id(), at_level(RENDEZVOUS, level, seed).id());
        for scale in [0.01, 0.3, 0.9] {
            let near = start_sim(&scaled(level, scale, seed));
            let [first, second, third] = near.satellites().map(|s| s.body);
            let [whole, others @ ..] = full.satellites().map(|s| s.body);
            assert_eq!([second, third], others);
            let radius = TARGET_RADIUS + (whole.radius() - TARGET_RADIUS) * scale;
            assert!((first.radius() - radius).abs() < 1e-9);
            assert!((first.radius() * (first.vx * first.vx + first.vy * first.vy) - GM).abs() < 1e-9);
            assert!((first.x * whole.y - first.y * whole.x).abs() < 1e-9, "the same direction");
        }
    }
}

/// The reference succeeds at every rung, and at the easiest one holding succeeds too where debris is sparse.
#[test]
fn success_is_reachable_on_every_rung() {
    let task = &KESSLER_TASKS[2];
    for (rung, scale) in task.start_rungs().iter().enumerate() {
        let (mut reached, mut held) = (0, 0);
        for level in [0, 3, 5] {
            for seed in 0..6 {
                let scenario = scaled(level, *scale, 700 + seed);
                let admission = admit(&scenario);
                let bracket = admission.bracket.unwrap();
                let succeeds = |outcome| is_success(&scenario, SuccessRule::Task, &bracket, outcome);
                reached += u32::from(succeeds(&bracket.reference));
                let mut hold = task.policy("hold", &scenario, 0).unwrap();
                let outcome = roll_out(&scenario, hold.as_mut()).unwrap().outcome;
                held += u32::from(succeeds(&outcome));
            }
        }
        assert!(reached >= 15, "rung {rung}: {reached} of 18");
        assert!(if rung == 0 { held > 0 } else { held <= 9 }, "rung {rung}: hold {held} of 18");
    }
}
