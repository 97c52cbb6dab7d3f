//! Tests of the subcommand's input, output and files.

use clap::Parser;
use env_core::Scenario;
use futures_util::future::LocalBoxFuture;
use serde_json::{Value, json};

use super::*;
use crate::api::StartedService;
use crate::output::OutputTarget;

#[derive(Debug, Parser)]
struct DesignCommand {
    #[command(flatten)]
    args: Args,
}

fn args(line: &[&str]) -> Args {
    DesignCommand::try_parse_from([&["design"], line].concat()).unwrap().args
}

/// The tests read no run.
fn no_service(_: PathBuf) -> LocalBoxFuture<'static, anyhow::Result<StartedService>> {
    Box::pin(async { Err(anyhow!("no service can be started")) })
}

fn fault(line: &[&str]) -> String {
    match DesignCommand::try_parse_from([&["design"], line].concat()) {
        Ok(line) => format!("{:#}", run(&line.args, no_service).unwrap_err()),
        Err(error) => error.to_string().lines().next().unwrap_or_default().to_owned(),
    }
}

fn file(text: &str) -> tempfile::NamedTempFile {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), text).unwrap();
    file
}

fn path(file: &tempfile::NamedTempFile) -> &str {
    file.path().to_str().unwrap()
}

/// Failure profiles of two tasks, as a service returns them; most failures belong to survival.
fn profiles() -> tempfile::NamedTempFile {
    let cell = |sector: u32, weight: f64| json!({"sector": sector, "band": 2, "count": 9, "weight": weight});
    file(
        &json!({"run": "r", "tasks": [
            {"task": "kessler/eco_station", "criticised": 50, "modes": [
                {"mode": "wasted_fuel", "count": 9, "weight": 8.5, "cells": [cell(3, 8.5)]}]},
            {"task": "kessler/survival", "criticised": 400, "weight": 390.0, "judge": null, "modes": [
                {"mode": "collision", "count": 40, "weight": 36.0, "cells": [cell(9, 32.0), cell(2, 4.0)],
                 "inertial_sectors": [{"sector": 3, "count": 20, "weight": 18.0}, {"sector": 7, "count": 20, "weight": 18.0}]},
                {"mode": "fuel_starvation", "count": 4, "weight": 4.0}, {"mode": "decay", "count": 0, "weight": 0.0}]},
        ]})
        .to_string(),
    )
}

/// Judges hand-written designs; some names hold terminal control characters.
fn outcome() -> DesignReport {
    let brief =
        build_brief(&args(&["--level", "4", "--param", "debris=12"]), &runtime().unwrap(), no_service)
            .unwrap();
    let mut gate = Gate::new(language_of(&brief).unwrap(), Vec::new());
    let met = |satellite: u32, step: u32, bearing_deg: u32, relative_speed: u32| {
        json!({"satellite": satellite, "step": step, "bearing_deg": bearing_deg, "relative_speed": relative_speed,
               "miss_distance": 5, "kind": "threat", "rogue": false})
    };
    let behind = json!([met(0, 12, 272, 30), met(1, 9, 265, 32), met(2, 16, 280, 28), met(0, 24, 270, 35)]);
    let ahead = json!([met(0, 7, 85, 80), met(1, 11, 95, 90), met(2, 14, 90, 70)]);
    let mut rows = Vec::new();
    for (name, bearing_deg, encounters) in [
        ("from behind", 270, behind.clone()),
        ("from ahead", 90, ahead),
        ("the same again", 270, behind),
        ("off\u{1b}[31m", 90, json!([met(0, 60, 90, 30)])),
    ] {
        let design = json!({"name": name, "aim": {"mode": "collision", "bearing_deg": bearing_deg}, "encounters": encounters});
        // Several base scenarios are tried, since the possible positions of bodies depend on the satellites.
        let verdict = gate.judge(&brief, &design, (0..32).map(|number| brief.base_scenario(number)));
        let (name, attempt) = (name.to_owned(), rows.len() as u64);
        let judged = designer::JudgedLayout { name, design: Some(design), attempt, round: 1, verdict };
        rows.push(LayoutResult::new("llm", "kessler/survival", judged));
    }
    let mut usage = designer::DesignUsage {
        model: Some("small".to_owned()),
        rounds: 3,
        ..designer::DesignUsage::default()
    };
    (usage.tokens_in, usage.tokens_out) = (1200, 340);
    let warnings = vec!["the model was asked again\u{1b}[2J: it answered in prose".to_owned()];
    DesignReport { designer: "llm", rows, usage, warnings, elapsed: Duration::from_millis(1234) }
}

