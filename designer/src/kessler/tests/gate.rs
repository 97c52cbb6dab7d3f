//! The gate lets through what it claims and nothing else; what it refuses it refuses by name.

use std::sync::Arc;

use env_core::task;

use super::*;
use crate::brief::{Brief, Fate, Past};
use crate::gate::{CHECKS, Gate, Refusal};
use crate::procedural::Procedural;
use crate::profile::{Cell, ModeProfile, Profile};
use crate::{Admitted, Claim, language};

pub(super) fn at_level(task_id: &str, level: u32, seed: u64) -> Brief {
    let task = task(task_id).unwrap();
    let recipe = Recipe::with_params(task, task.levels().params(level as usize)).unwrap();
    Brief::new(Arc::new(recipe), 4, seed).at_level(task.levels(), level)
}

pub(super) fn gate() -> Gate {
    Gate::new(language(task("kessler/survival").unwrap()).unwrap(), Vec::new())
}

/// A profile in which this mode is all there is.
fn only(task: &str, mode: &str) -> Profile {
    let cell = Cell { sector: Some(3), band: Some(2), count: 9, weight: 9.0, ..Cell::default() };
    let mode = ModeProfile {
        mode: mode.to_owned(),
        count: 9,
        weight: 9.0,
        cells: vec![cell],
        ..ModeProfile::default()
    };
    Profile { task: task.to_owned(), criticised: 50, weight: 50.0, modes: vec![mode] }
}

/// Flown again from its stored form, by the engine and not by the planner, it is what the gate said.
fn is_what_it_claims(admitted: &Admitted) {
    let stored = Scenario::from_json(&admitted.scenario().to_json()).unwrap();
    assert_eq!(stored.id(), admitted.scenario().id());
    let bracket = admitted.bracket();
    let flown = replay(&stored, &bracket.witness).unwrap();
    assert_eq!(flown, bracket.reference);
    assert!(env_core::bracket::success(&stored, env_core::SuccessRule::Task, bracket, &flown));
    let fuel = stored.recipe().param("fuel").unwrap();
    assert!(flown.fuel_used <= 3.0 * fuel + 1e-9);
    let mut holds = ActionLog::new(2, Precision::F64);
    holds.stopped = Some(env_core::Stopped::TooLate); // to the end
    let held = replay(&stored, &holds).unwrap();
    match admitted.claim() {
        Claim::Threat => assert!(held.lost > 0),
        Claim::Decoy => assert_eq!(held.lost, 0),
    }
    let losses = stored.task().critique(&stored, &holds).unwrap().failures;
    assert!(losses.iter().filter(|f| f.encounter.is_some()).all(|f| f.step >= 3));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    /// Whatever is asked for, in every task and level: nothing unfair, unsolvable or untrue gets through, and the same
    /// brief makes the same layouts.
    #[test]
    fn what_is_admitted_is_fair_solvable_and_true(
        task in prop::sample::select(vec!["kessler/survival", "kessler/eco_station", "kessler/rendezvous", "kessler/formation"]),
        level in 0u32..10,
        seed in 0u64..1_000_000,
        mode in prop::sample::select(vec!["collision", "rogue", "fuel_starvation", "wasted_fuel", "decay"]),
    ) {
        let mut brief = at_level(task, level, seed);
        brief.count = 1;
        brief.profile = only(task, mode);
        let designed = Procedural::layouts(&brief, &mut gate());
        for judged in &designed.judged {
            match &judged.verdict {
                Ok(admitted) => is_what_it_claims(admitted),
                Err(refusal) => prop_assert!(refusal.to_string().len() > 20 && refusal.rank() < CHECKS.len()),
            }
        }
        prop_assert_eq!(designed, Procedural::layouts(&brief, &mut gate()));
    }
}

