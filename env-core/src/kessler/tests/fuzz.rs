//! Legal but extreme scenarios and burns under every law: nothing panics, no number is none, scores stay in range.

use proptest::prelude::*;
use serde_json::{Value, json};

use super::staging::flight;
use crate::chance::Seeded;
use crate::error::StepError;
use crate::kessler::TASKS;
use crate::kessler::constants::SATELLITES;
use crate::kessler::flight::Flight;
use crate::kessler::setup::Setup;
use crate::kessler::spaces::MAX_DEBRIS;
use crate::kessler::tracks::{LIMIT, Tracks};
use crate::kessler::warnings::LOOK_AHEAD;
use crate::log::{JointAction, MAX_ENTRIES};
use crate::scenario::Scenario;
use crate::task::TaskSpec;

/// A param at one of its bounds, at its default, or anywhere between.
fn params(task: usize) -> impl Strategy<Value = Value> {
    let each: Vec<_> = TASKS[task]
        .params()
        .iter()
        .map(|spec| {
            let (min, max, whole) = (spec.min, spec.max, spec.whole);
            let anywhere = (min..max).prop_map(move |v| if whole { v.floor() } else { v });
            prop_oneof![3 => Just(spec.default), 1 => Just(min), 1 => Just(max), 2 => anywhere]
        })
        .collect();
    each.prop_map(move |values| {
        let named = TASKS[task].params().iter().zip(values).map(|(spec, v)| (spec.name.to_owned(), json!(v)));
        Value::Object(named.collect())
    })
}

fn physics() -> impl Strategy<Value = Value> {
    let words = TASKS[0].options().iter().map(|o| prop::sample::select(o.choices).boxed());
    words.collect::<Vec<_>>().prop_map(|words| {
        let named = TASKS[0].options().iter().zip(words).map(|(o, word)| (o.name.to_owned(), json!(word)));
        Value::Object(named.collect())
    })
}

/// Bodies where it is legal and hurts: at the corners of what a layout may give, grazing the Earth, at one spot, at rest.
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

/// The layout, and how much debris `params.debris` must say if that is decided by it.
fn layout() -> impl Strategy<Value = (Value, Option<usize>)> {
    let rogue = (1u32..=50, body()).prop_map(|(step, b)| json!([step, b[0], b[1], b[2], b[3]]));
    (
        prop::option::of(prop::array::uniform3(body())),
        prop::option::of(prop::collection::vec(body(), 0..12)),
        prop::option::of(prop::collection::vec(rogue, 0..4)),
        any::<bool>(),
    )
        .prop_map(|(satellites, debris, rogues, replace)| {
            let count = debris.as_ref().filter(|_| replace).map(Vec::len);
            let mut bodies = json!({});
            for (name, table) in
                [("satellites", json!(satellites)), ("debris", json!(debris)), ("rogues", json!(rogues))]
            {
                if !table.is_null() {
                    bodies[name] = table;
                }
            }
            (json!({"mode": if replace { "replace" } else { "extend" }, "bodies": bodies}), count)
        })
}

fn scenario() -> impl Strategy<Value = Value> {
    (0..TASKS.len()).prop_flat_map(|task| {
        (params(task), physics(), prop::option::of(layout()), 0u64..1 << 40).prop_map(
            move |(mut params, physics, layout, seed)| {
                if let Some((_, Some(count))) = &layout {
                    params["debris"] = json!(count);
                }
                let layout = layout.map(|(layout, _)| layout);
                // What is drawn and what is given are at most so many together.
                let given = layout.as_ref().and_then(|l| l["bodies"]["debris"].as_array()).map_or(0, Vec::len);
                let room = MAX_DEBRIS - given as f64;
                if params["debris"].as_f64().is_some_and(|drawn| drawn > room) {
                    params["debris"] = json!(room);
                }
                json!({"task": TASKS[task].id(), "params": params, "physics": physics, "layout": layout, "seed": seed})
            },
        )
    })
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -1.5..1.5f64,
        1 => prop::sample::select(vec![0.0, -0.0, 1.0, -1.0, 1e300, -1e300, f64::MAX, f64::MIN, f64::MIN_POSITIVE, 5e-324]),
    ]
}

/// One step's burns: satellites (sometimes one that is not there), and their deltas.
fn burns() -> impl Strategy<Value = Vec<(u32, f64, f64)>> {
    let satellite = prop_oneof![12 => 0u32..3, 1 => prop::sample::select(vec![3, 99, u32::MAX])];
    let few = prop::collection::vec((satellite, number(), number()), 0..5);
    prop_oneof![8 => few, 1 => (0u32..3, number(), number()).prop_map(|b| vec![b; MAX_ENTRIES])]
}

/// No number anywhere is none: what JSON cannot say it says as null.
fn numbers_are_numbers(value: &Value) -> bool {
    match value {
        Value::Null => false,
        Value::Array(items) => items.iter().all(numbers_are_numbers),
        Value::Object(fields) => fields.values().all(numbers_are_numbers),
        _ => true,
    }
}

