//! The tables of docs/reference/design-language-tasking.md match the language.

use std::fmt::Write;

use super::*;
use crate::Bound;
use crate::tasking::TaskingDesign;
use crate::tasking::aim::AIMS;
use crate::tasking::vocabulary::{AIM_ANGLE, FIELD_NUMBERS, START_NUMBERS};
use crate::test_support::assert_documented;

const DOCUMENT: &str = include_str!("../../../../docs/reference/design-language-tasking.md");

fn rows_of(numbers: &[Bound<i32>]) -> String {
    let mut rows = String::new();
    for Bound { name, min, max, description, .. } in numbers {
        let _ = writeln!(rows, "| `{name}` | {min} | {max} | {description} |");
    }
    rows
}

#[test]
fn documented_numbers_match_the_language() {
    assert_documented(DOCUMENT, "start", &rows_of(&START_NUMBERS));
    assert_documented(DOCUMENT, "fields", &rows_of(&FIELD_NUMBERS));
    assert_documented(DOCUMENT, "aim", &rows_of(&[AIM_ANGLE]));
}

#[test]
fn documented_aims_match_the_language() {
    let mut rows = String::new();
    for aim in AIMS {
        let _ = writeln!(rows, "| `{}` | {} |", aim.mode, aim.needs);
    }
    assert_documented(DOCUMENT, "aims", &rows);
}

#[test]
fn documented_example_is_a_valid_design() {
    let (_, rest) = DOCUMENT.split_once("```json\n").unwrap();
    let (example, _) = rest.split_once("```").unwrap();
    let example: Value = serde_json::from_str(example).unwrap();
    let design = TaskingDesign::from_json(&example).unwrap();
    assert_eq!(design.to_json(), example, "the example is in the canonical form");
    let brief = brief_at_level(IMAGING, 3, 1);
    empty_gate().language().build(&example, &brief.base_scenario(0)).expect("the example matches its aim");
}

/// All texts of the prompt are in the terms of the language.
#[test]
fn rules_name_every_field() {
    for task in TASKS {
        let brief = brief_at_level(task, 4, 1);
        let language = empty_gate().language();
        let (rules, schema) = (language.rules(&brief), language.schema(&brief).to_string());
        for number in START_NUMBERS.iter().chain(FIELD_NUMBERS.iter().filter(|_| task != SCANNING)) {
            assert!(rules.contains(&format!("- {}: ", number.name)), "{task}: {}", number.name);
            assert!(schema.contains(&format!("\"{}\"", number.name)), "{task}: {}", number.name);
        }
        assert_eq!(rules.contains("fields of targets"), task != SCANNING);
    }
}
