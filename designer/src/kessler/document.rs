//! What docs/designer.md says of the language is what the language is: its tables are these.

use std::fmt::Write;

use env_core::kessler::bearing::Frame;
use env_core::{Recipe, Scenario};
use serde_json::{Value, json};

use super::claim::AIMS;
use super::language::{BEARING, Bound, FRAMES, KINDS, MISS, SATELLITE, SPEED, STEP};
use super::{Design, Encounter};
use crate::gate::CHECKS;
use crate::{Brief, Gate, Refusal, language};

const DOCUMENT: &str = include_str!("../../../docs/designer.md");

/// That the document has these rows between its marks.
fn holds(mark: &str, rows: &str) {
    let (_, rest) = DOCUMENT.split_once(&format!("<!-- {mark} -->\n")).expect("the mark is there");
    let (table, _) = rest.split_once("<!-- end -->").expect("and its end");
    let body = table.lines().skip(2).collect::<Vec<_>>().join("\n");
    assert_eq!(body.trim(), rows.trim(), "docs/designer.md, {mark}: put these rows there:\n{rows}");
}

#[test]
fn the_limits_are_those_of_the_language() {
    let mut rows = String::new();
    for Bound { name, min, max, scale, unit, about } in [SATELLITE, STEP, BEARING, SPEED, MISS] {
        let unit = match (unit, scale < 1.0) {
            ("", _) => String::new(),
            (unit, true) => format!("{scale} {unit}"),
            (unit, false) => unit.to_owned(),
        };
        let _ = writeln!(rows, "| `{name}` | {min} | {max} | {unit} | {about} |");
    }
    holds("limits", &rows);
}

#[test]
fn kinds_frames_and_aims_are_those_of_the_language() {
    let mut rows = String::new();
    for (_, word, min, max, about) in KINDS {
        let _ = writeln!(rows, "| `{word}` | {min} to {max} | {about} |");
    }
    holds("kinds", &rows);
    rows.clear();
    for (word, _, about) in FRAMES {
        let _ = writeln!(rows, "| `{word}` | {about} |");
    }
    holds("frames", &rows);
    rows.clear();
    for (mode, _, _, takes) in AIMS {
        let _ = writeln!(rows, "| `{mode}` | {takes} |");
    }
    holds("aims", &rows);
}

fn brief(task: &str, params: &[(&str, f64)]) -> Brief {
    let task = env_core::task(task).unwrap();
    Brief::new(std::sync::Arc::new(Recipe::with_params(task, params.iter().copied()).unwrap()), 1, 0)
}

/// An encounter: satellite, step, bearing, speed, miss distance, kind.
fn met(numbers: [u32; 5], kind: &str) -> Value {
    let [satellite, step, bearing_deg, relative_speed, miss_distance] = numbers;
    json!({"satellite": satellite, "step": step, "bearing_deg": bearing_deg, "relative_speed": relative_speed,
           "miss_distance": miss_distance, "kind": kind, "rogue": false})
}

fn design(mode: &str, bearing_deg: u32, encounters: &[Value]) -> Value {
    json!({"name": "one", "aim": {"mode": mode, "bearing_deg": bearing_deg}, "encounters": encounters})
}

/// What the gate says of a design under the first sky in which it is this check that refuses.
fn refusal(gate: &mut Gate, check: &str, brief: &Brief, design: &Value) -> Refusal {
    let told = (0..60).find_map(|number| {
        // An archive of its own: what is let through by the way is not known to the next.
        let mut alone = Gate::new(gate.language(), Vec::new());
        let gate = if check == "new" { &mut *gate } else { &mut alone };
        gate.judge(brief, design, [brief.sky(number)]).err().filter(|refusal| refusal.check() == check)
    });
    told.unwrap_or_else(|| panic!("no sky in which {check} refuses {design}"))
}

/// A refusal by each check, as the document tells them.
fn refusals() -> Vec<Refusal> {
    let (survival, eco) = ("kessler/survival", "kessler/eco_station");
    let mut gate = Gate::new(language(env_core::task(survival).unwrap()).unwrap(), Vec::new());
    let plain = brief(survival, &[("debris", 12.0), ("fuel", 20.0)]);
    let starved = brief(survival, &[("debris", 12.0), ("fuel", 0.1)]);
    let station = brief(eco, &[("debris", 12.0), ("fuel", 20.0)]);
    let one = [met([0, 12, 272, 30, 5], "threat")];
    let three = [one[0].clone(), met([1, 9, 265, 32, 5], "threat"), met([2, 16, 280, 28, 5], "threat")];
    let behind = design("collision", 270, &three);
    gate.judge(&plain, &behind, (0..24).map(|number| plain.sky(number))).expect("one of the skies takes it");
    let mut told = |check, brief: &Brief, design: &Value| refusal(&mut gate, check, brief, design);
    let mut all = vec![
        told("schema", &plain, &design("collision", 90, &[met([0, 60, 90, 30, 0], "threat")])),
        told("compiles", &plain, &design("collision", 0, &[met([0, 40, 0, 120, 0], "threat")])),
        told("aim", &plain, &design("collision", 90, &one)),
        told("solvable", &starved, &behind),
        told("contested", &plain, &design("collision", 272, &[met([0, 20, 272, 40, 5], "threat")])),
        told("decoy", &station, &design("wasted_fuel", 90, &[met([0, 12, 90, 60, 80], "decoy")])),
        told("new", &plain, &behind),
    ];
    // The compiler builds nothing that is not fair; whoever lays out by hand can.
    let satellites = json!([[60, 0, 0, 4.08], [0, 60, -4.08, 0], [-60, 0, 0, -4.08]]);
    let unfair = json!({
        "task": survival, "params": {"debris": 1}, "seed": 5,
        "layout": {"mode": "replace", "bodies": {"satellites": satellites, "debris": [[60, 1, 0, 4.08]]}},
    });
    all.push(gate.judge_scenario(&Scenario::from_json(&unfair).unwrap()).unwrap_err());
    all
}

#[test]
fn every_check_is_explained() {
    let refusals = refusals();
    let mut rows = String::new();
    for (check, passes) in CHECKS {
        let example = refusals.iter().find(|refusal| refusal.check() == check);
        let example = example.unwrap_or_else(|| panic!("no example of {check}"));
        let _ = writeln!(rows, "| {check} | {passes} | *{example}* |");
    }
    holds("checks", &rows);
}

/// The design that the document shows, compiled: it is one.
#[test]
fn the_documents_example_is_a_design() {
    let (_, rest) = DOCUMENT.split_once("```json\n").unwrap();
    let (example, _) = rest.split_once("```").unwrap();
    let design = Design::from_json(&serde_json::from_str(example).unwrap()).unwrap();
    assert_eq!((design.frame, design.encounters.len()), (Frame::RadialInTrack, 3));
    let file: Value = serde_json::from_str(include_str!("../../../examples/layouts.json")).unwrap();
    let stored = &file["layouts"][1]["scenario"]["layout"]["provenance"];
    let encounters = design.encounters.iter().map(Encounter::to_json).collect::<Vec<_>>();
    assert_eq!(stored["encounters"], json!(encounters), "it is the one that is drawn");
}
