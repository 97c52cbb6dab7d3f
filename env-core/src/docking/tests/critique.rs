//! Critiques of episodes whose causes are known.

use serde_json::json;

use crate::critique::{ActionVerdict, Critique, Verdict};
use crate::docking::DOCKING_TASKS;
use crate::docking::approach_law::ApproachLaw;
use crate::docking::deputy::Deputy;
use crate::docking::planner::solo_plan::SoloPlan;
use crate::docking::setup::DockingSetup;
use crate::log::{ActionLog, Precision};
use crate::rollout::{Rollout, roll_out};
use crate::seed::Seed;
use crate::task::{Recipe, Scenario, TaskSpec};

/// A scenario whose deputies start in these states.
fn with_starts(rows: &serde_json::Value, time_limit: u32) -> Scenario {
    let count = rows.as_array().unwrap().len();
    Scenario::from_json(&json!({
        "task": "docking/multiagent", "seed": 5,
        "params": {"deputies": count, "time_limit_s": time_limit},
        "layout": {"mode": "replace", "bodies": {"deputies": rows}},
    }))
    .unwrap()
}

/// A thrust of one deputy over several steps.
#[derive(Clone, Copy)]
struct Arc {
    steps: u32,
    deputy: u32,
    thrust: [f64; 3],
}

const fn arc(steps: u32, deputy: u32, thrust: [f64; 3]) -> Arc {
    Arc { steps, deputy, thrust }
}

/// The critique of an episode with these thrusts one after the other, then none.
fn critique_of(scenario: &Scenario, arcs: &[Arc]) -> Critique {
    let mut log = ActionLog::new(3, Precision::F64);
    for &Arc { steps, deputy, thrust } in arcs {
        for _ in 0..steps {
            log.push_entry(deputy, &thrust);
            log.end_step();
        }
    }
    log.stopped = Some(crate::StopReason::TooLate);
    DOCKING_TASKS[1].critique(scenario, &log).unwrap()
}

/// The value of a measure of the first failure.
fn measured(critique: &Critique, name: &str) -> f64 {
    critique.failures[0].measures.iter().find(|m| m.name == name).unwrap().value
}

#[test]
fn crash_reports_speed_bearing_and_last_chance() {
    let critique = critique_of(&with_starts(&json!([[10.0, 0, 0, -0.6, 0, 0]]), 200), &[]);
    let failure = &critique.failures[0];
    assert_eq!((failure.mode, failure.agent), ("crash", 0));
    assert!((measured(&critique, "speed") - 0.6).abs() < 0.02, "{failure:?}");
    let encounter = failure.encounter.as_ref().unwrap();
    // It approaches from radial out, so the chief is radial in, except for the drift of 16 s.
    assert!((encounter.bearing_deg - 180.0).abs() < 25.0, "{encounter:?}");
    assert_eq!(encounter.avoidable, Some(true));
    // From 0.6 to 0.2 m/s at 1/12 m/s² takes 1.92 m, which takes 3.2 s: 4 s is the shortest sufficient lead of those tried.
    assert_eq!(measured(&critique, "last_chance"), 4.0);
    assert_eq!((critique.assessment.value, critique.assessment.case), (-1.0, "crash"));
}

#[test]
fn saturation_reports_first_violation() {
    let critique = critique_of(&with_starts(&json!([[100.0, 0, 0, 0, 3.0, 0]]), 2000), &[]);
    let failure = &critique.failures[0];
    assert_eq!((failure.mode, failure.encounter.is_none()), ("saturation", true));
    assert_eq!(measured(&critique, "first_violation_step"), 1.0);
    // The recorded edge case has the same motion and is stopped at step 154.
    assert_eq!(failure.step, 154);
    assert_eq!(critique.assessment.case, "saturation");
}

#[test]
fn out_of_bounds_and_timeout_report_distance() {
    let critique = critique_of(&with_starts(&json!([[0, 9999.5, 0, 0, 1.0, 0]]), 2000), &[]);
    assert_eq!(critique.failures[0].mode, "out_of_bounds");
    assert!(measured(&critique, "distance") > 10_000.0);
    // A deputy at rest in-track stays there.
    let critique = critique_of(&with_starts(&json!([[0, 100.0, 0, 0, 0, 0]]), 300), &[]);
    assert_eq!((critique.failures[0].mode, critique.failures[0].step), ("timeout", 300));
    assert_eq!(measured(&critique, "distance"), 100.0);
    // ∫ dd/(0.2 + 2n(d − 0.5)) from 0.5 to 100 m: ln(0.40437/0.2)/(2 · 0.001027) s.
    assert!((measured(&critique, "time_needed") - 342.77).abs() < 0.1);
    assert_eq!((critique.assessment.value, critique.assessment.case), (-0.5, "timeout"));
}

