//! The tables of docs/reference/design-language.md match the language and the gate.

use std::fmt::Write;
use std::sync::Arc;

use env_core::kessler::bearing::BearingFrame;
use env_core::{Recipe, Scenario};
use serde_json::{Value, json};

use super::{Design, Encounter};
use crate::kessler::aim::AIMS;
use crate::kessler::vocabulary::{BEARING, FRAMES, KINDS, KindSpec, MISS, SATELLITE, SPEED, STEP};
use crate::test_support::assert_documented;
use crate::{Bound, DesignBrief, Gate, GateCheck, Refusal, design_language};

const DOCUMENT: &str = include_str!("../../../../docs/reference/design-language.md");

const SURVIVAL: &str = "kessler/survival";
const ECO_STATION: &str = "kessler/eco_station";

#[test]
fn documented_bounds_match_the_language() {
    let mut rows = String::new();
    for Bound { name, min, max, per_unit, unit, description } in [SATELLITE, STEP, BEARING, SPEED, MISS] {
        let unit = match (unit, per_unit > 1.0) {
            ("", _) => String::new(),
            (unit, true) => format!("{} {unit}", 1.0 / per_unit),
            (unit, false) => unit.to_owned(),
        };
        let _ = writeln!(rows, "| `{name}` | {min} | {max} | {unit} | {description} |");
    }
    assert_documented(DOCUMENT, "limits", &rows);
}

#[test]
fn documented_kinds_match_the_language() {
    let mut rows = String::new();
    for KindSpec { name, min_miss, max_miss, description, .. } in KINDS {
        let _ = writeln!(rows, "| `{name}` | {min_miss} to {max_miss} | {description} |");
    }
    assert_documented(DOCUMENT, "kinds", &rows);
}

#[test]
fn documented_frames_match_the_language() {
    let mut rows = String::new();
    for frame in FRAMES {
        let _ = writeln!(rows, "| `{}` | {} |", frame.name, frame.description);
    }
    assert_documented(DOCUMENT, "frames", &rows);
}

#[test]
fn documented_aims_match_the_language() {
    let mut rows = String::new();
    for aim in AIMS {
        let _ = writeln!(rows, "| `{}` | {} |", aim.mode, aim.needs);
    }
    assert_documented(DOCUMENT, "aims", &rows);
}

fn brief(task: &str, params: &[(&str, f64)]) -> DesignBrief {
    let task = env_core::task(task).unwrap();
    DesignBrief::new(Arc::new(Recipe::with_params(task, params.iter().copied()).unwrap()), 1, 0)
}

/// JSON of an encounter with satellite, step, bearing, speed and miss distance.
fn encounter_json(numbers: [u32; 5], kind: &str) -> Value {
    let [satellite, step, bearing_deg, relative_speed, miss_distance] = numbers;
    json!({"satellite": satellite, "step": step, "bearing_deg": bearing_deg, "relative_speed": relative_speed,
           "miss_distance": miss_distance, "kind": kind, "rogue": false})
}

fn design_json(mode: &str, bearing_deg: u32, encounters: &[Value]) -> Value {
    json!({"name": "one", "aim": {"mode": mode, "bearing_deg": bearing_deg}, "encounters": encounters})
}

/// Returns the refusal of a design in the first base scenario in which this check refuses it.
fn refusal_by(gate: &mut Gate, check: GateCheck, brief: &DesignBrief, design: &Value) -> Refusal {
    let refusal = (0..60).find_map(|number| {
        // A gate of its own: a design that is admitted in passing must not enter the archive.
        let mut fresh = Gate::new(gate.language(), Vec::new());
        let gate = if check == GateCheck::New { &mut *gate } else { &mut fresh };
        let verdict = gate.judge(brief, design, [brief.base_scenario(number)]);
        verdict.err().filter(|refusal| refusal.check() == check)
    });
    refusal.unwrap_or_else(|| panic!("no base scenario in which {check:?} refuses {design}"))
}

