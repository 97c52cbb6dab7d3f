//! Fuzz tests of legal but extreme scenarios and burns under all physics: nothing panics, all numbers are
//! finite, and scores stay in range.

use proptest::prelude::*;
use serde_json::{Value, json};

use super::staging::start_sim;
use crate::episode_rng::SeededRng;
use crate::error::StepError;
use crate::kessler::KESSLER_TASKS;
use crate::kessler::constants::SATELLITES;
use crate::kessler::setup::KesslerSetup;
use crate::kessler::simulation::KesslerSim;
use crate::kessler::spaces::MAX_DEBRIS;
use crate::kessler::tracks::{CELL_LIMIT, TracksEncoder};
use crate::kessler::warnings::WARNING_LOOK_AHEAD;
use crate::log::{JointAction, MAX_ENTRIES};
use crate::task::Scenario;
use crate::task::TaskSpec;

/// Params at one of their bounds, at the default, or anywhere between.
fn params(task: usize) -> impl Strategy<Value = Value> {
    let each: Vec<_> = KESSLER_TASKS[task]
        .params()
        .iter()
        .map(|spec| {
            let (min, max, whole) = (spec.min, spec.max, spec.whole);
            let anywhere = (min..max).prop_map(move |v| if whole { v.floor() } else { v });
            prop_oneof![3 => Just(spec.default), 1 => Just(min), 1 => Just(max), 2 => anywhere]
        })
        .collect();
    each.prop_map(move |values| {
        let named =
            KESSLER_TASKS[task].params().iter().zip(values).map(|(spec, v)| (spec.name.to_owned(), json!(v)));
        Value::Object(named.collect())
    })
}

fn physics() -> impl Strategy<Value = Value> {
    let choices = KESSLER_TASKS[0].options().iter().map(|o| prop::sample::select(o.choices).boxed());
    choices.collect::<Vec<_>>().prop_map(|choices| {
        let options = KESSLER_TASKS[0].options().iter();
        let named = options.zip(choices).map(|(o, choice)| (o.name.to_owned(), json!(choice)));
        Value::Object(named.collect())
    })
}

/// Legal bodies at critical places: at the corners of a layout's range, grazing the Earth, at one spot, at
/// rest.
fn body() -> impl Strategy<Value = [f64; 4]> {
    let speed = || prop_oneof![Just(0.0), Just(100.0), Just(-100.0), Just(1e-300), -10.0..10.0f64];
    let place = prop_oneof![
        Just((1000.0, -1000.0)),
        Just((20.0, 0.0)),
        Just((-12.0, 16.0)),
        Just((0.0, -20.000_000_000_000_004)),
        Just((60.0, 0.0)),
        Just((60.0, 1e-9)),
        (0.0..std::f64::consts::TAU, 20.1..120.0f64)
            .prop_map(|(angle, r)| (r * libm::cos(angle), r * libm::sin(angle))),
    ];
    (place, speed(), speed()).prop_map(|((x, y), vx, vy)| [x, y, vx, vy])
}

/// Random layout of a scenario.
#[derive(Debug, Clone)]
struct RandomLayout {
    json: Value,
    /// Value of `params.debris` that the layout requires, if it replaces debris.
    required_debris: Option<usize>,
}

fn layout() -> impl Strategy<Value = RandomLayout> {
    let rogue = (1u32..=50, body()).prop_map(|(step, b)| json!([step, b[0], b[1], b[2], b[3]]));
    (
        prop::option::of(prop::array::uniform3(body())),
        prop::option::of(prop::collection::vec(body(), 0..12)),
        prop::option::of(prop::collection::vec(rogue, 0..4)),
        any::<bool>(),
    )
        .prop_map(|(satellites, debris, rogues, replace)| {
            let required_debris = debris.as_ref().filter(|_| replace).map(Vec::len);
            let mut bodies = json!({});
            for (name, table) in
                [("satellites", json!(satellites)), ("debris", json!(debris)), ("rogues", json!(rogues))]
            {
                if !table.is_null() {
                    bodies[name] = table;
                }
            }
            let json = json!({"mode": if replace { "replace" } else { "extend" }, "bodies": bodies});
            RandomLayout { json, required_debris }
        })
}

