//! Each difference of the default physics from the public kessler-env, one test each.

use serde_json::json;

use crate::error::StepError;
use crate::kessler::constants::HORIZON;
use crate::log::JointAction;
use crate::scenario::Scenario;
use crate::task::{Episode, StepReport};

/// Three satellites out of the way of each other, and this debris.
fn staged(compat: &str, debris: &serde_json::Value) -> Scenario {
    let v = |r: f64| (1000.0f64 / r).sqrt();
    let count = debris.as_array().unwrap().len();
    Scenario::from_json(&json!({
        "task": "kessler/survival",
        "params": {"debris": count, "fuel": 100},
        "physics": {"compat": compat},
        "layout": {"mode": "replace", "bodies": {
            "satellites": [[60.0, 0.0, 0.0, v(60.0)], [-70.0, 0.0, 0.0, -v(70.0)], [0.0, 80.0, -v(80.0), 0.0]],
            "debris": debris,
        }},
        "seed": 3,
    }))
    .unwrap()
}

fn started(compat: &str, debris: &serde_json::Value) -> Box<dyn Episode> {
    let scenario = staged(compat, debris);
    scenario.task().start(&scenario).unwrap()
}

fn velocity(episode: &dyn Episode, satellite: usize) -> (f64, f64) {
    let seen = episode.truth();
    let s = &seen["satellites"][satellite];
    (s["vx"].as_f64().unwrap(), s["vy"].as_f64().unwrap())
}

fn fuel(episode: &dyn Episode, satellite: usize) -> f64 {
    episode.truth()["satellites"][satellite]["fuel"].as_f64().unwrap()
}

fn step(episode: &mut dyn Episode, agents: &[u32], values: &[f64]) -> Result<StepReport, StepError> {
    let mut report = StepReport::default();
    episode.step(JointAction { agents, values }, &mut report).map(|()| report)
}

#[test]
fn burns_of_one_satellite_are_summed_clamped_and_charged_once() {
    let (mut ours, mut theirs, mut hold) =
        (started("none", &json!([])), started("upstream", &json!([])), started("none", &json!([])));
    let burns = ([1u32; 8], [0.5f64; 16]);
    step(&mut *ours, &burns.0, &burns.1).unwrap();
    step(&mut *theirs, &burns.0, &burns.1).unwrap();
    step(&mut *hold, &[], &[]).unwrap();
    let gained = |e: &dyn Episode| velocity(e, 1).0 - velocity(&*hold, 1).0;
    assert!((gained(&*ours) - 1.0).abs() < 1e-12, "the sum of 4 is clamped to 1");
    assert!((gained(&*theirs) - 4.0).abs() < 1e-12, "each of 8 counts by itself");
    assert!((fuel(&*ours, 1) - (100.0 - 5.0 * 2f64.sqrt())).abs() < 1e-12);
    assert!((fuel(&*theirs, 1) - (100.0 - 8.0 * 5.0 * 0.5f64.sqrt())).abs() < 1e-9);
}

#[test]
fn numbers_that_are_none_are_refused_and_change_nothing() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut episode = started("none", &json!([]));
        let before = episode.state_hash();
        assert_eq!(
            step(&mut *episode, &[0, 2], &[0.1, 0.1, bad, 0.0]),
            Err(StepError::NotFinite { agent: 2 })
        );
        assert_eq!(episode.state_hash(), before);
    }
}

#[test]
fn unknown_satellites_are_refused_but_ignored_upstream() {
    let mut ours = started("none", &json!([]));
    assert_eq!(step(&mut *ours, &[3], &[0.1, 0.0]), Err(StepError::UnknownAgent { agent: 3, last: 2 }));
    assert!(step(&mut *started("upstream", &json!([])), &[3, 99], &[0.1, 0.0, 0.0, 0.0]).is_ok());
}

