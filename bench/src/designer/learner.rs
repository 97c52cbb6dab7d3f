//! The demo's learner with and without the designer, with equal seeds: results on the contested part of the held-out suite,
//! over all scenarios and on the worst tenth.
//!
//! Designed groups are no evidence, so that with the same number of episodes levels move later. A third arm therefore has as
//! many undesigned episodes as the first.

use std::process::{Command, Stdio};

use anyhow::{Context, ensure};
use env_core::admission::{SuccessRule, is_success};
use env_core::rollout::roll_out;
use evaluation::suite::{self, SuiteEntry, SuitePart};
use rayon::prelude::*;
use serde_json::Value;
use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::Row;

const SEEDS: u64 = 10;
const EPISODES: usize = 60_000;
/// Designer and number of episodes of each arm. The share of designed groups is 0.3.
const ARMS: [(&str, usize); 3] =
    [("off", EPISODES), ("procedural", EPISODES), ("procedural", EPISODES * 10 / 7)];
const SUITE: &str = "kessler-heldout-v2";
/// Share of scenarios that counts as the worst.
const WORST_SHARE: f64 = 0.1;

/// Results of one learner, averaged over its tasks.
#[derive(Debug, Clone, Copy, Default)]
struct LearnerResult {
    success: f64,
    skill: f64,
    /// Mean skill on the worst tenth of the scenarios (conditional value at risk).
    worst: f64,
    level: f64,
    /// Share of its groups that were designed.
    designed: f64,
}

/// Name of a result and the function that reads it.
type LearnerMeasure = (&'static str, fn(&LearnerResult) -> f64);

const MEASURES: [LearnerMeasure; 5] = [
    ("success on contested scenarios", |f| f.success),
    ("mean skill there", |f| f.skill),
    ("mean skill on the worst 10 % (CVaR)", |f| f.worst),
    ("level reached", |f| f.level),
    ("share of groups that were designed", |f| f.designed),
];

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    let suite = suite::file::load_suite(SUITE)?.suite;
    let contested: Vec<&SuiteEntry> =
        suite.entries().filter(|entry| entry.part == SuitePart::Contested).collect();
    let mut arms: [Vec<LearnerResult>; 3] = Default::default();
    for seed in 1..=SEEDS {
        for (arm, (designer, episodes)) in arms.iter_mut().zip(ARMS) {
            arm.push(evaluate_learner(&run_demo(seed, designer, episodes)?, &contested)?);
        }
    }
    let [without, with, more] = &arms;
    let rows = [(with, "with the designer"), (more, "with as many that are not designed")];
    let rows = rows.into_iter().flat_map(|(with, words)| {
        MEASURES.map(|(name, of)| {
            let values = |arm: &[LearnerResult]| arm.iter().map(of).collect::<Vec<f64>>();
            let (without, with) = (values(without), values(with));
            let gains: Vec<f64> = with.iter().zip(&without).map(|(with, without)| with - without).collect();
            Row {
                label: format!("{name}, {SEEDS} seeds × {EPISODES} episodes: without, {words}"),
                measured: format!("{}, {}", interval(&without), interval(&with)),
                goal: format!("by {}", interval(&gains)),
                ratio: None,
            }
        })
    });
    Ok(rows.collect())
}

/// Formats a mean with its 95 % interval over seeds (Student's t).
fn interval(values: &[f64]) -> String {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>() / (n - 1.0);
    let t = StudentsT::new(0.0, 1.0, n - 1.0).map_or(f64::NAN, |t| t.inverse_cdf(0.975));
    format!("{mean:.3} ± {:.3}", t * (variance / n).sqrt())
}

/// Runs `sparring demo` with this seed and returns its JSON output.
fn run_demo(seed: u64, designer: &str, episodes: usize) -> anyhow::Result<Value> {
    let (seed, episodes) = (seed.to_string(), episodes.to_string());
    let args =
        ["demo", "--temporary", "--json", "--seed", &seed, "--episodes", &episodes, "--designer", designer];
    let out = Command::new(system_tests::sparring_binary()).args(args).stderr(Stdio::null()).output()?;
    ensure!(out.status.success(), "the demo failed");
    Ok(serde_json::from_slice(&out.stdout)?)
}

/// Evaluates the learned reflexes task by task and averages over tasks.
fn evaluate_learner(demo: &Value, contested: &[&SuiteEntry]) -> anyhow::Result<LearnerResult> {
    let tasks = demo["tasks"].as_object().context("tasks")?;
    let mut sum = LearnerResult::default();
    for (id, task) in tasks {
        let numbers: Vec<f64> = serde_json::from_value(task["numbers"].clone())?;
        let entries: Vec<_> = contested.iter().filter(|entry| entry.scenario.task().id() == id).collect();
        let results = entries.par_iter().map(|entry| {
            let mut policy = (entry.scenario.task().reflex().policy)(&numbers);
            let outcome = roll_out(&entry.scenario, &mut *policy)?.outcome;
            let succeeded = is_success(&entry.scenario, SuccessRule::Task, &entry.bracket, &outcome);
            Ok((f64::from(u8::from(succeeded)), entry.bracket.skill(outcome.score).unwrap_or(0.0)))
        });
        let results: Vec<(f64, f64)> = results.collect::<anyhow::Result<_>>()?;
        ensure!(!results.is_empty(), "the suite has no contested scenario of {id}");
        let mut skills: Vec<f64> = results.iter().map(|(_, skill)| *skill).collect();
        skills.sort_by(f64::total_cmp);
        let tail = ((skills.len() as f64 * WORST_SHARE).ceil() as usize).max(1);
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        sum.success += mean(&results.iter().map(|(success, _)| *success).collect::<Vec<_>>());
        sum.skill += mean(&skills);
        sum.worst += mean(&skills[..tail]);
        sum.level += task["level"].as_f64().unwrap_or(0.0);
    }
    let n = tasks.len() as f64;
    let designed = demo["designed"].as_f64().unwrap_or(0.0);
    Ok(LearnerResult {
        success: sum.success / n,
        skill: sum.skill / n,
        worst: sum.worst / n,
        level: sum.level / n,
        designed,
    })
}