fn text(outcome: &DesignReport) -> String {
    table::text_report(outcome).render(OutputTarget::Terminal(100))
}

#[test]
fn layouts_are_listed_with_their_encounters() {
    let mut outcome = outcome();
    let listed = text(&outcome);
    assert!(!listed.contains('\u{1b}'), "a name cannot reach into the terminal");
    insta::assert_snapshot!("layouts", listed);
    insta::assert_json_snapshot!("json", outcome.json(), { ".layouts[].scenario.layout.bodies" => "[bodies]" });
    let refused = outcome.rows.pop().unwrap();
    outcome.rows.clear();
    assert!(text(&outcome).starts_with("No layouts."));
    for _ in 0..15 {
        let verdict = refused.verdict.as_ref().map(|_| unreachable!("it was refused")).map_err(Clone::clone);
        let (name, scenario) = (String::new(), None);
        outcome.rows.push(LayoutResult {
            name,
            designer: "llm",
            task: refused.task,
            round: 1,
            design: None,
            scenario,
            verdict,
        });
    }
    assert!(text(&outcome).contains("3 more were refused"));
}

/// A written file is read, admitted and written again by `--layouts`, for every task with a designer.
#[test]
fn admitted_layouts_are_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let met = json!({"sector": 3, "band": 2, "count": 9, "weight": 9.0});
    for (task, level, mode) in [
        ("kessler/survival", "4", "collision"),
        ("kessler/survival", "2", "fuel_starvation"),
        ("kessler/eco_station", "3", "wasted_fuel"),
        ("kessler/rendezvous", "6", "rogue"),
        ("kessler/rendezvous", "3", "rogue"), // rogues come from level 4 on: its own param says none
        ("kessler/formation", "5", "collision"),
        ("docking/single", "5", "crash"),
        ("docking/multiagent", "4", "collision"),
    ] {
        let mode = json!({"mode": mode, "count": 9, "weight": 9.0, "cells": [met]});
        let profile = file(&json!({"task": task, "criticised": 20, "modes": [mode]}).to_string());
        let (out, again) = (at("out.json"), at("again.json"));
        let line = ["--profile", path(&profile), "--level", level, "--n", "3", "--out", &out];
        assert_eq!(run(&args(&line), no_service).unwrap(), ExitCode::SUCCESS, "{task}");
        let line = ["--layouts", &out, "--out", &again, "--json"];
        let outcome = design_layouts(&args(&line), no_service).unwrap();
        let refused: Vec<_> = outcome.rows.iter().filter_map(|row| row.verdict.as_ref().err()).collect();
        assert!(refused.is_empty() && outcome.rows.len() == 3, "{task}: {refused:?}");
        assert_eq!(run(&args(&line), no_service).unwrap(), ExitCode::SUCCESS);
        assert_eq!(std::fs::read(&out).unwrap(), std::fs::read(&again).unwrap(), "{task}");
        // The same profile and seed make the same layouts.
        let line = ["--profile", path(&profile), "--level", level, "--n", "3", "--out", &again];
        assert_eq!(run(&args(&line), no_service).unwrap(), ExitCode::SUCCESS);
        assert_eq!(std::fs::read(&out).unwrap(), std::fs::read(&again).unwrap(), "{task}");
    }
}

#[test]
fn pictures_are_written_with_an_index() {
    let folder = tempfile::tempdir().unwrap();
    let into = folder.path().join("new/pictures");
    let line = ["--n", "2", "--level", "4", "--svg", into.to_str().unwrap()];
    assert_eq!(run(&args(&line), no_service).unwrap(), ExitCode::SUCCESS);
    let mut files: Vec<_> = std::fs::read_dir(&into)
        .unwrap()
        .map(|file| file.unwrap().file_name().into_string().unwrap())
        .collect();
    files.sort();
    assert_eq!(files.len(), 3, "{files:?}");
    assert!(files[0].starts_with("01-collision") && files[1].starts_with("02-") && files[2] == "index.html");
    let index = std::fs::read_to_string(into.join("index.html")).unwrap();
    assert!(files[..2].iter().all(|file| index.contains(&format!("src=\"{file}\""))), "{index}");
}

