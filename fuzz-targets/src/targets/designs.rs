//! Designs of layouts: the design language, answers of language models, failure profiles, and files of layouts.

use std::path::Path;
use std::sync::{Arc, LazyLock};

use designer::fuzzing::extract_designs;
use designer::replay::parse_layouts;
use designer::{DesignBrief, DesignLanguage, FailureProfile, design_language};
use env_core::critique::PROFILE_SECTORS;
use env_core::{Recipe, SeedSpace};
use serde_json::{Value, json};

use crate::target::{Target, json_seeds, with_json, with_text};

pub(super) const TARGETS: &[Target] = &[
    Target::new("design", design, design_seeds),
    Target::new("design_docking", design_docking, docking_seeds),
    Target::new("design_tasking", design_tasking, tasking_seeds),
    Target::new("design_answer", design_answer, answer_seeds),
    Target::new("failure_profile", failure_profile, profile_seeds),
    Target::new("layout_file", layout_file, layout_seeds),
];

/// Largest number of designs that a test accepts of an answer.
const MAX_DESIGNS: usize = 3;

/// Language of a world, with a brief for one of its tasks.
struct BriefedLanguage {
    language: &'static dyn DesignLanguage,
    brief: DesignBrief,
}

impl BriefedLanguage {
    fn of(task: &str) -> Self {
        let task = env_core::task(task).expect("the task exists");
        let recipe = Recipe::at_level(task, 2).expect("the task has levels");
        let brief = DesignBrief::new(Arc::new(recipe), 1, 7).at_level(task.levels(), 2);
        Self { language: design_language(task).expect("the world can be designed for"), brief }
    }

    /// The canonical form of a design parses to itself.
    fn accepts(&self, bytes: &[u8]) -> bool {
        with_json(bytes, |value| {
            let Self { language, brief } = self;
            match language.parse(&value, brief) {
                Ok(canonical) => {
                    let again = language.parse(&canonical, brief).expect("a canonical design is valid");
                    assert_eq!(again, canonical, "the canonical form differs");
                    assert!(language.distance(&canonical, &canonical) == 0.0, "a design differs from itself");
                    true
                }
                Err(error) => {
                    let length = error.to_string().len();
                    assert!(length < 4096, "the error has {length} bytes");
                    false
                }
            }
        })
    }
}

/// Language of kessler, with a brief.
fn briefed_language() -> &'static BriefedLanguage {
    static BRIEFED: LazyLock<BriefedLanguage> = LazyLock::new(|| BriefedLanguage::of("kessler/survival"));
    &BRIEFED
}

/// Language of docking, with a brief.
fn docking_language() -> &'static BriefedLanguage {
    static BRIEFED: LazyLock<BriefedLanguage> = LazyLock::new(|| BriefedLanguage::of("docking/multiagent"));
    &BRIEFED
}

/// Language of tasking, with a brief.
fn tasking_language() -> &'static BriefedLanguage {
    static BRIEFED: LazyLock<BriefedLanguage> = LazyLock::new(|| BriefedLanguage::of("tasking/imaging"));
    &BRIEFED
}

fn design(bytes: &[u8]) -> bool {
    briefed_language().accepts(bytes)
}

fn design_docking(bytes: &[u8]) -> bool {
    docking_language().accepts(bytes)
}

fn design_tasking(bytes: &[u8]) -> bool {
    tasking_language().accepts(bytes)
}

/// An answer has at most as many designs as were requested.
fn design_answer(bytes: &[u8]) -> bool {
    with_text(bytes, |text| match extract_designs(text, briefed_language().language, MAX_DESIGNS) {
        Ok(found) => {
            assert!((1..=MAX_DESIGNS).contains(&found.designs.len()), "{} designs", found.designs.len());
            true
        }
        Err(reason) => {
            assert!(!reason.is_empty());
            false
        }
    })
}

/// A profile has valid weights and sectors, and is the same after it is written and parsed again.
fn failure_profile(bytes: &[u8]) -> bool {
    with_text(bytes, |text| {
        let _ = FailureProfile::parse(text, Some("kessler/survival"));
        let Ok(profile) = FailureProfile::parse(text, None) else { return false };
        for mode in &profile.modes {
            assert!(mode.weight >= 0.0 && mode.weight.is_finite(), "{}", mode.weight);
            let sectors = mode.cells.iter().filter_map(|cell| cell.sector);
            let sectors = sectors.chain(mode.inertial_sectors.iter().map(|weight| weight.sector));
            assert!(sectors.into_iter().all(|sector| sector < PROFILE_SECTORS), "a sector is out of range");
        }
        let written = serde_json::to_string(&profile).expect("a profile has a JSON form");
        assert_eq!(FailureProfile::parse(&written, None).ok(), Some(profile), "the written profile differs");
        true
    })
}