#[test]
fn collision_reports_bearing_and_remedy() {
    let rows = json!([[50.0, 0, 0, 0, 0, 0], [52.0, 0, 0, -0.2, 0, 0], [0, 0, 100.0, 0, 0, 0]]);
    let critique = critique_of(&with_starts(&rows, 500), &[]);
    assert_eq!(critique.failures.len(), 3);
    let encounter = critique.failures[0].encounter.as_ref().unwrap();
    assert_eq!((encounter.body, encounter.avoidable, critique.failures[0].step), (1, Some(true), 8));
    assert!(
        encounter.bearing_deg < 5.0 || encounter.bearing_deg > 355.0,
        "deputy 1 is radial out: {encounter:?}"
    );
    assert!((encounter.relative_speed - 0.2).abs() < 0.01);
    assert!(critique.failures[2].encounter.is_none());
    // With the remedy they do not collide at that step.
    let remedy = encounter.cheapest_avoidance.as_ref().unwrap();
    let mut log = ActionLog::new(3, Precision::F64);
    (1..remedy.step).for_each(|_| log.end_step());
    log.push_entry(0, &remedy.values);
    log.end_step();
    log.stopped = Some(crate::StopReason::TooLate);
    let again = DOCKING_TASKS[1].critique(&with_starts(&rows, 500), &log).unwrap();
    assert!(again.failures.iter().all(|f| f.mode == "timeout" || f.step > 18), "{:?}", again.failures);
}

#[test]
fn docking_arcs_are_needed_crashing_arcs_harmful() {
    let recipe = Recipe::new(&DOCKING_TASKS[1]).unwrap();
    let scenario = Scenario::new(recipe, Seed::user(3).unwrap());
    let mut policy = DOCKING_TASKS[1].policy("heuristic", &scenario, 0).unwrap();
    let Rollout { outcome, log } = roll_out(&scenario, policy.as_mut()).unwrap();
    assert_eq!(outcome.lost, 0);
    let critique = DOCKING_TASKS[1].critique(&scenario, &log).unwrap();
    assert!(critique.failures.is_empty());
    assert!(critique.assessment.value > 0.8 && critique.assessment.case == "docked");
    assert!(critique.actions.len() <= 18 && critique.actions.iter().any(|a| a.verdict == Verdict::Needed));

    // It docks at 0.15 m/s without thrust; a push makes it crash.
    let docks = with_starts(&json!([[0, 3.0, 0, 0, -0.15, 0]]), 100);
    assert!(critique_of(&docks, &[]).failures.is_empty());
    let pushed = critique_of(&docks, &[arc(3, 0, [0.0, -1.0, 0.0])]);
    assert_eq!(pushed.failures[0].mode, "crash");
    assert_eq!((pushed.actions.len(), pushed.actions[0].verdict), (1, Verdict::Harmful));
    // A push across the line to the chief and back costs a little and changes nothing.
    let waste = critique_of(&docks, &[arc(1, 0, [0.0, 0.0, 0.02]), arc(1, 0, [0.0, 0.0, -0.02])]);
    assert_eq!((waste.actions.len(), waste.actions[0].verdict), (1, Verdict::Wasteful));
}

#[test]
fn failures_have_modes_of_the_task() {
    for (seed, name) in [(1, "random"), (2, "blind"), (3, "frozen"), (4, "frozen"), (5, "hold")] {
        let scenario = super::at_level("docking/multiagent", 8, seed);
        let mut policy = DOCKING_TASKS[1].policy(name, &scenario, seed).unwrap();
        let Rollout { outcome, log } = roll_out(&scenario, policy.as_mut()).unwrap();
        let critique = DOCKING_TASKS[1].critique(&scenario, &log).unwrap();
        assert_eq!(critique.failures.len() as u32, outcome.lost);
        for failure in &critique.failures {
            assert!(DOCKING_TASKS[1].failure_modes().iter().any(|mode| mode.name == failure.mode));
            assert!(failure.measures.iter().all(|m| m.value.is_finite()));
        }
        assert!((-1.0..=1.0).contains(&critique.assessment.value));
    }
}

/// The verdict on the only arc of a deputy.
fn verdict_of(critique: &Critique, deputy: u32) -> ActionVerdict {
    let mut of = critique.actions.iter().filter(|action| action.agent == deputy);
    let found = *of.next().unwrap();
    assert!(of.next().is_none(), "{:?}", critique.actions);
    found
}

/// Two others collide at step 8 whatever this deputy does, so its thrust is not the cause.
#[test]
fn thrust_of_a_bystander_is_harmless() {
    let rows = json!([[50.0, 0, 0, 0, 0, 0], [52.0, 0, 0, -0.2, 0, 0], [0, 0, 100.0, 0, 0, 0]]);
    let critique = critique_of(&with_starts(&rows, 500), &[arc(5, 2, [0.0, 0.0, -0.1])]);
    assert_eq!((critique.failures.len(), critique.failures[2].step), (3, 8));
    // It approaches by some 0.2 m: worth more than 0.04 m/s of thrust, but irrelevant.
    let ActionVerdict { verdict, gain, .. } = verdict_of(&critique, 2);
    assert_eq!(verdict, Verdict::Harmless);
    assert!(gain > 0.0 && gain < 0.001, "{gain}");
}

