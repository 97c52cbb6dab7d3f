//! Determinism, bounds, fairness, and that nothing panics.

use proptest::prelude::*;
use serde_json::{Value, json};

use super::at_level;
use crate::chance::Seeded;
use crate::kessler::TASKS;
use crate::kessler::kernel::{Body, Gravity, distance_2, swept_2};
use crate::kessler::setup::Setup;
use crate::log::JointAction;
use crate::scenario::{Recipe, Scenario};
use crate::task::{StepReport, TaskSpec};
use crate::testing;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Same scenario and actions, same bits; scores in range; no NaN; rewards add up; ids survive the wire.
    #[test]
    fn episodes_are_determined_and_bounded(
        task in 0..TASKS.len(),
        level in 0usize..10,
        seed in 0u64..1 << 50,
        burns in proptest::collection::vec((0u32..3, -3.0..3.0f64, -3.0..3.0f64), 0..80),
    ) {
        let scenario = at_level(TASKS[task].id(), level, seed);
        let again = Scenario::from_json(&serde_json::from_str(&scenario.to_json().to_string()).unwrap()).unwrap();
        prop_assert_eq!(scenario.id(), again.id());
        let fly = |scenario: &Scenario| {
            let mut episode = TASKS[task].start(scenario).unwrap();
            let (mut report, mut sum) = (StepReport::default(), 0.0);
            while !episode.done() {
                let acts: Vec<_> = burns.iter().skip(episode.steps() as usize).step_by(50).collect();
                let agents: Vec<u32> = acts.iter().map(|b| b.0).collect();
                let values: Vec<f64> = acts.iter().flat_map(|b| [b.1, b.2]).collect();
                episode.step(JointAction { agents: &agents, values: &values }, &mut report).unwrap();
                sum += report.reward;
                assert!(report.reward.is_finite() && report.reward >= 0.0);
            }
            (episode.state_hash(), episode.flown(), sum)
        };
        let (hash, flown, sum) = fly(&scenario);
        prop_assert_eq!(fly(&again).0, hash);
        prop_assert_eq!(flown.total, sum);
        let range = TASKS[task].score_range();
        prop_assert!(flown.score >= range.min && flown.score <= range.max);
    }

    /// No fair start has a contact before step 3 under hold, at any number of debris, by any law of motion and contact.
    #[test]
    fn fair_starts_are_fair(
        task in 0..TASKS.len(),
        oblate in any::<bool>(),
        swept in any::<bool>(),
        seed in 0u64..1 << 50,
        debris in 0u32..=300,
        spread in 0.0..3.0f64,
    ) {
        let params = [("debris", f64::from(debris)), ("spread", spread)];
        let gravity = if oblate { Gravity::J2 } else { Gravity::Point };
        let recipe = Recipe::with_params(&TASKS[task], params.into_iter()).unwrap()
            .with_option("gravity", if oblate { "j2" } else { "point" }).unwrap()
            .with_option("contact", if swept { "swept" } else { "end_of_step" }).unwrap();
        let scenario = Scenario::new(recipe, crate::Seed::user(seed).unwrap());
        let start = Setup::read(scenario.recipe()).unwrap().start(&mut Seeded::new(scenario.seed())).unwrap();
        let coasted = |mut body: Body, n: usize| { for _ in 0..n { body = body.coasted(gravity); } body };
        for step in 0..3 {
            for s in start.satellites.map(|s| coasted(s, step)) {
                for d in start.debris.iter().map(|d| coasted(*d, step)) {
                    prop_assert!(distance_2(s.x, s.y, d.x, d.y) >= 4.0);
                    if swept && step > 0 {
                        prop_assert!(swept_2(s.x - d.x, s.y - d.y, s.vx - d.vx, s.vy - d.vy) >= 4.0);
                    }
                }
            }
        }
    }

    /// Changing one param keeps the draws of everything else.
    #[test]
    fn more_debris_keeps_the_first(seed in 0u64..1 << 50) {
        let start = |debris: f64, start: &str| {
            let recipe = Recipe::with_params(&TASKS[0], [("debris", debris)].into_iter()).unwrap()
                .with_option("start", start).unwrap();
            let scenario = Scenario::new(recipe, crate::Seed::user(seed).unwrap());
            Setup::read(scenario.recipe()).unwrap().start(&mut Seeded::new(scenario.seed())).unwrap()
        };
        let (few, many) = (start(10.0, "upstream"), start(60.0, "upstream"));
        prop_assert_eq!(few.satellites, many.satellites);
        prop_assert_eq!(&few.debris[..], &many.debris[..10]);
    }

    /// Whatever is sent as a scenario: a typed error or a valid scenario, never a panic.
    #[test]
    fn any_json_is_a_scenario_or_a_typed_error(
        field in prop::sample::select(vec!["task", "world", "params", "physics", "layout", "seed", "extra"]),
        value in prop::sample::select(strange()),
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

/// Any JSON at all, with words of this world.
fn any_json() -> impl Strategy<Value = Value> {
    testing::any_json(
        Just(json!("satellite_id")),
        &["satellite_id", "delta_vx", "delta_vy", "params", "seed", "task", "x"],
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// Whatever is sent as a step of a log, or as a scenario: taken or refused, never a panic; what is taken can be
    /// flown or is refused by the environment, and leaves no NaN behind.
    #[test]
    fn anything_sent_as_a_log_is_taken_or_refused(steps in prop::collection::vec(any_json(), 0..4)) {
        let scenario = at_level("kessler/survival", 2, 3);
        let stopped = Some(crate::Stopped::Unparsable);
        let log = crate::rollout::read_log(&scenario, &steps, crate::log::Precision::F64, stopped);
        if let Ok(flown) = log.map_err(|_| ()).and_then(|log| crate::rollout::replay(&scenario, &log).map_err(|_| ())) {
            prop_assert!(flown.score.is_finite() && flown.fuel_used.is_finite());
        }
        for value in &steps {
            let _ = Scenario::from_json(value);
        }
    }
}

fn strange() -> Vec<Value> {
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
    insta::assert_snapshot!(with("params", json!({"fuel": -1})), @"params.fuel is -1, outside 0.1 to 1000");
    insta::assert_snapshot!(with("params", json!({"fuel": 1e300})), @"params.fuel is 1e300, outside 0.1 to 1000");
    insta::assert_snapshot!(with("params", json!({"debris": 2.5})), @"params.debris is 2.5, but must be a whole number");
    insta::assert_snapshot!(with("params", json!({"fule": 1})), @"params.fule is not a known field; known are debris, fuel, spread, rogue_probability, rogue_speed, radar_range, sigma");
    insta::assert_snapshot!(with("physics", json!({"compat": "downstream"})), @r#"physics.compat is "downstream"; choose one of none, upstream"#);
    insta::assert_snapshot!(with("seed", json!(1u64 << 53)), @"seed is 9007199254740992, but must be a whole number from 0 to 2251799813685247 (larger ones are kept for training and evaluation)");
    insta::assert_snapshot!(with("task", json!("kessler/golf")), @r#"task is "kessler/golf"; choose one of kessler/survival, kessler/eco_station, kessler/rendezvous, kessler/formation, docking/single, docking/multiagent"#);
    insta::assert_snapshot!(with("layout", json!({"mode": "replace", "bodies": {"debris": [[30, 0, 0, 5]]}})), @"params.debris: it is 25, but the layout replaces debris by 1: say 1");
    insta::assert_snapshot!(with("layout", json!({"mode": "extend", "bodies": {"debris": [[3, 0, 0, 5]]}})), @"layout.bodies.debris.0: it starts inside the Earth, 3.0 LU from its centre");
    insta::assert_snapshot!(with("layout", json!({"mode": "extend", "bodies": {"debris": [[3, 0, 0, 500]]}})), @"layout.bodies.debris.0.3 is 500, outside -100 to 100");
}

#[test]
fn level_tables_are_within_their_spaces() {
    for task in crate::tasks() {
        assert_eq!(task.levels().len(), 10);
        for level in 0..10 {
            Recipe::with_params(task, task.levels().params(level)).unwrap();
        }
    }
}
