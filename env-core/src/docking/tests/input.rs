//! Invalid input gives typed errors that name the field.

use proptest::prelude::*;
use serde_json::{Value, json};

use crate::error::{LogError, StepError};
use crate::log::{ActionLog, JointAction, Precision};
use crate::rollout::{read_log, replay};
use crate::task::{Scenario, StepReport};
use crate::testing;

fn scenario(task: &str, params: &Value, layout: &Value) -> Result<Scenario, String> {
    let value = json!({"task": task, "seed": 1, "params": params, "layout": layout});
    Scenario::from_json(&value).map_err(|error| error.to_string())
}

/// The error of a layout with these rows.
fn layout_error(rows: &Value) -> String {
    let layout = json!({"mode": "replace", "bodies": {"deputies": rows}});
    scenario("docking/multiagent", &json!({"deputies": 2}), &layout).unwrap_err()
}

#[test]
fn errors_name_field_value_and_range() {
    let params =
        |task: &str, params: Value| scenario(&format!("docking/{task}"), &params, &Value::Null).unwrap_err();
    insta::assert_snapshot!(params("multiagent", json!({"deputies": 6})), @"params.deputies must be from 1 to 5, got 6");
    insta::assert_snapshot!(params("multiagent", json!({"deputies": 1.5})), @"params.deputies must be an integer, got 1.5");
    insta::assert_snapshot!(params("multiagent", json!({"time_limit_s": 2001})), @"params.time_limit_s must be from 20 to 2000, got 2001");
    insta::assert_snapshot!(params("multiagent", json!({"time_limit_s": 100.5})), @"params.time_limit_s must be an integer, got 100.5");
    insta::assert_snapshot!(params("multiagent", json!({"thrust_bound": 0})), @"params.thrust_bound must be from 0.01 to 1, got 0");
    insta::assert_snapshot!(params("multiagent", json!({"start_radius": -1})), @"params.start_radius must be from 10 to 1000, got -1");
    insta::assert_snapshot!(params("multiagent", json!({"speed_ratio": null})), @"params.speed_ratio must be a finite number, got null");
    insta::assert_snapshot!(params("single", json!({"deputies": 1})), @"params.deputies is not a known field; the known fields are start_radius, speed_ratio, time_limit_s, thrust_bound, start_scale");
    let far = json!([[50, 0, 0, 0, 0, 0], [0, 60, 0, 0, 0, 0]]);
    let layout = |mode: &str, table: &str| json!({"mode": mode, "bodies": {table: far}});
    let multi = |layout: &Value| scenario("docking/multiagent", &json!({"deputies": 2}), layout);
    assert!(multi(&layout("replace", "deputies")).is_ok());
    insta::assert_snapshot!(multi(&layout("extend", "deputies")).unwrap_err(), @"layout.mode must be replace: the task determines the number of deputies");
    insta::assert_snapshot!(multi(&layout("replace", "debris")).unwrap_err(), @"layout.bodies.debris is not a known field; the known fields are deputies");
}

#[test]
fn invalid_layouts_name_the_row() {
    insta::assert_snapshot!(layout_error(&json!([[50, 0, 0, 0, 0, 0]])), @"layout.bodies.deputies must have 2 rows, one for each deputy, got 1");
    insta::assert_snapshot!(layout_error(&json!([[50, 0, 0, 0, 0, 0], [50, 0.5, 0, 0, 0, 0]])), @"layout.bodies.deputies.1 must start at least 1 m from deputy 0, got 0.50 m");
    insta::assert_snapshot!(layout_error(&json!([[50, 0, 0, 0, 0, 0], [0.3, 0.4, 0, 0, 0, 0]])), @"layout.bodies.deputies.1 must start more than 0.5 m from the chief (the docking radius), got 0.50 m");
    insta::assert_snapshot!(layout_error(&json!([[9000, 9000, 0, 0, 0, 0], [50, 0, 0, 0, 0, 0]])), @"layout.bodies.deputies.0 must start at most 10000 m from the chief, got 12728 m");
    insta::assert_snapshot!(layout_error(&json!([[50, 0, 0, 0, 0, 0], [0, 60, 10001, 0, 0, 0]])), @"layout.bodies.deputies.1.2 must be from -10000 to 10000, got 10001");
    insta::assert_snapshot!(layout_error(&json!([[50, 0, 0, 0, 0, 0], [0, 60, 0, 0, 0, -11]])), @"layout.bodies.deputies.1.5 must be from -10 to 10, got -11");
    insta::assert_snapshot!(layout_error(&json!([[50, 0, 0, 0, 0, 0], [0, 60, 0]])), @"layout.bodies.deputies.1 must be a list of x, y, z, vx, vy, vz, got 3 numbers");
}

#[test]
fn invalid_actions_change_nothing() {
    let scenario = super::at_level("docking/multiagent", 2, 1);
    let mut episode = scenario.task().start(&scenario).unwrap();
    let before = episode.state_hash();
    let mut step = |agents: &[u32], values: &[f64]| {
        let error = episode.step(JointAction { agents, values }, &mut StepReport::default()).unwrap_err();
        assert_eq!(episode.state_hash(), before);
        error
    };
    assert_eq!(step(&[3], &[0.0; 3]), StepError::UnknownAgent { agent: 3, last: 2 });
    for wrong in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        assert_eq!(step(&[0, 1], &[0.0, 0.0, 0.0, 0.0, wrong, 0.0]), StepError::NotFinite { agent: 1 });
    }
    assert_eq!(step(&[0], &[0.0; 2]), StepError::Shape { values: 2, entries: 1, dim: 3 });
    assert_eq!(step(&[0; 65], &[0.0; 195]), StepError::TooMany { count: 65, max: 64 });
    let task = scenario.task();
    let mut episode = task.start(&super::at_level("docking/single", 9, 1)).unwrap();
    while !episode.done() {
        episode.step(JointAction::HOLD, &mut StepReport::default()).unwrap();
    }
    let after = episode.step(JointAction::HOLD, &mut StepReport::default());
    assert_eq!(after, Err(StepError::Ended { step: episode.steps() }));
}

