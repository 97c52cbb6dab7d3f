//! Fuzzing: any JSON is accepted or refused with the field at fault. Nothing panics, and nothing out of bounds is accepted.

use proptest::prelude::*;

use super::*;
use crate::tasking::TaskingDesign;
use crate::tasking::vocabulary::{FIELD_NUMBERS, START_NUMBERS};

/// Any small JSON value.
fn json_value() -> impl Strategy<Value = Value> {
    let leaf = prop_oneof![
        Just(Value::Null),
        any::<bool>().prop_map(Value::from),
        any::<i64>().prop_map(Value::from),
        (-700..1500i32).prop_map(Value::from),
        any::<f64>().prop_map(Value::from), // NaN becomes null
        ".{0,80}".prop_map(Value::from),
        prop::sample::select(vec!["power", "wheels", "duplicate", "full"]).prop_map(Value::from),
    ];
    leaf.prop_recursive(3, 24, 6, |inner| {
        prop_oneof![
            prop::collection::vec(inner.clone(), 0..6).prop_map(Value::from),
            prop::collection::btree_map("[a-z_]{1,12}", inner, 0..6).prop_map(|map| json!(map)),
        ]
    })
}

/// A valid design with one of its parts replaced.
fn corrupted_design() -> impl Strategy<Value = Value> {
    let mut pointers: Vec<String> = [
        "",
        "/name",
        "/aim",
        "/aim/mode",
        "/params",
        "/start",
        "/outages",
        "/background",
        "/fields",
        "/fields/0",
    ]
    .map(str::to_owned)
    .to_vec();
    pointers.extend(START_NUMBERS.iter().map(|number| format!("/start/{}", number.name)));
    pointers.extend(FIELD_NUMBERS.iter().map(|number| format!("/fields/1/{}", number.name)));
    (prop::sample::select(pointers), json_value()).prop_map(|(pointer, replacement)| {
        let mut design = design_json(IMAGING, "low_value");
        if let Some(part) = design.pointer_mut(&pointer) {
            *part = replacement;
        }
        design
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3000))]

    #[test]
    fn any_design_is_parsed_or_refused(design in prop_oneof![json_value(), corrupted_design()]) {
        let brief = brief_at_level(IMAGING, 2, 1);
        let language = empty_gate().language();
        match language.parse(&design, &brief) {
            Ok(canonical) => {
                prop_assert_eq!(language.parse(&canonical, &brief).unwrap(), canonical.clone());
                prop_assert_eq!(language.distance(&canonical, &canonical), 0.0);
                let parsed = TaskingDesign::from_json(&canonical).unwrap();
                prop_assert_eq!(parsed.to_json(), canonical);
                prop_assert!(parsed.name.chars().count() <= 60 && !parsed.name.chars().any(char::is_control));
            }
            Err(error) => prop_assert!(error.to_string().chars().count() < 700, "{error}"),
        }
    }
}

/// Designs within the bounds build or are refused by the compiler or the aim, whatever the level.
#[test]
fn any_bounded_design_is_built_or_refused() {
    let language = empty_gate().language();
    let mut rng = env_core::KeyedRng::new(env_core::keyed_rng::RngPurpose::Design, 7, 7);
    let mut built = 0;
    for number in 0..60 {
        let task = TASKS[number % 3];
        let brief = brief_at_level(task, (number % 10) as u32, 3);
        let mut design = design_json(task, "wheels");
        let mut fill = |part: &mut Value, numbers: &[crate::Bound<i32>]| {
            for bound in numbers {
                part[bound.name] = json!(bound.min + rng.below((bound.max - bound.min + 1) as u32) as i32);
            }
        };
        fill(&mut design["start"], &START_NUMBERS);
        for field in design["fields"].as_array_mut().unwrap() {
            fill(field, &FIELD_NUMBERS);
        }
        let Ok(parsed) = language.parse(&design, &brief) else { continue };
        match language.build(&parsed, &brief.base_scenario(0)) {
            Ok(_) => built += 1,
            Err(refusal) => assert!(["compiles", "aim"].contains(&refusal.check().as_str()), "{refusal}"),
        }
    }
    assert!(built > 0);
}