#[test]
fn the_aim_is_what_the_profile_says() {
    for (task, mode) in
        [("survival", "collision"), ("eco_station", "wasted_fuel"), ("survival", "fuel_starvation")]
    {
        let task = format!("kessler/{task}");
        let mut brief = at_level(&task, 3, 5);
        brief.profile = only(&task, mode);
        let designed = Procedural::layouts(&brief, &mut gate());
        assert_eq!(designed.admitted(), 4, "{mode}: {:?}", designed.judged);
        let admitted = designed.judged.iter().filter(|judged| judged.verdict.is_ok());
        let aims = admitted.map(|judged| Design::from_json(judged.design.as_ref().unwrap()).unwrap().aim);
        let aims: Vec<_> = aims.collect();
        assert!(aims.iter().all(|aim| aim.mode == mode));
        // Sector 3 or beside it, but for the one in twenty that explores.
        let there = |bearing: u32| difference(90.0, f64::from(bearing)).abs() <= 45.0;
        let off = aims.iter().filter(|aim| aim.bearing_deg.is_some_and(|bearing| !there(bearing)));
        assert!(off.count() <= 1, "{aims:?}");
    }
}

#[test]
fn edits_keep_to_the_language_and_change_something() {
    let brief = at_level("kessler/rendezvous", 5, 1);
    let language = gate().language();
    let mut draws = env_core::Draws::new(env_core::draws::Purpose::Design, 1, 1);
    let sky = brief.sky(0);
    let mut design = language.sample(&brief, &sky, &mut draws).unwrap();
    for _ in 0..300 {
        let Some(child) = language.edit(&design, &brief, &sky, &mut draws) else { continue };
        assert_ne!(child, design);
        assert_eq!(language.read(&child, &brief).unwrap(), child);
        design = child;
    }
}

#[test]
fn what_worked_is_edited() {
    let mut brief = at_level("kessler/survival", 3, 8);
    let first = Procedural::layouts(&brief, &mut gate());
    let parent = first.judged.iter().find_map(|j| j.verdict.as_ref().ok()).unwrap();
    let design = parent.scenario().recipe().layout().unwrap().provenance.clone().unwrap();
    let fate = Fate::Flown { episodes: 8, success: 0.0, regret: 1.0, as_aimed: None, retired: false };
    brief.fates = vec![Past { design: design.clone(), sky: Some(parent.scenario().seed()), fate }];
    brief.count = 12;
    let mut known = Gate::new(gate().language(), vec![design.clone()]);
    let next = Procedural::layouts(&brief, &mut known);
    let near = next.judged.iter().filter(|j| j.verdict.is_ok()).filter(|judged| {
        let distance = gate().language().distance(judged.design.as_ref().unwrap(), &design);
        (crate::gate::MIN_NOVELTY..0.15).contains(&distance)
    });
    assert!(near.count() >= 2, "children are like their parent, and not the same");
}

/// One design of each that the gate has a word for.
#[test]
fn every_refusal_has_its_name() {
    let brief = at_level("kessler/eco_station", 0, 3);
    let encounter = |step: u32, kind: &str, miss: u32| json!({"satellite": 0, "step": step, "bearing_deg": 90, "relative_speed": 40, "miss_distance": miss, "kind": kind});
    let design = |mode: &str, bearing: u32, encounters: Vec<serde_json::Value>| json!({"name": "x", "aim": {"mode": mode, "bearing_deg": bearing}, "encounters": encounters});
    let mut gate = gate();
    let mut judge = |design: &serde_json::Value| gate.judge(&brief, design, (0..8).map(|n| brief.sky(n)));
    let word =
        |verdict: Result<Admitted, Refusal>| verdict.map_or_else(|refusal| refusal.check(), |_| "admitted");

    let outside = design("collision", 90, vec![encounter(99, "threat", 0)]);
    assert_eq!(word(judge(&outside)), "schema");
    let unknown = design("overshoot", 90, vec![encounter(12, "threat", 0)]);
    assert_eq!(word(judge(&unknown)), "schema");
    let mut rogue = design("collision", 90, vec![encounter(12, "threat", 0)]);
    rogue["encounters"][0]["rogue"] = json!(true);
    let refused = judge(&rogue).unwrap_err();
    assert_eq!((refused.check(), refused.to_string().contains("no rogues")), ("schema", true));
    let slow = json!({"satellite": 0, "step": 3, "bearing_deg": 0, "relative_speed": 10, "miss_distance": 0, "kind": "threat"});
    assert_eq!(word(judge(&design("collision", 0, vec![slow]))), "compiles");
    assert_eq!(word(judge(&design("collision", 200, vec![encounter(12, "threat", 0)]))), "aim");
    assert_eq!(word(judge(&design("wasted_fuel", 90, vec![encounter(12, "threat", 0)]))), "aim");
    let survival = at_level("kessler/survival", 0, 3);
    // Far from the start even a gentle kick leads past.
    let one = |step: u32| design("collision", 90, vec![encounter(step, "threat", 19)]);
    let mut fresh = super::gate::gate();
    assert!((17..24).any(|step| word(fresh.judge(&survival, &one(step), [survival.sky(0)])) == "contested"));
    // Who has nothing to burn cannot be tempted.
    let mut poor = at_level("kessler/eco_station", 0, 3);
    let params = [("debris", 1.0), ("fuel", 1.0)].into_iter();
    poor.base = Arc::new(Recipe::with_params(poor.base.task(), params).unwrap());
    let dull = design("wasted_fuel", 90, vec![encounter(20, "decoy", 80)]);
    assert_eq!(word(fresh.judge(&poor, &dull, (0..8).map(|n| poor.sky(n)))), "decoy");
    let decoys = (8..14).map(|step| encounter(2 * step, "decoy", 30)).collect();
    let tempting = design("wasted_fuel", 90, decoys);
    assert_eq!(word(judge(&tempting)), "admitted");
    let again = judge(&tempting).unwrap_err();
    assert!(
        matches!(&again, Refusal::Known { like, distance } if like == "x" && *distance == 0.0),
        "{again}"
    );
}

