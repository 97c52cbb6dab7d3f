//! Suites: what is built reads back, and nothing else does.

use std::sync::LazyLock;

use indicatif::ProgressBar;

use super::build::{SuitePlan, build};
use super::verify::differences;
use crate::options::{self, TaskOptions};
use evaluation::suite::file::{self, BuiltInSuite, LoadedSuite};
use evaluation::suite::{Suite, SuiteError, SuitePart};

/// A small suite of another world, with one level of a task of the first.
pub(crate) fn mixed() -> Suite {
    let plan = SuitePlan {
        name: "mixed".to_owned(),
        tasks: ["docking/single", "docking/multiagent", "kessler/survival"]
            .map(|id| env_core::task(id).unwrap())
            .to_vec(),
        levels: vec![2],
        contested: 2,
        as_they_come: 1,
        options: TaskOptions::new(),
    };
    build(&plan, &ProgressBar::hidden()).unwrap()
}

/// A small suite of three tasks, built once.
pub(crate) fn small() -> Suite {
    static SUITE: LazyLock<Suite> = LazyLock::new(fresh);
    SUITE.clone()
}

fn fresh() -> Suite {
    let tasks = ["kessler/survival", "kessler/eco_station", "kessler/rendezvous"];
    let plan = SuitePlan {
        name: "small".to_owned(),
        tasks: tasks.iter().map(|id| env_core::task(id).unwrap()).collect(),
        levels: vec![2, 6],
        contested: 3,
        as_they_come: 2,
        options: TaskOptions::new(),
    };
    build(&plan, &ProgressBar::hidden()).unwrap()
}

#[test]
fn a_suite_reads_back_and_builds_the_same_again() {
    let suite = small();
    assert_eq!(suite.entries().count(), 3 * 2 * 5);
    let text = file::write_suite(&suite).unwrap();
    let LoadedSuite { suite: again, hash } = file::parse_suite(text.as_bytes()).unwrap();
    assert_eq!(again, suite);
    assert_eq!(hash.len(), 64);
    assert_eq!(file::write_suite(&fresh()).unwrap(), text);
    assert_eq!(differences(&again, &ProgressBar::hidden()), Vec::<String>::new());
}

#[test]
fn a_suite_of_several_worlds_is_one_like_any_other() {
    let suite = mixed();
    let text = file::write_suite(&suite).unwrap();
    assert_eq!(file::parse_suite(text.as_bytes()).unwrap().suite, suite);
    assert_eq!(differences(&suite, &ProgressBar::hidden()), Vec::<String>::new());
    // Whatever an episode's length, a scenario is a line of 1 to 2 kB: no log is stored.
    assert!(text.len() < 9 * 2000 + 3000, "{} bytes for 9 scenarios", text.len());
}

#[test]
fn contested_scenarios_are_contested_and_seeds_are_held_out() {
    for entry in small().entries() {
        assert_eq!(entry.scenario.seed().space(), env_core::SeedSpace::Evaluation);
        let contested = env_core::admission::is_contested(&entry.scenario, &entry.bracket);
        assert!(contested || entry.part == SuitePart::AsTheyCome);
    }
}

/// Every byte counts: flipped, dropped or doubled anywhere, the file is refused.
#[test]
fn an_altered_byte_is_refused() {
    let mut suite = small();
    suite.groups.truncate(1);
    suite.groups[0].entries.truncate(1);
    let bytes = file::write_suite(&suite).unwrap().into_bytes();
    for at in 0..bytes.len() {
        let mut flipped = bytes.clone();
        flipped[at] ^= 1;
        assert!(file::parse_suite(&flipped).is_err(), "byte {at} flipped");
        let mut dropped = bytes.clone();
        dropped.remove(at);
        assert!(file::parse_suite(&dropped).is_err(), "byte {at} dropped");
    }
    let mut longer = bytes.clone();
    longer.push(b'\n');
    assert!(file::parse_suite(&longer).is_err());
    let mut changed = String::from_utf8(bytes).unwrap().replace("\"planner\":1", "\"planner\":2");
    assert!(matches!(file::parse_suite(changed.as_bytes()), Err(SuiteError::Altered { .. })));
    changed.truncate(300);
    assert!(matches!(file::parse_suite(changed.as_bytes()), Err(SuiteError::NotASuite { .. })));
}

