//! Critiques of goals, risk and swept contact, which only some tasks or physics have.

use serde_json::json;

use super::critique::{burn, critique, log_of, only_failure, scenario_without_debris, survival, with_threat};
use crate::critique::Verdict;
use crate::episode_rng::SeededRng;
use crate::kessler::kernel::Gravity;
use crate::kessler::reward::formation_quality;
use crate::kessler::setup::KesslerSetup;
use crate::kessler::threat_placement::{Threat, place_threat};
use crate::rollout::replay;
use crate::task::{Recipe, Scenario};

#[test]
fn rendezvous_is_overshot_missed_or_held() {
    let start = scenario_without_debris("kessler/rendezvous", 80.0, &json!({}));
    let climb = |speed: f64| log_of(&[burn(1, 0, speed, 0.0)]);
    let past: Vec<_> = (1..=4).map(|step| burn(step, 0, 1.0, 0.0)).collect();
    let critiqued = critique(&start, &log_of(&past));
    assert_eq!(only_failure(&critiqued).mode, "overshoot");
    insta::assert_snapshot!(only_failure(&critiqued).explanation, @"Satellite 0 reached radius 100 at step 6 at a radial speed of 3.8 LU/TU and left it again at step 8, between 97.3 and 240.3 LU: mean proximity 0.00 over the last 20 steps.");
    // A radial kick of 1 LU/TU gives an apogee of 112 LU a quarter of an orbit later.
    let critiqued = critique(&start, &climb(1.0));
    assert_eq!(only_failure(&critiqued).mode, "overshoot");
    assert_eq!(critiqued.assessment.case, "goal_missed");
    insta::assert_snapshot!(only_failure(&critiqued).explanation, @"Satellite 0 reached radius 100 at step 21 at a radial speed of 0.7 LU/TU and left it again at step 31, between 97.4 and 108.2 LU: mean proximity 0.79 over the last 20 steps.");
    let critiqued = critique(&start, &climb(0.3));
    assert_eq!(only_failure(&critiqued).mode, "short");
    insta::assert_snapshot!(only_failure(&critiqued).explanation, @"Satellite 0 never came within 3 LU of radius 100: nearest was 85.4 LU at step 39; mean proximity 0.51 over the last 20 steps.");
    assert!(critiqued.assessment.case == "goal_missed" && (-0.5..0.5).contains(&critiqued.assessment.value));

    let plan = start.task().bracket(&start).unwrap().reference_plan;
    let critiqued = critique(&start, &plan);
    assert_eq!((critiqued.failures.len(), critiqued.assessment.case), (0, "goal_reached"));
    assert!((0.8..=1.0).contains(&critiqued.assessment.value));
    assert!(critiqued.actions.iter().any(|a| a.verdict == Verdict::Needed));
}

/// Without control a triangle shears apart; the planner keeps it.
#[test]
fn formation_without_control_breaks_up() {
    let recipe =
        Recipe::with_params(crate::task("kessler/formation").unwrap(), [("debris", 0.0)].into_iter());
    let scenario = Scenario::new(recipe.unwrap(), crate::Seed::user(4).unwrap());
    let critiqued = critique(&scenario, &log_of(&[]));
    let failure = only_failure(&critiqued);
    assert_eq!((failure.mode, critiqued.assessment.case), ("break_up", "goal_missed"));
    let mut bodies = KesslerSetup::from_recipe(scenario.recipe())
        .unwrap()
        .draw_initial_state(&mut SeededRng::new(scenario.seed()))
        .unwrap()
        .satellites;
    let held = (0..50).map(|_| {
        bodies = bodies.map(|body| body.coast(Gravity::Point));
        formation_quality(&bodies) >= 0.9
    });
    let held: Vec<bool> = held.collect();
    assert_eq!(held.iter().rposition(|&held| held).map_or(0, |last| last + 1), failure.step as usize - 1);
    insta::assert_snapshot!(failure.explanation, @"The formation was lost at step 4: satellites 0 and 1 were 24.9 LU apart, 95.5 at the end, not 20; mean formation quality 0.33 over the last steps.");

    let plan = scenario.task().bracket(&scenario).unwrap().reference_plan;
    let critiqued = critique(&scenario, &plan);
    assert_eq!((critiqued.failures.len(), critiqued.assessment.case), (0, "goal_reached"));
}

