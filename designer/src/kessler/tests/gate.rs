//! The gate admits only layouts that keep their claim, and refuses others by the right check.

use std::sync::Arc;

use env_core::task;
use serde_json::Value;

use super::*;
use crate::procedural::ProceduralDesigner;
use crate::test_support::{assert_reference_succeeds, count_children, count_edits, profile_of_one_mode};
use crate::{AdmittedLayout, DesignBrief, Gate, GateCheck, LayoutKind, Refusal, design_language};

/// A brief for four layouts at a level of a task.
pub(super) fn brief_at_level(task_id: &str, level: u32, seed: u64) -> DesignBrief {
    let task = task(task_id).unwrap();
    let recipe = Recipe::at_level(task, level as usize).unwrap();
    DesignBrief::new(Arc::new(recipe), 4, seed).at_level(task.levels(), level)
}

/// A gate of kessler with an empty archive.
pub(super) fn empty_gate() -> Gate {
    Gate::new(design_language(task("kessler/survival").unwrap()).unwrap(), Vec::new())
}

/// Asserts what the gate found, and that no satellite burns more fuel than it has.
fn assert_keeps_claim(admitted: &AdmittedLayout) {
    let stored = assert_reference_succeeds(admitted);
    let reference = &admitted.bracket().reference;
    let fuel = stored.recipe().param("fuel").unwrap();
    assert!(reference.fuel_used <= 3.0 * fuel + 1e-9);
    let mut hold = ActionLog::new(2, Precision::F64);
    hold.stopped = Some(env_core::StopReason::TooLate); // the remaining steps hold
    let held = replay(&stored, &hold).unwrap();
    match admitted.kind() {
        LayoutKind::Threat => assert!(held.lost > 0),
        LayoutKind::Decoy => assert_eq!(held.lost, 0),
    }
    let failures = stored.task().critique(&stored, &hold).unwrap().failures;
    assert!(failures.iter().filter(|f| f.encounter.is_some()).all(|f| f.step >= 3));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn admitted_layouts_keep_their_claim(
        task in prop::sample::select(vec!["kessler/survival", "kessler/eco_station", "kessler/rendezvous", "kessler/formation"]),
        level in 0u32..10,
        seed in 0u64..1_000_000,
        mode in prop::sample::select(vec!["collision", "rogue", "fuel_starvation", "wasted_fuel", "decay"]),
    ) {
        let mut brief = brief_at_level(task, level, seed);
        brief.count = 1;
        brief.profile = profile_of_one_mode(task, mode, Some(3), Some(2));
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

#[test]
fn aim_follows_the_failure_profile() {
    for (task, mode) in
        [("survival", "collision"), ("eco_station", "wasted_fuel"), ("survival", "fuel_starvation")]
    {
        let task = format!("kessler/{task}");
        let mut brief = brief_at_level(&task, 3, 5);
        brief.profile = profile_of_one_mode(&task, mode, Some(3), Some(2));
        let outcome = ProceduralDesigner::design_layouts(&brief, &mut empty_gate());
        assert_eq!(outcome.admitted(), 4, "{mode}: {:?}", outcome.judged);
        let admitted = outcome.judged.iter().filter(|judged| judged.verdict.is_ok());
        let aims = admitted.map(|judged| Design::from_json(judged.design.as_ref().unwrap()).unwrap().aim);
        let aims: Vec<_> = aims.collect();
        assert!(aims.iter().all(|aim| aim.mode == mode));
        // Sector 3 or a neighbour, except for one layout in twenty that explores.
        let is_near = |bearing: u32| angle_between(90.0, f64::from(bearing)) <= 45.0;
        let exploring = aims.iter().filter(|aim| aim.bearing_deg.is_some_and(|bearing| !is_near(bearing)));
        assert!(exploring.count() <= 1, "{aims:?}");
    }
}

#[test]
fn edited_designs_are_canonical_and_changed() {
    let brief = brief_at_level("kessler/rendezvous", 5, 1);
    assert!(count_edits(empty_gate().language(), &brief, 300) > 0);
}

#[test]
fn successful_layouts_are_edited() {
    let brief = brief_at_level("kessler/survival", 3, 8);
    let children = count_children(empty_gate().language(), &brief, 12, 0.15);
    assert!(children >= 2, "children are similar to their parent, but not equal");
}

fn encounter_json(step: u32, kind: &str, miss_distance: u32) -> Value {
    json!({
        "satellite": 0, "step": step, "bearing_deg": 90, "relative_speed": 40, "miss_distance": miss_distance,
        "kind": kind,
    })
}

fn design_json(mode: &str, bearing_deg: u32, encounters: &[Value]) -> Value {
    json!({"name": "x", "aim": {"mode": mode, "bearing_deg": bearing_deg}, "encounters": encounters})
}

/// Judges a design in the first eight base scenarios. Returns the name of the check that refuses it, or `admitted`.
fn verdict(gate: &mut Gate, brief: &DesignBrief, design: &Value) -> &'static str {
    let bases = (0..8).map(|number| brief.base_scenario(number));
    gate.judge(brief, design, bases).map_or_else(|refusal| refusal.check().as_str(), |_| "admitted")
}

#[test]
fn designs_are_refused_by_the_right_check() {
    let brief = brief_at_level("kessler/eco_station", 0, 3);
    let mut gate = empty_gate();
    let threat = encounter_json(12, "threat", 0);
    let mut rogue = threat.clone();
    rogue["rogue"] = json!(true);
    let slow = json!({"satellite": 0, "step": 3, "bearing_deg": 0, "relative_speed": 10, "miss_distance": 0, "kind": "threat"});
    for (design, check) in [
        (design_json("collision", 90, &[encounter_json(99, "threat", 0)]), "schema"),
        (design_json("overshoot", 90, std::slice::from_ref(&threat)), "schema"),
        (design_json("collision", 90, std::slice::from_ref(&rogue)), "schema"),
        (design_json("collision", 0, &[slow]), "compiles"),
        (design_json("collision", 200, std::slice::from_ref(&threat)), "aim"),
        (design_json("wasted_fuel", 90, &[threat]), "aim"),
    ] {
        assert_eq!(verdict(&mut gate, &brief, &design), check, "{design}");
    }
    let design = design_json("collision", 90, &[rogue]);
    let refusal = gate.judge(&brief, &design, [brief.base_scenario(0)]).unwrap_err();
    assert!(refusal.to_string().contains("no rogues"), "{refusal}");
}

#[test]
fn grazing_threat_is_uncontested() {
    let brief = brief_at_level("kessler/survival", 0, 3);
    let mut gate = empty_gate();
    // A small burn long before the encounter avoids it.
    let mut refusal_at = |step: u32| {
        let design = design_json("collision", 90, &[encounter_json(step, "threat", 19)]);
        gate.judge(&brief, &design, [brief.base_scenario(0)]).err().map(|refusal| refusal.check())
    };
    assert!((17..24).any(|step| refusal_at(step) == Some(GateCheck::Contested)));
}

#[test]
fn decoys_must_tempt_and_differ() {
    // Without fuel no agent is tempted.
    let mut poor = brief_at_level("kessler/eco_station", 0, 3);
    let params = [("debris", 1.0), ("fuel", 1.0)].into_iter();
    poor.recipe = Arc::new(Recipe::with_params(poor.recipe.task(), params).unwrap());
    let distant = design_json("wasted_fuel", 90, &[encounter_json(20, "decoy", 80)]);
    assert_eq!(verdict(&mut empty_gate(), &poor, &distant), "decoy");
    let brief = brief_at_level("kessler/eco_station", 0, 3);
    let decoys: Vec<_> = (8..14).map(|step| encounter_json(2 * step, "decoy", 30)).collect();
    let tempting = design_json("wasted_fuel", 90, &decoys);
    let mut gate = empty_gate();
    assert_eq!(verdict(&mut gate, &brief, &tempting), "admitted");
    let bases = (0..8).map(|number| brief.base_scenario(number));
    let refusal = gate.judge(&brief, &tempting, bases).unwrap_err();
    assert!(
        matches!(&refusal, Refusal::Known { like, distance, .. } if like == "x" && *distance == 0.0),
        "{refusal}"
    );
}

#[test]
fn layout_must_match_its_provenance() {
    let brief = brief_at_level("kessler/survival", 2, 4);
    let outcome = ProceduralDesigner::design_layouts(&brief, &mut empty_gate());
    let admitted = outcome.judged.iter().find_map(|judged| judged.verdict.as_ref().ok()).unwrap();
    let again = empty_gate().judge_scenario(admitted.scenario()).unwrap();
    assert_eq!((again.scenario().id(), again.kind()), (admitted.scenario().id(), LayoutKind::Threat));
    let mut forged = admitted.scenario().to_json();
    let x = forged.pointer_mut("/layout/bodies/debris/0/0").unwrap();
    *x = json!(x.as_f64().unwrap() + 0.5);
    let refusal = empty_gate().judge_scenario(&Scenario::from_json(&forged).unwrap()).unwrap_err();
    assert_eq!(refusal.check(), GateCheck::Compiles);
    assert!(refusal.to_string().starts_with("layout.provenance: "), "{refusal}");
}

/// The encounters pass at 10 LU/TU: a radar range of 6 LU shows none of them in time.
#[test]
fn threat_that_is_seen_too_late_is_unfair() {
    let task = env_core::task("kessler/survival").unwrap();
    let design = json!({
        "name": "unseen", "aim": {"mode": "collision", "bearing_deg": 250}, "frame": "radial_in_track", "params": {},
        "encounters": (0..3).map(|satellite| json!({
            "satellite": satellite, "step": 6 + satellite, "bearing_deg": 250, "relative_speed": 100, "miss_distance": 5,
            "kind": "threat", "rogue": false
        })).collect::<Vec<_>>()
    });
    let verdict = |radar_range: f64| {
        let params = [("debris", 10.0), ("fuel", 50.0), ("radar_range", radar_range)];
        let recipe = Arc::new(Recipe::with_params(task, params.into_iter()).unwrap());
        let brief = DesignBrief::new(recipe, 1, 5);
        empty_gate().judge(&brief, &design, (0..40).map(|number| brief.base_scenario(number)))
    };
    assert!(verdict(300.0).is_ok(), "{:?}", verdict(300.0));
    let refusal = verdict(6.0).unwrap_err();
    assert!(matches!(refusal, Refusal::TooLate(_)), "{refusal:?}");
    assert_eq!(refusal.check(), GateCheck::Fair);
    assert!(refusal.to_string().contains("visible"), "{refusal}");
}

#[test]
fn scenario_without_design_is_admitted_once() {
    let task = env_core::task("kessler/survival").unwrap();
    let recipe = Arc::new(Recipe::with_params(task, [("debris", 40.0)].into_iter()).unwrap());
    let mut gate = empty_gate();
    let mut scenarios = (0..200).map(|seed| Scenario::new(Arc::clone(&recipe), Seed::user(seed).unwrap()));
    let admitted = scenarios.find(|scenario| gate.judge_scenario(scenario).is_ok()).unwrap();
    assert_eq!(gate.judge_scenario(&admitted).unwrap_err(), Refusal::Duplicate);
}