#[test]
fn a_burn_is_applied_whole_or_refused_whole() {
    let mut episode = started("none", &json!([]));
    for _ in 0..20 {
        step(&mut *episode, &[0], &[0.0, 1.0]).unwrap();
    }
    assert_eq!(fuel(&*episode, 0), 0.0);
    let before = fuel(&*episode, 1);
    step(&mut *episode, &[0], &[0.0, 0.001]).unwrap();
    assert_eq!(episode.truth()["critical_alerts"][0], "Sat 0 failed burn: Insufficient fuel.");
    assert_eq!(fuel(&*episode, 1), before);
}

#[test]
fn debris_inside_the_earth_is_removed_but_freezes_upstream() {
    // Falls straight down from r = 24 and is inside after one step.
    let falling = json!([[24.0, 0.0, -3.0, 0.0], [90.0, 0.0, 0.0, 3.3]]);
    let (mut ours, mut theirs) = (started("none", &falling), started("upstream", &falling));
    for _ in 0..2 {
        step(&mut *ours, &[], &[]).unwrap();
        step(&mut *theirs, &[], &[]).unwrap();
    }
    let ids = |e: &dyn Episode| -> Vec<u64> {
        e.truth()["radar_debris"].as_array().unwrap().iter().map(|d| d["id"].as_u64().unwrap()).collect()
    };
    assert_eq!(ids(&*ours), [1], "ids of the others stay");
    assert_eq!(ids(&*theirs), [0, 1]);
    let x = theirs.truth()["radar_debris"][0]["x"].clone();
    step(&mut *theirs, &[], &[]).unwrap();
    assert_eq!(theirs.truth()["radar_debris"][0]["x"], x);
}

#[test]
fn stepping_after_the_end_is_an_error_and_pays_nothing() {
    let mut episode = started("none", &json!([]));
    for number in 1..=HORIZON {
        let report = step(&mut *episode, &[], &[]).unwrap();
        assert_eq!(report.done, number == HORIZON);
        assert!(report.agents.iter().all(|a| a.truncated == (number == HORIZON) && !a.terminated));
    }
    let total = episode.flown().total;
    assert_eq!(step(&mut *episode, &[], &[]), Err(StepError::Ended { step: 50 }));
    assert_eq!(episode.flown().total, total);
    assert!((total - 0.998).abs() < 1e-12);
}

#[test]
fn a_lost_satellite_terminates_once_and_its_burns_are_ignored() {
    // Debris that flies along with satellite 0, half a unit ahead at step 3: start: upstream lets it.
    let mut value = staged("none", &json!([[60.0, 1.0, 0.0, 4.08]])).to_json();
    value["physics"]["start"] = json!("upstream");
    let scenario = Scenario::from_json(&value).unwrap();
    let mut episode = scenario.task().start(&scenario).unwrap();
    let report = step(&mut *episode, &[], &[]).unwrap();
    let gone = report.agents.iter().find(|a| a.agent == 0).unwrap();
    assert!(gone.terminated && !gone.truncated && !gone.needs_action);
    let fuel_before = fuel(&*episode, 0);
    let report = step(&mut *episode, &[0], &[0.5, 0.5]).unwrap();
    assert_eq!(fuel(&*episode, 0), fuel_before);
    assert!(report.agents.iter().all(|a| a.agent != 0));
    assert_eq!(episode.truth()["radar_debris"].as_array().unwrap().len(), 3, "two fragments");
}

#[test]
fn hidden_debris_still_kills() {
    let mut value = staged("none", &json!([[60.0, -9.0, 0.0, 6.0]])).to_json();
    value["params"]["radar_range"] = json!(1.0);
    let scenario = Scenario::from_json(&value).unwrap();
    let mut episode = scenario.task().start(&scenario).unwrap();
    let mut seen = 0;
    while !episode.done() && episode.flown().lost == 0 {
        seen += episode.telemetry()["radar_debris"].as_array().unwrap().len();
        step(&mut *episode, &[], &[]).unwrap();
    }
    assert_eq!((seen, episode.flown().lost), (0, 1));
    assert_eq!(episode.telemetry()["radar_range"], 1.0);
}
