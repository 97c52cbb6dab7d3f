//! Tests of pictures: well-formed, small, and with the right content.

use std::sync::Arc;

use env_core::{Bracket, Recipe, Scenario};
use roxmltree::Document;
use serde_json::{Value, json};

use crate::procedural::ProceduralDesigner;
use crate::{AdmittedLayout, DesignBrief, FailureProfile, Gate, LayoutView, design_language, draw_layout};

/// An admitted layout that aims at a failure mode.
struct Example {
    design: Value,
    layout: AdmittedLayout,
}

impl Example {
    fn new(task: &str, level: u32, mode: &str) -> Self {
        let task = env_core::task(task).unwrap();
        let recipe = Recipe::at_level(task, level as usize).unwrap();
        let mut brief = DesignBrief::new(Arc::new(recipe), 1, 3).at_level(task.levels(), level);
        let cell = json!({"sector": 3, "band": 2, "count": 9, "weight": 9.0});
        let mode = json!({"mode": mode, "count": 9, "weight": 9.0, "cells": [cell]});
        let profile = json!({"task": task.id(), "criticised": 20, "modes": [mode]}).to_string();
        brief.profile = FailureProfile::parse(&profile, None).unwrap();
        let mut gate = Gate::new(design_language(task).unwrap(), Vec::new());
        let outcome = ProceduralDesigner::design_layouts(&brief, &mut gate);
        let judged = outcome.judged.into_iter().find(|judged| judged.verdict.is_ok());
        let judged = judged.expect("one of 40 attempts passes");
        Self { design: judged.design.unwrap(), layout: judged.verdict.unwrap() }
    }

    fn draw(&self, name: &str) -> String {
        draw(name, Some(&self.design), self.layout.scenario(), self.layout.bracket())
    }
}

fn draw(name: &str, design: Option<&Value>, scenario: &Scenario, bracket: &Bracket) -> String {
    draw_layout(LayoutView { name, design, scenario, bracket }).unwrap()
}

/// A scenario in which a body touches a satellite at the start.
fn unfair_scenario() -> Scenario {
    let satellites = json!([[60, 0, 0, 4.08], [0, 60, -4.08, 0], [-60, 0, 0, -4.08]]);
    let scenario = json!({
        "task": "kessler/survival", "params": {"debris": 1}, "seed": 5,
        "layout": {"mode": "replace", "bodies": {"satellites": satellites, "debris": [[60, 1, 0, 4.08]]}},
    });
    Scenario::from_json(&scenario).unwrap()
}

/// Texts of a picture, in order.
fn texts<'a>(document: &'a Document<'_>) -> Vec<&'a str> {
    document
        .descendants()
        .filter(|node| node.tag_name().name() == "text")
        .filter_map(|node| node.text())
        .collect()
}

/// Largest number of decimals of any number in a text.
fn max_decimals(text: &str) -> usize {
    text.split('.')
        .skip(1)
        .map(|rest| rest.chars().take_while(char::is_ascii_digit).count())
        .max()
        .unwrap_or(0)
}

#[test]
fn pictures_are_well_formed_and_small() {
    for (task, level, mode, kind) in [
        ("kessler/survival", 4, "collision", "threat"),
        ("kessler/eco_station", 3, "wasted_fuel", "decoy"),
        ("kessler/rendezvous", 6, "rogue", "threat"),
        ("kessler/formation", 6, "collision", "threat"), // burns in every step
    ] {
        let example = Example::new(task, level, mode);
        let svg = example.draw("a layout");
        let document = Document::parse(&svg).unwrap();
        assert!(svg.len() < 60_000, "{task}: {} bytes", svg.len());
        let attributes = document.descendants().flat_map(|node| node.attributes());
        assert!(attributes.map(|attribute| max_decimals(attribute.value())).max() <= Some(2), "{task}");
        assert!(!svg.contains("NaN") && !svg.contains("inf "), "{task}");
        let texts = texts(&document);
        let bracket = example.layout.bracket();
        let (hold, reference) = (bracket.hold_score(), bracket.reference.score);
        let scores = format!("hold {hold:.3}, floor {:.3}, reference {reference:.3}", bracket.floor);
        for expected in ["a layout", kind, mode, &scores, "out, 0°", "LU"] {
            assert!(texts.iter().any(|text| text.contains(expected)), "{task}: {expected:?} in {texts:?}");
        }
        let encounters = example.design["encounters"].as_array().unwrap();
        let labels = texts.iter().filter(|text| text.contains(": step ")).count();
        assert_eq!(labels, encounters.len(), "{task}");
        assert_eq!(svg.matches("clipPath id=\"inset").count(), encounters.len().min(8), "{task}");
    }
}