fn inspect(flight: &Flight<Seeded>, tracks: &mut Tracks, cells: &mut Vec<f32>) -> Result<(), TestCaseError> {
    for s in flight.satellites() {
        let numbers = [s.body.x, s.body.y, s.body.vx, s.body.vy, s.fuel];
        prop_assert!(numbers.iter().all(|v| v.is_finite()) && s.fuel >= 0.0, "{s:?}");
        prop_assert!((0.0..=1.0).contains(&s.survival), "{s:?}");
    }
    for i in 0..flight.debris().len() {
        let d = flight.debris().body(i);
        prop_assert!([d.x, d.y, d.vx, d.vy].iter().all(|v| v.is_finite()), "{d:?}");
    }
    cells.clear();
    // Room for more bodies than there are.
    let bodies = flight.debris().len() + 7;
    cells.resize(SATELLITES * 6 + 5 * bodies, f32::NAN);
    flight.observe_into(cells, bodies);
    prop_assert!(cells.iter().all(|v| v.is_finite()));
    cells.clear();
    cells.resize(tracks.total(), f32::NAN);
    tracks.write(flight, cells);
    prop_assert!(cells.iter().all(|v| v.abs() <= LIMIT));
    for c in flight.conjunctions(true).into_iter().flatten() {
        prop_assert!((0.0..=LOOK_AHEAD as f64).contains(&c.time_to_closest_approach), "{c:?}");
        prop_assert!(c.miss_distance >= 0.0 && c.miss_distance.is_finite(), "{c:?}");
        prop_assert!(c.relative_speed >= 0.0 && c.relative_speed.is_finite(), "{c:?}");
        prop_assert!((0.0..=1.0).contains(&c.probability), "{c:?}");
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(160))]

    /// Every task under every law, legal extremes of params and layouts, any burns.
    #[test]
    fn extreme_episodes_have_no_strange_numbers(
        value in scenario(),
        plan in prop::collection::vec(burns(), 1..12),
        k in 0usize..10,
    ) {
        let scenario = match Scenario::from_json(&value) {
            Ok(scenario) => scenario,
            Err(error) => {
                // All that can be wrong with it: options that contradict each other, or a sum of squares that rounds
                // to just inside the Earth.
                let field = error.field();
                prop_assert!(field.starts_with("physics.") || error.to_string().contains("inside the Earth"), "{error}");
                return Ok(());
            }
        };
        let mut tracks = Tracks::new(k, 15).unwrap();
        let mut cells = Vec::new();
        if let Err(error) = Setup::read(scenario.recipe()).unwrap().start(&mut Seeded::new(scenario.seed())) {
            prop_assert!(error.to_string().contains("not fair"), "{error}");
            return Ok(());
        }
        let mut flight = flight(&scenario);
        let mut sum = 0.0;
        inspect(&flight, &mut tracks, &mut cells)?;
        for acts in plan.iter().cycle().take(200) {
            let agents: Vec<u32> = acts.iter().map(|b| b.0).collect();
            let values: Vec<f64> = acts.iter().flat_map(|b| [b.1, b.2]).collect();
            let before = flight.state_hash();
            let mut poisoned = values.clone();
            if let Some(first) = poisoned.first_mut() {
                *first = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY][acts.len() % 3];
                let refused = flight.step(JointAction { agents: &agents, values: &poisoned });
                prop_assert!(refused.is_err(), "{refused:?}");
                prop_assert_eq!(flight.state_hash(), before);
            }
            match flight.step(JointAction { agents: &agents, values: &values }) {
                Ok(stepped) => {
                    prop_assert!(stepped.reward.is_finite() && stepped.reward >= 0.0);
                    sum += stepped.reward;
                }
                Err(StepError::UnknownAgent { .. }) => {
                    prop_assert_eq!(flight.state_hash(), before);
                    flight.step(JointAction::HOLD).unwrap();
                    sum = flight.total();
                }
                Err(error) => prop_assert!(false, "{error}"),
            }
            inspect(&flight, &mut tracks, &mut cells)?;
            if flight.steps() % 8 == 1 || flight.done() {
                let seen = serde_json::to_value(flight.telemetry(0.0, true)).unwrap();
                prop_assert!(numbers_are_numbers(&seen), "{seen}");
            }
            if flight.done() {
                break;
            }
        }
        prop_assert!(flight.done() && sum == flight.total());
        let (range, flown) = (scenario.task().score_range(), flight.flown());
        prop_assert!(flown.score >= range.min && flown.score <= range.max, "{flown:?}");
        prop_assert!(flown.goal.is_none_or(|goal| (0.0..=1.0 + 1e-12).contains(&goal)), "{flown:?}");
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

    /// Whatever stands in a layout: a typed error that names a field, or a scenario that reads back the same.
    #[test]
    fn any_layout_is_taken_or_refused_by_field(layout in any_layout()) {
        let value = json!({"task": "kessler/survival", "params": {"debris": 2}, "layout": layout, "seed": 1});
        match Scenario::from_json(&value) {
            Ok(scenario) => prop_assert_eq!(Scenario::from_json(&scenario.to_json()).unwrap().id(), scenario.id()),
            Err(error) => prop_assert!(!error.field().is_empty() && error.to_string().len() < 400),
        }
    }
}
