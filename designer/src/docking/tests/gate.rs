//! The gate admits only layouts that keep their claim, and refuses others by the right check.

use env_core::log::Precision;
use env_core::rollout::{replay, roll_out};
use env_core::{ActionLog, StopReason};
use proptest::prelude::*;

use super::*;
use crate::docking::DockingDesign;
use crate::docking::aim::allowed_aims;
use crate::procedural::ProceduralDesigner;
use crate::test_support::{assert_reference_succeeds, count_children};
use crate::{AdmittedLayout, GateCheck, LayoutKind};

/// Asserts what the gate found, and that no deputy docks by itself.
fn assert_keeps_claim(admitted: &AdmittedLayout) {
    let stored = assert_reference_succeeds(admitted);
    assert_eq!(admitted.kind(), LayoutKind::Threat);
    let mut hold = ActionLog::new(3, Precision::F64);
    hold.stopped = Some(StopReason::TooLate); // the remaining steps hold
    let held = replay(&stored, &hold).unwrap();
    assert_eq!(held.goal, Some(0.0), "no deputy docks by itself");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn admitted_layouts_keep_their_claim(
        task in prop::sample::select(vec!["docking/single", "docking/multiagent"]),
        level in 0u32..10,
        seed in 0u64..1_000_000,
        mode in prop::sample::select(MODES.to_vec()),
    ) {
        let mut brief = brief_at_level(task, level, seed);
        brief.count = 1;
        brief.profile = aimed_profile(task, mode);
        let outcome = ProceduralDesigner::design_layouts(&brief, &mut empty_gate());
        for judged in &outcome.judged {
            match &judged.verdict {
                Ok(admitted) => assert_keeps_claim(admitted),
                Err(refusal) => prop_assert!(refusal.to_string().len() > 20),
            }
        }
        let repeated = ProceduralDesigner::design_layouts(&brief, &mut empty_gate());
        prop_assert_eq!(outcome, repeated, "the same brief gives the same layouts");
    }
}

/// Share of sampled designs that the gate admits.
fn admission_rate(task: &str, level: u32, mode: &str) -> f64 {
    const ATTEMPTS: usize = 16;
    let mut brief = brief_at_level(task, level, 1);
    brief.profile = aimed_profile(task, mode);
    let designs = ProceduralDesigner::preview(&brief, language(), ATTEMPTS);
    let mut gate = empty_gate();
    let admitted = designs.iter().enumerate().filter(|(number, design)| {
        assert_eq!(design["aim"]["mode"], json!(mode));
        gate.judge(&brief, design, [brief.base_scenario(*number as u64)]).is_ok()
    });
    admitted.count() as f64 / ATTEMPTS as f64
}

#[test]
fn every_aim_is_admitted_at_every_level() {
    let rates = std::thread::scope(|scope| {
        let tasks = ["docking/single", "docking/multiagent"].map(|task| {
            scope.spawn(move || {
                let mut rates = Vec::new();
                for level in 2..10 {
                    let brief = brief_at_level(task, level, 1);
                    for aim in allowed_aims(&brief) {
                        rates.push((task, level, aim.mode, admission_rate(task, level, aim.mode)));
                    }
                }
                rates
            })
        });
        tasks.map(|task| task.join().unwrap()).concat()
    });
    let low: Vec<_> = rates.iter().filter(|rate| rate.3 < 0.3).collect();
    assert!(low.is_empty(), "{low:#?}\n{rates:?}");
    let modes: std::collections::BTreeSet<_> = rates.iter().map(|rate| rate.2).collect();
    assert_eq!(modes.len(), MODES.len());
}

/// Share of episodes of the heuristic policy in which a failure of a mode occurs.
fn failure_share(scenarios: &[Scenario], mode: &str) -> f64 {
    let fails = |scenario: &&Scenario| {
        let mut policy = scenario.task().policy("heuristic", scenario, 0).unwrap();
        let log = roll_out(scenario, &mut *policy).unwrap().log;
        let critique = scenario.task().critique(scenario, &log).unwrap();
        critique.failures.iter().any(|failure| failure.mode == mode)
    };
    scenarios.iter().filter(fails).count() as f64 / scenarios.len() as f64
}

/// The heuristic policy, which flies at 0.85 of the speed limit and ignores other deputies, fails in the aimed way more often on
/// layouts than on the level's own scenarios. It brakes at once, so that it does not crash.
#[test]
fn layouts_cause_the_failure_that_they_aim_at() {
    for (task, level, mode) in [
        ("docking/single", 3, "timeout"),
        ("docking/multiagent", 3, "timeout"),
        ("docking/multiagent", 4, "collision"),
    ] {
        let mut brief = brief_at_level(task, level, 1);
        let own: Vec<Scenario> = (0..16).map(|number| brief.base_scenario(number)).collect();
        brief.count = 16;
        brief.profile = aimed_profile(task, mode);
        let outcome = ProceduralDesigner::design_layouts(&brief, &mut empty_gate());
        let admitted = outcome.judged.iter().filter_map(|judged| judged.verdict.as_ref().ok());
        let layouts: Vec<Scenario> = admitted.map(|layout| layout.scenario().clone()).collect();
        let (before, after) = (failure_share(&own, mode), failure_share(&layouts, mode));
        assert!(after >= before + 0.25, "{task} L{level} {mode}: {before:.2}, designed {after:.2}");
    }
}

