//! Tests of the planners.

use std::rc::Rc;
use std::sync::Arc;

use super::coarse::CoarseState;
use super::constellation::plan_all;
use super::flight::{Pilot, best_index, fly_all};
use super::image_beam::{Beam, Effort, TargetBook, Worth};
use super::image_plan::imager_state;
use super::image_sky::ImageSky;
use super::imaging::usual_rate;
use super::scan_pilot::ScanPilot;
use super::scanning::ScanPlans;
use super::slots::SlotTable;
use super::{fly_candidates, imaging, scanning, threshold_rules};
use crate::log::ActionLog;
use crate::rollout::step_through;
use crate::seed::Seed;
use crate::task::{Recipe, Scenario, TaskSpec};
use crate::tasking::task::TASKING_TASKS;
use crate::tasking::task::run::TaskRun;
use crate::tasking::task::spaces::IMAGE_ACTIONS;
use crate::tasking::task::task_setup::TaskSetup;

/// A scenario of a task at a level, with some params replaced.
fn scenario(task: usize, level: usize, seed: u64, params: &[(&str, f64)]) -> Scenario {
    let task: &'static dyn TaskSpec = &TASKING_TASKS[task];
    let levels = task.levels().params(level);
    let kept = levels.filter(|(name, _)| !params.iter().any(|(replaced, _)| replaced == name));
    let recipe = Recipe::with_params(task, kept.chain(params.iter().copied())).unwrap();
    Scenario::new(Arc::new(recipe), Seed::user(seed).unwrap())
}

fn start(scenario: &Scenario) -> TaskRun {
    let mut run = TaskRun::start(TaskSetup::read(scenario.recipe()).unwrap(), scenario.seed()).unwrap();
    run.sim.compute_station_windows();
    run
}

/// A constellation of a short episode.
fn constellation(level: usize, seed: u64) -> Scenario {
    scenario(2, level, seed, &[("satellites", 3.0), ("time_limit_s", 4000.0)])
}

#[test]
fn coarse_scores_are_near_flown_ones() {
    let mut errors = Vec::new();
    for level in [0, 3, 6, 9] {
        for seed in 0..3 {
            let run = start(&scenario(0, level, seed, &[]));
            let table = Rc::new(SlotTable::new(&run));
            let ScanPlans { candidates, swapped } =
                scanning::plan(&table, &CoarseState::of(run.sim.satellite(0)));
            let mut plans = vec![swapped];
            plans.extend(candidates.into_iter().take(3).map(|candidate| candidate.plan));
            let scores: Vec<f64> = plans.iter().map(|plan| plan.score).collect();
            let pilot = |plan| Box::new(ScanPilot { table: Rc::clone(&table), plan }) as Box<dyn Pilot>;
            let flown = fly_all(&run, plans.into_iter().map(pilot).collect());
            errors.extend(flown.iter().zip(scores).map(|(flown, score)| (flown.outcome.score - score).abs()));
        }
    }
    errors.sort_by(f64::total_cmp);
    let share = |limit: f64| errors.partition_point(|error| *error < limit) as f64 / errors.len() as f64;
    assert!(share(0.02) >= 0.5 && share(0.05) >= 0.85, "{errors:?}");
}

#[test]
fn slew_times_are_near_flown_ones() {
    for level in [0, 4, 7, 9] {
        let mut run = start(&scenario(1, level, 5, &[("time_limit_s", 9000.0)]));
        let sky = ImageSky::new(&run);
        let mut book = TargetBook::new(run.sim.targets().len());
        let rate = usual_rate(&run);
        let mut beam = Beam::new(Effort { width: 2, slots: 8 }, Worth { rate, power_w: 1e9 }, 0.05);
        let mut errors: Vec<f64> = Vec::new();
        while !run.is_done() {
            let state = imager_state(&mut run);
            let firsts = beam.search(&sky, &book, state).to_vec();
            let best = firsts.iter().find(|first| first.action < IMAGE_ACTIONS).unwrap_or(&firsts[0]);
            let chosen = run.choose(|_| Some(best.action));
            run.step(&chosen);
            for [_, target] in run.last_step().imaged.clone() {
                book.known_from_s[target] = 0.0;
                errors.push(run.sim.time_s() - best.after.time_s);
            }
        }
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        let square = errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64;
        assert!(errors.len() > 20, "level {level}: {} images", errors.len());
        assert!(mean.abs() < 15.0 && square.sqrt() < 30.0, "level {level}: mean {mean}, {}", square.sqrt());
    }
}