/// With a right hash, what the file claims is still held against the worlds.
#[test]
fn a_forged_suite_is_refused() {
    let text = file::write_suite(&small()).unwrap();
    let seed = small().entries().next().unwrap().scenario.seed().get();
    let tell = |from: &str, to: &str| {
        file::parse_suite(rehashed(&text.replacen(from, to, 1)).as_bytes()).unwrap_err()
    };
    let seed = format!("\"seed\":{seed}");
    insta::assert_snapshot!([
        tell(&seed, "\"seed\":5"),
        tell(&seed, "\"seed\":6755399441055743"),
        tell(&seed, "\"seed\":9007199254740992"),
        tell("\"debris\":50.0", "\"debris\":51.0"),
        tell("\"debris\":50.0", "\"debris\":5000.0"),
        tell("{\"task\":\"kessler/survival\"", "{\"task\":\"kessler/eco_station\""),
        tell("sparring-suite/1", "sparring-suite/2"),
        tell("\"floor\":", "\"ceiling\":"),
    ].map(|error| error.to_string()).join("\n"), @r#"
    scenario 0 of kessler/survival level 2: seed 5 is not an evaluation seed
    scenario 0 of kessler/survival level 2: recipe and seed give other canonical bytes here
    scenario 0 of kessler/survival level 2: seed must be an integer from 0 to 2251799813685247 (larger seeds are reserved for training and evaluation), got 9007199254740992
    scenario 0 of kessler/survival level 2: recipe and seed give other canonical bytes here
    scenario 0 of kessler/survival level 2: params.debris must be from 0 to 1000, got 5000
    scenario 0 of kessler/eco_station level 2: its recipe belongs to kessler/survival
    its format is "sparring-suite/2"; this build reads "sparring-suite/1"
    it is not a suite file: unknown field `ceiling`, expected one of `part`, `seed`, `id`, `canonical`, `floor`, `reference`, `panel` at line 3 column 518
    "#);
}

#[test]
fn an_altered_bracket_is_found_by_verify() {
    let mut suite = small();
    let entry = &mut suite.groups[1].entries[2];
    entry.bracket.panel[3].score += 1e-15;
    let (id, floor) = (entry.scenario.id().to_string(), &mut suite.groups[4].entries[0].bracket.floor);
    *floor *= 0.5;
    let found = differences(&suite, &ProgressBar::hidden());
    assert_eq!(found.len(), 2);
    assert!(found[0].starts_with(&id), "{}", found[0]);
}

#[test]
fn built_in_suites_read_and_are_small_enough_to_commit() {
    assert!(file::BUILT_IN_SUITES.iter().any(|suite| suite.name == file::DEFAULT_SUITE));
    for BuiltInSuite { name, bytes } in file::BUILT_IN_SUITES {
        let suite = file::load_suite(name).unwrap().suite;
        assert_eq!(suite.name, *name);
        for group in &suite.groups {
            let contested = group.entries.iter().filter(|e| e.part == SuitePart::Contested).count();
            assert!(contested > 0 && contested < group.entries.len(), "{name}: both parts");
            let first = &group.entries[0];
            let here = first.scenario.task().bracket(&first.scenario).unwrap();
            assert_eq!(group.planner(), Some(here.planner_version), "{name}: {}", first.scenario.task().id());
        }
        assert!(bytes.len() < 1_500_000, "{name}");
        // Not always the same bytes: params and options that came later are written out at their defaults.
        let again = file::parse_suite(file::write_suite(&suite).unwrap().as_bytes()).unwrap().suite;
        assert!(again == suite, "{name}: what is written reads back");
    }
}

/// Committed once, a suite never changes: results on it would not compare.
#[test]
fn regress_built_in_suites_are_the_committed_ones() {
    let hashes = file::BUILT_IN_SUITES
        .iter()
        .map(|BuiltInSuite { name, .. }| format!("{name} {}", file::load_suite(name).unwrap().hash));
    insta::assert_snapshot!("built_in", hashes.collect::<Vec<_>>().join("\n"));
}

/// Levels are taken as far as every task has them, and worlds by their names.
#[test]
fn tasks_are_named_one_by_one_or_by_their_world() {
    let ids = |names: &[&str]| {
        let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
        super::build::tasks_by_name(&names)
            .map(|tasks| tasks.iter().map(|task| task.id()).collect::<Vec<_>>())
    };
    assert_eq!(ids(&["docking"]).unwrap(), ["docking/single", "docking/multiagent"]);
    let both = ["docking/multiagent", "docking", "kessler/survival"];
    assert_eq!(ids(&both).unwrap(), ["docking/multiagent", "docking/single", "kessler/survival"]);
    let error = ids(&["golf"]).unwrap_err().to_string();
    assert!(error.starts_with("\"golf\" is neither a task (kessler/survival, "), "{error}");
}

/// Tasks of several worlds have planners of their own.
#[test]
fn a_group_names_its_planner_where_it_is_not_the_suites() {
    let mut suite = small();
    suite.groups.truncate(2);
    suite.planner = 7;
    suite.groups[1].entries.iter_mut().for_each(|entry| entry.bracket.planner_version = 7);
    let text = file::write_suite(&suite).unwrap();
    let level = suite.groups[0].level;
    assert!(text.contains(&format!("\"level\":{level},\"planner\":1,\"recipe\"")), "{text}");
    assert_eq!(text.matches("\"planner\":7").count(), 1);
    assert_eq!(file::parse_suite(text.as_bytes()).unwrap().suite, suite);
}

#[test]
fn what_is_neither_a_name_nor_a_file_is_said_so() {
    let error = file::load_suite("kessler-heldout-v9").unwrap_err();
    assert_eq!(
        error.to_string(),
        format!("\"kessler-heldout-v9\" is neither a built-in suite ({}) nor a file", file::built_in_names())
    );
}

fn rehashed(text: &str) -> String {
    let end = text.rfind("\n\"hash\":").unwrap() + 1;
    let hash = blake3::hash(&text.as_bytes()[..end]).to_hex();
    format!("{}\"hash\":\"{hash}\"}}\n", &text[..end])
}

#[test]
fn a_suite_may_have_physics_of_its_own() {
    let tasks = ["kessler/survival", "kessler/formation"].map(|id| env_core::task(id).unwrap()).to_vec();
    let chosen = ["risk=pc", "kessler/formation:gravity=j2"].map(|text| options::parse(text).unwrap());
    let options = options::by_task(&chosen, &tasks).unwrap();
    let plan =
        SuitePlan { name: "own".to_owned(), tasks, levels: vec![3], contested: 2, as_they_come: 1, options };
    let suite = build(&plan, &ProgressBar::hidden()).unwrap();
    let told = "--physics kessler/formation:gravity=j2 --physics kessler/formation:risk=pc --physics kessler/survival:risk=pc";
    assert!(suite.created_by.ends_with(told), "{}", suite.created_by);
    for group in &suite.groups {
        let formation = group.recipe.task().id() == "kessler/formation";
        assert_eq!(group.recipe.option("risk"), Some("pc"));
        assert_eq!(group.recipe.option("gravity"), Some(if formation { "j2" } else { "point" }));
    }
    let text = file::write_suite(&suite).unwrap();
    assert_eq!(file::parse_suite(text.as_bytes()).unwrap().suite, suite);
    assert_eq!(differences(&suite, &ProgressBar::hidden()), Vec::<String>::new());
}
