//! The numbers of an evaluation, as tables and as JSON.

use std::collections::BTreeSet;

use serde::Serialize;

use super::Args;
use super::fly::{Measures, Row};
use super::physics::Physics;
use crate::cli::bootstrap::{CONFIDENCE, Estimate, RESAMPLES, estimates};
use crate::cli::options::ByTask;
use crate::cli::output;
use crate::cli::suite::{Entry, Part, Suite};

/// Everything an evaluation found; its JSON form is documented in `sparring eval --help`.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    suite: String,
    suite_hash: String,
    planner: u32,
    physics: ByTask,
    comparable: bool,
    note: Option<String>,
    seed: u64,
    rollouts: u32,
    confidence: f64,
    resamples: usize,
    scenarios: usize,
    rows: Vec<ReportRow>,
}

/// One policy on one part of one task.
#[derive(Debug, Serialize)]
pub(super) struct ReportRow {
    task: String,
    part: &'static str,
    policy: String,
    scenarios: usize,
    score: Option<Estimate>,
    success: Option<Estimate>,
    skill: Option<Estimate>,
    lost: Option<Estimate>,
    fuel_used: Option<Estimate>,
}

const ALL: &str = "all";
const PARTS: [(&str, Option<Part>); 3] =
    [("contested", Some(Part::Contested)), ("as_they_come", Some(Part::AsTheyCome)), (ALL, None)];

impl Report {
    pub(super) fn new(
        suite: &Suite,
        suite_hash: String,
        args: &Args,
        physics: Option<Physics>,
        rows: &[Row],
    ) -> Self {
        let of = suite.tasks();
        // Scores, agents and fuel of different worlds are no one quantity: no mean is made of them.
        let worlds: BTreeSet<&str> = of.iter().map(|task| task.world()).collect();
        let all = (worlds.len() == 1).then_some(ALL);
        let mut told = Vec::new();
        for task in all.into_iter().chain(of.iter().map(|task| task.id())) {
            for (part, of) in PARTS {
                let belongs = |entry: &Entry| {
                    (task == ALL || entry.scenario.task().id() == task)
                        && of.is_none_or(|of| entry.part == of)
                };
                let picked: Vec<bool> = suite.entries().map(belongs).collect();
                if picked.contains(&true) {
                    told.extend(rows.iter().map(|row| ReportRow::new(task, part, row, &picked, args.seed)));
                }
            }
        }
        Self {
            suite: suite.name.clone(),
            suite_hash,
            planner: suite.planner,
            comparable: physics.is_none(),
            note: physics.as_ref().map(Physics::note),
            physics: physics.map(|physics| physics.options).unwrap_or_default(),
            seed: args.seed,
            rollouts: args.rollouts,
            confidence: CONFIDENCE,
            resamples: RESAMPLES,
            scenarios: suite.entries().count(),
            rows: told,
        }
    }

    /// A table per task, all tasks together first where they are of one world.
    pub(super) fn tables(&self) -> String {
        let mut text = format!(
            "{}: {} scenarios, hash {}…, planner {}; means with {:.0} % bootstrap intervals over scenarios\n",
            self.suite,
            self.scenarios,
            self.suite_hash.get(..16).unwrap_or_default(),
            self.planner,
            100.0 * self.confidence
        );
        if let Some(note) = &self.note {
            text.push_str(&format!("\n{}\n", textwrap::fill(note, wrapping())));
        }
        for block in self.rows.chunk_by(|a, b| a.task == b.task) {
            let mut table =
                output::table(&["scenarios", "policy", "score", "success", "skill", "lost", "fuel used"], 2);
            for row in block.chunk_by(|a, b| a.part == b.part).flat_map(part_cells) {
                table.add_row(row);
            }
            let task = block.first().map_or("", |row| &row.task);
            let title = if task == ALL { "all tasks" } else { task };
            text.push_str(&format!("\n{title}\n{table}\n"));
        }
        text
    }
}

/// Between words only: a task's id has a slash in it.
fn wrapping() -> textwrap::Options<'static> {
    textwrap::Options::new(100).word_separator(textwrap::WordSeparator::AsciiSpace)
}

/// The rows of one part; the part is named on the first.
fn part_cells(rows: &[ReportRow]) -> Vec<[String; 7]> {
    let cells = |(at, row): (usize, &ReportRow)| {
        let part = format!("{} {}", row.scenarios, row.part.replace('_', " "));
        let part = if at == 0 { part } else { String::new() };
        [
            part,
            row.policy.clone(),
            cell(row.score, 3),
            cell(row.success, 3),
            skill_cell(row),
            cell(row.lost, 3),
            cell(row.fuel_used, 2),
        ]
    };
    rows.iter().enumerate().map(cells).collect()
}

fn cell(estimate: Option<Estimate>, digits: usize) -> String {
    let number = |value: f64| {
        let text = format!("{value:.digits$}");
        // What rounds to zero has no sign.
        let zero = text.chars().all(|c| matches!(c, '-' | '0' | '.'));
        if zero { text.trim_start_matches('-').to_owned() } else { text }
    };
    let told = |e: Estimate| format!("{} [{}, {}]", number(e.mean), number(e.low), number(e.high));
    estimate.map_or_else(|| "none".to_owned(), told)
}

fn skill_cell(row: &ReportRow) -> String {
    match row.skill {
        Some(skill) if skill.scenarios < row.scenarios => {
            format!("{} over {}", cell(row.skill, 3), skill.scenarios)
        }
        skill => cell(skill, 3),
    }
}

impl ReportRow {
    fn new(task: &str, part: &'static str, row: &Row, picked: &[bool], seed: u64) -> Self {
        let measures: Vec<Measures> =
            row.measures.iter().zip(picked).filter(|(_, picked)| **picked).map(|(m, _)| *m).collect();
        let [score, success, skill, lost, fuel_used] = estimates(&measures, seed);
        Self {
            task: task.to_owned(),
            part,
            policy: row.policy.clone(),
            scenarios: measures.len(),
            score,
            success,
            skill,
            lost,
            fuel_used,
        }
    }
}
