//! Tables of a comparison as text, which the HTML and the PDF page show.

use api_types::{Estimate, SuiteSection};
use clock::rfc3339;
use orchestrator::evaluations::read::{self, LoadedEvaluation};

use super::curves::{Quantity, mean_band};
use super::gather::{Comparison, TaskComparison};
use super::groups::run_label;
use super::settings::settings_table;

/// Table whose cells are texts.
#[derive(Debug)]
pub(super) struct TextTable {
    /// Titles of the columns.
    pub(super) head: Vec<String>,
    /// Rows with one text for each column.
    pub(super) rows: Vec<Vec<String>>,
}

impl TextTable {
    fn new(head: &[&str]) -> Self {
        Self { head: head.iter().map(|&title| title.to_owned()).collect(), rows: Vec::new() }
    }
}

/// Returns the runs with their groups.
pub(super) fn run_table(comparison: &Comparison) -> TextTable {
    let mut table = TextTable::new(&["Run", "Id", "Group", "Seed", "Created", "Episodes", "Policy version"]);
    for group in &comparison.groups {
        for &at in &group.runs {
            let run = &comparison.runs[at];
            table.rows.push(vec![
                run.row.name.clone(),
                run.row.id.clone(),
                group.label.clone(),
                run.row.seed.to_string(),
                rfc3339(run.row.created_at),
                run.episodes.to_string(),
                run.row.policy_version.to_string(),
            ]);
        }
    }
    table
}

/// Returns the values of a task at the ends of the runs, by group.
pub(super) fn final_table(comparison: &Comparison, task: &TaskComparison) -> TextTable {
    let mut table = TextTable::new(&["Group", "Runs"]);
    table.head.extend(task.lines.iter().map(|(quantity, _)| quantity.name().to_owned()));
    for group in &comparison.groups {
        let mut row = vec![group.label.clone(), group.runs.len().to_string()];
        for (quantity, lines) in &task.lines {
            let values: Vec<f64> = group.runs.iter().filter_map(|at| lines[*at].final_value()).collect();
            row.push(final_text(*quantity, &values));
        }
        table.rows.push(row);
    }
    table
}

fn final_text(quantity: Quantity, values: &[f64]) -> String {
    let text = |value: f64| match quantity {
        Quantity::Level | Quantity::Rung => format!("{value:.1}"),
        Quantity::Success | Quantity::Skill => format!("{value:.3}"),
    };
    match mean_band(values, quantity.bounds()) {
        None => "–".to_owned(),
        Some(band) if values.len() < 2 => text(band.mean),
        Some(band) => {
            format!("{} [{}, {}]", text(band.mean), text(band.interval.low), text(band.interval.high))
        }
    }
}

/// Returns the evaluations of the runs by suite, with the differences to the first run that has one.
///
/// # Errors
/// Returns an error if the suite of an evaluation has changed.
pub(super) fn evaluation_tables(comparison: &Comparison) -> anyhow::Result<Vec<(String, TextTable)>> {
    let mut suites: Vec<(String, Vec<(usize, &LoadedEvaluation)>)> = Vec::new();
    for (at, run) in comparison.runs.iter().enumerate() {
        for evaluation in &run.evaluations {
            match suites.iter_mut().find(|(suite, _)| *suite == evaluation.row.suite) {
                Some((_, found)) => found.push((at, evaluation)),
                None => suites.push((evaluation.row.suite.clone(), vec![(at, evaluation)])),
            }
        }
    }
    let tables = suites.into_iter().map(|(suite, found)| Ok((suite, evaluation_table(comparison, &found)?)));
    tables.collect()
}

fn evaluation_table(
    comparison: &Comparison,
    found: &[(usize, &LoadedEvaluation)],
) -> anyhow::Result<TextTable> {
    let mut table = TextTable::new(&[
        "Run",
        "Evaluation",
        "Policy",
        "Version",
        "Success rate",
        "Skill",
        "Success, difference",
        "Skill, difference",
    ]);
    for (nth, (at, evaluation)) in found.iter().enumerate() {
        let report = read::report_evaluation(evaluation)?;
        let own =
            report.rows.iter().filter(|row| row.policy != "blind_panel" && row.part == SuiteSection::All);
        // A suite with one task has no row for all tasks.
        let own: Vec<_> = own.collect();
        let overall = own.iter().find(|row| row.task == "all").or_else(|| own.first());
        let version = evaluation.row.policy_version.map_or_else(|| "–".to_owned(), |v| v.to_string());
        let mut row = vec![
            run_label(*at, &comparison.runs),
            format!("eval-{}", evaluation.row.id),
            evaluation.row.policy.clone(),
            version,
            estimate_text(overall.and_then(|row| row.success)),
            estimate_text(overall.and_then(|row| row.skill)),
        ];
        row.extend(if nth == 0 {
            ["baseline".to_owned(), String::new()]
        } else {
            differences(evaluation, found[0].1)
        });
        table.rows.push(row);
    }
    Ok(table)
}

/// Returns the differences in success rate and skill; the reason if the two cannot be compared.
fn differences(evaluation: &LoadedEvaluation, base: &LoadedEvaluation) -> [String; 2] {
    match read::compare_sides(std::slice::from_ref(evaluation), std::slice::from_ref(base)) {
        Err(error) => [error.to_string(), String::new()],
        Ok(compared) => {
            let rows = &compared.report.comparisons;
            let all: Vec<_> = rows.iter().filter(|row| row.part == SuiteSection::All).collect();
            let row = all.iter().find(|row| row.task == "all").or_else(|| all.first());
            let of = |value: fn(&api_types::PolicyComparison) -> Option<Estimate>| {
                estimate_text(row.and_then(|row| value(&row.comparison)))
            };
            [of(|row| row.success), of(|row| row.skill)]
        }
    }
}

fn estimate_text(of: Option<Estimate>) -> String {
    of.map_or_else(|| "–".to_owned(), |e| format!("{:.3} [{:.3}, {:.3}]", e.mean, e.low, e.high))
}

/// Returns the settings that differ, and the number of all settings.
pub(super) fn differing_settings(comparison: &Comparison) -> (TextTable, usize) {
    let runs = &comparison.runs;
    let all = settings_table(&runs.iter().map(|run| &run.settings).collect::<Vec<_>>());
    let mut table = TextTable::new(&["Setting"]);
    table.head.extend((0..runs.len()).map(|at| run_label(at, runs)));
    for row in all.iter().filter(|row| row.differs()) {
        let values = row.values.iter().map(|value| value.clone().unwrap_or_else(|| "–".to_owned()));
        table.rows.push(std::iter::once(row.path.clone()).chain(values).collect());
    }
    (table, all.len())
}
