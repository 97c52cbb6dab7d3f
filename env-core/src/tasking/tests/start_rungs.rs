//! Start rungs: shorter episodes with fuller batteries.

use crate::admission::admit;
use crate::log::{ActionLog, Precision};
use crate::rollout::{replay, roll_out};
use crate::seed::Seed;
use crate::task::{Recipe, Scenario, TaskSpec};
use crate::tasking::task::TASKING_TASKS;
use crate::tasking::task::telemetry::TaskingTelemetry;

fn scaled(task: &'static dyn TaskSpec, level: usize, scale: f64, seed: u64) -> Scenario {
    let params = task.levels().params(level).chain([("start_scale", scale)]);
    Scenario::new(Recipe::with_params(task, params).unwrap(), Seed::user(seed).unwrap())
}

fn tasks() -> impl Iterator<Item = &'static dyn TaskSpec> {
    TASKING_TASKS.iter().map(|task| task as &dyn TaskSpec)
}

/// Observation of a scenario at its start.
fn start(scenario: &Scenario) -> TaskingTelemetry {
    let episode = scenario.task().start(scenario).unwrap();
    serde_json::from_value(episode.telemetry()).unwrap()
}

#[test]
fn rungs_are_geometric_and_end_at_the_full_start() {
    for task in tasks() {
        let rungs = task.start_rungs();
        let last = rungs.len() - 1;
        assert_eq!(rungs[last], 1.0);
        for (rung, scale) in rungs.iter().enumerate() {
            let exact = libm::pow(rungs[0], 1.0 - rung as f64 / last as f64);
            assert!((scale / exact - 1.0).abs() < 0.001, "{scale} {exact}");
        }
    }
}

/// The limit, the missing charge, the data and the speeds of the wheels shrink, and the horizon stays.
#[test]
fn scaled_starts_are_shorter_and_fuller() {
    for task in tasks() {
        for (level, seed) in [(0, 7), (4, 8), (9, 9)] {
            let (full, half) = (scaled(task, level, 1.0, seed), scaled(task, level, 0.5, seed));
            let (whole, part) = (start(&full), start(&half));
            assert_eq!(part.time_limit_s, libm::ceil(0.5 * whole.time_limit_s));
            assert_eq!(task.horizon(half.recipe()), task.horizon(full.recipe()));
            let scans = task.id() == "tasking/scanning";
            for (whole, part) in whole.satellites.iter().zip(&part.satellites) {
                assert!((1.0 - part.battery - 0.5 * (1.0 - whole.battery)).abs() < 1e-9);
                let share = if scans { 0.5 } else { 1.0 };
                assert!((part.storage - share * whole.storage).abs() < 1e-9);
                let wheels = part.wheels.iter().zip(&whole.wheels);
                assert!(wheels.clone().all(|(part, whole)| (part - share * whole).abs() < 1e-9));
                assert!(wheels.count() == 3);
            }
        }
    }
}

/// A scale of one is the original start, to the id.
#[test]
fn full_scale_is_no_scale() {
    for task in tasks() {
        let levels = task.levels().params(5);
        let without = Scenario::new(Recipe::with_params(task, levels).unwrap(), Seed::user(8).unwrap());
        assert_eq!(scaled(task, 5, 1.0, 8).id(), without.id());
    }
}

/// An episode ends at its own limit, in a batch as alone, and its log replays.
#[test]
fn scaled_time_limits_end_episodes() {
    let task = &TASKING_TASKS[0];
    let scenario = scaled(task, 2, 0.05, 12);
    let mut policy = task.policy("blind", &scenario, 0).unwrap();
    let flown = roll_out(&scenario, policy.as_mut()).unwrap();
    let shortest = start(&scenario).time_limit_s;
    assert_eq!(shortest, libm::ceil(0.05 * 28_500.0));
    assert!((8..=30).contains(&flown.outcome.steps), "{} steps of at most 180 s", flown.outcome.steps);
    assert_eq!(replay(&scenario, &flown.log).unwrap(), flown.outcome);
    let mut short = ActionLog::new(1, Precision::F64);
    short.end_step();
    assert!(replay(&scenario, &short).is_err());
}

/// Nearly every scenario of a rung is contested and can be solved, from the first rung on.
#[test]
fn success_is_reachable_on_the_first_rungs() {
    for task in tasks() {
        for scale in &task.start_rungs()[..2] {
            let contested = |level: usize| {
                let scenarios = (0..2).map(|seed| scaled(task, level, *scale, 500 + seed));
                scenarios.filter(|scenario| admit(scenario).contested).count()
            };
            let contested: usize = (0..10).map(contested).sum();
            assert!(contested >= 17, "{} {scale}: {contested} of 20", task.id());
        }
    }
}
