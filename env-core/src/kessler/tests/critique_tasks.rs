//! The critique of what only some tasks or physics have: goals, risk, swept contact.

use serde_json::json;

use super::critique::{burns, critique, only, quiet, survival, threat};
use crate::chance::Seeded;
use crate::critique::Verdict;
use crate::kessler::kernel::Gravity;
use crate::kessler::plant::{Threat, plant};
use crate::kessler::reward::form;
use crate::kessler::setup::Setup;
use crate::rollout::replay;
use crate::scenario::{Recipe, Scenario};

#[test]
fn rendezvous_is_overshot_missed_or_held() {
    let start = quiet("kessler/rendezvous", 80.0, &json!({}));
    let climb = |speed: f64| burns(&[(1, 0, speed, 0.0)]);
    let past: Vec<_> = (1..=4).map(|step| (step, 0, 1.0, 0.0)).collect();
    let told = critique(&start, &burns(&past));
    assert_eq!(only(&told).mode, "overshoot");
    insta::assert_snapshot!(only(&told).words, @"Satellite 0 reached radius 100 at step 6 at a radial speed of 3.8 LU/TU and left it again at step 8, between 97.3 and 240.3 LU: mean proximity 0.00 over the last 20 steps.");
    // A radial kick of 1 is an apogee of 112 LU a quarter of an orbit later.
    let told = critique(&start, &climb(1.0));
    assert_eq!(only(&told).mode, "overshoot");
    assert_eq!(told.judged.case, "goal_missed");
    insta::assert_snapshot!(only(&told).words, @"Satellite 0 reached radius 100 at step 21 at a radial speed of 0.7 LU/TU and left it again at step 31, between 97.4 and 108.2 LU: mean proximity 0.79 over the last 20 steps.");
    let told = critique(&start, &climb(0.3));
    assert_eq!(only(&told).mode, "short");
    insta::assert_snapshot!(only(&told).words, @"Satellite 0 never came within 3 LU of radius 100: nearest was 85.4 LU at step 39; mean proximity 0.51 over the last 20 steps.");
    assert!(told.judged.case == "goal_missed" && (-0.5..0.5).contains(&told.judged.value));

    let witness = start.task().bracket(&start).unwrap().witness;
    let told = critique(&start, &witness);
    assert_eq!((told.failures.len(), told.judged.case), (0, "goal_reached"));
    assert!((0.8..=1.0).contains(&told.judged.value));
    assert!(told.actions.iter().any(|a| a.verdict == Verdict::Needed));
}

/// Left alone, a triangle shears apart; the planner keeps it.
#[test]
fn a_formation_that_is_not_kept_breaks_up() {
    let recipe =
        Recipe::with_params(crate::task("kessler/formation").unwrap(), [("debris", 0.0)].into_iter());
    let scenario = Scenario::new(recipe.unwrap(), crate::Seed::user(4).unwrap());
    let told = critique(&scenario, &burns(&[]));
    let failure = only(&told);
    assert_eq!((failure.mode, told.judged.case), ("break_up", "goal_missed"));
    let mut bodies =
        Setup::read(scenario.recipe()).unwrap().start(&mut Seeded::new(scenario.seed())).unwrap().satellites;
    let held = (0..50).map(|_| {
        bodies = bodies.map(|body| body.coasted(Gravity::Point));
        form(&bodies) >= 0.9
    });
    let held: Vec<bool> = held.collect();
    assert_eq!(held.iter().rposition(|&held| held).map_or(0, |last| last + 1), failure.step as usize - 1);
    insta::assert_snapshot!(failure.words, @"The formation was lost at step 4: satellites 0 and 1 were 24.9 LU apart, 95.5 at the end, not 20; mean form 0.33 over the last steps.");

    let witness = scenario.task().bracket(&scenario).unwrap().witness;
    let told = critique(&scenario, &witness);
    assert_eq!((told.failures.len(), told.judged.case), (0, "goal_reached"));
}

