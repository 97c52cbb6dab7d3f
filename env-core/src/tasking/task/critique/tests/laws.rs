//! Laws of all critiques: counterfactuals are replays, numbers are finite, times are within the episode.

use proptest::prelude::*;

use super::{CONSTELLATION, IMAGING, SCANNING, critique_of, fly, scenario, start, task};
use crate::critique::Critique;
use crate::episode_rng::{EpisodeRng, RngStream, SeededRng};
use crate::log::{ActionLog, StopReason};
use crate::rollout::{replay, roll_out};
use crate::seed::Seed;
use crate::task::Scenario;
use crate::tasking::task::critique::counterfactual::{BUDGET, JudgedAction, judged_actions};
use crate::tasking::task::critique::finding::MAX_FINDINGS;
use crate::tasking::task::critique::{TaskingTrace, critique_within};

/// A scenario of a level that lasts less than an orbit.
fn short(index: usize, level: usize, seed: u64) -> Scenario {
    let params: Vec<_> = task(index).levels().params(level).collect();
    let targets = if index == SCANNING { &[][..] } else { &[("targets", 400.0)][..] };
    let shorter = [targets, &[("time_limit_s", 3600.0)]].concat();
    scenario(index, &params, &shorter, seed)
}

/// The log of random actions, now and then none.
fn random_log(scenario: &Scenario, seed: u64) -> ActionLog {
    let mut rng = SeededRng::new(Seed::user(seed).unwrap());
    let count = scenario.task().action_space().names().len() as f64;
    fly(scenario, |_, _| {
        let draw = 1.1 * rng.uniform(RngStream::Policy);
        (draw < 1.0).then_some((draw * count) as usize)
    })
}

/// Score and losses of an episode without an action, by a replay step by step.
fn replay_without(scenario: &Scenario, log: &ActionLog, action: &JudgedAction, end: u64) -> (f64, u32) {
    let mut run = start(scenario);
    run.sim.end_at(end);
    while !run.is_done() {
        let step = run.sim.steps() + 1;
        let mut actions = run.read_actions(log.step(step as usize - 1)).unwrap();
        if step == action.step {
            actions[action.agent] = None;
            run.sim.go_on_until(action.agent, action.until);
        }
        run.step(&actions);
    }
    (run.outcome().score, run.outcome().lost)
}

#[test]
fn counterfactuals_are_replays_without_the_action() {
    for (index, level) in [(SCANNING, 3), (SCANNING, 9), (IMAGING, 4), (CONSTELLATION, 2)] {
        let scenario = short(index, level, 21);
        let log = random_log(&scenario, 5);
        let trace = TaskingTrace::replay(&scenario, &log).unwrap();
        let judged = judged_actions(&trace, BUDGET);
        let critique = critique_of(&scenario, &log);
        assert_eq!(judged.len(), critique.actions.len());
        assert!(judged.iter().any(|action| !action.is_repeat));
        for (action, verdict) in judged.iter().zip(&critique.actions) {
            assert_eq!((action.step, action.agent as u32), (verdict.step, verdict.agent));
            let (score, _) = replay_without(&scenario, &log, action, trace.end());
            // Repetitions are not simulated, and their counterfactual is the episode to the bit.
            assert_eq!((trace.outcome.score - score).to_bits(), verdict.gain.to_bits(), "{action:?}");
        }
    }
}

#[test]
fn a_trace_is_the_replay() {
    for index in [SCANNING, IMAGING, CONSTELLATION] {
        let scenario = short(index, 5, 3);
        let mut log = random_log(&scenario, 8);
        assert_eq!(TaskingTrace::replay(&scenario, &log).unwrap().outcome, replay(&scenario, &log).unwrap());
        // A log that stopped early goes on without actions.
        let mut stopped = ActionLog::new(1, crate::log::Precision::F64);
        for step in 0..log.len() / 2 {
            let action = log.step(step);
            action
                .agents
                .iter()
                .zip(action.values)
                .for_each(|(agent, value)| stopped.push_entry(*agent, &[*value]));
            stopped.end_step();
        }
        stopped.stopped = Some(StopReason::TooLate);
        let critique = critique_of(&scenario, &stopped);
        assert_sane(&scenario, &stopped, &critique);
        log.end_step();
        assert!(task(index).critique(&scenario, &log).is_err(), "the log is too long");
    }
}

#[test]
fn a_small_budget_leaves_out_actions_evenly() {
    let scenario = short(SCANNING, 3, 2);
    let log = random_log(&scenario, 3);
    let trace = TaskingTrace::replay(&scenario, &log).unwrap();
    let all = judged_actions(&trace, f64::INFINITY);
    let few = judged_actions(&trace, 20_000.0);
    let changes =
        |judged: &[JudgedAction]| judged.iter().filter(|a| !a.is_repeat).copied().collect::<Vec<_>>();
    let (all, few) = (changes(&all), changes(&few));
    assert!(few.len() < all.len() && !few.is_empty(), "{} of {}", few.len(), all.len());
    let stride = all.len().div_ceil(few.len());
    assert!((2..).any(|stride| all.iter().step_by(stride).eq(&few)), "{stride}");
    assert_eq!(judged_actions(&trace, f64::INFINITY).len(), trace.satellites[0].actions.len());
    assert_eq!(
        critique_within(&scenario, &log, 20_000.0).unwrap().failures,
        critique_of(&scenario, &log).failures
    );
}

