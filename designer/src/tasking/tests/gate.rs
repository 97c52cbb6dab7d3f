//! The gate admits layouts of every aim, refuses others by the right check, and gives the same result again.

use env_core::KeyedRng;
use env_core::admission::{SuccessRule, is_success};
use env_core::keyed_rng::RngPurpose;

use super::*;
use crate::angles::angle_between;
use crate::procedural::ProceduralDesigner;
use crate::tasking::TaskingDesign;
use crate::tasking::aim::{AIM_TOLERANCE_DEG, allowed_aims};
use crate::test_support::{assert_reference_succeeds, count_children, count_edits, profile_of_one_mode};
use crate::{AdmittedLayout, LayoutKind};

/// Asserts what the gate found, and that few blind plans succeed.
fn assert_keeps_claim(admitted: &AdmittedLayout) {
    let (stored, bracket) = (assert_reference_succeeds(admitted), admitted.bracket());
    assert_eq!(admitted.kind(), LayoutKind::Threat);
    let blind = bracket.panel.iter().filter(|blind| is_success(&stored, SuccessRule::Task, bracket, blind));
    assert!(blind.count() <= bracket.max_blind_successes());
}

/// Samples layouts of an aim with one seed after the other. Returns the number of designs that were judged and admitted.
fn sample_aim(task: &str, level: u32, mode: &str, attempts: u64) -> [u64; 2] {
    let mut brief = brief_at_level(task, level, 11);
    brief.profile = profile_of_one_mode(task, mode, Some(3), None);
    let mut gate = empty_gate();
    let (mut judged, mut admitted) = (0, 0);
    for number in 0..attempts {
        let mut rng = KeyedRng::new(RngPurpose::Design, 5, number);
        let base = brief.base_scenario(number);
        let Some(design) = gate.language().sample(&brief, &base, &mut rng) else { continue };
        judged += 1;
        assert_eq!(design["aim"]["mode"], mode);
        match gate.judge(&brief, &design, [base]) {
            Ok(layout) => {
                assert_keeps_claim(&layout);
                admitted += 1;
            }
            Err(refusal) => assert!(
                ["solvable", "contested"].contains(&refusal.check().as_str()),
                "{task} {mode}: a sampled design compiles and matches its aim: {refusal}"
            ),
        }
    }
    [judged, admitted]
}

/// A designer needs few attempts for a layout of any aim.
#[test]
fn every_aim_is_sampled_and_admitted() {
    for task in TASKS {
        // At the lower levels of constellation, blind plans are as good as the planner in many layouts.
        let level = if task == CONSTELLATION { 7 } else { 4 };
        let brief = brief_at_level(task, level, 1);
        let modes: Vec<_> = allowed_aims(&brief).map(|aim| aim.mode).collect();
        assert!(modes.len() >= 5, "{task}: {modes:?}");
        for mode in modes {
            let [judged, admitted] = sample_aim(task, level, mode, 6);
            assert!(judged >= 2, "{task} {mode}: {judged} of 6 bases have a design");
            assert!(admitted >= 1, "{task} {mode}: {admitted} of {judged} are admitted");
        }
    }
}

#[test]
fn aim_follows_the_failure_profile() {
    for (task, mode, sector) in [(SCANNING, "full", 2), (IMAGING, "low_value", 8)] {
        let mut brief = brief_at_level(task, 3, 5);
        brief.count = 2;
        brief.profile = profile_of_one_mode(task, mode, Some(sector), None);
        let outcome = ProceduralDesigner::design_layouts(&brief, &mut empty_gate());
        assert_eq!(outcome.admitted(), 2, "{mode}: {:?}", outcome.judged);
        for judged in outcome.judged.iter().filter(|judged| judged.verdict.is_ok()) {
            let design = TaskingDesign::from_json(judged.design.as_ref().unwrap()).unwrap();
            assert_eq!(design.mode, mode);
            // One design in twenty explores.
            if let Some(angle) = design.aim_angle_deg {
                let turn = angle_between(f64::from(angle), 30.0 * f64::from(sector));
                assert!(turn <= 1.5 * AIM_TOLERANCE_DEG, "{angle} for sector {sector}");
            }
        }
        let repeated = ProceduralDesigner::design_layouts(&brief, &mut empty_gate());
        assert_eq!(outcome, repeated, "the same brief gives the same layouts");
    }
}

#[test]
fn edited_designs_are_canonical_and_changed() {
    for task in [SCANNING, CONSTELLATION] {
        let mut brief = brief_at_level(task, 5, 1);
        brief.profile = profile_of_one_mode(task, "wheels", Some(1), None);
        let edits = count_edits(empty_gate().language(), &brief, 25);
        assert!(edits > 15, "{task}: {edits}");
    }
}

#[test]
fn successful_layouts_are_edited() {
    let mut brief = brief_at_level(SCANNING, 4, 8);
    brief.count = 1;
    let children = count_children(empty_gate().language(), &brief, 4, 0.2);
    assert!(children >= 1, "children are similar to their parent, but not equal");
}