#[test]
fn a_layout_that_is_not_what_its_provenance_says_is_refused() {
    let brief = at_level("kessler/survival", 2, 4);
    let designed = Procedural::layouts(&brief, &mut gate());
    let admitted = designed.judged.iter().find_map(|judged| judged.verdict.as_ref().ok()).unwrap();
    let again = gate().judge_scenario(admitted.scenario()).unwrap();
    assert_eq!((again.scenario().id(), again.claim()), (admitted.scenario().id(), Claim::Threat));
    let mut forged = admitted.scenario().to_json();
    let x = forged.pointer_mut("/layout/bodies/debris/0/0").unwrap();
    *x = json!(x.as_f64().unwrap() + 0.5);
    let refused = gate().judge_scenario(&Scenario::from_json(&forged).unwrap()).unwrap_err();
    assert_eq!(refused.check(), "compiles");
    assert!(refused.to_string().starts_with("layout.provenance: "), "{refused}");
}

/// Passes at 10 LU/TU: a radar of 6 LU shows none of them in time, one without a limit does.
#[test]
fn what_nobody_can_see_in_time_is_not_fair() {
    let task = env_core::task("kessler/survival").unwrap();
    let design = json!({
        "name": "unseen", "aim": {"mode": "collision", "bearing_deg": 250}, "frame": "radial_in_track", "params": {},
        "encounters": (0..3).map(|satellite| json!({
            "satellite": satellite, "step": 6 + satellite, "bearing_deg": 250, "relative_speed": 100, "miss_distance": 5,
            "kind": "threat", "rogue": false
        })).collect::<Vec<_>>()
    });
    let verdict = |radar: f64| {
        let params = [("debris", 10.0), ("fuel", 50.0), ("radar_range", radar)];
        let brief = Brief::new(Arc::new(Recipe::with_params(task, params.into_iter()).unwrap()), 1, 5);
        let mut gate = Gate::new(language(task).unwrap(), Vec::new());
        gate.judge(&brief, &design, (0..40).map(|number| brief.sky(number)))
    };
    assert!(verdict(300.0).is_ok(), "{:?}", verdict(300.0));
    let refused = verdict(6.0).unwrap_err();
    assert!(matches!(refused, Refusal::Unseen(_)) && refused.check() == "fair", "{refused:?}");
    assert!(refused.to_string().contains("radar"), "{refused}");
}

#[test]
fn the_same_scenario_by_hand_is_known_the_second_time() {
    let task = env_core::task("kessler/survival").unwrap();
    let recipe = Arc::new(Recipe::with_params(task, [("debris", 40.0)].into_iter()).unwrap());
    let mut gate = Gate::new(language(task).unwrap(), Vec::new());
    let skies = (0..200).map(|seed| Scenario::new(Arc::clone(&recipe), Seed::user(seed).unwrap()));
    let passed = skies.into_iter().find(|sky| gate.judge_scenario(sky).is_ok()).unwrap();
    assert_eq!(gate.judge_scenario(&passed).unwrap_err().check(), "new");
}