#[test]
fn the_reference_is_judged_1_and_equal_episodes_alike() {
    for index in [SCANNING, IMAGING, CONSTELLATION] {
        let scenario = short(index, 1, 4);
        let bracket = task(index).bracket(&scenario).unwrap();
        assert_eq!(bracket.reference.lost, 0, "the test needs a reference that lives");
        let critique = critique_of(&scenario, &bracket.reference_plan);
        assert_eq!((critique.assessment.value, critique.assessment.case), (1.0, "as_reference"));
        assert_eq!(critique, critique_of(&scenario, &bracket.reference_plan));
        let held = roll_out(&scenario, &mut *task(index).policy("hold", &scenario, 0).unwrap()).unwrap();
        let critique = critique_of(&scenario, &held.log);
        assert!(critique.actions.is_empty() && critique.assessment.value < 1.0);
    }
}

#[test]
fn failure_modes_belong_to_tasks() {
    let names = |index: usize| task(index).failure_modes().iter().map(|mode| mode.name).collect::<Vec<_>>();
    assert_eq!(names(SCANNING), ["power", "wheels", "full", "pass_missed", "idle", "other"]);
    assert_eq!(names(IMAGING)[6..], ["window_missed", "low_value"]);
    assert_eq!(names(CONSTELLATION)[8..], ["duplicate"]);
    assert_eq!(task(SCANNING).sector_quantity().name, "orbit angle");
}

/// Checks what every critique must have.
fn assert_sane(scenario: &Scenario, log: &ActionLog, critique: &Critique) {
    let outcome = replay(scenario, log).unwrap();
    let end_s = outcome.time_s.unwrap();
    let modes = scenario.task().failure_modes();
    let agents = scenario.task().agents(scenario.recipe());
    for failure in &critique.failures {
        assert!(modes.iter().any(|mode| mode.name == failure.mode), "{failure:?}");
        assert!((1..=outcome.steps).contains(&failure.step) && failure.agent < agents, "{failure:?}");
        assert!((0.0..360.0).contains(&failure.sector_deg().unwrap()), "{failure:?}");
        assert!(
            failure.explanation.ends_with('.') && failure.explanation.contains("atellite"),
            "{failure:?}"
        );
        assert!(!failure.explanation.contains("NaN") && !failure.explanation.contains("inf"), "{failure:?}");
        for measure in &failure.measures {
            assert!(measure.value.is_finite(), "{failure:?}");
            let is_moment =
                ["time", "until", "empty_from", "since", "tasked", "last_chance", "first_time", "full_from"]
                    .contains(&measure.name);
            assert!(!is_moment || (0.0..=end_s).contains(&measure.value), "{failure:?}");
        }
        let same = critique.failures.iter().filter(|f| f.mode == failure.mode && f.agent == failure.agent);
        assert!(same.count() <= MAX_FINDINGS, "{failure:?}");
    }
    assert!(critique.failures.is_sorted_by_key(|failure| (failure.step, failure.agent)));
    assert!(critique.actions.is_sorted_by_key(|action| (action.step, action.agent)));
    for action in &critique.actions {
        assert!(action.gain.abs() <= 2.0 && (1..=outcome.steps).contains(&action.step), "{action:?}");
    }
    let deaths = critique.failures.iter().filter(|f| ["power", "wheels", "other"].contains(&f.mode));
    assert_eq!(deaths.count(), outcome.lost as usize);
    let value = critique.assessment.value;
    assert!((-1.0..=1.0).contains(&value));
    assert_eq!(value == -1.0, outcome.lost == agents, "{:?}", critique.assessment);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn critiques_of_random_episodes_are_sane(
        index in 0usize..3,
        level in 0usize..10,
        seed in 0u64..1_000_000,
        is_any in any::<bool>(),
    ) {
        let mut scenario = short(index, level, seed);
        if is_any {
            let recipe = crate::task::Recipe::clone(scenario.recipe()).with_option("retasking", "any").unwrap();
            scenario = Scenario::new(recipe, scenario.seed());
        }
        let log = random_log(&scenario, seed);
        let critique = critique_of(&scenario, &log);
        assert_sane(&scenario, &log, &critique);
        prop_assert_eq!(&critique, &critique_of(&scenario, &log));
    }
}

/// The extremes of the params, at which numbers could overflow or vanish.
#[test]
fn critiques_at_the_bounds_of_params_are_sane() {
    for index in [SCANNING, IMAGING, CONSTELLATION] {
        for (position, bound) in [false, true].into_iter().enumerate() {
            let params: Vec<_> = task(index)
                .params()
                .iter()
                .filter(|param| {
                    !["time_limit_s", "targets", "charge_min", "charge_max"].contains(&param.name)
                })
                .map(|param| (param.name, if bound { param.max } else { param.min }))
                .collect();
            let others = [("time_limit_s", 1800.0), ("targets", 100.0)];
            let others = if index == SCANNING { &others[..1] } else { &others[..] };
            let scenario = scenario(index, &params, others, position as u64);
            let log = random_log(&scenario, 6);
            assert_sane(&scenario, &log, &critique_of(&scenario, &log));
        }
    }
}