/// The path of a threat ends in contact with its satellite; that of a decoy passes at its miss distance.
#[test]
fn paths_lead_to_their_encounters() {
    for (task, level, mode) in [
        ("kessler/survival", 5, "collision"),
        ("kessler/rendezvous", 6, "rogue"),
        ("kessler/eco_station", 3, "wasted_fuel"),
    ] {
        let Example { design, layout } = Example::new(task, level, mode);
        let view = LayoutView {
            name: "",
            design: Some(&design),
            scenario: layout.scenario(),
            bracket: layout.bracket(),
        };
        let scene = super::Scene::new(view).unwrap();
        assert!(!scene.passes.is_empty());
        for pass in &scene.passes {
            let satellite = scene.coast.satellite(pass.satellite(), pass.encounter.step);
            let body = pass.at(pass.encounter.step).unwrap();
            let distance = (satellite.x - body.x).hypot(satellite.y - body.y);
            let expected = f64::from(pass.encounter.miss_distance) / 10.0;
            // The path from the start has at most 48 steps, and reaches the encounter to within 1e-9.
            assert!((distance - expected).abs() < 1e-8, "{task}: {distance} {expected}");
        }
        let all = scene.passes.len() + scene.background.len();
        let rogues = scene.passes.iter().filter(|pass| pass.encounter.is_rogue).count();
        assert_eq!(all - rogues, layout.scenario().recipe().param("debris").unwrap() as usize, "{task}");
    }
}

#[test]
fn untrusted_name_is_escaped() {
    let mut example = Example::new("kessler/survival", 4, "collision");
    let name = "</text><script>alert(1)</script>&\"'";
    example.design["name"] = name.into();
    let svg = example.draw(name);
    let document = Document::parse(&svg).unwrap();
    assert!(document.descendants().all(|node| node.tag_name().name() != "script"));
    assert!(!svg.contains("<script"));
    assert!(texts(&document).contains(&name));
}

#[test]
fn hits_are_found_without_a_design() {
    let scenario = json!({
        "task": "kessler/survival", "params": {"debris": 0, "fuel": 20}, "seed": 5,
        "layout": {"mode": "extend", "bodies": {"debris": [[15, -85.9, 2.3, 4.4], [70, 70, -2.6, 2.6]]}},
    });
    let scenario = Scenario::from_json(&scenario).unwrap();
    let bracket = env_core::admission::admit(&scenario).bracket.unwrap();
    let svg = draw("by hand", None, &scenario, &bracket);
    let document = Document::parse(&svg).unwrap();
    let texts = texts(&document);
    assert!(texts.iter().any(|text| text.starts_with("without a design")), "{texts:?}");
    assert!(texts.contains(&"threat") && texts.contains(&"background debris: 1"), "{texts:?}");
}

#[test]
fn unplayable_layout_gives_a_message() {
    let Example { layout, .. } = Example::new("kessler/survival", 4, "collision");
    let invalid = json!({"encounters": [{"satellite": 9}]});
    Document::parse(&draw("", Some(&invalid), layout.scenario(), layout.bracket())).unwrap();
    let svg = draw("unfair", None, &unfair_scenario(), layout.bracket());
    let document = Document::parse(&svg).unwrap();
    assert!(texts(&document)[0].contains("cannot start"), "{svg}");
}
