//! The numbers of an evaluation.

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;
use serde::Serialize;

use super::bootstrap::{CONFIDENCE, Estimate, RESAMPLES, estimates, share};
use super::compare::{Compared, compare};
use super::flown::Flown;
use super::suite::{Entry, Part, Suite};
use super::tail::cvar;

/// Options by task's id, then by name.
pub type ByTask = BTreeMap<&'static str, BTreeMap<String, String>>;

/// The word for all tasks of a world.
pub const ALL: &str = "all";
const PARTS: [(&str, Option<Part>); 3] =
    [("contested", Some(Part::Contested)), ("as_they_come", Some(Part::AsTheyCome)), (ALL, None)];

/// Everything an evaluation found; its JSON form is documented in `sparring eval --help`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// The suite.
    pub suite: String,
    /// Its hash.
    pub suite_hash: String,
    /// The planner that made its brackets.
    pub planner: u32,
    /// Options that were flown under instead of the suite's.
    pub physics: ByTask,
    /// Whether it compares with other reports of the suite.
    pub comparable: bool,
    /// Why not, in words.
    pub note: Option<String>,
    /// What policies with chance in them and the resamples drew from.
    pub seed: u64,
    /// How often policies with chance in them flew each scenario.
    pub rollouts: u32,
    /// What share of resampled means an interval holds.
    pub confidence: f64,
    /// How often scenarios were drawn again.
    pub resamples: usize,
    /// Scenarios of the suite.
    pub scenarios: usize,
    /// Each policy on each part of each task.
    pub rows: Vec<ReportRow>,
    /// What policies are compared with, if with any.
    pub against: Option<String>,
    /// Each policy against that one.
    pub comparisons: Vec<ComparisonRow>,
}

/// One policy on one part of one task.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReportRow {
    /// The task, or `all`.
    pub task: String,
    /// `contested`, `as_they_come` or `all`.
    pub part: &'static str,
    /// The policy.
    pub policy: String,
    /// Scenarios.
    pub scenarios: usize,
    /// The world's score.
    pub score: Option<Estimate>,
    /// The share of successes.
    pub success: Option<Estimate>,
    /// Skill, where defined.
    pub skill: Option<Estimate>,
    /// The share of agents lost.
    pub lost: Option<Estimate>,
    /// Fuel used by all agents together.
    pub fuel_used: Option<Estimate>,
    /// The mean score over the worst tenth of the scenarios ([`cvar`]).
    pub cvar10: Option<Estimate>,
}

/// One policy against another on one part of one task.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ComparisonRow {
    /// The task, or `all`.
    pub task: String,
    /// `contested`, `as_they_come` or `all`.
    pub part: &'static str,
    /// The policy.
    pub policy: String,
    /// Scenarios.
    pub scenarios: usize,
    /// What it did against the other.
    #[serde(flatten)]
    pub compared: Compared,
}

/// How an evaluation was made.
#[derive(Debug, Clone, Default)]
pub struct Terms {
    /// What policies with chance in them and the resamples draw from.
    pub seed: u64,
    /// How often policies with chance in them fly each scenario.
    pub rollouts: u32,
    /// What policies are compared with.
    pub against: Option<String>,
}

impl Report {
    /// Of what policies did on a suite.
    #[must_use]
    pub fn new(suite: &Suite, suite_hash: String, terms: &Terms, flown: &[Flown]) -> Self {
        let blocks = blocks(suite, flown);
        let rows = blocks.par_iter().flat_map_iter(|block| {
            flown.iter().map(|flown| block.row(flown, terms.seed)).collect::<Vec<_>>()
        });
        let other = terms.against.as_ref().and_then(|name| flown.iter().find(|flown| flown.policy == *name));
        let comparisons = blocks.par_iter().flat_map_iter(|block| {
            let others = flown.iter().filter(|flown| other.is_some_and(|other| other.policy != flown.policy));
            let rows = others.zip(other.into_iter().cycle());
            rows.map(|(one, other)| block.comparison(one, other, terms.seed)).collect::<Vec<_>>()
        });
        Self {
            suite: suite.name.clone(),
            suite_hash,
            planner: suite.planner,
            comparable: true,
            note: None,
            physics: ByTask::default(),
            seed: terms.seed,
            rollouts: terms.rollouts,
            confidence: CONFIDENCE,
            resamples: RESAMPLES,
            scenarios: suite.entries().count(),
            rows: rows.collect(),
            against: other.map(|other| other.policy.clone()),
            comparisons: comparisons.collect(),
        }
    }
}

/// Some scenarios of a suite.
struct Block {
    task: String,
    part: &'static str,
    picked: Vec<bool>,
}

/// All tasks together where they are of one world, then each; each part of them, as far as all policies flew it.
fn blocks(suite: &Suite, flown: &[Flown]) -> Vec<Block> {
    let by_all = |place: usize| {
        flown.iter().all(|flown| flown.episodes.get(place).is_some_and(|episodes| !episodes.is_empty()))
    };
    let entries: Vec<(bool, &Entry)> =
        suite.entries().enumerate().map(|(place, entry)| (by_all(place), entry)).collect();
    let any = |task: &str| entries.iter().any(|(flown, entry)| *flown && entry.scenario.task().id() == task);
    let mut tasks = suite.tasks();
    tasks.retain(|task| any(task.id()));
    // Scores, agents and fuel of different worlds are no one quantity: no mean is made of them.
    let worlds: BTreeSet<&str> = tasks.iter().map(|task| task.world()).collect();
    let all = (worlds.len() == 1).then_some(ALL);
    let mut blocks = Vec::new();
    for task in all.into_iter().chain(tasks.iter().map(|task| task.id())) {
        for (part, of) in PARTS {
            let belongs = |(flown, entry): &(bool, &Entry)| {
                *flown
                    && (task == ALL || entry.scenario.task().id() == task)
                    && of.is_none_or(|of| entry.part == of)
            };
            let picked: Vec<bool> = entries.iter().map(belongs).collect();
            if picked.contains(&true) {
                blocks.push(Block { task: task.to_owned(), part, picked });
            }
        }
    }
    blocks
}

impl Block {
    fn row(&self, flown: &Flown, seed: u64) -> ReportRow {
        let flown = flown.on(&self.picked);
        let [score, success, skill, lost, fuel_used] = estimates(&flown.means(), seed);
        ReportRow {
            task: self.task.clone(),
            part: self.part,
            scenarios: flown.episodes.len(),
            score,
            success: success.map(share),
            skill,
            lost,
            fuel_used,
            cvar10: cvar(&flown, seed),
            policy: flown.policy,
        }
    }

    fn comparison(&self, one: &Flown, other: &Flown, seed: u64) -> ComparisonRow {
        let (one, other) = (one.on(&self.picked), other.on(&self.picked));
        ComparisonRow {
            task: self.task.clone(),
            part: self.part,
            scenarios: one.episodes.len(),
            compared: compare(&one, &other, seed),
            policy: one.policy,
        }
    }
}
