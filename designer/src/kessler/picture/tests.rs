//! Pictures are well-formed, small, and say what they are of.

use std::sync::Arc;

use env_core::Recipe;
use serde_json::json;

use crate::picture::{Subject, draw};
use crate::procedural::Procedural;
use crate::{Brief, Gate, Profile, language};

#[test]
fn scratch() {
    for (i, (task, level, mode, sector, inertial)) in [
        ("kessler/survival", 4, "collision", 9, false),
        ("kessler/survival", 3, "collision", 3, true),
        ("kessler/eco_station", 3, "wasted_fuel", 3, false),
        ("kessler/rendezvous", 6, "rogue", 1, false),
        ("kessler/formation", 6, "collision", 1, false),
    ]
    .into_iter()
    .enumerate()
    {
        let task = env_core::task(task).unwrap();
        let recipe = Recipe::with_params(task, task.levels().params(level)).unwrap();
        let mut brief = Brief::new(Arc::new(recipe), 2, 3).at_level(task.levels(), level as u32);
        let cell = json!({"sector": sector, "band": 2, "count": 9, "weight": 9.0});
        let mode = if inertial {
            json!({"mode": mode, "count": 9, "weight": 9.0, "inertial": [{"sector": sector, "count": 9, "weight": 9.0}]})
        } else {
            json!({"mode": mode, "count": 9, "weight": 9.0, "cells": [cell]})
        };
        brief.profile =
            Profile::read(&json!({"task": task.id(), "criticised": 20, "modes": [mode]}).to_string(), None)
                .unwrap();
        let mut gate = Gate::new(language(task).unwrap(), Vec::new());
        let designed = Procedural::layouts(&brief, &mut gate);
        println!("{} {} of {}", task.id(), designed.admitted(), designed.judged.len());
        for (j, judged) in designed.judged.iter().filter(|j| j.verdict.is_ok()).enumerate() {
            let a = judged.verdict.as_ref().unwrap();
            let text = draw(Subject {
                name: &judged.name,
                design: judged.design.as_ref(),
                scenario: a.scenario(),
                bracket: a.bracket(),
            })
            .unwrap();
            println!("{}", text.len());
            std::fs::write(format!("/tmp/pic{i}{j}.svg"), text).unwrap();
        }
    }
}
