//! Rejected input: every error names its field, in the reader of recipes and in that of scenarios.

use serde_json::{Value, json};

use crate::task::{MAX_LAYOUT_ROWS, Recipe, Scenario};

/// Error of a survival recipe with these changes. Checks that both readers give it and that it names its
/// field.
fn error_of(changes: &[(&str, Value)]) -> String {
    let mut recipe = json!({"task": "kessler/survival"});
    for (path, value) in changes {
        match path.split_once('.') {
            Some((outer, inner)) => recipe[outer][inner] = value.clone(),
            None => recipe[*path] = value.clone(),
        }
    }
    let mut scenario = recipe.clone();
    scenario["seed"] = json!(1);
    let by_recipe = Recipe::from_json(&recipe).expect_err(&format!("{recipe} was accepted"));
    assert_eq!(Scenario::from_json(&scenario).unwrap_err(), by_recipe);
    let text = by_recipe.to_string();
    assert!(text.starts_with(by_recipe.field()), "{text} does not begin with its field");
    text
}

/// Errors of several changes, one per line.
fn errors_of(table: &[&[(&str, Value)]]) -> String {
    table.iter().map(|changes| error_of(changes) + "\n").collect()
}

fn with_bodies(table: &str, rows: &Value) -> Value {
    json!({"mode": "extend", "bodies": {table: rows}})
}

