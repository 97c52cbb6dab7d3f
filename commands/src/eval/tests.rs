//! Tests with policies whose results are known beforehand.

use super::*;
use crate::output::OutputTarget;
use crate::suite::tests::{mixed, small};
use env_core::policy_factory::BuiltInPolicy;
use evaluation::results::measure_episode;
use evaluation::suite::SuitePart;

fn flown(suite: &Suite, policy: &str, rollouts: u32) -> PolicyResults {
    let policy = BuiltInPolicy(policy.to_owned());
    roll_out_policy(suite, &policy, SuiteRolloutSettings { seed: 0, rollouts }, &|| ()).unwrap()
}

fn args(policies: &[&str]) -> Args {
    Args {
        suite: String::new(),
        policies: policies.iter().map(|&name| name.to_owned()).collect(),
        seed: 0,
        rollouts: 2,
        against: None,
        svg: None,
        options: Vec::new(),
        output: JsonFlag { json: true },
    }
}

#[test]
fn hold_earns_the_stored_hold_numbers_exactly() {
    let suite = small();
    let stored: Vec<_> =
        suite.entries().map(|entry| measure_episode(entry, &entry.bracket.panel[0])).collect();
    assert_eq!(flown(&suite, "hold", 1).scenario_means(), stored);
}

#[test]
fn reference_earns_its_stored_score_where_solvable() {
    let suite = small();
    let row = flown(&suite, "reference", 1);
    for (entry, measures) in suite.entries().zip(row.scenario_means()) {
        assert_eq!(measures, measure_episode(entry, &entry.bracket.reference));
        let solvable = env_core::admission::is_solvable(&entry.scenario, &entry.bracket);
        assert_eq!(measures.success, Some(f64::from(u8::from(solvable))));
    }
}

#[test]
fn chance_follows_the_seed_and_every_rollout_is_another() {
    let suite = small();
    let (once, twice) = (flown(&suite, "frozen", 1), flown(&suite, "frozen", 2));
    assert_eq!(once, flown(&suite, "frozen", 1));
    assert_ne!(once, twice);
    let settings = SuiteRolloutSettings { seed: 1, rollouts: 1 };
    let frozen = BuiltInPolicy("frozen".to_owned());
    assert_ne!(once, roll_out_policy(&suite, &frozen, settings, &|| ()).unwrap());
    assert_eq!(flown(&suite, "heuristic", 1), flown(&suite, "heuristic", 3));
}

#[test]
fn the_report_has_every_block_and_the_controls() {
    let suite = small();
    let args = args(&["hold", "hold", "reference"]);
    let rows = roll_out_policies(&suite, &args, &open_policies(&suite, &args).unwrap()).unwrap();
    let names: Vec<&str> = rows.iter().map(|row| row.policy.as_str()).collect();
    assert_eq!(names, ["hold", "reference", "frozen", "blind_panel"]);
    let report = build_report(&suite, "0123456789abcdef".repeat(4), &args, None, &rows);
    let value = serde_json::to_value(&report).unwrap();
    let told = value["rows"].as_array().unwrap();
    assert_eq!(told.len(), 4 * 3 * 4);
    let find = |task: &str, part: &str, policy: &str| {
        told.iter().find(|r| r["task"] == task && r["part"] == part && r["policy"] == policy).unwrap()
    };
    let best = find("all", "contested", "reference");
    assert_eq!(best["success"]["mean"], 1.0);
    assert_eq!(best["scenarios"], 18);
    let held = find("kessler/rendezvous", "contested", "hold");
    assert_eq!((&held["success"]["mean"], &held["fuel_used"]["high"]), (&0.0.into(), &0.0.into()));
    // The floor of survival is the panel's mean score: its skill is 0 but for plans cut off at −1.
    let panel = find("kessler/survival", "contested", "blind_panel");
    assert!((-1e-9..0.2).contains(&panel["skill"]["mean"].as_f64().unwrap()), "{panel}");
    // The other policies are compared with the first requested one.
    assert_eq!(value["against"], "hold");
    let against = value["comparisons"].as_array().unwrap();
    assert_eq!(against.len(), 4 * 3 * 3);
    let better =
        against.iter().find(|r| r["task"] == "all" && r["part"] == "contested" && r["policy"] == "reference");
    let better = better.unwrap();
    // Neither is better where both are perfect or both lose everything.
    assert!((0.8..=1.0).contains(&better["improvement"]["mean"].as_f64().unwrap()), "{better}");
    let gap = best["score"]["mean"].as_f64().unwrap()
        - find("all", "contested", "hold")["score"]["mean"].as_f64().unwrap();
    assert!((better["score"]["mean"].as_f64().unwrap() - gap).abs() < 1e-9, "{better}");
    // Two rollouts of a random policy are too few for its worst tenth.
    assert!(
        find("all", "all", "frozen")["cvar10"].is_null() && find("all", "all", "hold")["cvar10"].is_object()
    );
}

