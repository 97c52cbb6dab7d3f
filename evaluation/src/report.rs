//! The report of an evaluation: estimates for each policy on each part of each task, and comparisons.

use std::collections::{BTreeMap, BTreeSet};

use api_types::{ComparisonEstimates, EvaluationEstimates, SuiteSection};
use rayon::prelude::*;
use serde::Serialize;

use super::bootstrap::{CONFIDENCE, RESAMPLES, estimate_means, with_exact_interval};
use super::compare::compare_policies;
use super::results::{MEASURES, PolicyResults};
use super::suite::{Suite, SuiteEntry, SuitePart};
use super::tail::cvar;

/// Physics options by task id and name.
pub type TaskOptions = BTreeMap<&'static str, BTreeMap<String, String>>;

/// Label of all tasks of a world.
pub const ALL_LABEL: &str = "all";
/// Parts that a report has; `None` stands for all of them.
const PARTS: [(SuiteSection, Option<SuitePart>); 3] = [
    (SuiteSection::Contested, Some(SuitePart::Contested)),
    (SuiteSection::AsTheyCome, Some(SuitePart::AsTheyCome)),
    (SuiteSection::All, None),
];

/// Report of an evaluation; `sparring eval --help` documents its JSON form.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EvaluationReport {
    /// Name of the suite.
    pub suite: String,
    /// Hash of the suite.
    pub suite_hash: String,
    /// Version of the planner that made the suite's brackets.
    pub planner: u32,
    /// Physics options that replaced those of the suite.
    pub physics: TaskOptions,
    /// True if the report can be compared with other reports of the suite.
    pub comparable: bool,
    /// Reason why the report is not comparable.
    pub note: Option<String>,
    /// Seed of stochastic policies and of the resamples.
    pub seed: u64,
    /// Number of episodes of a stochastic policy on each scenario.
    pub rollouts: u32,
    /// Share of the resampled means that lie in an interval.
    pub confidence: f64,
    /// Number of bootstrap resamples.
    pub resamples: usize,
    /// Number of scenarios in the suite.
    pub scenarios: usize,
    /// Estimates for each policy on each part of each task.
    pub rows: Vec<EvaluationEstimates>,
    /// Policy that the others are compared with.
    pub against: Option<String>,
    /// Comparison of each other policy with `against`.
    pub comparisons: Vec<ComparisonEstimates>,
}

/// Settings of an evaluation.
#[derive(Debug, Clone, Default)]
pub struct ReportSettings {
    /// Seed of stochastic policies and of the resamples.
    pub seed: u64,
    /// Number of episodes of a stochastic policy on each scenario.
    pub rollouts: u32,
    /// Policy that the others are compared with.
    pub against: Option<String>,
}

impl EvaluationReport {
    /// Creates the report of policies' results on a suite.
    #[must_use]
    pub fn new(
        suite: &Suite,
        suite_hash: String,
        settings: &ReportSettings,
        results: &[PolicyResults],
    ) -> Self {
        let sections = sections(suite, results);
        let rows = sections.par_iter().flat_map_iter(|section| {
            results.iter().map(|results| section.row(results, settings.seed)).collect::<Vec<_>>()
        });
        let against =
            settings.against.as_ref().and_then(|name| results.iter().find(|other| other.policy == *name));
        let comparisons = sections.par_iter().flat_map_iter(|section| {
            let Some(against) = against else { return Vec::new() };
            let others = results.iter().filter(|results| results.policy != against.policy);
            others.map(|results| section.comparison(results, against, settings.seed)).collect()
        });
        Self {
            suite: suite.name.clone(),
            suite_hash,
            planner: suite.planner,
            comparable: true,
            note: None,
            physics: TaskOptions::default(),
            seed: settings.seed,
            rollouts: settings.rollouts,
            confidence: CONFIDENCE,
            resamples: RESAMPLES,
            scenarios: suite.entries().count(),
            rows: rows.collect(),
            against: against.map(|against| against.policy.clone()),
            comparisons: comparisons.collect(),
        }
    }
}

/// Scenarios of one part of one task.
struct Section {
    task: String,
    part: SuiteSection,
    /// True for each scenario of the suite that belongs to the section.
    mask: Vec<bool>,
}

/// Returns the sections that all policies have episodes on: all tasks together if they are of one world, then each task.
fn sections(suite: &Suite, results: &[PolicyResults]) -> Vec<Section> {
    let has_episodes = |index: usize| {
        results.iter().all(|results| results.episodes.get(index).is_some_and(|episodes| !episodes.is_empty()))
    };
    let entries: Vec<(bool, &SuiteEntry)> =
        suite.entries().enumerate().map(|(index, entry)| (has_episodes(index), entry)).collect();
    let mut tasks = suite.tasks();
    tasks.retain(|task| {
        entries.iter().any(|(has_episodes, entry)| *has_episodes && entry.scenario.task().id() == task.id())
    });
    // Scores, agents and fuel of different worlds are different quantities, without a common mean.
    let worlds: BTreeSet<&str> = tasks.iter().map(|task| task.world()).collect();
    let all = (worlds.len() == 1).then_some(ALL_LABEL);
    let mut sections = Vec::new();
    for task in all.into_iter().chain(tasks.iter().map(|task| task.id())) {
        for (label, part) in PARTS {
            let belongs = |(has_episodes, entry): &(bool, &SuiteEntry)| {
                *has_episodes
                    && (task == ALL_LABEL || entry.scenario.task().id() == task)
                    && part.is_none_or(|part| entry.part == part)
            };
            let mask: Vec<bool> = entries.iter().map(belongs).collect();
            if mask.contains(&true) {
                sections.push(Section { task: task.to_owned(), part: label, mask });
            }
        }
    }
    sections
}

impl Section {
    fn row(&self, results: &PolicyResults, seed: u64) -> EvaluationEstimates {
        let results = results.select(&self.mask);
        let means: Vec<[Option<f64>; MEASURES]> =
            results.scenario_means().into_iter().map(Into::into).collect();
        let [score, success, skill, lost, fuel_used] = estimate_means(&means, seed);
        EvaluationEstimates {
            task: self.task.clone(),
            part: self.part,
            scenarios: results.episodes.len(),
            score,
            success: success.map(with_exact_interval),
            skill,
            lost,
            fuel_used,
            cvar10: cvar(&results, seed),
            policy: results.policy,
        }
    }

    fn comparison(&self, one: &PolicyResults, other: &PolicyResults, seed: u64) -> ComparisonEstimates {
        let (one, other) = (one.select(&self.mask), other.select(&self.mask));
        ComparisonEstimates {
            task: self.task.clone(),
            part: self.part,
            scenarios: one.episodes.len(),
            comparison: compare_policies(&one, &other, seed),
            policy: one.policy,
        }
    }
}