#[test]
fn steps_of_a_log_are_lists_or_objects() {
    let scenario = super::at_level("docking/multiagent", 2, 1);
    let read = |step: Value| read_log(&scenario, &[step], Precision::F64, Some(crate::StopReason::TooLong));
    let list = read(json!([[1, 0.5, -0.25, 0.0]])).unwrap();
    assert_eq!(list, read(json!([{"deputy": 1, "fx": 0.5, "fy": -0.25, "fz": 0}])).unwrap());
    assert_eq!((list.step(0).agents, list.step(0).values), (&[1][..], &[0.5, -0.25, 0.0][..]));
    let error = |step: Value| read(step).unwrap_err().to_string();
    insta::assert_snapshot!(error(json!({})), @"steps.0: a step must be a list of thrusts");
    insta::assert_snapshot!(error(json!([[0, 1, 2]])), @"steps.0.0: a thrust must be [deputy, fx, fy, fz]");
    insta::assert_snapshot!(error(json!([[0, 1, 2, 3], 7])), @"steps.0.1: a thrust must be a list or an object");
    insta::assert_snapshot!(error(json!([[-1, 1, 2, 3]])), @"steps.0.0.0: the index of a deputy must be an integer of at least 0");
    insta::assert_snapshot!(error(json!([[0, 1, "a", 3]])), @"steps.0.0.2: a thrust must be a finite number");
    insta::assert_snapshot!(error(json!([{"deputy": 0, "fx": 1, "fy": 0}])), @"steps.0.0.fz: a thrust must be a finite number");
    insta::assert_snapshot!(error(json!([{"deputy": 0, "thrust": 1}])), @"steps.0.0.thrust: unknown field of a thrust; the known fields are deputy, fx, fy, fz");
    let many: Vec<Value> = (0..65).map(|_| json!([0, 0, 0, 0])).collect();
    insta::assert_snapshot!(error(json!(many)), @"steps.0: a step must have at most 64 thrusts, got 65");
}

#[test]
fn policy_holds_on_a_foreign_observation() {
    let scenario = super::at_level("docking/single", 0, 1);
    assert!(scenario.task().policy("golf", &scenario, 0).is_err());
    let mut log = ActionLog::new(3, Precision::F64);
    scenario.task().policy("heuristic", &scenario, 0).unwrap().act(&"not telemetry", &mut log).unwrap();
    assert_eq!((log.len(), log.step(0)), (1, JointAction::HOLD));
}

/// Strategy for arbitrary JSON with field names of this world.
fn any_json() -> impl Strategy<Value = Value> {
    testing::any_json(
        (0u32..5, -2.0..2.0f64).prop_map(|(id, f)| json!([id, f, -f, 0.1])),
        &["deputy", "fx", "fy", "fz", "bodies", "deputies", "mode", "x"],
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// An arbitrary log is accepted or rejected without a panic. An accepted one can be replayed, unless the environment
    /// rejects an action, gives no NaN, and has a critique.
    #[test]
    fn any_log_is_accepted_or_rejected(steps in prop::collection::vec(any_json(), 0..4)) {
        let scenario = super::at_level("docking/multiagent", 9, 3);
        let log = read_log(&scenario, &steps, Precision::F64, Some(crate::StopReason::Unparsable));
        let outcome = log.and_then(|log| {
            let outcome = replay(&scenario, &log).map_err(|_| LogError::malformed("", ""))?;
            assert!(scenario.task().critique(&scenario, &log).is_ok());
            Ok(outcome)
        });
        if let Ok(outcome) = outcome {
            prop_assert!(outcome.score.is_finite() && outcome.fuel_used.is_finite());
        }
    }

    /// An arbitrary layout gives a typed error or a scenario that starts, without a panic.
    #[test]
    fn any_layout_is_accepted_or_rejected(layout in any_json(), table in any_json()) {
        for layout in [layout, json!({"mode": "replace", "bodies": {"deputies": table}})] {
            let value = json!({"task": "docking/single", "seed": 1, "layout": layout});
            match Scenario::from_json(&value) {
                Err(error) => prop_assert!(!error.field().is_empty() && error.to_string().len() < 400),
                Ok(scenario) => prop_assert!(scenario.task().start(&scenario).is_ok()),
            }
        }
    }
}

/// Few actions are within the action space, hold first, and each differs from the others.
#[test]
fn few_actions_are_distinct_and_valid() {
    for task in crate::tasks() {
        let (few, space) = (task.few_actions(), task.action_space());
        assert!(few.rows.len() <= task.action_grid().rows.len() && !few.description.is_empty());
        for (index, row) in few.rows.iter().enumerate() {
            assert_eq!(row.len(), space.dim(), "{}", task.id());
            assert!(row.iter().all(|value| space.accepts(*value)), "{}", task.id());
            assert!(!few.rows[..index].contains(row), "{}", task.id());
        }
        if few.hold.is_some() {
            assert!(few.hold == Some(0) && few.rows[0].iter().all(|value| *value == space.hold));
        }
    }
}
