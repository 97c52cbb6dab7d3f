//! The demo's learner with and without the designer, the same episodes and seeds: how it does on the contested part of the
//! held-out suite, over all of it and on the worst tenth. Printed whatever it shows. Designed groups move no level, so that
//! with them the same episodes are less evidence: a third arm has as many episodes that are not designed as the first.

use std::process::{Command, Stdio};

use anyhow::{Context, ensure};
use env_core::bracket::{SuccessRule, success};
use env_core::rollout::fly;
use orchestrator::evaluation::suite::{self, Entry, Part};
use rayon::prelude::*;
use serde_json::Value;
use statrs::distribution::{ContinuousCDF, StudentsT};

use crate::Row;

const SEEDS: u64 = 10;
const EPISODES: usize = 60_000;
/// Who designs, and for how many episodes. A run's share of designed groups is 0.3.
const ARMS: [(&str, usize); 3] =
    [("off", EPISODES), ("procedural", EPISODES), ("procedural", EPISODES * 10 / 7)];
const SUITE: &str = "kessler-heldout-v2";
/// The share of scenarios that the worst are.
const WORST: f64 = 0.1;

/// What one learner came to, the mean of its tasks.
#[derive(Debug, Clone, Copy, Default)]
struct Fared {
    success: f64,
    skill: f64,
    /// Mean skill on the worst tenth of the scenarios (conditional value at risk).
    worst: f64,
    level: f64,
    /// The share of its groups that were designed.
    designed: f64,
}

/// A name, and which number of a learner it stands for.
type Measure = (&'static str, fn(&Fared) -> f64);

const MEASURES: [Measure; 5] = [
    ("success on contested scenarios", |f| f.success),
    ("mean skill there", |f| f.skill),
    ("mean skill on the worst 10 % (CVaR)", |f| f.worst),
    ("level reached", |f| f.level),
    ("share of groups that were designed", |f| f.designed),
];

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    let (suite, _) = suite::file::open(SUITE)?;
    let contested: Vec<&Entry> = suite.entries().filter(|entry| entry.part == Part::Contested).collect();
    let mut arms: [Vec<Fared>; 3] = Default::default();
    for seed in 1..=SEEDS {
        for (arm, (designer, episodes)) in arms.iter_mut().zip(ARMS) {
            arm.push(fared(&trained(seed, designer, episodes)?, &contested)?);
        }
    }
    let [without, with, more] = &arms;
    let rows = [(with, "with the designer"), (more, "with as many that are not designed")];
    let rows = rows.into_iter().flat_map(|(with, words)| {
        MEASURES.map(|(name, of)| {
            let values = |arm: &[Fared]| arm.iter().map(of).collect::<Vec<f64>>();
            let (without, with) = (values(without), values(with));
            let gains: Vec<f64> = with.iter().zip(&without).map(|(with, without)| with - without).collect();
            Row {
                what: format!("{name}, {SEEDS} seeds × {EPISODES} episodes: without, {words}"),
                measured: format!("{}, {}", interval(&without), interval(&with)),
                goal: format!("by {}", interval(&gains)),
                ratio: None,
            }
        })
    });
    Ok(rows.collect())
}

/// A mean with its 95 % interval over seeds (Student's t).
fn interval(values: &[f64]) -> String {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>() / (n - 1.0);
    let t = StudentsT::new(0.0, 1.0, n - 1.0).map_or(f64::NAN, |t| t.inverse_cdf(0.975));
    format!("{mean:.3} ± {:.3}", t * (variance / n).sqrt())
}

/// What a demo of this seed says, as JSON.
fn trained(seed: u64, designer: &str, episodes: usize) -> anyhow::Result<Value> {
    let (seed, episodes) = (seed.to_string(), episodes.to_string());
    let args = ["demo", "--json", "--seed", &seed, "--episodes", &episodes, "--designer", designer];
    let out = Command::new(system_tests::binary()).args(args).stderr(Stdio::null()).output()?;
    ensure!(out.status.success(), "the demo failed");
    Ok(serde_json::from_slice(&out.stdout)?)
}

/// How the learner's reflexes do, task by task; the mean over tasks.
fn fared(told: &Value, contested: &[&Entry]) -> anyhow::Result<Fared> {
    let tasks = told["tasks"].as_object().context("tasks")?;
    let mut sum = Fared::default();
    for (id, task) in tasks {
        let numbers: Vec<f64> = serde_json::from_value(task["numbers"].clone())?;
        let entries: Vec<_> = contested.iter().filter(|entry| entry.scenario.task().id() == id).collect();
        let flown = entries.par_iter().map(|entry| {
            let mut policy = (entry.scenario.task().reflex().policy)(&numbers);
            let (flown, _) = fly(&entry.scenario, &mut *policy)?;
            let succeeded = success(&entry.scenario, SuccessRule::Task, &entry.bracket, &flown);
            Ok((f64::from(u8::from(succeeded)), entry.bracket.skill(flown.score).unwrap_or(0.0)))
        });
        let flown: Vec<(f64, f64)> = flown.collect::<anyhow::Result<_>>()?;
        ensure!(!flown.is_empty(), "the suite has nothing of {id}");
        let mut skills: Vec<f64> = flown.iter().map(|(_, skill)| *skill).collect();
        skills.sort_by(f64::total_cmp);
        let tail = ((skills.len() as f64 * WORST).ceil() as usize).max(1);
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        sum.success += mean(&flown.iter().map(|(success, _)| *success).collect::<Vec<_>>());
        sum.skill += mean(&skills);
        sum.worst += mean(&skills[..tail]);
        sum.level += task["level"].as_f64().unwrap_or(0.0);
    }
    let n = tasks.len() as f64;
    let designed = told["designed"].as_f64().unwrap_or(0.0);
    Ok(Fared {
        success: sum.success / n,
        skill: sum.skill / n,
        worst: sum.worst / n,
        level: sum.level / n,
        designed,
    })
}