/// Two pairs collide in the same step; without this deputy's thrust one of them still does.
#[test]
fn thrust_into_one_of_two_collisions_is_wasteful() {
    let rows = json!([[48.0, 0, 0, 0, 0, 0], [50.0, 0, 0, 0, 0, 0], [52.0, 0, 0, -0.2, 0, 0]]);
    // 0.25 m/s and 0.375 m after 3 s; 1.625 m at step 8.
    let push = [arc(3, 0, [1.0, 0.0, 0.0])];
    let critique = critique_of(&with_starts(&rows, 500), &push);
    let met = |of: usize| {
        (critique.failures[of].step, critique.failures[of].encounter.as_ref().map(|encounter| encounter.body))
    };
    assert_eq!((met(0), met(1), met(2)), ((8, Some(1)), (8, Some(0)), (8, Some(1))));
    assert_eq!(verdict_of(&critique, 0).verdict, Verdict::Wasteful);
    // With only one pair, the thrust is the cause.
    let rows = json!([[48.0, 0, 0, 0, 0, 0], [50.0, 0, 0, 0, 0, 0], [52.0, 0, 0, 0, 0, 0]]);
    let critique = critique_of(&with_starts(&rows, 500), &push);
    assert_eq!(
        (critique.failures[0].mode, verdict_of(&critique, 0).verdict),
        ("collision", Verdict::Harmful)
    );
}

/// A deputy that docked before two others collided would otherwise have been stopped by that collision, without a timeout.
#[test]
fn counterfactual_ends_at_collision_of_others() {
    for apart in [8.2, 28.2] {
        // The others collide about step 39, within the simulated minute, and about step 139, after it.
        let rows = json!([[0, 3.0, 0, 0, 0, 0], [50.0, 0, 0, 0, 0, 0], [50.0, 0, apart, 0, 0, -0.2]]);
        let critique = critique_of(&with_starts(&rows, 500), &[arc(2, 0, [0.0, -1.0, 0.0])]);
        assert_eq!(critique.failures.iter().map(|f| f.mode).collect::<Vec<_>>(), ["collision"; 2]);
        let ActionVerdict { verdict, gain, .. } = verdict_of(&critique, 0);
        assert_eq!(verdict, Verdict::Needed);
        // Docking earns 1 plus the share of the remaining time, more than 0.9; the approach earns below 0.04. The score gets
        // a third of that.
        assert!((1.9..2.05).contains(&(3.0 * gain)), "{gain}");
    }
}

/// Thrust after leaving has no effect in the episode, so it has none in the counterfactual without the arc before it.
#[test]
fn thrust_after_leaving_is_ignored() {
    let rows = json!([[0, 3.0, 0, 0, 0, 0], [0, 100.0, 0, 0, 0, 0]]);
    let push = arc(2, 0, [0.0, -1.0, 0.0]);
    // The time limit is so long that docking half a minute later costs almost nothing.
    let critique = critique_of(&with_starts(&rows, 1400), &[push, arc(28, 0, [0.0; 3]), push]);
    assert_eq!((critique.failures.len(), critique.failures[0].agent), (1, 1));
    assert_eq!(verdict_of(&critique, 0).verdict, Verdict::Needed);
}

/// The deputy crashes at the time limit, so braking at any time docks too late.
#[test]
fn braking_has_only_the_remaining_time_and_penalty() {
    let scenario = with_starts(&json!([[0, 10.4, 0, 0, -0.5, 0]]), 20);
    let critique = critique_of(&scenario, &[]);
    let failure = &critique.failures[0];
    assert_eq!((failure.mode, failure.step), ("crash", 20));
    assert_eq!(failure.encounter.as_ref().unwrap().avoidable, Some(false), "{failure:?}");
    assert!(failure.measures.iter().all(|m| m.name != "last_chance"));

    // Slowing down from 0.5 m/s takes seconds above the limit, at 0.01 each; with 0.01 left the deputy is stopped first.
    let mut setup = DockingSetup::read(scenario.recipe()).unwrap();
    setup.time_limit = 500;
    let docks = |velocity_penalty: f64, step: u32| {
        let deputy = Deputy { velocity_penalty, ..Deputy::new([0.0, 10.4, 0.0, 0.0, -0.5, 0.0]) };
        SoloPlan::simulate(&setup, deputy, step, ApproachLaw::HEURISTIC).docked
    };
    assert_eq!(
        [docks(0.0, 0), docks(-4.5, 200), docks(-4.99, 0), docks(0.0, 480)],
        [true, true, false, false]
    );
}