#[test]
fn no_mean_is_made_of_two_worlds() {
    let suite = mixed();
    let rows = [flown(&suite, "hold", 1)];
    let report = serde_json::to_value(build_report(&suite, "0".repeat(64), &args(&[]), None, &rows)).unwrap();
    let tasks: std::collections::BTreeSet<&str> =
        report["rows"].as_array().unwrap().iter().map(|row| row["task"].as_str().unwrap()).collect();
    assert!(!tasks.contains("all") && tasks.len() > 1, "{tasks:?}");
}

/// The rows depend on the planner alone, so a change of the learner does not affect them.
#[test]
fn the_tables_are_readable() {
    let suite = small();
    let rows = [flown(&suite, "hold", 1), flown(&suite, "reference", 1), PolicyResults::blind_panel(&suite)];
    let report =
        build_report(&suite, "0123456789abcdef".repeat(4), &args(&["hold", "reference"]), None, &rows);
    insta::assert_snapshot!("tables", tables::text_report(&report).render(OutputTarget::Terminal(120)));
    let drawn = picture::draw(&report).unwrap();
    assert!(
        drawn.starts_with("<svg") && drawn.contains("kessler/survival") && drawn.contains("blind_panel"),
        "{drawn}"
    );
}

#[test]
fn policies_are_those_of_every_world_in_the_suite() {
    let suite = mixed();
    let row = flown(&suite, "heuristic", 1);
    assert_eq!(row.episodes.len(), 9);
    let contested = suite.entries().zip(row.scenario_means()).filter(|(e, _)| e.part == SuitePart::Contested);
    let successes: f64 = contested.filter_map(|(_, measures)| measures.success).sum();
    assert!(successes >= 5.0, "the heuristics of both worlds are good at level 2: {successes} of 6");
    assert!(open_policies(&suite, &args(&["hold", "reference"])).is_ok());
    let error = open_policies(&suite, &args(&["hold", "golf"])).err().unwrap().to_string();
    assert!(error.contains("docking/single, which has no policy golf; it has hold, random"), "{error}");
}

#[test]
fn the_panel_is_the_mean_of_its_plans() {
    let suite = small();
    let row = PolicyResults::blind_panel(&suite);
    for (entry, measures) in suite.entries().zip(row.scenario_means()) {
        let scores: f64 = entry.bracket.panel.iter().map(|flown| flown.score).sum();
        assert!((measures.score.unwrap() - scores / 16.0).abs() < 1e-12);
        assert!(measures.lost.unwrap() <= 1.0);
    }
}

#[test]
fn other_physics_are_judged_by_brackets_of_their_own_and_say_so() {
    let suite = small();
    let chosen = |texts: &[&str]| texts.iter().map(|text| options::parse(text).unwrap()).collect::<Vec<_>>();
    let mut args = args(&["hold", "reference"]);
    args.options = chosen(&["contact=swept", "kessler/rendezvous:gravity=j2"]);
    let (flown, physics) = with_physics(suite.clone(), &args).unwrap();
    for (entry, own) in flown.entries().zip(suite.entries()) {
        assert_eq!((entry.part, entry.scenario.seed()), (own.part, own.scenario.seed()));
        let recipe = entry.scenario.recipe();
        let j2 = recipe.task().id() == "kessler/rendezvous";
        assert_eq!(recipe.option("contact"), Some("swept"));
        assert_eq!(recipe.option("gravity"), Some(if j2 { "j2" } else { "point" }));
        let bracket = recipe.task().bracket(&entry.scenario).unwrap();
        assert_eq!((&entry.bracket.panel, entry.bracket.floor), (&bracket.panel, bracket.floor));
    }
    let floors = |suite: &Suite| suite.entries().map(|entry| entry.bracket.floor).collect::<Vec<_>>();
    assert_ne!(floors(&flown), floors(&suite), "another physics is worth something else");
    let rows = [PolicyResults::blind_panel(&flown)];
    let report = build_report(&flown, "0123456789abcdef".repeat(4), &args, physics, &rows);
    let told = serde_json::to_value(&report).unwrap();
    assert_eq!(told["comparable"], false);
    assert_eq!(told["physics"]["kessler/rendezvous"]["gravity"], "j2");
    assert_eq!(told["physics"]["kessler/survival"].as_object().unwrap().len(), 1);
    assert_eq!(told["suite"], "small");
    let head: Vec<_> = tables::text_report(&report)
        .render(OutputTarget::Terminal(120))
        .lines()
        .take(8)
        .map(str::to_owned)
        .collect();
    insta::assert_snapshot!("other_physics", head.join("\n"));
}

#[test]
fn options_that_change_nothing_leave_a_report_comparable() {
    let suite = small();
    let mut args = args(&["hold"]);
    args.options = vec![options::parse("contact=end_of_step").unwrap()];
    let (flown, physics) = with_physics(suite.clone(), &args).unwrap();
    assert!(flown == suite && physics.is_none());
    let report = build_report(&flown, String::new(), &args, None, &[]);
    let told = serde_json::to_value(&report).unwrap();
    assert!(told["comparable"] == true && told["note"].is_null() && told["physics"] == serde_json::json!({}));
    args.options = vec![options::parse("compat=upstream").unwrap()];
    let error = format!("{:#}", with_physics(suite, &args).unwrap_err());
    assert!(error.contains("which only scenarios made by hand may have"), "{error}");
}