/// Under `risk: pc` a goal that was held can be missed for lack of survival, without a loss: the critique
/// reports risk.
#[test]
fn goal_held_with_low_survival_is_risk() {
    let mut words = std::collections::BTreeMap::new();
    for task in ["kessler/formation", "kessler/rendezvous"] {
        let params = [("debris", 25.0), ("sigma", 0.6)];
        let plain = Recipe::with_params(crate::task(task).unwrap(), params.into_iter()).unwrap();
        let risky = plain.clone().with_option("risk", "pc").unwrap();
        for seed in (0..80).map(|seed| crate::Seed::user(seed).unwrap()) {
            // A plan that succeeds if only contact counts.
            let log = plain.task().bracket(&Scenario::new(plain.clone(), seed)).unwrap().reference_plan;
            let scenario = Scenario::new(risky.clone(), seed);
            let outcome = replay(&scenario, &log).unwrap();
            let critiqued = critique(&scenario, &log);
            let missed = outcome.lost == 0 && outcome.goal.is_some_and(|goal| goal < 0.9);
            let Some(failure) =
                critiqued.failures.iter().find(|f| missed && f.step == 50 && f.mode == "risk")
            else {
                continue;
            };
            let measure = |name| failure.measures.iter().find(|m| m.name == name).unwrap().value;
            assert!(measure("held") >= 0.9 && (0.9..1.0).contains(&measure("survival")), "{failure:?}");
            assert!(!critiqued.failures.iter().any(|f| ["break_up", "short", "overshoot"].contains(&f.mode)));
            words.entry(task).or_insert_with(|| failure.explanation.clone());
        }
    }
    insta::assert_snapshot!(words["kessler/formation"], @"The goal was held at 1.000 over the last 25 steps, but close approaches left satellite 2 with survival 0.906: 0.887 in total.");
}

#[test]
fn risk_is_attributed_to_the_worst_approach() {
    let mut scenario = with_threat(&survival(&json!({})), 12, 0.0).to_json();
    scenario["physics"]["risk"] = json!("pc");
    let scenario = Scenario::from_json(&scenario).unwrap();
    let critiqued = critique(&scenario, &log_of(&[]));
    let failure = only_failure(&critiqued);
    assert_eq!((failure.mode, failure.agent), ("risk", 0));
    assert!(
        (12..=13).contains(&failure.step),
        "at the end of step 12 both are at one place, within rounding"
    );
    let sigma = scenario.recipe().param("sigma").unwrap();
    let probability = failure.measures.iter().find(|m| m.name == "probability").unwrap().value;
    assert!((probability - libm::erf(2.0 / sigma / std::f64::consts::SQRT_2)).abs() < 1e-9);
    let encounter = failure.encounter.as_ref().unwrap();
    assert_eq!((encounter.body, encounter.avoidable), (0, Some(true)));
    assert_eq!((critiqued.assessment.case, critiqued.assessment.value), ("threat_missed", -1.0));
    let remedy = encounter.cheapest_avoidance.as_ref().unwrap();
    let log = log_of(&[burn(remedy.step, 0, remedy.values[0], remedy.values[1])]);
    assert_eq!(replay(&scenario, &log).unwrap().lost, 0);
    let critiqued = critique(&scenario, &log);
    assert_eq!((critiqued.failures.len(), critiqued.assessment.case), (0, "threat_avoided"));
    assert_eq!(critiqued.actions[0].verdict, Verdict::Needed);
}

/// At 8 LU/TU the debris passes a satellite between two ends of steps.
#[test]
fn swept_contact_has_encounter_geometry() {
    let start = survival(&json!({}));
    let critique_moved = |swept: bool| {
        let mut scenario =
            place_threat(&start, Threat { satellite: 0, step: 12, direction: 0.5, speed: 8.0 })
                .unwrap()
                .to_json();
        // Moves the debris back by half a relative step along its track.
        let debris = &mut scenario["layout"]["bodies"]["debris"][0];
        let body: Vec<f64> = (0..4).map(|i| debris[i].as_f64().unwrap()).collect();
        *debris = json!([body[0] - 0.5 * body[2], body[1] - 0.5 * body[3], body[2], body[3]]);
        scenario["physics"]["contact"] = json!(if swept { "swept" } else { "end_of_step" });
        critique(&Scenario::from_json(&scenario).unwrap(), &log_of(&[]))
    };
    assert_eq!(critique_moved(false).assessment.case, "no_action_needed");
    let critiqued = critique_moved(true);
    let encounter = only_failure(&critiqued).encounter.as_ref().unwrap();
    assert!(
        (encounter.relative_speed - 8.0).abs() < 2.0 && encounter.avoidable == Some(true),
        "{encounter:?}"
    );
}
