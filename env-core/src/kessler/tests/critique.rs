//! Critiques of constructed scenarios with known answers.

use serde_json::{Value, json};

use super::at_level;
use crate::critique::{Critique, Encounter, Failure, Verdict};
use crate::kessler::kernel::{Body, Gravity};
use crate::kessler::threat_placement::{Threat, place_threat};
use crate::log::{ActionLog, Precision, StopReason};
use crate::rollout::replay;
use crate::task::Scenario;

/// Default initial radius of satellite 0, LU. Its mean motion there is √(1000/60³) = 0.068 per TU.
const INITIAL_RADIUS: f64 = 60.0;
/// Relative speed of threats, LU/TU.
const THREAT_SPEED: f64 = 4.0;

/// Scenario of three satellites far from each other, satellite 0 on +X, without debris.
pub(super) fn scenario_without_debris(task: &str, radius: f64, params: &Value) -> Scenario {
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

/// Survival scenario without debris.
pub(super) fn survival(params: &Value) -> Scenario {
    scenario_without_debris("kessler/survival", INITIAL_RADIUS, params)
}

/// Adds a threat to satellite 0 that comes from `direction` degrees (radial out towards in-track, at
/// contact). Returns `None` if its path would cross the Earth.
fn try_threat(scenario: &Scenario, step: u32, direction: f64) -> Option<Scenario> {
    place_threat(
        scenario,
        Threat { satellite: 0, step, direction: direction.to_radians(), speed: THREAT_SPEED },
    )
    .ok()
}

/// Adds a threat to satellite 0; see [`try_threat`].
pub(super) fn with_threat(scenario: &Scenario, step: u32, direction: f64) -> Scenario {
    try_threat(scenario, step, direction).unwrap()
}

/// Burn of one satellite in a test log.
#[derive(Debug, Clone, Copy)]
pub(super) struct TestBurn {
    step: u32,
    satellite: u32,
    dv: [f64; 2],
}

/// Burn of a satellite at a step, by dvx, dvy in LU/TU.
pub(super) fn burn(step: u32, satellite: u32, dvx: f64, dvy: f64) -> TestBurn {
    TestBurn { step, satellite, dv: [dvx, dvy] }
}

/// Log of these burns, followed by hold.
pub(super) fn log_of(burns: &[TestBurn]) -> ActionLog {
    let mut log = ActionLog::new(2, Precision::F64);
    for step in 1..=burns.iter().map(|b| b.step).max().unwrap_or(0) {
        for burn in burns.iter().filter(|b| b.step == step) {
            log.push_entry(burn.satellite, &burn.dv);
        }
        log.end_step();
    }
    log.stopped = Some(StopReason::TooLong);
    log
}

/// Critique of a log.
pub(super) fn critique(scenario: &Scenario, log: &ActionLog) -> Critique {
    scenario.task().critique(scenario, log).unwrap()
}

/// The only failure of a critique.
pub(super) fn only_failure(critique: &Critique) -> &Failure {
    assert_eq!(critique.failures.len(), 1, "{:?}", critique.failures);
    &critique.failures[0]
}

/// Encounter of the only failure under hold.
fn encounter_under_hold(scenario: &Scenario) -> Encounter {
    let critique = critique(scenario, &log_of(&[]));
    only_failure(&critique).encounter.clone().unwrap()
}

/// Difference of two angles, degrees, in [0, 180].
fn angle_between(a: f64, b: f64) -> f64 {
    let d = (a - b).rem_euclid(360.0);
    d.min(360.0 - d)
}

/// Angle of satellite 0 after `step`, degrees from +X.
fn angle_after(step: u32) -> f64 {
    let mut body = Body::circular(INITIAL_RADIUS, 0.0, 1.0);
    for _ in 0..step {
        body = body.coast(Gravity::Point);
    }
    libm::atan2(body.y, body.x).to_degrees()
}

/// One step before contact the debris is exactly one relative step away: p_k = p_{k+1} − v_{k+1} for both
/// bodies.
#[test]
fn bearings_one_step_before_contact_are_exact() {
    let scenario = survival(&json!({"radar_range": 6})); // Sees 4 LU, one step before, but not 8.
    let mut tested = 0;
    for (step, inertial) in
        [3, 6, 10, 15].into_iter().flat_map(|s| [0, 45, 90, 135, 180, 225, 270].map(|d| (s, d)))
    {
        let inertial = f64::from(inertial);
        let Some(with_threat) = try_threat(&scenario, step, inertial - angle_after(step)) else { continue };
        let encounter = encounter_under_hold(&with_threat);
        assert_eq!((encounter.first_visible_step, encounter.steps_left), (Some(step - 1), 1));
        // Bound: rounding of a trip back to the start and forth again (tested to 1e-9), at 4 LU.
        assert!(angle_between(encounter.bearing_inertial_deg.unwrap(), inertial) < 1e-6, "{encounter:?}");
        assert!(
            angle_between(encounter.bearing_deg, inertial - angle_after(step - 1)) < 1e-6,
            "{encounter:?}"
        );
        assert!((encounter.relative_speed - THREAT_SPEED).abs() < 1e-8);
        // A burn of at most 1 LU/TU moves 1 LU in the one step that is left; contact is at 2 LU.
        assert_eq!((encounter.avoidable, encounter.cheapest_avoidance), (Some(false), None));
        tested += 1;
    }
    assert!(tested >= 20, "{tested}");
}

/// Five steps before contact the relative path was bent by the difference of gravity over up to 20 LU, at
/// most 2·n²·d: for a mean distance of 10 LU and 60 LU radius (n = 0.068/TU) 0.09 LU/TU², 1.2 LU after 5 TU,
/// 3° of 20 LU. Debris that passes nearer to the Earth is bent more: 10°, a third of a sector.
#[test]
fn bearings_five_steps_before_contact_are_close() {
    let scenario = survival(&json!({}));
    let mut tested = 0;
    for (step, direction) in [8, 12, 20].into_iter().flat_map(|s| [0.0, 90.0, 180.0, 270.0].map(|d| (s, d))) {
        // Directions +X, +Y, −X, −Y.
        if let Some(with_threat) = try_threat(&scenario, step, direction - angle_after(step)) {
            let encounter = encounter_under_hold(&with_threat);
            assert!(
                angle_between(encounter.bearing_inertial_deg.unwrap(), direction) < 10.0,
                "{direction} {encounter:?}"
            );
            tested += 1;
        }
        // Radial out, ahead, below, behind, as tested at contact; the frame has turned since.
        if let Some(with_threat) = try_threat(&scenario, step, direction) {
            let encounter = encounter_under_hold(&with_threat);
            let turned = angle_between(angle_after(step), angle_after(step - 5));
            assert!(
                angle_between(encounter.bearing_deg, direction + turned) < 10.0,
                "{direction} {encounter:?}"
            );
            tested += 1;
        }
    }
    assert!(tested >= 16, "{tested}");
}

#[test]
fn visible_threat_has_a_working_remedy() {
    let scenario = with_threat(&survival(&json!({})), 12, 0.0);
    let critiqued = critique(&scenario, &log_of(&[]));
    let failure = only_failure(&critiqued);
    assert_eq!((failure.mode, failure.agent, failure.step), ("collision", 0, 12));
    let encounter = failure.encounter.as_ref().unwrap();
    assert_eq!(
        (encounter.first_visible_step, encounter.steps_left, encounter.avoidable),
        (Some(0), 12, Some(true))
    );
    let remedy = encounter.cheapest_avoidance.as_ref().unwrap();
    // Contact is at 2 LU: 0.2 LU/TU moves a satellite that far in ten steps, 0.05 LU/TU in no less than
    // twelve.
    assert!(remedy.cost <= 1.0 + 1e-12, "{remedy:?}");
    let outcome =
        replay(&scenario, &log_of(&[burn(remedy.step, 0, remedy.values[0], remedy.values[1])])).unwrap();
    assert_eq!((outcome.lost, outcome.fuel_used), (0, remedy.cost));
    assert_eq!((critiqued.assessment.case, critiqued.assessment.value), ("threat_missed", -1.0));
    insta::assert_snapshot!(failure.explanation, @"Debris 0 hit satellite 0 at step 12, from 20° (radial out towards in-track) at 4.0 LU/TU; it was visible from step 0, 12 steps before, and one burn at step 4 for 1.00 fuel would have avoided it.");
    insta::assert_snapshot!(critiqued.assessment.explanation, @"Satellite 0 was lost although the threat was visible and avoidable.");
}

#[test]
fn threat_seen_too_late_is_unavoidable() {
    let late = critique(&with_threat(&survival(&json!({"radar_range": 6})), 10, 30.0), &log_of(&[]));
    assert_eq!((late.assessment.case, late.assessment.value), ("unavoidable", 0.0));
    insta::assert_snapshot!(only_failure(&late).explanation, @"Debris 0 hit satellite 0 at step 10, from 34° (radial out towards in-track) at 4.0 LU/TU; it was visible from step 9, 1 step before, and no single burn with the known debris and the remaining fuel would have avoided it.");

    let hidden = critique(&with_threat(&survival(&json!({"radar_range": 3})), 10, 30.0), &log_of(&[]));
    let encounter = only_failure(&hidden).encounter.as_ref().unwrap();
    assert_eq!((encounter.first_visible_step, encounter.steps_left, encounter.avoidable), (None, 0, None));
    assert_eq!((hidden.assessment.case, hidden.assessment.value), ("unavoidable", 0.0));
    insta::assert_snapshot!(only_failure(&hidden).explanation, @"Debris 0 hit satellite 0 at step 10, from 49° (radial out towards in-track) at 4.0 LU/TU; it was never visible.");
}

#[test]
fn reference_plan_consists_of_needed_burns() {
    for step in [5, 12, 25] {
        let start = survival(&json!({}));
        let scenario = (0..12).find_map(|d| try_threat(&start, step, 200.0 + 30.0 * f64::from(d))).unwrap();
        let plan = scenario.task().bracket(&scenario).unwrap().reference_plan;
        let critiqued = critique(&scenario, &plan);
        assert_eq!(critiqued.failures, []);
        assert!(!critiqued.actions.is_empty());
        assert!(
            critiqued.actions.iter().all(|a| a.agent != 0 || a.verdict == Verdict::Needed),
            "{critiqued:?}"
        );
        assert_eq!(critiqued.assessment.case, "threat_avoided");
        assert!((0.8..=1.0).contains(&critiqued.assessment.value));
    }
}

/// Debris that hits the satellite only if it burns.
#[test]
fn burn_into_debris_is_harmful() {
    let before = survival(&json!({}));
    let mut moved = before.to_json();
    moved["layout"]["bodies"]["satellites"][0][2] = json!(0.5);
    let trap = with_threat(&Scenario::from_json(&moved).unwrap(), 8, 20.0).to_json();
    let mut trapped = before.to_json();
    trapped["layout"]["bodies"]["debris"] = trap["layout"]["bodies"]["debris"].clone();
    trapped["params"]["debris"] = json!(1);
    let scenario = Scenario::from_json(&trapped).unwrap();

    assert_eq!(critique(&scenario, &log_of(&[])).assessment.case, "no_action_needed");
    let critiqued = critique(&scenario, &log_of(&[burn(1, 0, 0.5, 0.0)]));
    assert_eq!(critiqued.actions.len(), 1);
    assert_eq!(critiqued.actions[0].verdict, Verdict::Harmful);
    assert!(critiqued.actions[0].gain < -0.2, "a third of the reward of 42 steps is lost");
    assert_eq!((critiqued.assessment.case, critiqued.assessment.value), ("harmful_burn", -1.0));
    let remedy = only_failure(&critiqued).encounter.as_ref().unwrap().cheapest_avoidance.clone().unwrap();
    assert_eq!((remedy.step, remedy.cost), (1, 0.0), "holding avoids the loss");
}

#[test]
fn needless_burn_is_wasteful_only_where_fuel_is_score() {
    let log = log_of(&[burn(1, 1, 0.3, 0.0), burn(9, 1, 0.0, 0.4)]);
    let eco = scenario_without_debris("kessler/eco_station", INITIAL_RADIUS, &json!({}));
    let critiqued = critique(&eco, &log);
    assert!(critiqued.actions.iter().all(|a| a.verdict == Verdict::Wasteful && a.gain < 0.0));
    assert_eq!((only_failure(&critiqued).mode, only_failure(&critiqued).agent), ("wasted_fuel", 1));
    insta::assert_snapshot!(only_failure(&critiqued).explanation, @"Satellite 1 spent 3.50 fuel in 2 burns that gained nothing and cost 0.021 of the score.");
    assert_eq!(critiqued.assessment.case, "unnecessary_burn");
    assert!((-1.0..=-0.5).contains(&critiqued.assessment.value));
    assert_eq!(critique(&eco, &log_of(&[])).assessment.case, "no_action_needed");

    let critiqued = critique(&survival(&json!({})), &log);
    assert!(critiqued.actions.iter().all(|a| a.verdict == Verdict::Harmless && a.gain == 0.0));
    assert_eq!((critiqued.failures.len(), critiqued.assessment.case), (0, "unnecessary_burn"));
    // Spends 3.5 of 300 fuel units.
    assert!((critiqued.assessment.value - (-0.5 - 0.5 * 3.5 / 300.0)).abs() < 1e-12);
    let critiqued = critique(&survival(&json!({})), &log_of(&[]));
    // Sums 50 rewards of 0.998/50.
    assert!(
        critiqued.assessment.case == "no_action_needed" && (critiqued.assessment.value - 1.0).abs() < 1e-12
    );
}

#[test]
fn fall_into_the_earth_is_decay_by_harmful_burns() {
    // Two retrograde burns of 1 LU/TU, of the 4.1 of a circular orbit at 60 LU, leave a perigee of 9 LU; one
    // leaves 24.
    let critiqued = critique(&survival(&json!({})), &log_of(&[burn(1, 0, 0.0, -1.0), burn(2, 0, 0.0, -1.0)]));
    let failure = only_failure(&critiqued);
    assert_eq!((failure.mode, &failure.encounter), ("decay", &None));
    assert!(critiqued.actions.iter().all(|a| a.verdict == Verdict::Harmful), "{:?}", critiqued.actions);
    assert_eq!((critiqued.assessment.case, critiqued.assessment.value), ("harmful_burn", -1.0));
    insta::assert_snapshot!(failure.explanation, @"Satellite 0 fell into the Earth at step 19 after burns of 10.0 fuel; holding from step 2 on would have avoided it.");
}

#[test]
fn fuel_spent_before_a_threat_is_starvation() {
    // The fuel is spent without need and then requested.
    let scenario = with_threat(&survival(&json!({"fuel": 1})), 20, 0.0);
    let spent = [burn(1, 0, 0.1, 0.0), burn(2, 0, -0.1, 0.0)];
    let critiqued = critique(&scenario, &log_of(&[spent[0], spent[1], burn(8, 0, 0.3, 0.0)]));
    let modes: Vec<_> = critiqued.failures.iter().map(|f| (f.mode, f.step)).collect();
    assert_eq!(modes[0], ("fuel_starvation", 8), "{modes:?}");
    assert_eq!((modes.len(), modes[1].0), (2, "collision"));
    insta::assert_snapshot!(critiqued.failures[0].explanation, @"Satellite 0 was short of fuel from step 8 on (1.50 requested, 0.00 left): with all requested burns a satellite would have been saved.");
    // A rejected burn that would not have helped is no starvation.
    let critiqued = critique(&scenario, &log_of(&[spent[0], spent[1], burn(20, 0, 0.3, 0.0)]));
    assert_eq!(only_failure(&critiqued).mode, "collision");

    // A burn that takes the fuel of the one that saves is harmful, even if fuel is not scored.
    let scenario = with_threat(&survival(&json!({"fuel": 1.6})), 12, 0.0);
    let critiqued = critique(&scenario, &log_of(&[burn(1, 0, 0.1, 0.0), burn(3, 0, 0.3, 0.0)]));
    assert_eq!(critiqued.actions.len(), 1);
    assert_eq!(critiqued.actions[0].verdict, Verdict::Harmful);

    // The fuel is spent before the debris is visible.
    let scenario = with_threat(&survival(&json!({"fuel": 5, "radar_range": 18})), 20, 0.0);
    let critiqued = critique(&scenario, &log_of(&[burn(1, 0, 0.49, 0.0), burn(2, 0, -0.49, 0.0)]));
    let starved = critiqued.failures.iter().find(|f| f.mode == "fuel_starvation").unwrap();
    insta::assert_snapshot!(starved.explanation, @"Satellite 0 had 0.10 fuel left when the debris that hit it became visible; a burn of 1.00 fuel at step 17 would have avoided it.");
    assert_eq!((critiqued.assessment.case, critiqued.assessment.value), ("harmful_burn", -1.0));
}

#[test]
fn rogues_are_visible_from_their_arrival() {
    let (arrival, contact) = (6, 14);
    let mut body = Body::circular(INITIAL_RADIUS, 0.0, 1.0);
    (0..contact).for_each(|_| body = body.coast(Gravity::Point));
    body.vx -= 3.0;
    (0..=contact - arrival).for_each(|_| body = body.coast_back(Gravity::Point));
    let mut scenario = survival(&json!({})).to_json();
    scenario["layout"]["bodies"]["rogues"] = json!([[arrival, body.x, body.y, body.vx, body.vy]]);
    let critiqued = critique(&Scenario::from_json(&scenario).unwrap(), &log_of(&[]));
    let failure = only_failure(&critiqued);
    assert_eq!((failure.mode, failure.step), ("rogue", contact));
    let encounter = failure.encounter.as_ref().unwrap();
    assert_eq!((encounter.first_visible_step, encounter.steps_left), (Some(arrival), contact - arrival));
    assert!(
        (encounter.relative_speed - 3.0).abs() < 1e-8 && encounter.avoidable == Some(true),
        "{encounter:?}"
    );
}

/// Satellite 1 flies 2.5 LU ahead of satellite 0, which is hit: some of the fragments reach it.
#[test]
fn fragments_are_distinguished_from_debris() {
    let v = (1000.0f64 / INITIAL_RADIUS).sqrt();
    let (sin, cos) = libm::sincos(2.5 / INITIAL_RADIUS);
    let near = json!([INITIAL_RADIUS * cos, INITIAL_RADIUS * sin, -v * sin, v * cos]);
    let mut fragment_losses = 0;
    for seed in 0..12 {
        let mut scenario = with_threat(&survival(&json!({})), 9, 0.0).to_json();
        scenario["layout"]["bodies"]["satellites"][1] = near.clone();
        scenario["seed"] = json!(seed);
        let critiqued = critique(&Scenario::from_json(&scenario).unwrap(), &log_of(&[]));
        let Some(failure) = critiqued.failures.iter().find(|f| f.agent == 1) else { continue };
        let encounter = failure.encounter.as_ref().unwrap();
        assert_eq!(failure.mode, "fragment", "{failure:?}");
        assert_eq!(encounter.first_visible_step, (failure.step > 9).then_some(9));
        assert!(encounter.body >= 1);
        fragment_losses += 1;
    }
    assert!(fragment_losses >= 3, "{fragment_losses}");
}

#[test]
fn invalid_logs_fail_like_a_replay() {
    let scenario = at_level("kessler/survival", 2, 5);
    let mut short = ActionLog::new(2, Precision::F64);
    let mut wrong = short.clone();
    wrong.push_entry(7, &[0.0, 0.0]);
    let mut long = short.clone();
    short.end_step();
    wrong.end_step();
    (0..60).for_each(|_| long.end_step());
    for log in [short, wrong, long] {
        let error = replay(&scenario, &log).unwrap_err();
        assert_eq!(scenario.task().critique(&scenario, &log).unwrap_err(), error);
    }
}
