//! The critique on constructed scenarios whose answer is known.

use serde_json::{Value, json};

use super::at_level;
use crate::critique::{Critique, Encounter, Failure, Verdict};
use crate::kessler::kernel::{Body, Gravity};
use crate::kessler::plant::{Threat, plant};
use crate::log::{ActionLog, Precision, Stopped};
use crate::rollout::replay;
use crate::scenario::Scenario;

/// Where satellite 0 starts unless a test says otherwise, LU; its mean motion there is √(1000/60³) = 0.068 per TU.
const RADIUS: f64 = 60.0;
const SPEED: f64 = 4.0;

/// Three satellites far from each other, satellite 0 on +X, and no debris.
pub(super) fn quiet(task: &str, radius: f64, params: &Value) -> Scenario {
    let v = |r: f64| (1000.0f64 / r).sqrt();
    let mut params = params.clone();
    params["debris"] = json!(0);
    params["rogue_probability"] = json!(0);
    Scenario::from_json(&json!({
        "task": task,
        "params": params,
        "layout": {"mode": "replace", "bodies": {
            "satellites": [[radius, 0.0, 0.0, v(radius)], [-70.0, 0.0, 0.0, -v(70.0)], [0.0, 78.0, -v(78.0), 0.0]],
            "debris": [],
        }},
        "seed": 3,
    }))
    .unwrap()
}

pub(super) fn survival(params: &Value) -> Scenario {
    quiet("kessler/survival", RADIUS, params)
}

/// Something on satellite 0's way, from `direction` degrees (radial out towards in-track, at contact), if it can come
/// from there without coming out of the Earth.
fn try_threat(scenario: &Scenario, step: u32, direction: f64) -> Option<Scenario> {
    plant(scenario, Threat { satellite: 0, step, direction: direction.to_radians(), speed: SPEED }).ok()
}

pub(super) fn threat(scenario: &Scenario, step: u32, direction: f64) -> Scenario {
    try_threat(scenario, step, direction).unwrap()
}

/// These burns of (step, satellite, dvx, dvy), and hold.
pub(super) fn burns(burns: &[(u32, u32, f64, f64)]) -> ActionLog {
    let mut log = ActionLog::new(2, Precision::F64);
    for step in 1..=burns.iter().map(|b| b.0).max().unwrap_or(0) {
        for (_, satellite, dvx, dvy) in burns.iter().filter(|b| b.0 == step) {
            log.act(*satellite, &[*dvx, *dvy]);
        }
        log.end_step();
    }
    log.stopped = Some(Stopped::TooLong);
    log
}

pub(super) fn critique(scenario: &Scenario, log: &ActionLog) -> Critique {
    scenario.task().critique(scenario, log).unwrap()
}

pub(super) fn only(critique: &Critique) -> &Failure {
    assert_eq!(critique.failures.len(), 1, "{:?}", critique.failures);
    &critique.failures[0]
}

fn met(scenario: &Scenario) -> Encounter {
    let critique = critique(scenario, &burns(&[]));
    only(&critique).encounter.clone().unwrap()
}

/// Difference of two angles, degrees, in [0, 180].
fn apart(a: f64, b: f64) -> f64 {
    let d = (a - b).rem_euclid(360.0);
    d.min(360.0 - d)
}

/// The angle of satellite 0 after `step`, degrees from +X.
fn angle_after(step: u32) -> f64 {
    let mut body = Body::circular(RADIUS, 0.0, 1.0);
    for _ in 0..step {
        body = body.coasted(Gravity::Point);
    }
    libm::atan2(body.y, body.x).to_degrees()
}

/// One step before contact the debris is exactly one relative step away: p_k = p_{k+1} − v_{k+1} for both bodies.
#[test]
fn bearings_one_step_before_contact_are_exact() {
    let scenario = survival(&json!({"radar_range": 6})); // sees 4 LU, one step before, and not 8
    let mut seen = 0;
    for (step, inertial) in
        [3, 6, 10, 15].into_iter().flat_map(|s| [0, 45, 90, 135, 180, 225, 270].map(|d| (s, d)))
    {
        let inertial = f64::from(inertial);
        let Some(planted) = try_threat(&scenario, step, inertial - angle_after(step)) else { continue };
        let found = met(&planted);
        assert_eq!((found.first_visible_step, found.steps_left), (Some(step - 1), 1));
        // Rounding of a trip back to the start and forth again (tested to 1e-9), at 4 LU.
        assert!(apart(found.bearing_inertial_deg.unwrap(), inertial) < 1e-6, "{found:?}");
        assert!(apart(found.bearing_deg, inertial - angle_after(step - 1)) < 1e-6, "{found:?}");
        assert!((found.relative_speed - SPEED).abs() < 1e-8);
        // At most 1 LU/TU, so 1 LU in the one step that is left; contact is at 2.
        assert_eq!((found.avoidable, found.cheapest), (Some(false), None));
        seen += 1;
    }
    assert!(seen >= 20, "{seen}");
}