fn scenario() -> impl Strategy<Value = Value> {
    (0..KESSLER_TASKS.len()).prop_flat_map(|task| {
        (params(task), physics(), prop::option::of(layout()), 0u64..1 << 40).prop_map(
            move |(mut params, physics, layout, seed)| {
                if let Some(count) = layout.as_ref().and_then(|layout| layout.required_debris) {
                    params["debris"] = json!(count);
                }
                let layout = layout.map(|layout| layout.json);
                // Drawn and given debris together is bounded.
                let given = layout.as_ref().and_then(|l| l["bodies"]["debris"].as_array()).map_or(0, Vec::len);
                let room = MAX_DEBRIS - given as f64;
                if params["debris"].as_f64().is_some_and(|drawn| drawn > room) {
                    params["debris"] = json!(room);
                }
                json!({"task": KESSLER_TASKS[task].id(), "params": params, "physics": physics, "layout": layout, "seed": seed})
            },
        )
    })
}

/// Numbers of a burn, some of them extreme.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -1.5..1.5f64,
        1 => prop::sample::select(vec![0.0, -0.0, 1.0, -1.0, 1e300, -1e300, f64::MAX, f64::MIN, f64::MIN_POSITIVE, 5e-324]),
    ]
}

/// Burn of one satellite.
#[derive(Debug, Clone, Copy)]
struct FuzzBurn {
    satellite: u32,
    dv: [f64; 2],
}

/// Burns of one step, sometimes of a satellite that does not exist.
fn burns() -> impl Strategy<Value = Vec<FuzzBurn>> {
    let burn = |(satellite, dvx, dvy)| FuzzBurn { satellite, dv: [dvx, dvy] };
    let satellite = prop_oneof![12 => 0u32..3, 1 => prop::sample::select(vec![3, 99, u32::MAX])];
    let few = prop::collection::vec((satellite, number(), number()).prop_map(burn), 0..5);
    let many = (0u32..3, number(), number()).prop_map(burn).prop_map(|b| vec![b; MAX_ENTRIES]);
    prop_oneof![8 => few, 1 => many]
}

/// Returns true if the JSON has no null, which stands for a number that is not finite.
fn has_only_finite_numbers(value: &Value) -> bool {
    match value {
        Value::Null => false,
        Value::Array(items) => items.iter().all(has_only_finite_numbers),
        Value::Object(fields) => fields.values().all(has_only_finite_numbers),
        _ => true,
    }
}

