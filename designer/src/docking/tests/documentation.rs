//! The tables of docs/reference/design-language-docking.md match the language.

use std::fmt::Write;

use super::*;
use crate::docking::DockingDesign;
use crate::docking::aim::AIMS;
use crate::docking::vocabulary::NUMBERS;
use crate::test_support::assert_documented;
use crate::{Bound, GateCheck};

const DOCUMENT: &str = include_str!("../../../../docs/reference/design-language-docking.md");

#[test]
fn documented_numbers_match_the_language() {
    let mut rows = String::new();
    for Bound { name, min, max, description, .. } in NUMBERS {
        let _ = writeln!(rows, "| `{name}` | {min} | {max} | {description} |");
    }
    assert_documented(DOCUMENT, "numbers", &rows);
}

#[test]
fn documented_aims_match_the_language() {
    let mut rows = String::new();
    for aim in AIMS {
        let _ = writeln!(rows, "| `{}` | {} |", aim.mode, aim.needs);
    }
    assert_documented(DOCUMENT, "aims", &rows);
}

/// Returns the refusal of a design in the first base scenario.
fn refusal(brief: &DesignBrief, design: &Value) -> crate::Refusal {
    empty_gate().judge(brief, design, [brief.base_scenario(0)]).unwrap_err()
}

#[test]
fn documented_refusals_are_those_of_the_gate() {
    let single = brief_at_level("docking/single", 5, 3);
    let team = brief_at_level("docking/multiagent", 5, 3);
    let one = |mode: &str, numbers: [i32; 6]| design(mode, &[deputy(numbers)]);
    let twins = [900, 900, 900].map(|distance| deputy([distance, 90, 0, 0, 0, 0]));
    let mut rows = String::new();
    for (check, refusal) in [
        (GateCheck::Schema, refusal(&single, &one("timeout", [15_000, 90, 0, 0, 0, 0]))),
        (GateCheck::Compiles, refusal(&team, &design("timeout", &twins))),
        (GateCheck::Aim, refusal(&single, &one("crash", [1000, 90, 0, 120, 0, 0]))),
        (GateCheck::Fair, refusal(&single, &one("crash", [100, 90, 0, 250, 0, 0]))),
        (GateCheck::Solvable, refusal(&single, &one("timeout", [10_000, 90, 0, -100, 0, 0]))),
    ] {
        assert_eq!(refusal.check(), check, "{refusal}");
        let _ = writeln!(rows, "| {} | *{refusal}* |", check.as_str());
    }
    assert_documented(DOCUMENT, "refusals", &rows);
}

#[test]
fn documented_example_is_admitted() {
    let (_, rest) = DOCUMENT.split_once("```json\n").unwrap();
    let (example, _) = rest.split_once("```").unwrap();
    let example: Value = serde_json::from_str(example).unwrap();
    assert_eq!(DockingDesign::from_json(&example).unwrap().deputies.len(), 3);
    let brief = brief_at_level("docking/multiagent", 4, 1);
    let admitted = empty_gate().judge(&brief, &example, [brief.base_scenario(0)]).unwrap();
    let file: Value = serde_json::from_str(include_str!("../../../../examples/layouts.json")).unwrap();
    let mut stored =
        file["layouts"].as_array().unwrap().iter().filter(|layout| layout["name"] == example["name"]);
    let drawn = stored.next().map(|layout| &layout["scenario"]);
    let scenario = admitted.scenario().to_json();
    assert_eq!(drawn, Some(&scenario), "examples/layouts.json, the layout that is drawn: {scenario}");
}