#[test]
fn references_are_at_least_rules_and_blind_plans() {
    for (task, level, params) in [
        (0, 1, &[][..]),
        (0, 4, &[]),
        (0, 8, &[]),
        (1, 0, &[]),
        (1, 5, &[]),
        (2, 3, &[("satellites", 3.0), ("time_limit_s", 6000.0)]),
    ] {
        for seed in 20..22 {
            let scenario = scenario(task, level, seed, params);
            let run = start(&scenario);
            let bracket = scenario.task().bracket(&scenario).unwrap();
            assert_eq!(bracket.reference.lost, 0, "{task} {level} {seed}");
            assert!(bracket.reference.score >= bracket.floor, "{task} {level} {seed}");
            let rules = threshold_rules::all().into_iter().map(|rule| Box::new(rule) as Box<dyn Pilot>);
            let flown = fly_all(&run, rules.collect());
            let best = flown[best_index(&flown)].outcome.score;
            assert!(bracket.reference.score >= best, "{task} {level} {seed}: {best} {:?}", bracket.reference);
        }
    }
}

#[test]
fn equal_scenarios_have_equal_plans() {
    let scenarios =
        [scenario(0, 5, 3, &[("time_limit_s", 9000.0)]), scenario(1, 5, 3, &[]), constellation(4, 3)];
    for scenario in scenarios {
        let here = scenario.task().bracket(&scenario).unwrap();
        let other = scenario.clone();
        let there = std::thread::spawn(move || other.task().bracket(&other).unwrap()).join().unwrap();
        assert_eq!(here, there);
    }
}

#[test]
fn no_target_is_imaged_by_two_satellites() {
    for seed in 0..2 {
        let scenario = constellation(5, seed);
        let run = start(&scenario);
        let plans = plan_all(&run);
        let mut planned: Vec<usize> =
            plans.iter().flat_map(|plan| plan.images.iter().map(|image| image.target)).collect();
        let count = planned.len();
        planned.sort_unstable();
        planned.dedup();
        assert_eq!(planned.len(), count, "a target is in two plans");
        let flown = fly_candidates(&run, Vec::new());
        let imaged = images(&run, &flown[best_index(&flown)].log);
        assert!(imaged.len() * 20 >= count * 19, "{} of {count} planned images were flown", imaged.len());
        let mut unique = imaged.clone();
        unique.sort_unstable();
        unique.dedup();
        assert!(imaged.len() - unique.len() <= imaged.len() / 50, "{imaged:?}");
    }
}

/// Targets of all images of a flight.
fn images(start: &TaskRun, log: &ActionLog) -> Vec<usize> {
    let mut run = start.clone();
    let mut imaged = Vec::new();
    step_through(log, |action| {
        let actions = run.read_actions(action)?;
        run.step(&actions);
        imaged.extend(run.last_step().imaged.iter().map(|[_, target]| *target));
        Ok(run.is_done())
    })
    .unwrap();
    imaged
}

/// Searches and flights are counts, not times.
#[test]
fn efforts_are_bounded() {
    let run = start(&scenario(0, 3, 1, &[]));
    assert_eq!(scanning::pilots(&run).len(), scanning::FLOWN);
    let run = start(&scenario(1, 3, 1, &[]));
    let limit_s = run.sim.time_limit_s();
    for plan in imaging::plan_all(&run) {
        assert!(plan.flown_s < 8.0 * limit_s, "{} s of {limit_s} s", plan.flown_s);
    }
}
