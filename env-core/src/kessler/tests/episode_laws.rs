//! Property tests of episodes: determinism, bounds, fairness, and that no input panics.

use proptest::prelude::*;
use serde_json::{Value, json};

use super::at_level;
use crate::episode_rng::SeededRng;
use crate::kessler::KESSLER_TASKS;
use crate::kessler::kernel::{Body, Gravity, distance_squared, min_distance_squared};
use crate::kessler::setup::KesslerSetup;
use crate::log::JointAction;
use crate::task::{Recipe, Scenario};
use crate::task::{StepReport, TaskSpec};
use crate::testing;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// The same scenario and actions give the same bits. Scores are in range, rewards are finite and add up,
    /// and ids survive JSON.
    #[test]
    fn episodes_are_deterministic_and_bounded(
        task in 0..KESSLER_TASKS.len(),
        level in 0usize..10,
        seed in 0u64..1 << 50,
        burns in proptest::collection::vec((0u32..3, -3.0..3.0f64, -3.0..3.0f64), 0..80),
    ) {
        let scenario = at_level(KESSLER_TASKS[task].id(), level, seed);
        let again = Scenario::from_json(&serde_json::from_str(&scenario.to_json().to_string()).unwrap()).unwrap();
        prop_assert_eq!(scenario.id(), again.id());
        let fly = |scenario: &Scenario| {
            let mut episode = KESSLER_TASKS[task].start(scenario).unwrap();
            let (mut report, mut sum) = (StepReport::default(), 0.0);
            while !episode.done() {
                let acts: Vec<_> = burns.iter().skip(episode.steps() as usize).step_by(50).collect();
                let agents: Vec<u32> = acts.iter().map(|b| b.0).collect();
                let values: Vec<f64> = acts.iter().flat_map(|b| [b.1, b.2]).collect();
                episode.step(JointAction { agents: &agents, values: &values }, &mut report).unwrap();
                sum += report.reward;
                assert!(report.reward.is_finite() && report.reward >= 0.0);
            }
            (episode.state_hash(), episode.outcome(), sum)
        };
        let (hash, outcome, sum) = fly(&scenario);
        prop_assert_eq!(fly(&again).0, hash);
        prop_assert_eq!(outcome.total_reward, sum);
        let range = KESSLER_TASKS[task].score_range();
        prop_assert!(outcome.score >= range.min && outcome.score <= range.max);
    }

    /// A fair start has no contact before step 3 under hold, for any number of debris, gravity and contact
    /// model.
    #[test]
    fn fair_start_has_no_early_contact(
        task in 0..KESSLER_TASKS.len(),
        oblate in any::<bool>(),
        swept in any::<bool>(),
        seed in 0u64..1 << 50,
        debris in 0u32..=300,
        spread in 0.0..3.0f64,
    ) {
        let params = [("debris", f64::from(debris)), ("spread", spread)];
        let gravity = if oblate { Gravity::J2 } else { Gravity::Point };
        let recipe = Recipe::with_params(&KESSLER_TASKS[task], params.into_iter()).unwrap()
            .with_option("gravity", if oblate { "j2" } else { "point" }).unwrap()
            .with_option("contact", if swept { "swept" } else { "end_of_step" }).unwrap();
        let scenario = Scenario::new(recipe, crate::Seed::user(seed).unwrap());
        let start = KesslerSetup::from_recipe(scenario.recipe()).unwrap().draw_initial_state(&mut SeededRng::new(scenario.seed())).unwrap();
        let propagate = |mut body: Body, n: usize| { for _ in 0..n { body = body.coast(gravity); } body };
        for step in 0..3 {
            for s in start.satellites.map(|s| propagate(s, step)) {
                for d in start.debris.iter().map(|d| propagate(*d, step)) {
                    prop_assert!(distance_squared(s.x, s.y, d.x, d.y) >= 4.0);
                    if swept && step > 0 {
                        prop_assert!(min_distance_squared(s.x - d.x, s.y - d.y, s.vx - d.vx, s.vy - d.vy) >= 4.0);
                    }
                }
            }
        }
    }

    /// A change of one param keeps the draws of everything else.
    #[test]
    fn more_debris_keeps_the_other_draws(seed in 0u64..1 << 50) {
        let start = |debris: f64, start: &str| {
            let recipe = Recipe::with_params(&KESSLER_TASKS[0], [("debris", debris)].into_iter()).unwrap()
                .with_option("start", start).unwrap();
            let scenario = Scenario::new(recipe, crate::Seed::user(seed).unwrap());
            KesslerSetup::from_recipe(scenario.recipe()).unwrap().draw_initial_state(&mut SeededRng::new(scenario.seed())).unwrap()
        };
        let (few, many) = (start(10.0, "upstream"), start(60.0, "upstream"));
        prop_assert_eq!(few.satellites, many.satellites);
        prop_assert_eq!(&few.debris[..], &many.debris[..10]);
    }

    /// Any JSON as a scenario gives a valid scenario or a typed error, never a panic.
    #[test]
    fn any_json_is_a_scenario_or_typed_error(
        field in prop::sample::select(vec!["task", "world", "params", "physics", "layout", "seed", "extra"]),
        value in prop::sample::select(strange_values()),
        inner in prop::sample::select(vec!["debris", "fuel", "start", "mode", "bodies", "x"]),
        nested: bool,
    ) {
        let mut scenario = at_level("kessler/survival", 1, 9).to_json();
        if nested { scenario[field] = json!({ inner: value }); } else { scenario[field] = value; }
        if let Err(error) = Scenario::from_json(&scenario) {
            prop_assert!(!error.field().is_empty() && error.to_string().len() < 400);
        }
    }
}