#[test]
fn aim_follows_the_failure_profile() {
    for (task, mode) in [("single", "crash"), ("single", "timeout"), ("multiagent", "collision")] {
        let task = format!("docking/{task}");
        let mut brief = brief_at_level(&task, 5, 5);
        brief.profile = aimed_profile(&task, mode);
        let outcome = ProceduralDesigner::design_layouts(&brief, &mut empty_gate());
        assert_eq!(outcome.admitted(), 4, "{mode}: {:?}", outcome.judged);
        let admitted = outcome.judged.iter().filter(|judged| judged.verdict.is_ok());
        let aims =
            admitted.map(|judged| DockingDesign::from_json(judged.design.as_ref().unwrap()).unwrap().aim);
        let aims: Vec<_> = aims.collect();
        assert!(aims.iter().all(|aim| aim.mode == mode));
        // Sector 3 or a neighbour, except for one layout in twenty that explores. A timeout has no bearing.
        let is_far = |bearing: &i32| crate::angles::angle_between(90.0, f64::from(*bearing)) > 45.0;
        let known = aims.iter().filter_map(|aim| aim.bearing_deg);
        assert_eq!(known.clone().count() > 0, mode != "timeout", "{aims:?}");
        assert!(known.filter(is_far).count() == 0, "{aims:?}");
    }
}

#[test]
fn successful_layouts_are_edited() {
    let brief = brief_at_level("docking/multiagent", 4, 8);
    let children = count_children(language(), &brief, 12, 0.2);
    assert!(children >= 2, "children are similar to their parent, but not equal");
}

/// Returns the name of the check that refuses a design, or `admitted`.
fn verdict(brief: &DesignBrief, design: &Value) -> &'static str {
    let verdict = empty_gate().judge(brief, design, [brief.base_scenario(0)]);
    verdict.map_or_else(|refusal| refusal.check().as_str(), |_| "admitted")
}

#[test]
fn designs_are_refused_by_the_right_check() {
    let single = brief_at_level("docking/single", 5, 3);
    let team = brief_at_level("docking/multiagent", 5, 3);
    let late = deputy([1450, 90, 0, 0, 0, 0]);
    for (brief, design, check) in [
        (&single, design("timeout", &[deputy([10, 90, 0, 0, 0, 0])]), "schema"),
        (&single, design("decoy", std::slice::from_ref(&late)), "schema"),
        (&single, design("collision", std::slice::from_ref(&late)), "schema"),
        (&single, design("timeout", &[late.clone(), late.clone()]), "schema"),
        // Twice the same place.
        (&team, design("timeout", &[late.clone(), late.clone(), late.clone()]), "compiles"),
        (&single, design("crash", std::slice::from_ref(&late)), "aim"),
        // Full thrust would brake in time if the agent knew the start before.
        (&single, design("crash", &[deputy([100, 90, 0, 250, 0, 0])]), "fair"),
        (&single, design("crash", &[deputy([20, 90, 0, 400, 0, 0])]), "solvable"),
        // One kilometre in 550 s.
        (&single, design("timeout", &[deputy([10_000, 90, 0, -300, 0, 0])]), "solvable"),
        (&single, design("timeout", &[late]), "admitted"),
    ] {
        assert_eq!(verdict(brief, &design), check, "{design}");
    }
}

/// A deputy that drifts gently into the chief docks without any thrust.
#[test]
fn layout_in_which_holding_docks_is_refused() {
    let drifting = json!({"mode": "replace", "bodies": {"deputies": [[0.0, 3.0, 0.0, 0.0, -0.1, 0.0]]}});
    let scenario = json!({
        "task": "docking/single", "params": {"time_limit_s": 550, "thrust_bound": 0.2}, "seed": 5, "layout": drifting,
    });
    let refusal = empty_gate().judge_scenario(&Scenario::from_json(&scenario).unwrap()).unwrap_err();
    assert_eq!(refusal.check(), GateCheck::Contested);
    assert!(refusal.to_string().starts_with("a deputy docks without any thrust"), "{refusal}");
}

#[test]
fn scenario_of_a_design_is_judged_by_its_design() {
    let brief = brief_at_level("docking/single", 5, 3);
    let design = design("timeout", &[deputy([1450, 90, 0, 0, 0, 0])]);
    let admitted = empty_gate().judge(&brief, &design, [brief.base_scenario(0)]).unwrap();
    let mut gate = empty_gate();
    assert_eq!(gate.judge_scenario(admitted.scenario()).unwrap().scenario().id(), admitted.scenario().id());
    let refusal = gate.judge_scenario(admitted.scenario()).unwrap_err();
    assert_eq!(refusal.check(), GateCheck::New, "the design is known now");
    let mut changed = admitted.scenario().to_json();
    changed["layout"]["bodies"]["deputies"][0][0] = json!(12.0);
    let refusal = empty_gate().judge_scenario(&Scenario::from_json(&changed).unwrap()).unwrap_err();
    assert_eq!(refusal.check(), GateCheck::Compiles);
}

#[test]
fn colliding_start_is_too_late_to_avoid() {
    let brief = brief_at_level("docking/multiagent", 2, 3);
    // 5 m apart on one line, one overtakes the other within four seconds.
    let front = deputy([600, 90, 0, 0, 0, 0]);
    let back = deputy([650, 90, 0, 480, 0, 0]);
    let colliding = design("collision", &[front, back]);
    let refusal = empty_gate().judge(&brief, &colliding, [brief.base_scenario(0)]).unwrap_err();
    assert!(matches!(refusal.check(), GateCheck::Fair | GateCheck::Solvable), "{refusal}");
    let (scenario, _) = language().build(&colliding, &brief.base_scenario(0)).unwrap();
    let error = language().check_reaction(&scenario).unwrap_err();
    assert!(error.to_string().contains("hits deputies.0"), "{error}");
}