#[test]
fn dry_run_prints_the_brief() {
    let profile = profiles();
    let line = ["--profile", path(&profile), "--level", "5", "--param", "fuel=7", "--n", "3", "--dry-run"];
    let args = args(&line);
    let mut brief = build_brief(&args, &runtime().unwrap(), no_service).unwrap();
    brief.mastery = Some(designer::brief::LevelMastery { n: 64, mean: 0.5, q10: 0.42, q90: 0.58 });
    let report = dry_run::text_report(&brief, language_of(&brief).unwrap());
    let text = report.render(OutputTarget::Terminal(100));
    // The designer's own tests cover the ideas.
    let (known, ideas) = text.split_once("first ideas").unwrap();
    insta::assert_snapshot!("dry_run", known);
    assert_eq!(
        ideas
            .lines()
            .filter(|line| line.contains("(radial/in-track)") || line.contains("(inertial)"))
            .count(),
        3
    );
    assert!(brief.param_choices.iter().all(|limit| limit.param != "fuel") && brief.param("fuel") == 7.0);
    assert_eq!(run(&args, no_service).unwrap(), ExitCode::SUCCESS);
}

#[test]
fn a_profile_decides_the_task_unless_one_is_named() {
    let profile = profiles();
    let brief = |line: &[&str]| build_brief(&args(line), &runtime().unwrap(), no_service).unwrap();
    let given = brief(&["--profile", path(&profile)]);
    assert_eq!(
        (given.recipe.task().id(), given.level, given.profile.criticised),
        ("kessler/survival", Some(3), 400)
    );
    let named = brief(&["--profile", path(&profile), "--task", "kessler/eco_station"]);
    assert_eq!((named.recipe.task().id(), named.profile.criticised), ("kessler/eco_station", 50));
    let blank = brief(&["--physics", "contact=swept"]);
    assert_eq!((blank.recipe.task().id(), blank.count, blank.seed), ("kessler/survival", 8, 0));
    assert_eq!(blank.recipe.to_json()["physics"]["contact"], "swept");
}

/// The exit code is 1 if one layout of a file is refused. Layouts without a design are judged as threats.
#[test]
fn files_of_any_world_pass_the_gate() {
    let scenario = |value: Value| Scenario::from_json(&value).unwrap().to_json();
    let docking = scenario(json!({"task": "docking/single", "params": {"start_radius": 50}, "seed": 4}));
    let empty = scenario(json!({"task": "kessler/survival", "params": {"debris": 0}, "seed": 5}));
    let entry = |name: &str, scenario: &Value| json!({"name": name, "scenario": scenario});
    let good = file(&json!({"layouts": [entry("dock", &docking)]}).to_string());
    assert_eq!(run(&args(&["--layouts", path(&good)]), no_service).unwrap(), ExitCode::SUCCESS);
    let both = file(&json!({"layouts": [entry("dock", &docking), entry("empty", &empty)]}).to_string());
    assert_eq!(run(&args(&["--layouts", path(&both), "--json"]), no_service).unwrap(), ExitCode::FAILURE);
    let outcome = design_layouts(&args(&["--layouts", path(&both)]), no_service).unwrap();
    assert_eq!(outcome.json()["summary"]["refused"], json!({"contested": 1}));
    let one =
        design_layouts(&args(&["--layouts", path(&both), "--task", "docking/single"]), no_service).unwrap();
    assert_eq!((one.rows.len(), one.admitted().count()), (1, 1));
}

#[test]
fn bad_input_is_one_sentence_that_names_the_flag() {
    let profile = profiles();
    let sane = path(&profile);
    let [empty, none] = ["{}", "{\"tasks\": []}"].map(file);
    let found = [
        fault(&["--designer", "llm"]),
        fault(&["--designer", "replay"]),
        fault(&["--designer", "procedural", "--layouts", "x.json"]),
        fault(&["--layouts", "/nowhere.json"]),
        fault(&["--profile", "/nowhere.json"]),
        fault(&["--profile", path(&empty)]).replace(path(&empty), "FILE"),
        fault(&["--profile", path(&none)]).replace(path(&none), "FILE"),
        fault(&["--profile", sane, "--task", "kessler/rendezvous"]).replace(sane, "FILE"),
        fault(&["--task", "kessler/golf"]),
        fault(&["--level", "10"]),
        fault(&["--param", "fuel=-1"]),
        fault(&["--param", "golf=1"]),
        fault(&["--param", "fuel"]),
        fault(&["--physics", "contact=hard"]),
        fault(&["--run", "../x"]),
        fault(&["--run", "x", "--url", "http://127.0.0.1:9"]),
        fault(&["--run", "x", "--profile", sane]),
        fault(&["--n", "0"]),
    ];
    insta::assert_snapshot!(found.join("\n"));
}