/// Returns a refusal by each check, as in the document.
fn example_refusals() -> Vec<Refusal> {
    let mut gate = Gate::new(design_language(env_core::task(SURVIVAL).unwrap()).unwrap(), Vec::new());
    let survival = brief(SURVIVAL, &[("debris", 12.0), ("fuel", 20.0)]);
    let without_fuel = brief(SURVIVAL, &[("debris", 12.0), ("fuel", 0.1)]);
    let station = brief(ECO_STATION, &[("debris", 12.0), ("fuel", 20.0)]);
    let one = [encounter_json([0, 12, 272, 30, 5], "threat")];
    let three = [
        one[0].clone(),
        encounter_json([1, 9, 265, 32, 5], "threat"),
        encounter_json([2, 16, 280, 28, 5], "threat"),
    ];
    let behind = design_json("collision", 270, &three);
    let bases = (0..24).map(|number| survival.base_scenario(number));
    gate.judge(&survival, &behind, bases).expect("admitted in one of the base scenarios");
    let late = design_json("collision", 90, &[encounter_json([0, 60, 90, 30, 0], "threat")]);
    let far = design_json("collision", 0, &[encounter_json([0, 40, 0, 120, 0], "threat")]);
    let single = design_json("collision", 272, &[encounter_json([0, 20, 272, 40, 5], "threat")]);
    let distant = design_json("wasted_fuel", 90, &[encounter_json([0, 12, 90, 60, 80], "decoy")]);
    let mut example =
        |check, brief: &DesignBrief, design: &Value| refusal_by(&mut gate, check, brief, design);
    let mut refusals = vec![
        example(GateCheck::Schema, &survival, &late),
        example(GateCheck::Compiles, &survival, &far),
        example(GateCheck::Aim, &survival, &design_json("collision", 90, &one)),
        example(GateCheck::Solvable, &without_fuel, &behind),
        example(GateCheck::Contested, &survival, &single),
        example(GateCheck::Decoy, &station, &distant),
        example(GateCheck::New, &survival, &behind),
    ];
    // The compiler builds only fair layouts; a layout by hand may be unfair.
    let satellites = json!([[60, 0, 0, 4.08], [0, 60, -4.08, 0], [-60, 0, 0, -4.08]]);
    let unfair = json!({
        "task": SURVIVAL, "params": {"debris": 1}, "seed": 5,
        "layout": {"mode": "replace", "bodies": {"satellites": satellites, "debris": [[60, 1, 0, 4.08]]}},
    });
    refusals.push(gate.judge_scenario(&Scenario::from_json(&unfair).unwrap()).unwrap_err());
    refusals
}

#[test]
fn documented_checks_match_the_gate() {
    let refusals = example_refusals();
    let mut rows = String::new();
    for check in GateCheck::ALL {
        let example = refusals.iter().find(|refusal| refusal.check() == check);
        let example = example.unwrap_or_else(|| panic!("no example of {check:?}"));
        let _ = writeln!(rows, "| {} | {} | *{example}* |", check.as_str(), check.description());
    }
    assert_documented(DOCUMENT, "checks", &rows);
}

#[test]
fn documented_example_is_a_valid_design() {
    let (_, rest) = DOCUMENT.split_once("```json\n").unwrap();
    let (example, _) = rest.split_once("```").unwrap();
    let design = Design::from_json(&serde_json::from_str(example).unwrap()).unwrap();
    assert_eq!((design.frame, design.encounters.len()), (BearingFrame::RadialInTrack, 3));
    let file: Value = serde_json::from_str(include_str!("../../../../examples/layouts.json")).unwrap();
    let stored = &file["layouts"][1]["scenario"]["layout"]["provenance"];
    let encounters = design.encounters.iter().map(Encounter::to_json).collect::<Vec<_>>();
    assert_eq!(stored["encounters"], json!(encounters), "it is the layout that is drawn");
}