/// Five steps before, the relative path has been bent by the difference of gravity over up to 20 LU, at most
/// 2·n²·d: for a mean distance of 10 LU and 60 LU radius (n = 0.068/TU) 0.09 LU/TU², 1.2 LU after 5 TU, 3° of 20 LU. Debris
/// that passes nearer to the Earth is bent more: 10°, a third of a sector.
#[test]
fn bearings_five_steps_before_contact() {
    let scenario = survival(&json!({}));
    let mut seen = 0;
    for (step, direction) in [8, 12, 20].into_iter().flat_map(|s| [0.0, 90.0, 180.0, 270.0].map(|d| (s, d))) {
        // +X, +Y, −X, −Y as people speak.
        if let Some(planted) = try_threat(&scenario, step, direction - angle_after(step)) {
            let found = met(&planted);
            assert!(apart(found.bearing_inertial_deg.unwrap(), direction) < 10.0, "{direction} {found:?}");
            seen += 1;
        }
        // Radial out, ahead, below, behind, as seen at contact; since then the frame has turned.
        if let Some(planted) = try_threat(&scenario, step, direction) {
            let found = met(&planted);
            let turned = apart(angle_after(step), angle_after(step - 5));
            assert!(apart(found.bearing_deg, direction + turned) < 10.0, "{direction} {found:?}");
            seen += 1;
        }
    }
    assert!(seen >= 16, "{seen}");
}

#[test]
fn a_threat_in_sight_can_be_avoided_and_the_remedy_works() {
    let scenario = threat(&survival(&json!({})), 12, 0.0);
    let told = critique(&scenario, &burns(&[]));
    let failure = only(&told);
    assert_eq!((failure.mode, failure.agent, failure.step), ("collision", 0, 12));
    let met = failure.encounter.as_ref().unwrap();
    assert_eq!((met.first_visible_step, met.steps_left, met.avoidable), (Some(0), 12, Some(true)));
    let remedy = met.cheapest.as_ref().unwrap();
    // Contact is at 2 LU: 0.2 LU/TU moves a satellite as far in ten steps, 0.05 in no less than twelve.
    assert!(remedy.cost <= 1.0 + 1e-12, "{remedy:?}");
    let flown = replay(&scenario, &burns(&[(remedy.step, 0, remedy.values[0], remedy.values[1])])).unwrap();
    assert_eq!((flown.lost, flown.fuel_used), (0, remedy.cost));
    assert_eq!((told.judged.case, told.judged.value), ("threat_missed", -1.0));
    insta::assert_snapshot!(failure.words, @"Debris 0 hit satellite 0 at step 12, from 20° (radial out towards in-track) at 4.0 LU/TU; it was visible from step 0, 12 steps before, and one burn at step 4 for 1.00 fuel would have avoided it.");
    insta::assert_snapshot!(told.judged.words, @"Satellite 0 was lost to what was visible and could have been avoided.");
}

#[test]
fn nobody_is_blamed_for_what_could_not_be_known_in_time() {
    let late = critique(&threat(&survival(&json!({"radar_range": 6})), 10, 30.0), &burns(&[]));
    assert_eq!((late.judged.case, late.judged.value), ("unavoidable", 0.0));
    insta::assert_snapshot!(only(&late).words, @"Debris 0 hit satellite 0 at step 10, from 34° (radial out towards in-track) at 4.0 LU/TU; it was visible from step 9, 1 step before, and no single burn within what was known and left of the fuel would have avoided it.");

    let hidden = critique(&threat(&survival(&json!({"radar_range": 3})), 10, 30.0), &burns(&[]));
    let met = only(&hidden).encounter.as_ref().unwrap();
    assert_eq!((met.first_visible_step, met.steps_left, met.avoidable), (None, 0, None));
    assert_eq!((hidden.judged.case, hidden.judged.value), ("unavoidable", 0.0));
    insta::assert_snapshot!(only(&hidden).words, @"Debris 0 hit satellite 0 at step 10, from 49° (radial out towards in-track) at 4.0 LU/TU; nobody saw it come.");
}