/// Any JSON, with words of this world.
fn any_json() -> impl Strategy<Value = Value> {
    testing::any_json(
        Just(json!("satellite_id")),
        &["satellite_id", "delta_vx", "delta_vy", "params", "seed", "task", "x"],
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// Any JSON as steps of a log or as a scenario is accepted or rejected, never a panic. An accepted log
    /// replays or is rejected by the environment, and its outcome has no NaN.
    #[test]
    fn any_json_log_is_accepted_or_rejected(steps in prop::collection::vec(any_json(), 0..4)) {
        let scenario = at_level("kessler/survival", 2, 3);
        let stopped = Some(crate::StopReason::Unparsable);
        let log = crate::rollout::read_log(&scenario, &steps, crate::log::Precision::F64, stopped);
        if let Ok(outcome) = log.map_err(|_| ()).and_then(|log| crate::rollout::replay(&scenario, &log).map_err(|_| ())) {
            prop_assert!(outcome.score.is_finite() && outcome.fuel_used.is_finite());
        }
        for value in &steps {
            let _ = Scenario::from_json(value);
        }
    }
}

fn strange_values() -> Vec<Value> {
    vec![
        Value::Null,
        json!(true),
        json!(-1),
        json!(1e308),
        json!(u64::MAX),
        json!(0.5),
        json!(""),
        json!("x".repeat(5000)),
        json!([]),
        json!([[1, 2, 3, 4]]),
        json!({}),
        json!({"debris": [[1, 2, 3]]}),
        json!({"debris": [[0, 0, 0, 0]]}),
        json!({"satellites": [[50, 0, 0, 4]]}),
        json!({"rogues": [[51, 95, 0, 0, 3]]}),
    ]
}

#[test]
fn errors_name_field_value_and_range() {
    let base = at_level("kessler/survival", 0, 1).to_json();
    let with = |field: &str, value: Value| {
        let mut changed = base.clone();
        changed[field] = value;
        Scenario::from_json(&changed).unwrap_err().to_string()
    };
    insta::assert_snapshot!(with("params", json!({"fuel": -1})), @"params.fuel must be from 0.1 to 1000, got -1");
    insta::assert_snapshot!(with("params", json!({"fuel": 1e300})), @"params.fuel must be from 0.1 to 1000, got 1e300");
    insta::assert_snapshot!(with("params", json!({"debris": 2.5})), @"params.debris must be an integer, got 2.5");
    insta::assert_snapshot!(with("params", json!({"fule": 1})), @"params.fule is not a known field; the known fields are debris, fuel, spread, rogue_probability, rogue_speed, radar_range, sigma");
    insta::assert_snapshot!(with("physics", json!({"compat": "downstream"})), @r#"physics.compat must be one of none, upstream, got "downstream""#);
    insta::assert_snapshot!(with("seed", json!(1u64 << 53)), @"seed must be an integer from 0 to 2251799813685247 (larger seeds are reserved for training and evaluation), got 9007199254740992");
    insta::assert_snapshot!(with("task", json!("kessler/golf")), @r#"task must be one of kessler/survival, kessler/eco_station, kessler/rendezvous, kessler/formation, docking/single, docking/multiagent, tasking/scanning, tasking/imaging, tasking/constellation, got "kessler/golf""#);
    insta::assert_snapshot!(with("layout", json!({"mode": "replace", "bodies": {"debris": [[30, 0, 0, 5]]}})), @"params.debris must be 1, the debris of the layout, got 25");
    insta::assert_snapshot!(with("layout", json!({"mode": "extend", "bodies": {"debris": [[3, 0, 0, 5]]}})), @"layout.bodies.debris.0 must start outside the Earth (radius 20 LU), got a distance of 3.0 LU");
    insta::assert_snapshot!(with("layout", json!({"mode": "extend", "bodies": {"debris": [[3, 0, 0, 500]]}})), @"layout.bodies.debris.0.3 must be from -100 to 100, got 500");
}

#[test]
fn level_tables_are_within_their_spaces() {
    for task in crate::tasks() {
        assert_eq!(task.levels().len(), 10);
        for level in 0..10 {
            Recipe::at_level(task, level).unwrap();
        }
    }
}
