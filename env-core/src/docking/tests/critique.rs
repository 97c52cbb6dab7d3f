//! What a critique says of episodes whose story is known.

use serde_json::json;

use crate::critique::{Critique, Verdict};
use crate::docking::TASKS;
use crate::docking::approach::Approach;
use crate::docking::deputy::Deputy;
use crate::docking::planner::solo::Solo;
use crate::docking::setup::Setup;
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
    assert!(seen.actions.len() <= 18 && seen.actions.iter().any(|a| a.verdict == Verdict::Needed));

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

/// The verdict on the only arc of a deputy.
fn verdict_of(critique: &Critique, deputy: u32) -> (Verdict, f64) {
    let mut of = critique.actions.iter().filter(|action| action.agent == deputy);
    let found = of.next().unwrap();
    assert!(of.next().is_none(), "{:?}", critique.actions);
    (found.verdict, found.gain)
}

/// Two others collide at step 8 whatever this one does: its thrust is not to blame for that.
#[test]
fn a_bystanders_thrust_does_not_make_others_collide() {
    let rows = json!([[50.0, 0, 0, 0, 0, 0], [52.0, 0, 0, -0.2, 0, 0], [0, 0, 100.0, 0, 0, 0]]);
    let seen = critique_of(&staged(&rows, 500), &[(5, 2, [0.0, 0.0, -0.1])]);
    assert_eq!((seen.failures.len(), seen.failures[2].step), (3, 8));
    // It came some 0.2 m nearer: worth more than 0.04 m/s of thrust, but nothing that counts.
    let (verdict, gain) = verdict_of(&seen, 2);
    assert_eq!(verdict, Verdict::Harmless);
    assert!(gain > 0.0 && gain < 0.001, "{gain}");
}

/// Of two pairs that collide in the same step one is left without this one's thrust.
#[test]
fn a_thrust_into_one_of_two_collisions_is_not_what_ended_the_episode() {
    let rows = json!([[48.0, 0, 0, 0, 0, 0], [50.0, 0, 0, 0, 0, 0], [52.0, 0, 0, -0.2, 0, 0]]);
    // 0.25 m/s after 3 s, 0.375 m on: 1.625 m on at step 8.
    let push = [(3, 0, [1.0, 0.0, 0.0])];
    let seen = critique_of(&staged(&rows, 500), &push);
    let met = |of: usize| (seen.failures[of].step, seen.failures[of].encounter.as_ref().map(|met| met.body));
    assert_eq!((met(0), met(1), met(2)), ((8, Some(1)), (8, Some(0)), (8, Some(1))));
    assert_eq!(verdict_of(&seen, 0).0, Verdict::Wasteful);
    // Where it is the only pair, it is.
    let rows = json!([[48.0, 0, 0, 0, 0, 0], [50.0, 0, 0, 0, 0, 0], [52.0, 0, 0, 0, 0, 0]]);
    let seen = critique_of(&staged(&rows, 500), &push);
    assert_eq!((seen.failures[0].mode, verdict_of(&seen, 0).0), ("collision", Verdict::Harmful));
}

/// A deputy that docked before two others collided would have been stopped by that too, had it not: no timeout to pay for.
#[test]
fn a_counterfactual_ends_with_the_collision_of_others() {
    for apart in [8.2, 28.2] {
        // The others meet about step 39, within the minute that is flown by the rules, and about 139, beyond it.
        let rows = json!([[0, 3.0, 0, 0, 0, 0], [50.0, 0, 0, 0, 0, 0], [50.0, 0, apart, 0, 0, -0.2]]);
        let seen = critique_of(&staged(&rows, 500), &[(2, 0, [0.0, -1.0, 0.0])]);
        assert_eq!(seen.failures.iter().map(|f| f.mode).collect::<Vec<_>>(), ["collision"; 2]);
        let (verdict, gain) = verdict_of(&seen, 0);
        assert_eq!(verdict, Verdict::Needed);
        // Docking pays 1 and the share of the time that was left, more than 0.9; the way there below 0.04; a third of
        // that is the score's.
        assert!((1.9..2.05).contains(&(3.0 * gain)), "{gain}");
    }
}

/// What is thrust after leaving moves nothing in truth, so neither where the arc that led there is taken away.
#[test]
fn thrust_after_leaving_is_not_flown() {
    let rows = json!([[0, 3.0, 0, 0, 0, 0], [0, 100.0, 0, 0, 0, 0]]);
    let push = (2, 0, [0.0, -1.0, 0.0]);
    // So long that docking half a minute later would cost next to nothing.
    let seen = critique_of(&staged(&rows, 1400), &[push, (28, 0, [0.0; 3]), push]);
    assert_eq!((seen.failures.len(), seen.failures[0].agent), (1, 1));
    assert_eq!(verdict_of(&seen, 0).0, Verdict::Needed);
}

/// It crashes as time runs out: braking, however early, is too late.
#[test]
fn braking_has_the_time_and_penalty_that_were_left() {
    let staged = staged(&json!([[0, 10.4, 0, 0, -0.5, 0]]), 20);
    let seen = critique_of(&staged, &[]);
    let failure = &seen.failures[0];
    assert_eq!((failure.mode, failure.step), ("crash", 20));
    assert_eq!(failure.encounter.as_ref().unwrap().avoidable, Some(false), "{failure:?}");
    assert!(failure.measures.iter().all(|m| m.name != "last_chance"));

    // Slowing down from 0.5 m/s takes seconds above the limit, at 0.01 each: who has 0.01 left is stopped first.
    let mut setup = Setup::read(staged.recipe()).unwrap();
    setup.time_limit = 500;
    let fly = |velocity_sum: f64, step: u32| {
        let deputy = Deputy { velocity_sum, ..Deputy::at([0.0, 10.4, 0.0, 0.0, -0.5, 0.0]) };
        Solo::fly(&setup, deputy, step, Approach::PILOT).docked
    };
    assert_eq!([fly(0.0, 0), fly(-4.5, 200), fly(-4.99, 0), fly(0.0, 480)], [true, true, false, false]);
}
