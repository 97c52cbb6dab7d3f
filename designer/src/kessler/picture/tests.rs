//! Pictures are well-formed, small, and say what they are of.

use std::sync::Arc;

use env_core::{Bracket, Recipe, Scenario};
use roxmltree::Document;
use serde_json::{Value, json};

use crate::picture::{Subject, draw};
use crate::procedural::Procedural;
use crate::{Admitted, Brief, Gate, Profile, language};

/// An admitted layout of a task that goes for a mode, and its design.
fn admitted(task: &str, level: u32, mode: &str) -> (Value, Admitted) {
    let task = env_core::task(task).unwrap();
    let recipe = Recipe::with_params(task, task.levels().params(level as usize)).unwrap();
    let mut brief = Brief::new(Arc::new(recipe), 1, 3).at_level(task.levels(), level);
    let cell = json!({"sector": 3, "band": 2, "count": 9, "weight": 9.0});
    let mode = json!({"mode": mode, "count": 9, "weight": 9.0, "cells": [cell]});
    let profile = json!({"task": task.id(), "criticised": 20, "modes": [mode]}).to_string();
    brief.profile = Profile::read(&profile, None).unwrap();
    let mut gate = Gate::new(language(task).unwrap(), Vec::new());
    let judged = Procedural::layouts(&brief, &mut gate).judged.into_iter().find(|j| j.verdict.is_ok());
    let judged = judged.expect("one of 40 tries passes");
    (judged.design.unwrap(), judged.verdict.unwrap())
}

fn drawn(name: &str, design: Option<&Value>, scenario: &Scenario, bracket: &Bracket) -> String {
    draw(Subject { name, design, scenario, bracket }).unwrap()
}

/// Every text of a picture, in order.
fn texts<'a>(document: &'a Document<'_>) -> Vec<&'a str> {
    document
        .descendants()
        .filter(|node| node.tag_name().name() == "text")
        .filter_map(|node| node.text())
        .collect()
}

/// The longest run of decimals in any number.
fn decimals(text: &str) -> usize {
    text.split('.')
        .skip(1)
        .map(|rest| rest.chars().take_while(char::is_ascii_digit).count())
        .max()
        .unwrap_or(0)
}

#[test]
fn pictures_are_well_formed_and_small() {
    for (task, level, mode, claim) in [
        ("kessler/survival", 4, "collision", "threat"),
        ("kessler/eco_station", 3, "wasted_fuel", "decoy"),
        ("kessler/rendezvous", 6, "rogue", "threat"),
        ("kessler/formation", 6, "collision", "threat"), // burns in every step
    ] {
        let (design, layout) = admitted(task, level, mode);
        let text = drawn("a layout", Some(&design), layout.scenario(), layout.bracket());
        let document = Document::parse(&text).unwrap();
        assert!(text.len() < 60_000, "{task}: {} bytes", text.len());
        let attributes = document.descendants().flat_map(|node| node.attributes());
        assert!(attributes.map(|attribute| decimals(attribute.value())).max() <= Some(2), "{task}");
        assert!(!text.contains("NaN") && !text.contains("inf "), "{task}");
        let texts = texts(&document);
        let scores = format!(
            "hold {:.3} → reference {:.3}",
            layout.bracket().hold(),
            layout.bracket().reference.score
        );
        for told in ["a layout", claim, mode, &scores, "out, 0°", "LU"] {
            assert!(texts.iter().any(|text| text.contains(told)), "{task}: {told:?} in {texts:?}");
        }
        let encounters = design["encounters"].as_array().unwrap();
        let marks = texts.iter().filter(|text| text.contains(": step ")).count();
        assert_eq!(marks, encounters.len(), "{task}");
        assert_eq!(text.matches("clipPath id=\"inset").count(), encounters.len().min(8), "{task}");
    }
}