/// Under `risk: pc` nothing is hit: a pass through the middle costs Φ(2/σ) − Φ(−2/σ) of survival.
/// Under `risk: pc` a goal that was held can be missed for want of safety, with nobody lost: that is told as what it is.
#[test]
fn a_goal_that_was_held_in_danger_is_risk() {
    let mut told = std::collections::BTreeMap::new();
    for task in ["kessler/formation", "kessler/rendezvous"] {
        let params = [("debris", 25.0), ("sigma", 0.6)];
        let plain = Recipe::with_params(crate::task(task).unwrap(), params.into_iter()).unwrap();
        let risky = plain.clone().with_option("risk", "pc").unwrap();
        for seed in (0..80).map(|seed| crate::Seed::user(seed).unwrap()) {
            // What succeeds where only contact counts.
            let log = plain.task().bracket(&Scenario::new(plain.clone(), seed)).unwrap().witness;
            let scenario = Scenario::new(risky.clone(), seed);
            let flown = replay(&scenario, &log).unwrap();
            let shown = critique(&scenario, &log);
            let missed = flown.lost == 0 && flown.goal.is_some_and(|goal| goal < 0.9);
            let Some(failure) = shown.failures.iter().find(|f| missed && f.step == 50 && f.mode == "risk")
            else {
                continue;
            };
            let measure = |name| failure.measures.iter().find(|m| m.name == name).unwrap().value;
            assert!(measure("held") >= 0.9 && (0.9..1.0).contains(&measure("survival")), "{failure:?}");
            assert!(!shown.failures.iter().any(|f| ["break_up", "short", "overshoot"].contains(&f.mode)));
            told.entry(task).or_insert_with(|| failure.words.clone());
        }
    }
    insta::assert_snapshot!(told["kessler/formation"], @"The goal was held, 1.000 over the last 25 steps, but encounters left satellite 2 a survival of 0.906: together 0.887.");
}

#[test]
fn risk_is_laid_to_the_worst_encounter() {
    let mut scenario = threat(&survival(&json!({})), 12, 0.0).to_json();
    scenario["physics"]["risk"] = json!("pc");
    let scenario = Scenario::from_json(&scenario).unwrap();
    let told = critique(&scenario, &burns(&[]));
    let failure = only(&told);
    assert_eq!((failure.mode, failure.agent), ("risk", 0));
    assert!(
        (12..=13).contains(&failure.step),
        "at the end of step 12 they are in one place, within rounding"
    );
    let sigma = scenario.recipe().param("sigma").unwrap();
    let probability = failure.measures.iter().find(|m| m.name == "probability").unwrap().value;
    assert!((probability - libm::erf(2.0 / sigma / std::f64::consts::SQRT_2)).abs() < 1e-9);
    let met = failure.encounter.as_ref().unwrap();
    assert_eq!((met.body, met.avoidable), (0, Some(true)));
    assert_eq!((told.judged.case, told.judged.value), ("threat_missed", -1.0));
    let remedy = met.cheapest.as_ref().unwrap();
    let log = burns(&[(remedy.step, 0, remedy.values[0], remedy.values[1])]);
    assert_eq!(replay(&scenario, &log).unwrap().lost, 0);
    let told = critique(&scenario, &log);
    assert_eq!((told.failures.len(), told.judged.case), (0, "threat_avoided"));
    assert_eq!(told.actions[0].verdict, Verdict::Needed);
}

/// At 8 LU/TU end of step after end of step steps over a satellite that it meets half way.
#[test]
fn swept_contacts_have_their_geometry() {
    let start = survival(&json!({}));
    let moved = |swept: bool| {
        let mut scenario =
            plant(&start, Threat { satellite: 0, step: 12, direction: 0.5, speed: 8.0 }).unwrap().to_json();
        // Half a relative step back along the track of the debris.
        let debris = &mut scenario["layout"]["bodies"]["debris"][0];
        let body: Vec<f64> = (0..4).map(|i| debris[i].as_f64().unwrap()).collect();
        *debris = json!([body[0] - 0.5 * body[2], body[1] - 0.5 * body[3], body[2], body[3]]);
        scenario["physics"]["contact"] = json!(if swept { "swept" } else { "end_of_step" });
        critique(&Scenario::from_json(&scenario).unwrap(), &burns(&[]))
    };
    assert_eq!(moved(false).judged.case, "no_action_needed");
    let told = moved(true);
    let met = only(&told).encounter.as_ref().unwrap();
    assert!((met.relative_speed - 8.0).abs() < 2.0 && met.avoidable == Some(true), "{met:?}");
}