#[test]
fn the_witness_saves_by_needed_burns() {
    for step in [5, 12, 25] {
        let start = survival(&json!({}));
        let scenario = (0..12).find_map(|d| try_threat(&start, step, 200.0 + 30.0 * f64::from(d))).unwrap();
        let witness = scenario.task().bracket(&scenario).unwrap().witness;
        let told = critique(&scenario, &witness);
        assert_eq!(told.failures, []);
        assert!(!told.actions.is_empty());
        assert!(told.actions.iter().all(|a| a.agent != 0 || a.verdict == Verdict::Needed), "{told:?}");
        assert_eq!(told.judged.case, "threat_avoided");
        assert!((0.8..=1.0).contains(&told.judged.value));
    }
}

/// Debris that only meets who burns.
#[test]
fn a_burn_into_debris_is_harmful() {
    let before = survival(&json!({}));
    let mut moved = before.to_json();
    moved["layout"]["bodies"]["satellites"][0][2] = json!(0.5);
    let trap = threat(&Scenario::from_json(&moved).unwrap(), 8, 20.0).to_json();
    let mut trapped = before.to_json();
    trapped["layout"]["bodies"]["debris"] = trap["layout"]["bodies"]["debris"].clone();
    trapped["params"]["debris"] = json!(1);
    let scenario = Scenario::from_json(&trapped).unwrap();

    assert_eq!(critique(&scenario, &burns(&[])).judged.case, "no_action_needed");
    let told = critique(&scenario, &burns(&[(1, 0, 0.5, 0.0)]));
    assert_eq!(told.actions.len(), 1);
    assert_eq!(told.actions[0].verdict, Verdict::Harmful);
    assert!(told.actions[0].gain < -0.2, "a third of the reward of 42 steps");
    assert_eq!((told.judged.case, told.judged.value), ("harmful_burn", -1.0));
    let remedy = only(&told).encounter.as_ref().unwrap().cheapest.clone().unwrap();
    assert_eq!((remedy.step, remedy.cost), (1, 0.0), "not to burn would have done");
}

#[test]
fn a_needless_burn_wastes_where_fuel_is_score_and_is_harmless_elsewhere() {
    let log = burns(&[(1, 1, 0.3, 0.0), (9, 1, 0.0, 0.4)]);
    let eco = quiet("kessler/eco_station", RADIUS, &json!({}));
    let told = critique(&eco, &log);
    assert!(told.actions.iter().all(|a| a.verdict == Verdict::Wasteful && a.gain < 0.0));
    assert_eq!((only(&told).mode, only(&told).agent), ("wasted_fuel", 1));
    insta::assert_snapshot!(only(&told).words, @"Satellite 1 spent 3.50 fuel in 2 burns that gained nothing and cost 0.021 of the score.");
    assert_eq!(told.judged.case, "unnecessary_burn");
    assert!((-1.0..=-0.5).contains(&told.judged.value));
    assert_eq!(critique(&eco, &burns(&[])).judged.case, "no_action_needed");

    let told = critique(&survival(&json!({})), &log);
    assert!(told.actions.iter().all(|a| a.verdict == Verdict::Harmless && a.gain == 0.0));
    assert_eq!((told.failures.len(), told.judged.case), (0, "unnecessary_burn"));
    // 3.5 fuel of 300.
    assert!((told.judged.value - (-0.5 - 0.5 * 3.5 / 300.0)).abs() < 1e-12);
    let told = critique(&survival(&json!({})), &burns(&[]));
    // 50 rewards of 0.998/50, summed.
    assert!(told.judged.case == "no_action_needed" && (told.judged.value - 1.0).abs() < 1e-12);
}

#[test]
fn falling_into_the_earth_is_decay_by_harmful_burns() {
    // Two retrograde LU/TU of the 4.1 that a circle of 60 LU takes leave a perigee of 9 LU, one leaves 24.
    let told = critique(&survival(&json!({})), &burns(&[(1, 0, 0.0, -1.0), (2, 0, 0.0, -1.0)]));
    let failure = only(&told);
    assert_eq!((failure.mode, &failure.encounter), ("decay", &None));
    assert!(told.actions.iter().all(|a| a.verdict == Verdict::Harmful), "{:?}", told.actions);
    assert_eq!((told.judged.case, told.judged.value), ("harmful_burn", -1.0));
    insta::assert_snapshot!(failure.words, @"Satellite 0 fell into the Earth at step 19 after burns of 10.0 fuel; holding from step 2 on would have avoided it.");
}

