//! What a critique says of episodes whose story is known.

use serde_json::json;

use crate::critique::{Critique, Verdict};
use crate::docking::TASKS;
use crate::log::{ActionLog, Precision};
use crate::rollout::fly;
use crate::scenario::{Recipe, Scenario};
use crate::seed::Seed;
use crate::task::TaskSpec;

/// A scenario whose deputies start where the rows say.
fn staged(rows: &serde_json::Value, time_limit: u32) -> Scenario {
    let count = rows.as_array().unwrap().len();
    Scenario::from_json(&json!({
        "task": "docking/multiagent", "seed": 5,
        "params": {"deputies": count, "time_limit_s": time_limit},
        "layout": {"mode": "replace", "bodies": {"deputies": rows}},
    }))
    .unwrap()
}

/// The critique of an episode flown by these thrusts, each (steps, deputy, thrust), then by nothing.
fn critique_of(scenario: &Scenario, arcs: &[(u32, u32, [f64; 3])]) -> Critique {
    let mut log = ActionLog::new(3, Precision::F64);
    for &(steps, deputy, thrust) in arcs {
        for _ in 0..steps {
            log.act(deputy, &thrust);
            log.end_step();
        }
    }
    log.stopped = Some(crate::Stopped::TooLate);
    TASKS[1].critique(scenario, &log).unwrap()
}

fn measured(critique: &Critique, name: &str) -> f64 {
    critique.failures[0].measures.iter().find(|m| m.name == name).unwrap().value
}

#[test]
fn a_crash_names_speed_place_and_last_chance() {
    let seen = critique_of(&staged(&json!([[10.0, 0, 0, -0.6, 0, 0]]), 200), &[]);
    let failure = &seen.failures[0];
    assert_eq!((failure.mode, failure.agent), ("crash", 0));
    assert!((measured(&seen, "speed") - 0.6).abs() < 0.02, "{failure:?}");
    let met = failure.encounter.as_ref().unwrap();
    // It comes from radial out, so the chief is radial in, but for the drift of 16 s.
    assert!((met.bearing_deg - 180.0).abs() < 25.0, "{met:?}");
    assert_eq!(met.avoidable, Some(true));
    // From 0.6 to 0.2 m/s at 1/12 m/s² takes 1.92 m, which it flew in 3.2 s: of the tries 4 s is the first that will do.
    assert_eq!(measured(&seen, "last_chance"), 4.0);
    assert_eq!((seen.judged.value, seen.judged.case), (-1.0, "crash"));
}

#[test]
fn saturation_says_since_when_and_how_much() {
    let seen = critique_of(&staged(&json!([[100.0, 0, 0, 0, 3.0, 0]]), 2000), &[]);
    let failure = &seen.failures[0];
    assert_eq!((failure.mode, failure.encounter.is_none()), ("saturation", true));
    assert_eq!(measured(&seen, "first_violation_step"), 1.0);
    // The recorded edge case flies the same and is stopped at step 154.
    assert_eq!(failure.step, 154);
    assert_eq!(seen.judged.case, "saturation");
}

#[test]
fn out_of_bounds_and_timeout_say_how_far() {
    let seen = critique_of(&staged(&json!([[0, 9999.5, 0, 0, 1.0, 0]]), 2000), &[]);
    assert_eq!(seen.failures[0].mode, "out_of_bounds");
    assert!(measured(&seen, "distance") > 10_000.0);
    // In-track at rest a deputy stays.
    let seen = critique_of(&staged(&json!([[0, 100.0, 0, 0, 0, 0]]), 300), &[]);
    assert_eq!((seen.failures[0].mode, seen.failures[0].step), ("timeout", 300));
    assert_eq!(measured(&seen, "distance"), 100.0);
    // ∫ dd/(0.2 + 2n(d − 0.5)) from 0.5 to 100 m: ln(0.40437/0.2)/(2 · 0.001027) s.
    assert!((measured(&seen, "time_needed") - 342.77).abs() < 0.1);
    assert_eq!((seen.judged.value, seen.judged.case), (-0.5, "timeout"));
}