/// Each threat's path ends where its satellite is, in contact; each decoy's passes as near as it says.
#[test]
fn debris_is_drawn_to_where_it_meets() {
    for (task, level, mode) in [
        ("kessler/survival", 5, "collision"),
        ("kessler/rendezvous", 6, "rogue"),
        ("kessler/eco_station", 3, "wasted_fuel"),
    ] {
        let (design, layout) = admitted(task, level, mode);
        let subject = Subject {
            name: "",
            design: Some(&design),
            scenario: layout.scenario(),
            bracket: layout.bracket(),
        };
        let scene = super::Scene::of(subject).unwrap();
        assert!(!scene.passes.is_empty());
        for pass in &scene.passes {
            let of = scene.hold.at(pass.encounter.satellite as usize, pass.encounter.step);
            let at = pass.at(pass.encounter.step).unwrap();
            let distance = (of.x - at.x).hypot(of.y - at.y);
            let claimed = f64::from(pass.encounter.miss_distance) / 10.0;
            // The way there from the start: at most 48 steps close to 1e-9.
            assert!((distance - claimed).abs() < 1e-8, "{task}: {distance} {claimed}");
        }
        let all = scene.passes.len() + scene.background.len();
        let rogues = scene.passes.iter().filter(|pass| pass.encounter.rogue).count();
        assert_eq!(all - rogues, layout.scenario().recipe().param("debris").unwrap() as usize, "{task}");
    }
}

#[test]
fn strangers_names_are_words() {
    let (mut design, layout) = admitted("kessler/survival", 4, "collision");
    let name = "</text><script>alert(1)</script>&\"'";
    design["name"] = name.into();
    let text = drawn(name, Some(&design), layout.scenario(), layout.bracket());
    let document = Document::parse(&text).unwrap();
    assert!(
        document.descendants().all(|node| node.tag_name().name() != "script") && !text.contains("<script")
    );
    assert!(texts(&document).contains(&name));
}

#[test]
fn what_hits_is_found_where_there_is_no_design() {
    let scenario = json!({
        "task": "kessler/survival", "params": {"debris": 0, "fuel": 20}, "seed": 5,
        "layout": {"mode": "extend", "bodies": {"debris": [[15, -85.9, 2.3, 4.4], [70, 70, -2.6, 2.6]]}},
    });
    let scenario = Scenario::from_json(&scenario).unwrap();
    let bracket = crate::gate::threat(&scenario).unwrap();
    let text = drawn("by hand", None, &scenario, &bracket);
    let document = Document::parse(&text).unwrap();
    let texts = texts(&document);
    assert!(texts.iter().any(|text| text.starts_with("laid out by hand")), "{texts:?}");
    assert!(texts.contains(&"threat") && texts.contains(&"background: 1 pieces"), "{texts:?}");
}

/// What cannot be flown, and a design that is none, are no reason to fail.
#[test]
fn what_cannot_be_drawn_is_said() {
    let (_, layout) = admitted("kessler/survival", 4, "collision");
    let none = json!({"encounters": [{"satellite": 9}]});
    Document::parse(&drawn("", Some(&none), layout.scenario(), layout.bracket())).unwrap();
    // A body that touches at once: no fair start.
    let satellites = json!([[60, 0, 0, 4.08], [0, 60, -4.08, 0], [-60, 0, 0, -4.08]]);
    let unfair = json!({
        "task": "kessler/survival", "params": {"debris": 1}, "seed": 5,
        "layout": {"mode": "replace", "bodies": {"satellites": satellites, "debris": [[60, 1, 0, 4.08]]}},
    });
    let unfair = Scenario::from_json(&unfair).unwrap();
    let text = drawn("unfair", None, &unfair, layout.bracket());
    let document = Document::parse(&text).unwrap();
    assert!(texts(&document)[0].contains("cannot be flown"), "{text}");
    let docking = Scenario::from_json(&json!({"task": "docking/single", "seed": 1})).unwrap();
    assert_eq!(draw(Subject { name: "", design: None, scenario: &docking, bracket: layout.bracket() }), None);
}