#[test]
fn params_out_of_range_are_rejected() {
    insta::assert_snapshot!(errors_of(&[
        &[("params.debris", json!(-5))],
        &[("params.debris", json!(1005))],
        &[("params.debris", json!(7.5))],
        &[("params.debris", json!("many"))],
        &[("params.debris", json!(null))],
        &[("params.fuel", json!(0))],
        &[("params.fuel", json!(1000.5))],
        &[("params.spread", json!(-0.1))],
        &[("params.spread", json!(3.1))],
        &[("params.rogue_probability", json!(-0.01))],
        &[("params.rogue_probability", json!(1.01))],
        &[("params.rogue_speed", json!(0.29))],
        &[("params.rogue_speed", json!(1.31))],
        &[("params.radar_range", json!(0))],
        &[("params.radar_range", json!(301))],
        &[("params.sigma", json!(0.04))],
        &[("params.sigma", json!(10.1))],
        &[("params.sigma", json!([0.5]))],
        &[("params.warnings", json!(1))],
        &[("params", json!([1, 2]))],
    ]), @r#"
    params.debris is -5, outside 0 to 1000
    params.debris is 1005, outside 0 to 1000
    params.debris is 7.5, but must be a whole number
    params.debris is "many", but must be a finite number
    params.debris is null, but must be a finite number
    params.fuel is 0, outside 0.1 to 1000
    params.fuel is 1000.5, outside 0.1 to 1000
    params.spread is -0.1, outside 0 to 3
    params.spread is 3.1, outside 0 to 3
    params.rogue_probability is -0.01, outside 0 to 1
    params.rogue_probability is 1.01, outside 0 to 1
    params.rogue_speed is 0.29, outside 0.3 to 1.3
    params.rogue_speed is 1.31, outside 0.3 to 1.3
    params.radar_range is 0, outside 1 to 300
    params.radar_range is 301, outside 1 to 300
    params.sigma is 0.04, outside 0.05 to 10
    params.sigma is 10.1, outside 0.05 to 10
    params.sigma is [0.5], but must be a finite number
    params.warnings is not a known field; known are debris, fuel, spread, rogue_probability, rogue_speed, radar_range, sigma
    params is [1,2], but must be an object
    "#);
}

#[test]
fn unknown_or_conflicting_options_are_rejected() {
    let upstream = ("physics.compat", json!("upstream"));
    insta::assert_snapshot!(errors_of(&[
        &[("physics.start", json!("unfair"))],
        &[("physics.compat", json!("downstream"))],
        &[("physics.contact", json!("continuous"))],
        &[("physics.gravity", json!("j3"))],
        &[("physics.risk", json!("none"))],
        &[("physics.warnings", json!("loud"))],
        &[("physics.warnings", json!(true))],
        &[("physics.radar", json!("on"))],
        &[("physics", json!("j2"))],
        &[("physics.contact", json!("swept")), ("physics.risk", json!("pc"))],
        &[upstream.clone(), ("physics.contact", json!("swept"))],
        &[upstream.clone(), ("physics.gravity", json!("j2"))],
        &[upstream.clone(), ("physics.risk", json!("pc"))],
    ]), @r#"
    physics.start is "unfair"; choose one of fair, upstream
    physics.compat is "downstream"; choose one of none, upstream
    physics.contact is "continuous"; choose one of end_of_step, swept
    physics.gravity is "j3"; choose one of point, j2
    physics.risk is "none"; choose one of contact, pc
    physics.warnings is "loud"; choose one of none, exact, noisy
    physics.warnings is true, but must be a word
    physics.radar is not a known field; known are start, compat, contact, gravity, risk, warnings
    physics is "j2", but must be an object
    physics.contact: it cannot be combined with risk: pc: pc has no destructive contacts, so contact: swept has no effect
    physics.contact: it cannot be combined with compat: upstream: that is the public original's arithmetic, to the bit
    physics.gravity: it cannot be combined with compat: upstream: that is the public original's arithmetic, to the bit
    physics.risk: it cannot be combined with compat: upstream: that is the public original's arithmetic, to the bit
    "#);
}

#[test]
fn invalid_layouts_are_rejected() {
    let far = vec![json!([500, 0, 0, 1]); MAX_LAYOUT_ROWS + 1];
    let bodies = |table, rows| [("layout", with_bodies(table, &rows))];
    let replaced = |count: u32, rows: Value| {
        [("params.debris", json!(count)), ("layout", json!({"mode": "replace", "bodies": {"debris": rows}}))]
    };
    insta::assert_snapshot!(errors_of(&[
        &[("layout", json!([]))],
        &[("layout", json!({"bodies": {}}))],
        &[("layout", json!({"mode": "merge", "bodies": {}}))],
        &[("layout", json!({"mode": "extend"}))],
        &bodies("moons", json!([[60, 0, 0, 4]])),
        &bodies("debris", json!(Value::Array(far))),
        &bodies("debris", json!([[60, 0, 0, 4], [60, 0, 4]])),
        &bodies("debris", json!([[60, 0, 0, "4"]])),
        &bodies("debris", json!([[1000.1, 0, 0, 4]])),
        &bodies("debris", json!([[60, 0, 0, -100.1]])),
        &bodies("debris", json!([[12, 15.9, 0, 4]])),
        &bodies("satellites", json!([[60, 0, 0, 4]])),
        &bodies("satellites", json!([[60, 0, 0, 4], [0, 70, -4, 0], [0, -19.9, 4, 0]])),
        &bodies("rogues", json!([[]])),
        &bodies("rogues", json!([[0, 95, 0, 0, 4]])),
        &bodies("rogues", json!([[51, 95, 0, 0, 4]])),
        &bodies("rogues", json!([[2.5, 95, 0, 0, 4]])),
        &bodies("rogues", json!([[2, 5, 0, 0, 4]])),
        &bodies("rogues", json!([[2, 95, 0, 0]])),
        &bodies("rogues", json!([[2, 95, -1001, 0, 4]])),
        &bodies("rogues", json!([[2, 95, 0, 0, 101]])),
        &replaced(3, json!([[60, 0, 0, 4]])),
    ]), @r#"
    layout is [], but must be an object
    layout.mode is missing: replace or extend
    layout.mode is "merge"; choose one of replace, extend
    layout.bodies is missing: tables of rows by name
    layout.bodies.moons is not a known field; known are satellites, debris, rogues
    layout.bodies.debris: 513 rows; at most 512 are taken
    layout.bodies.debris.1: 3 numbers; a body is x, y, vx, vy
    layout.bodies.debris.0.3 is "4", but must be a finite number
    layout.bodies.debris.0.0 is 1000.1, outside -1000 to 1000
    layout.bodies.debris.0.3 is -100.1, outside -100 to 100
    layout.bodies.debris.0: it starts inside the Earth, 19.9 LU from its centre
    layout.bodies.satellites: 1 rows; give all 3
    layout.bodies.satellites.2: it starts inside the Earth, 19.9 LU from its centre
    layout.bodies.rogues.0: 0 numbers; a rogue is step, x, y, vx, vy
    layout.bodies.rogues.0.0 is 0, outside 1 to 50
    layout.bodies.rogues.0.0 is 51, outside 1 to 50
    layout.bodies.rogues.0.0 is 2.5, but must be a whole number
    layout.bodies.rogues.0: it starts inside the Earth, 5.0 LU from its centre
    layout.bodies.rogues.0: 4 numbers; a rogue is step, x, y, vx, vy
    layout.bodies.rogues.0.2 is -1001, outside -1000 to 1000
    layout.bodies.rogues.0.4 is 101, outside -100 to 100
    params.debris: it is 3, but the layout replaces debris by 1: say 1
    "#);
}

/// The path of an error counts from 0, its text repeats the path, and the path starts at the place of the
/// log.
#[test]
fn log_errors_name_the_path_at_fault() {
    let scenario = super::at_level("kessler/survival", 0, 1);
    let error_of_log = |steps: serde_json::Value| {
        let steps: Vec<_> = steps.as_array().unwrap().clone();
        let stopped = Some(crate::StopReason::TooLong);
        let read = crate::rollout::read_log(&scenario, &steps, crate::log::Precision::F64, stopped);
        let error = read
            .map_err(crate::error::ReplayError::from)
            .and_then(|log| crate::rollout::replay(&scenario, &log));
        let Err(crate::error::ReplayError::Log(error)) = error else { panic!("{error:?}") };
        let (field, under) = (format!("actions.{}", error.field()), error.with_parent("actions").to_string());
        assert!(under.starts_with(&format!("{field}: ")) || field == "actions.steps", "{field} | {under}");
        under
    };
    let errors = [
        json!([7]),
        json!([[], [[0, 0.1, 0], [5, 0, 0]]]),
        json!([[], [[0, 0.1, 0], [-1, 0, 0]]]),
        json!([[[0, 0.1, "x"]]]),
        json!([[{"satellite_id": 0, "delta_vx": 0.1}]]),
        json!([[{"satellite": 0}]]),
        json!([[[0, 0.1]]]),
        json!(vec![json!([]); 51]),
    ]
    .map(error_of_log);
    insta::assert_snapshot!(errors.join("\n"), @r"
    actions.steps.0: a step is a list of burns
    actions.steps.1.1: agent 5 does not exist; agents are 0 to 2
    actions.steps.1.1.0: a satellite's number must be a whole number, 0 or more
    actions.steps.0.0.2: a change of speed must be a finite number
    actions.steps.0.0.delta_vy: a change of speed must be a finite number
    actions.steps.0.0.satellite: it is not known; a burn has satellite_id, delta_vx, delta_vy
    actions.steps.0.0: a burn is [satellite, dvx, dvy]
    the log has 51 steps, but the episode was over after 50
    ");
}

#[test]
fn invalid_task_or_seed_is_rejected() {
    let scenario = |value: Value| Scenario::from_json(&value).unwrap_err().to_string() + "\n";
    let errors: String = [
        json!(null),
        json!("kessler/survival"),
        json!({"seed": 1}),
        json!({"task": 1, "seed": 1}),
        json!({"task": "kessler/golf", "seed": 1}),
        json!({"task": "kessler/survival"}),
        json!({"task": "kessler/survival", "seed": -1}),
        json!({"task": "kessler/survival", "seed": 1.5}),
        json!({"task": "kessler/survival", "seed": "1"}),
        json!({"task": "kessler/survival", "seed": 1u64 << 53}),
        json!({"task": "kessler/survival", "seed": 1, "world": "kessler@2"}),
        json!({"task": "kessler/survival", "seed": 1, "level": 3}),
    ]
    .into_iter()
    .map(scenario)
    .collect();
    insta::assert_snapshot!(errors, @r#"
    scenario is null, but must be an object
    scenario is "kessler/survival", but must be an object
    task is missing: a task's id, as kessler/survival
    task is 1, but must be a task's id, as kessler/survival
    task is "kessler/golf"; choose one of kessler/survival, kessler/eco_station, kessler/rendezvous, kessler/formation, docking/single, docking/multiagent
    seed is missing: a whole number from 0 to 2251799813685247 (larger ones are kept for training and evaluation)
    seed is -1, but must be a whole number from 0 to 2251799813685247 (larger ones are kept for training and evaluation)
    seed is 1.5, but must be a whole number from 0 to 2251799813685247 (larger ones are kept for training and evaluation)
    seed is "1", but must be a whole number from 0 to 2251799813685247 (larger ones are kept for training and evaluation)
    seed is 9007199254740992, but must be a whole number from 0 to 2251799813685247 (larger ones are kept for training and evaluation)
    world is "kessler@2"; choose one of kessler@1
    level is not a known field; known are world, task, params, physics, layout, seed
    "#);
}

/// Bodies that touch a satellite before any agent could act are rejected at the start, by field.
#[test]
fn unfair_starts_are_rejected() {
    let start_error = |layout: Value, physics: Value| {
        let value = json!({"task": "kessler/survival", "params": {"debris": 0}, "physics": physics, "layout": layout, "seed": 1});
        let scenario = Scenario::from_json(&value).unwrap();
        scenario.task().start(&scenario).err().map(|error| {
            assert!(error.to_string().starts_with(error.field()));
            error.to_string()
        })
    };
    let satellites = json!([[60, 0, 0, 4], [0, 70, -3.7, 0], [0, -80, 3.5, 0]]);
    let layout =
        |debris: Value| json!({"mode": "extend", "bodies": {"satellites": satellites, "debris": debris}});
    insta::assert_snapshot!(start_error(layout(json!([[90, 0, 0, 3], [61, 0, 0, 4]])), json!({})).unwrap(), @"layout.bodies.debris.1: the start is not fair: it touches satellite 0 at step 0 under hold, before any agent could act");
    // A head-on crossing within the second step is found only by a swept contact.
    let crossing = layout(json!([[60, 12, 0, -4]]));
    assert_eq!(start_error(crossing.clone(), json!({})), None);
    insta::assert_snapshot!(start_error(crossing.clone(), json!({"contact": "swept"})).unwrap(), @"layout.bodies.debris.0: the start is not fair: it touches satellite 0 at step 2 under hold, before any agent could act");
    assert_eq!(start_error(crossing, json!({"contact": "swept", "start": "upstream"})), None);
    // Rogues: one arrives beside a satellite and flies with it, and one arrives when the agents could have
    // acted.
    let rogue = |step: u32| json!({"mode": "extend", "bodies": {"satellites": satellites, "rogues": [[step, 61, 0, 0, 4]]}});
    insta::assert_snapshot!(start_error(rogue(1), json!({})).unwrap(), @"layout.bodies.rogues: the start is not fair: the rogue of step 1 touches satellite 0 at step 1 under hold, before any agent could act");
    assert_eq!(start_error(rogue(1), json!({"start": "upstream"})), None);
    assert_eq!(start_error(rogue(3), json!({})), None);
}

#[test]
fn options_are_checked_together_and_some_are_manual() {
    let of = |options: &[(&str, &str)]| {
        let recipe = Recipe::new(crate::task("kessler/survival").unwrap()).unwrap();
        recipe.with_options(options.iter().copied())
    };
    let recipe = of(&[("risk", "pc"), ("warnings", "noisy"), ("start", "fair")]).unwrap();
    assert_eq!(
        recipe.chosen_options().into_iter().collect::<Vec<_>>(),
        [("risk", "pc"), ("warnings", "noisy")]
    );
    assert_eq!(recipe.check_for_series(), Ok(()));
    // Each option by itself contradicts the options before; together they do not.
    let away = recipe.with_options([("contact", "swept"), ("risk", "contact")].into_iter()).unwrap();
    assert_eq!(away.option("contact"), Some("swept"));
    let upstream = of(&[("compat", "upstream")]).unwrap();
    let error = upstream.check_for_series().unwrap_err();
    assert_eq!(error.field(), "physics.compat");
    let moved = error.relocate("physics", "task_settings.kessler/survival.options");
    assert_eq!(moved.field(), "task_settings.kessler/survival.options.compat");
    assert!(moved.to_string().starts_with("task_settings.kessler/survival.options.compat: upstream is for"));
    let clash = of(&[("contact", "swept"), ("risk", "pc")]).unwrap_err();
    assert_eq!(clash.clone().relocate("phys", "x").field(), "physics.contact", "whole names only");
    assert_eq!(clash.relocate("layout", "x").field(), "physics.contact");
}

/// Recipes accept what the option specs say: the first choice is the default, and manual choices are among
/// the choices.
#[test]
fn recipes_accept_the_options_of_their_specs() {
    for task in crate::tasks() {
        let recipe = Recipe::new(task).unwrap();
        for option in task.options() {
            assert_eq!(recipe.option(option.name), Some(option.default_choice()));
            for choice in option.choices {
                let by_hand = option.manual_choices.iter().any(|reserved| reserved.choice == *choice);
                let with = recipe.clone().with_option(option.name, choice).unwrap();
                assert_eq!(with.check_for_series().is_err(), by_hand, "{} {choice}", option.name);
            }
            assert!(
                option.manual_choices.iter().all(|reserved| option.choices[1..].contains(&reserved.choice))
            );
        }
    }
}