#[test]
fn fuel_spent_early_is_missed_later() {
    // Spent on nothing, then asked for.
    let scenario = threat(&survival(&json!({"fuel": 1})), 20, 0.0);
    let spent = [(1, 0, 0.1, 0.0), (2, 0, -0.1, 0.0)];
    let told = critique(&scenario, &burns(&[spent[0], spent[1], (8, 0, 0.3, 0.0)]));
    let modes: Vec<_> = told.failures.iter().map(|f| (f.mode, f.step)).collect();
    assert_eq!(modes[0], ("fuel_starvation", 8), "{modes:?}");
    assert_eq!((modes.len(), modes[1].0), (2, "collision"));
    insta::assert_snapshot!(told.failures[0].words, @"Satellite 0 was short of fuel from step 8 on (1.50 wanted, 0.00 left): with all it asked for somebody would have lived.");
    // What would not have helped is not called starvation.
    let told = critique(&scenario, &burns(&[spent[0], spent[1], (20, 0, 0.3, 0.0)]));
    assert_eq!(only(&told).mode, "collision");

    // A burn that costs the fuel for the one that saves is harmful, even where fuel is no score.
    let scenario = threat(&survival(&json!({"fuel": 1.6})), 12, 0.0);
    let told = critique(&scenario, &burns(&[(1, 0, 0.1, 0.0), (3, 0, 0.3, 0.0)]));
    assert_eq!(told.actions.len(), 1);
    assert_eq!(told.actions[0].verdict, Verdict::Harmful);

    // Spent before there was anything to see.
    let scenario = threat(&survival(&json!({"fuel": 5, "radar_range": 18})), 20, 0.0);
    let told = critique(&scenario, &burns(&[(1, 0, 0.49, 0.0), (2, 0, -0.49, 0.0)]));
    let starved = told.failures.iter().find(|f| f.mode == "fuel_starvation").unwrap();
    insta::assert_snapshot!(starved.words, @"Satellite 0 had 0.10 fuel left when it could see what hit it; 1.00 at step 17 would have avoided it.");
    assert_eq!((told.judged.case, told.judged.value), ("harmful_burn", -1.0));
}

#[test]
fn rogues_are_seen_from_their_arrival() {
    let (arrival, contact) = (6, 14);
    let mut body = Body::circular(RADIUS, 0.0, 1.0);
    (0..contact).for_each(|_| body = body.coasted(Gravity::Point));
    body.vx -= 3.0;
    (0..=contact - arrival).for_each(|_| body = body.uncoasted(Gravity::Point));
    let mut scenario = survival(&json!({})).to_json();
    scenario["layout"]["bodies"]["rogues"] = json!([[arrival, body.x, body.y, body.vx, body.vy]]);
    let told = critique(&Scenario::from_json(&scenario).unwrap(), &burns(&[]));
    let failure = only(&told);
    assert_eq!((failure.mode, failure.step), ("rogue", contact));
    let met = failure.encounter.as_ref().unwrap();
    assert_eq!((met.first_visible_step, met.steps_left), (Some(arrival), contact - arrival));
    assert!((met.relative_speed - 3.0).abs() < 1e-8 && met.avoidable == Some(true), "{met:?}");
}

/// Satellite 1 flies 2.5 LU ahead of satellite 0, which is hit: some of the fragments reach it.
#[test]
fn fragments_are_told_from_debris() {
    let v = (1000.0f64 / RADIUS).sqrt();
    let (sin, cos) = libm::sincos(2.5 / RADIUS);
    let near = json!([RADIUS * cos, RADIUS * sin, -v * sin, v * cos]);
    let mut found = 0;
    for seed in 0..12 {
        let mut scenario = threat(&survival(&json!({})), 9, 0.0).to_json();
        scenario["layout"]["bodies"]["satellites"][1] = near.clone();
        scenario["seed"] = json!(seed);
        let told = critique(&Scenario::from_json(&scenario).unwrap(), &burns(&[]));
        let Some(failure) = told.failures.iter().find(|f| f.agent == 1) else { continue };
        let met = failure.encounter.as_ref().unwrap();
        assert_eq!(failure.mode, "fragment", "{failure:?}");
        assert_eq!(met.first_visible_step, (failure.step > 9).then_some(9));
        assert!(met.body >= 1);
        found += 1;
    }
    assert!(found >= 3, "{found}");
}

#[test]
fn logs_that_are_none_are_refused_as_a_replay_refuses_them() {
    let scenario = at_level("kessler/survival", 2, 5);
    let mut short = ActionLog::new(2, Precision::F64);
    let mut wrong = short.clone();
    wrong.act(7, &[0.0, 0.0]);
    let mut long = short.clone();
    short.end_step();
    wrong.end_step();
    (0..60).for_each(|_| long.end_step());
    for log in [short, wrong, long] {
        let error = replay(&scenario, &log).unwrap_err();
        assert_eq!(scenario.task().critique(&scenario, &log).unwrap_err(), error);
    }
}