/// Checks that state, observations and warnings are finite and in range.
fn inspect(
    sim: &KesslerSim<SeededRng>,
    tracks: &TracksEncoder,
    cells: &mut Vec<f32>,
) -> Result<(), TestCaseError> {
    for s in sim.satellites() {
        let numbers = [s.body.x, s.body.y, s.body.vx, s.body.vy, s.fuel];
        prop_assert!(numbers.iter().all(|v| v.is_finite()) && s.fuel >= 0.0, "{s:?}");
        prop_assert!((0.0..=1.0).contains(&s.survival), "{s:?}");
    }
    for i in 0..sim.debris().len() {
        let d = sim.debris().body(i);
        prop_assert!([d.x, d.y, d.vx, d.vy].iter().all(|v| v.is_finite()), "{d:?}");
    }
    cells.clear();
    // More slots than bodies.
    let bodies = sim.debris().len() + 7;
    cells.resize(SATELLITES * 6 + 5 * bodies, f32::NAN);
    sim.observe_into(cells, bodies);
    prop_assert!(cells.iter().all(|v| v.is_finite()));
    cells.clear();
    cells.resize(tracks.total_cells(), f32::NAN);
    tracks.write(sim, cells);
    prop_assert!(cells.iter().all(|v| v.abs() <= CELL_LIMIT));
    for c in sim.conjunctions(true).into_iter().flatten() {
        prop_assert!((0.0..=WARNING_LOOK_AHEAD as f64).contains(&c.time_to_closest_approach), "{c:?}");
        prop_assert!(c.miss_distance >= 0.0 && c.miss_distance.is_finite(), "{c:?}");
        prop_assert!(c.relative_speed >= 0.0 && c.relative_speed.is_finite(), "{c:?}");
        prop_assert!((0.0..=1.0).contains(&c.probability), "{c:?}");
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(160))]

    /// Every task under all physics, with legal extremes of params and layouts and any burns.
    #[test]
    fn extreme_episodes_have_finite_numbers(
        value in scenario(),
        plan in prop::collection::vec(burns(), 1..12),
        k in 0usize..10,
    ) {
        let scenario = match Scenario::from_json(&value) {
            Ok(scenario) => scenario,
            Err(error) => {
                // Only options that contradict each other, or a sum of squares that rounds to just inside the
                // Earth, are rejected.
                let field = error.field();
                prop_assert!(field.starts_with("physics.") || error.to_string().contains("outside the Earth"), "{error}");
                return Ok(());
            }
        };
        let tracks = TracksEncoder::new(k, 15).unwrap();
        let mut cells = Vec::new();
        if let Err(error) = KesslerSetup::from_recipe(scenario.recipe()).unwrap().draw_initial_state(&mut SeededRng::new(scenario.seed())) {
            prop_assert!(error.to_string().contains("unfair"), "{error}");
            return Ok(());
        }
        let mut sim = start_sim(&scenario);
        let mut sum = 0.0;
        inspect(&sim, &tracks, &mut cells)?;
        for burns in plan.iter().cycle().take(200) {
            let agents: Vec<u32> = burns.iter().map(|b| b.satellite).collect();
            let values: Vec<f64> = burns.iter().flat_map(|b| b.dv).collect();
            let before = sim.state_hash();
            let mut poisoned = values.clone();
            if let Some(first) = poisoned.first_mut() {
                *first = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY][burns.len() % 3];
                let rejected = sim.step(JointAction { agents: &agents, values: &poisoned });
                prop_assert!(rejected.is_err(), "{rejected:?}");
                prop_assert_eq!(sim.state_hash(), before);
            }
            match sim.step(JointAction { agents: &agents, values: &values }) {
                Ok(stepped) => {
                    prop_assert!(stepped.reward.is_finite() && stepped.reward >= 0.0);
                    sum += stepped.reward;
                }
                Err(StepError::UnknownAgent { .. }) => {
                    prop_assert_eq!(sim.state_hash(), before);
                    sim.step(JointAction::HOLD).unwrap();
                    sum = sim.total_reward();
                }
                Err(error) => prop_assert!(false, "{error}"),
            }
            inspect(&sim, &tracks, &mut cells)?;
            if sim.steps() % 8 == 1 || sim.is_done() {
                let telemetry = serde_json::to_value(sim.telemetry(0.0, true)).unwrap();
                prop_assert!(has_only_finite_numbers(&telemetry), "{telemetry}");
            }
            if sim.is_done() {
                break;
            }
        }
        prop_assert!(sim.is_done() && sum == sim.total_reward());
        let (range, outcome) = (scenario.task().score_range(), sim.outcome());
        prop_assert!(outcome.score >= range.min && outcome.score <= range.max, "{outcome:?}");
        prop_assert!(outcome.goal.is_none_or(|goal| (0.0..=1.0 + 1e-12).contains(&goal)), "{outcome:?}");
    }
}

/// Any table of any rows, as a layout.
fn any_layout() -> impl Strategy<Value = Value> {
    let cell = prop_oneof![
        6 => (-1100.0..1100.0f64).prop_map(|v| json!(v)),
        1 => prop::sample::select(vec![json!(null), json!("60"), json!(1e308), json!(-0.0), json!([]), json!(u64::MAX)]),
    ];
    let row = prop::collection::vec(cell, 0..7).prop_map(Value::from);
    let table = prop::sample::select(vec!["satellites", "debris", "rogues", "moons"]);
    let bodies = prop::collection::btree_map(table, prop::collection::vec(row, 0..5), 0..4);
    let mode =
        prop::sample::select(vec![json!("extend"), json!("replace"), json!("add"), json!(1), json!(null)]);
    (mode, bodies).prop_map(|(mode, bodies)| json!({"mode": mode, "bodies": bodies}))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    /// Any layout gives a typed error that names a field, or a scenario that reads back the same.
    #[test]
    fn any_layout_is_accepted_or_rejected_by_field(layout in any_layout()) {
        let value = json!({"task": "kessler/survival", "params": {"debris": 2}, "layout": layout, "seed": 1});
        match Scenario::from_json(&value) {
            Ok(scenario) => prop_assert_eq!(Scenario::from_json(&scenario.to_json()).unwrap().id(), scenario.id()),
            Err(error) => prop_assert!(!error.field().is_empty() && error.to_string().len() < 400),
        }
    }
}