/// Layouts of a file have user seeds.
fn layout_file(bytes: &[u8]) -> bool {
    with_text(bytes, |text| match parse_layouts(Path::new("layouts.json"), text) {
        Ok(layouts) => {
            assert!(layouts.iter().all(|layout| layout.scenario.seed().space() == SeedSpace::User));
            true
        }
        Err(error) => {
            assert!(!error.to_string().is_empty());
            false
        }
    })
}

fn encounter() -> Value {
    json!({"satellite": 0, "step": 20, "bearing_deg": 90, "relative_speed": 100, "miss_distance": 0, "kind": "threat",
        "rogue": false})
}

fn designs() -> Vec<Value> {
    let BriefedLanguage { language, brief } = briefed_language();
    let modes = ["collision", "fuel"];
    let frames = ["radial", "inertial", "rtn"];
    let mut designs = Vec::new();
    for mode in modes {
        for frame in frames {
            let mut second = encounter();
            second["satellite"] = json!(1);
            second["step"] = json!(30);
            designs
                .push(json!({"name": "crossing", "aim": {"mode": mode, "bearing_deg": 90}, "frame": frame,
                "encounters": [encounter(), second]}));
        }
    }
    designs.retain(|design| language.parse(design, brief).is_ok());
    designs
}

fn design_seeds() -> Vec<Vec<u8>> {
    let seeds = json_seeds(designs());
    assert!(!seeds.is_empty(), "no design is valid");
    seeds
}

fn docking_seeds() -> Vec<Vec<u8>> {
    let deputy = |azimuth: u32, closing: i32| {
        json!({"distance": 900, "azimuth_deg": azimuth, "elevation_deg": -10, "closing_speed": closing, "cross_speed": 20,
               "cross_deg": 90})
    };
    let design = |mode: &str, deputies: &[Value]| json!({"name": "one", "aim": {"mode": mode, "bearing_deg": 190}, "params": {"time_limit_s": 1500}, "deputies": deputies});
    let BriefedLanguage { language, brief } = docking_language();
    let mut designs =
        vec![design("crash", &[deputy(10, 120)]), design("collision", &[deputy(80, 40), deputy(120, 40)])];
    designs.retain(|design| language.parse(design, brief).is_ok());
    assert_eq!(designs.len(), 2, "a design is invalid");
    json_seeds(designs)
}

fn tasking_seeds() -> Vec<Vec<u8>> {
    let start = json!({"day": 172, "utc_minute": 600, "node_hour": 11, "start_angle_deg": 0, "battery_percent": 70,
        "wheels_percent": 20, "storage_percent": 10});
    let field = json!({"satellite": 0, "minute": 20, "offset_km": -60, "spread_km": 150, "targets": 30,
        "priority_low": 10, "priority_high": 95});
    let design = |mode: &str, fields: &[Value]| {
        json!({"name": "crowded", "aim": {"mode": mode, "orbit_angle_deg": 74}, "start": start, "outages": [0, 4],
            "background": false, "fields": fields})
    };
    let BriefedLanguage { language, brief } = tasking_language();
    let mut designs = vec![design("low_value", std::slice::from_ref(&field)), design("power", &[])];
    designs.retain(|design| language.parse(design, brief).is_ok());
    assert_eq!(designs.len(), 2, "a design is invalid");
    json_seeds(designs)
}

fn answer_seeds() -> Vec<Vec<u8>> {
    let design = json!({"name": "a", "aim": {"mode": "collision"}, "encounters": [encounter()]});
    let mut seeds = json_seeds([json!({"layouts": [design, design]}), json!([design]), design.clone()]);
    seeds.push(
        format!("<think>{{\"aim\": 1}}</think>Here it is:\n```json\n{design}\n```\nDone {{").into_bytes(),
    );
    seeds
}

fn profile_seeds() -> Vec<Vec<u8>> {
    let profile = json!({"task": "kessler/survival", "criticised": 12, "weight": 3.5, "modes": [
        {"mode": "collision", "count": 4, "weight": 2.5,
            "cells": [{"sector": 0, "band": 1, "count": 2, "weight": 1.5, "avoidable_share": 0.5, "mean_steps_left": 3}],
            "inertial_sectors": [{"sector": 3, "count": 1, "weight": 0.5}]}]});
    json_seeds([json!({"tasks": [profile]}), profile])
}

fn layout_seeds() -> Vec<Vec<u8>> {
    let text = include_str!("../../../examples/layouts.json");
    let examples: Value = serde_json::from_str(text).expect("the examples are JSON");
    json_seeds([
        json!({"layouts": [examples["layouts"][0]]}),
        json!({"layouts": [{"name": "a", "scenario": {"task": "docking/single", "seed": 3}}]}),
    ])
}