/// Judges a design in the first base scenario. Returns the name of the check that refuses it and the message.
fn verdict(gate: &mut Gate, brief: &DesignBrief, design: &Value) -> [String; 2] {
    gate.judge(brief, design, [brief.base_scenario(0)]).map_or_else(
        |refusal| [refusal.check().as_str().to_owned(), refusal.to_string()],
        |_| ["admitted".to_owned(), String::new()],
    )
}

fn changed(design: &Value, pointer: &str, value: Value) -> Value {
    let mut design = design.clone();
    *design.pointer_mut(pointer).unwrap() = value;
    design
}

#[test]
fn designs_are_refused_by_the_right_check() {
    let mut gate = empty_gate();
    for (task, mode, pointer, value, check, field) in [
        (SCANNING, "wheels", "/start/day", json!(366), "schema", "start.day"),
        (SCANNING, "wheels", "/start/battery_percent", json!(4), "schema", "start.battery_percent"),
        (SCANNING, "wheels", "/start/node_hour", json!(1.5), "schema", "start.node_hour"),
        (SCANNING, "wheels", "/outages", json!([1, 1]), "schema", "outages"),
        (SCANNING, "wheels", "/outages", json!([7]), "schema", "outages.0"),
        (SCANNING, "wheels", "/params", json!({"wheel_rpm": 3000.5}), "schema", "params.wheel_rpm"),
        (SCANNING, "duplicate", "/aim", json!({"mode": "duplicate"}), "schema", "aim.mode"),
        (IMAGING, "wheels", "/fields/0/targets", json!(0), "schema", "fields.0.targets"),
        (IMAGING, "wheels", "/fields/1/priority_high", json!(5), "schema", "fields.1.priority_high"),
        (IMAGING, "wheels", "/fields/1/minute", json!(900), "compiles", "fields.1.minute"),
        (SCANNING, "power", "/start/start_angle_deg", json!(260), "aim", "start.start_angle_deg"),
        (SCANNING, "power", "/start/battery_percent", json!(90), "aim", "start.battery_percent"),
        (SCANNING, "wheels", "/start/wheels_percent", json!(40), "aim", "start.wheels_percent"),
        (SCANNING, "full", "/start/storage_percent", json!(0), "aim", "start.storage_percent"),
        (SCANNING, "pass_missed", "/start/storage_percent", json!(100), "aim", "start.storage_percent"),
        (SCANNING, "idle", "/start/battery_percent", json!(50), "aim", "start.battery_percent"),
        (IMAGING, "window_missed", "/fields/0/targets", json!(2), "aim", "fields"),
        (IMAGING, "low_value", "/fields/0/priority_low", json!(90), "aim", "fields"),
        (CONSTELLATION, "duplicate", "/fields", json!([field_json(2, 3)]), "aim", "fields"),
    ] {
        let brief = brief_at_level(task, 0, 3);
        let mut design = changed(&design_json(task, mode), pointer, value);
        if check == "aim" && task == IMAGING {
            design["fields"] = json!([design["fields"][0]]);
        }
        let [found, message] = verdict(&mut gate, &brief, &design);
        assert_eq!(found, check, "{design} {message}");
        assert!(message.starts_with(field), "{field}: {message}");
    }
}

#[test]
fn aim_angles_must_be_where_the_failure_begins() {
    let brief = brief_at_level(SCANNING, 3, 3);
    let mut gate = empty_gate();
    let design = changed(&design_json(SCANNING, "wheels"), "/start/wheels_percent", json!(75));
    for (angle, is_refused) in [(60, false), (85, false), (30, false), (120, true), (240, true)] {
        let aim = json!({"mode": "wheels", "orbit_angle_deg": angle});
        let [_, message] = verdict(&mut gate, &brief, &changed(&design, "/aim", aim));
        assert_eq!(message.starts_with("aim.orbit_angle_deg"), is_refused, "{angle}: {message}");
    }
}

/// An admitted design leads to its scenario; with another design as provenance a scenario is refused.
#[test]
fn layouts_of_files_are_judged_by_their_design() {
    let mut brief = brief_at_level(SCANNING, 4, 2);
    brief.count = 1;
    let outcome = ProceduralDesigner::design_layouts(&brief, &mut empty_gate());
    let layout = outcome.judged.iter().find_map(|judged| judged.verdict.as_ref().ok()).unwrap();
    let scenario = stored(layout.scenario());
    assert_eq!(empty_gate().judge_scenario(&scenario).unwrap().scenario().id(), scenario.id());
    let mut other = scenario.to_json();
    other["layout"]["bodies"]["epoch"][0][1] = json!(1);
    let refusal = empty_gate().judge_scenario(&Scenario::from_json(&other).unwrap()).unwrap_err();
    assert_eq!(refusal.check().as_str(), "compiles", "{refusal}");
}