#[test]
fn a_collision_has_a_bearing_and_a_remedy() {
    let rows = json!([[50.0, 0, 0, 0, 0, 0], [52.0, 0, 0, -0.2, 0, 0], [0, 0, 100.0, 0, 0, 0]]);
    let seen = critique_of(&staged(&rows, 500), &[]);
    assert_eq!(seen.failures.len(), 3);
    let met = seen.failures[0].encounter.as_ref().unwrap();
    assert_eq!((met.body, met.avoidable, seen.failures[0].step), (1, Some(true), 8));
    assert!(met.bearing_deg < 5.0 || met.bearing_deg > 355.0, "deputy 1 is radial out: {met:?}");
    assert!((met.relative_speed - 0.2).abs() < 0.01);
    assert!(seen.failures[2].encounter.is_none());
    // The remedy works: flown with it, they do not collide at that step.
    let remedy = met.cheapest.as_ref().unwrap();
    let mut log = ActionLog::new(3, Precision::F64);
    (1..remedy.step).for_each(|_| log.end_step());
    log.act(0, &remedy.values);
    log.end_step();
    log.stopped = Some(crate::Stopped::TooLate);
    let again = TASKS[1].critique(&staged(&rows, 500), &log).unwrap();
    assert!(again.failures.iter().all(|f| f.mode == "timeout" || f.step > 18), "{:?}", again.failures);
}

#[test]
fn arcs_that_dock_are_needed_and_those_that_crash_harmful() {
    let recipe = Recipe::new(&TASKS[1]).unwrap();
    let scenario = Scenario::new(recipe, Seed::user(3).unwrap());
    let mut pilot = TASKS[1].policy("heuristic", &scenario, 0).unwrap();
    let (flown, log) = fly(&scenario, pilot.as_mut()).unwrap();
    assert_eq!(flown.lost, 0);
    let seen = TASKS[1].critique(&scenario, &log).unwrap();
    assert!(seen.failures.is_empty());
    assert!(seen.judged.value > 0.8 && seen.judged.case == "docked");
    assert!(seen.actions.len() <= 30 && seen.actions.iter().any(|a| a.verdict == Verdict::Needed));

    // It would dock at 0.15 m/s by itself; a push makes it crash.
    let docks = staged(&json!([[0, 3.0, 0, 0, -0.15, 0]]), 100);
    assert!(critique_of(&docks, &[]).failures.is_empty());
    let pushed = critique_of(&docks, &[(3, 0, [0.0, -1.0, 0.0])]);
    assert_eq!(pushed.failures[0].mode, "crash");
    assert_eq!((pushed.actions.len(), pushed.actions[0].verdict), (1, Verdict::Harmful));
    // Across the line to the chief and straight back: it costs a little and changes nothing.
    let waste = critique_of(&docks, &[(1, 0, [0.0, 0.0, 0.02]), (1, 0, [0.0, 0.0, -0.02])]);
    assert_eq!((waste.actions.len(), waste.actions[0].verdict), (1, Verdict::Wasteful));
}

#[test]
fn critiques_name_only_modes_of_the_task() {
    for (seed, name) in [(1, "random"), (2, "blind"), (3, "frozen"), (4, "frozen"), (5, "hold")] {
        let scenario = super::at_level("docking/multiagent", 8, seed);
        let mut policy = TASKS[1].policy(name, &scenario, seed).unwrap();
        let (flown, log) = fly(&scenario, policy.as_mut()).unwrap();
        let seen = TASKS[1].critique(&scenario, &log).unwrap();
        assert_eq!(seen.failures.len() as u32, flown.lost);
        for failure in &seen.failures {
            assert!(TASKS[1].failure_modes().iter().any(|mode| mode.name == failure.mode));
            assert!(failure.measures.iter().all(|m| m.value.is_finite()));
        }
        assert!((-1.0..=1.0).contains(&seen.judged.value));
    }
}
