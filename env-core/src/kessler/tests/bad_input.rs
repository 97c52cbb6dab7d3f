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
    params.debris must be from 0 to 1000, got -5
    params.debris must be from 0 to 1000, got 1005
    params.debris must be an integer, got 7.5
    params.debris must be a finite number, got "many"
    params.debris must be a finite number, got null
    params.fuel must be from 0.1 to 1000, got 0
    params.fuel must be from 0.1 to 1000, got 1000.5
    params.spread must be from 0 to 3, got -0.1
    params.spread must be from 0 to 3, got 3.1
    params.rogue_probability must be from 0 to 1, got -0.01
    params.rogue_probability must be from 0 to 1, got 1.01
    params.rogue_speed must be from 0.3 to 1.3, got 0.29
    params.rogue_speed must be from 0.3 to 1.3, got 1.31
    params.radar_range must be from 1 to 300, got 0
    params.radar_range must be from 1 to 300, got 301
    params.sigma must be from 0.05 to 10, got 0.04
    params.sigma must be from 0.05 to 10, got 10.1
    params.sigma must be a finite number, got [0.5]
    params.warnings is not a known field; the known fields are debris, fuel, spread, rogue_probability, rogue_speed, radar_range, sigma
    params must be an object, got [1,2]
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
    physics.start must be one of fair, upstream, got "unfair"
    physics.compat must be one of none, upstream, got "downstream"
    physics.contact must be one of end_of_step, swept, got "continuous"
    physics.gravity must be one of point, j2, got "j3"
    physics.risk must be one of contact, pc, got "none"
    physics.warnings must be one of none, exact, noisy, got "loud"
    physics.warnings must be a word, got true
    physics.radar is not a known field; the known fields are start, compat, contact, gravity, risk, warnings
    physics must be an object, got "j2"
    physics.contact cannot be combined with risk: pc: its contacts are not destructive, so contact: swept has no effect
    physics.contact cannot be combined with compat: upstream: that choice reproduces the public kessler-env bit by bit
    physics.gravity cannot be combined with compat: upstream: that choice reproduces the public kessler-env bit by bit
    physics.risk cannot be combined with compat: upstream: that choice reproduces the public kessler-env bit by bit
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
    layout must be an object, got []
    layout.mode is required: replace or extend
    layout.mode must be one of replace, extend, got "merge"
    layout.bodies is required: tables of rows by name
    layout.bodies.moons is not a known field; the known fields are satellites, debris, rogues
    layout.bodies.debris must have at most 512 rows, got 513
    layout.bodies.debris.1 must be a list of x, y, vx, vy, got 3 numbers
    layout.bodies.debris.0.3 must be a finite number, got "4"
    layout.bodies.debris.0.0 must be from -1000 to 1000, got 1000.1
    layout.bodies.debris.0.3 must be from -100 to 100, got -100.1
    layout.bodies.debris.0 must start outside the Earth (radius 20 LU), got a distance of 19.9 LU
    layout.bodies.satellites must have 3 rows, got 1
    layout.bodies.satellites.2 must start outside the Earth (radius 20 LU), got a distance of 19.9 LU
    layout.bodies.rogues.0 must be a list of step, x, y, vx, vy, got 0 numbers
    layout.bodies.rogues.0.0 must be from 1 to 50, got 0
    layout.bodies.rogues.0.0 must be from 1 to 50, got 51
    layout.bodies.rogues.0.0 must be an integer, got 2.5
    layout.bodies.rogues.0 must start outside the Earth (radius 20 LU), got a distance of 5.0 LU
    layout.bodies.rogues.0 must be a list of step, x, y, vx, vy, got 4 numbers
    layout.bodies.rogues.0.2 must be from -1000 to 1000, got -1001
    layout.bodies.rogues.0.4 must be from -100 to 100, got 101
    params.debris must be 1, the debris of the layout, got 3
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
    actions.steps.0: a step must be a list of burns
    actions.steps.1.1: the agent must be from 0 to 2, got 5
    actions.steps.1.1.0: the index of a satellite must be an integer of at least 0
    actions.steps.0.0.2: a change of speed must be a finite number
    actions.steps.0.0.delta_vy: a change of speed must be a finite number
    actions.steps.0.0.satellite: unknown field of a burn; the known fields are satellite_id, delta_vx, delta_vy
    actions.steps.0.0: a burn must be [satellite, dvx, dvy]
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
    scenario must be an object, got null
    scenario must be an object, got "kessler/survival"
    task is required: the id of a task, such as kessler/survival
    task must be the id of a task, such as kessler/survival, got 1
    task must be one of kessler/survival, kessler/eco_station, kessler/rendezvous, kessler/formation, docking/single, docking/multiagent, tasking/scanning, tasking/imaging, tasking/constellation, got "kessler/golf"
    seed is required: an integer from 0 to 2251799813685247 (larger seeds are reserved for training and evaluation)
    seed must be an integer from 0 to 2251799813685247 (larger seeds are reserved for training and evaluation), got -1
    seed must be an integer from 0 to 2251799813685247 (larger seeds are reserved for training and evaluation), got 1.5
    seed must be an integer from 0 to 2251799813685247 (larger seeds are reserved for training and evaluation), got "1"
    seed must be an integer from 0 to 2251799813685247 (larger seeds are reserved for training and evaluation), got 9007199254740992
    world must be one of kessler@1, got "kessler@2"
    level is not a known field; the known fields are world, task, params, physics, layout, seed
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
    insta::assert_snapshot!(start_error(layout(json!([[90, 0, 0, 3], [61, 0, 0, 4]])), json!({})).unwrap(), @"layout.bodies.debris.1 makes the start unfair: it touches satellite 0 at step 0 under hold, before any agent could act");
    // A head-on crossing within the second step is found only by a swept contact.
    let crossing = layout(json!([[60, 12, 0, -4]]));
    assert_eq!(start_error(crossing.clone(), json!({})), None);
    insta::assert_snapshot!(start_error(crossing.clone(), json!({"contact": "swept"})).unwrap(), @"layout.bodies.debris.0 makes the start unfair: it touches satellite 0 at step 2 under hold, before any agent could act");
    assert_eq!(start_error(crossing, json!({"contact": "swept", "start": "upstream"})), None);
    // Rogues: one arrives beside a satellite and flies with it, and one arrives when the agents could have
    // acted.
    let rogue = |step: u32| json!({"mode": "extend", "bodies": {"satellites": satellites, "rogues": [[step, 61, 0, 0, 4]]}});
    insta::assert_snapshot!(start_error(rogue(1), json!({})).unwrap(), @"layout.bodies.rogues makes the start unfair: the rogue of step 1 touches satellite 0 at step 1 under hold, before any agent could act");
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
    assert!(
        moved.to_string().starts_with("task_settings.kessler/survival.options.compat must not be upstream,")
    );
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
