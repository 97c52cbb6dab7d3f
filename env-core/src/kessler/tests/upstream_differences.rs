//! Differences of the default physics from the public kessler-env, one test each.

use serde_json::json;

use crate::error::StepError;
use crate::kessler::constants::HORIZON;
use crate::log::JointAction;
use crate::task::Scenario;
use crate::task::{Episode, StepReport};

/// Scenario of three satellites far from each other and this debris.
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
    let truth = episode.truth();
    let s = &truth["satellites"][satellite];
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
fn burns_of_one_satellite_are_summed_and_clamped_once() {
    let (mut default, mut upstream, mut hold) =
        (started("none", &json!([])), started("upstream", &json!([])), started("none", &json!([])));
    let burns = ([1u32; 8], [0.5f64; 16]);
    step(&mut *default, &burns.0, &burns.1).unwrap();
    step(&mut *upstream, &burns.0, &burns.1).unwrap();
    step(&mut *hold, &[], &[]).unwrap();
    let gained = |e: &dyn Episode| velocity(e, 1).0 - velocity(&*hold, 1).0;
    assert!((gained(&*default) - 1.0).abs() < 1e-12, "the sum of 4 is clamped to 1");
    assert!((gained(&*upstream) - 4.0).abs() < 1e-12, "each of 8 counts by itself");
    assert!((fuel(&*default, 1) - (100.0 - 5.0 * 2f64.sqrt())).abs() < 1e-12);
    assert!((fuel(&*upstream, 1) - (100.0 - 8.0 * 5.0 * 0.5f64.sqrt())).abs() < 1e-9);
}

#[test]
fn non_finite_burns_are_rejected_without_effect() {
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
fn unknown_satellites_are_rejected_but_ignored_upstream() {
    let mut default = started("none", &json!([]));
    assert_eq!(step(&mut *default, &[3], &[0.1, 0.0]), Err(StepError::UnknownAgent { agent: 3, last: 2 }));
    assert!(step(&mut *started("upstream", &json!([])), &[3, 99], &[0.1, 0.0, 0.0, 0.0]).is_ok());
}

#[test]
fn burn_is_applied_or_rejected_as_a_whole() {
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
    // Debris 0 falls straight down from r = 24 LU and is inside the Earth after one step.
    let falling = json!([[24.0, 0.0, -3.0, 0.0], [90.0, 0.0, 0.0, 3.3]]);
    let (mut default, mut upstream) = (started("none", &falling), started("upstream", &falling));
    for _ in 0..2 {
        step(&mut *default, &[], &[]).unwrap();
        step(&mut *upstream, &[], &[]).unwrap();
    }
    let ids = |e: &dyn Episode| -> Vec<u64> {
        e.truth()["radar_debris"].as_array().unwrap().iter().map(|d| d["id"].as_u64().unwrap()).collect()
    };
    assert_eq!(ids(&*default), [1], "other ids do not change");
    assert_eq!(ids(&*upstream), [0, 1]);
    let x = upstream.truth()["radar_debris"][0]["x"].clone();
    step(&mut *upstream, &[], &[]).unwrap();
    assert_eq!(upstream.truth()["radar_debris"][0]["x"], x);
}

#[test]
fn step_after_the_end_is_an_error_without_reward() {
    let mut episode = started("none", &json!([]));
    for number in 1..=HORIZON {
        let report = step(&mut *episode, &[], &[]).unwrap();
        assert_eq!(report.done, number == HORIZON);
        assert!(report.agents.iter().all(|a| a.truncated == (number == HORIZON) && !a.terminated));
    }
    let total = episode.outcome().total_reward;
    assert_eq!(step(&mut *episode, &[], &[]), Err(StepError::Ended { step: 50 }));
    assert_eq!(episode.outcome().total_reward, total);
    assert!((total - 0.998).abs() < 1e-12);
}

#[test]
fn lost_satellite_terminates_once_and_ignores_burns() {
    // Debris flies along with satellite 0 at 1 LU, and touches it before step 3: `start: upstream` allows
    // that.
    let mut value = staged("none", &json!([[60.0, 1.0, 0.0, 4.08]])).to_json();
    value["physics"]["start"] = json!("upstream");
    let scenario = Scenario::from_json(&value).unwrap();
    let mut episode = scenario.task().start(&scenario).unwrap();
    let report = step(&mut *episode, &[], &[]).unwrap();
    let lost_agent = report.agents.iter().find(|a| a.agent == 0).unwrap();
    assert!(lost_agent.terminated && !lost_agent.truncated && !lost_agent.needs_action);
    let fuel_before = fuel(&*episode, 0);
    let report = step(&mut *episode, &[0], &[0.5, 0.5]).unwrap();
    assert_eq!(fuel(&*episode, 0), fuel_before);
    assert!(report.agents.iter().all(|a| a.agent != 0));
    assert_eq!(episode.truth()["radar_debris"].as_array().unwrap().len(), 3, "two fragments");
}

#[test]
fn hidden_debris_still_destroys() {
    let mut value = staged("none", &json!([[60.0, -9.0, 0.0, 6.0]])).to_json();
    value["params"]["radar_range"] = json!(1.0);
    let scenario = Scenario::from_json(&value).unwrap();
    let mut episode = scenario.task().start(&scenario).unwrap();
    let mut visible = 0;
    while !episode.done() && episode.outcome().lost == 0 {
        visible += episode.telemetry()["radar_debris"].as_array().unwrap().len();
        step(&mut *episode, &[], &[]).unwrap();
    }
    assert_eq!((visible, episode.outcome().lost), (0, 1));
    assert_eq!(episode.telemetry()["radar_range"], 1.0);
}
