//! Formats an evaluation report as text tables.

use api_types::{ComparisonEstimates, Estimate, EvaluationEstimates, SuiteSection};
use orchestrator::evaluation::EvaluationReport;
use orchestrator::evaluation::report::ALL_LABEL;

use crate::output;

/// Formats one table per task, then the comparisons. If all tasks belong to one world, a joint table comes first.
pub(super) fn tables(report: &EvaluationReport) -> String {
    let mut text = format!(
        "{}: {} scenarios, hash {}…, planner {}; means with {:.0} % bootstrap intervals over scenarios\n",
        report.suite,
        report.scenarios,
        report.suite_hash.get(..16).unwrap_or_default(),
        report.planner,
        100.0 * report.confidence
    );
    if let Some(note) = &report.note {
        text.push_str(&format!("\n{}\n", textwrap::fill(note, wrapping())));
    }
    for block in report.rows.chunk_by(|a, b| a.task == b.task) {
        let header = ["scenarios", "policy", "score", "worst tenth", "success", "skill", "lost", "fuel used"];
        let mut table = output::table(&header, 2);
        for row in block.chunk_by(|a, b| a.part == b.part).flat_map(part_cells) {
            table.add_row(row);
        }
        text.push_str(&format!("\n{}\n{table}\n", title(block.first().map(|row| row.task.as_str()))));
    }
    if let Some(against) = &report.against {
        text.push_str(&format!(
            "\nDifferences from {against} on the same scenarios; better: how likely an episode scores higher, ties half\n"
        ));
        for block in report.comparisons.chunk_by(|a, b| a.task == b.task) {
            let mut table = output::table(&["scenarios", "policy", "score", "success", "skill", "better"], 2);
            for row in block.chunk_by(|a, b| a.part == b.part).flat_map(comparison_cells) {
                table.add_row(row);
            }
            text.push_str(&format!("\n{}\n{table}\n", title(block.first().map(|row| row.task.as_str()))));
        }
    }
    text
}

fn title(task: Option<&str>) -> &str {
    match task {
        Some(ALL_LABEL) => "all tasks",
        Some(task) => task,
        None => "",
    }
}

/// Wraps at spaces only, since the id of a task contains a slash.
fn wrapping() -> textwrap::Options<'static> {
    textwrap::Options::new(100).word_separator(textwrap::WordSeparator::AsciiSpace)
}

/// Returns the label of a part for its first row, and an empty string for the others.
fn part_label(at: usize, scenarios: usize, part: SuiteSection) -> String {
    if at == 0 { format!("{scenarios} {}", part.as_str().replace('_', " ")) } else { String::new() }
}

fn part_cells(rows: &[EvaluationEstimates]) -> Vec<[String; 8]> {
    let cells = |(at, row): (usize, &EvaluationEstimates)| {
        [
            part_label(at, row.scenarios, row.part),
            row.policy.clone(),
            cell(row.score, 3),
            cell(row.cvar10, 3),
            cell(row.success, 3),
            skill_cell(row.skill, row.scenarios),
            cell(row.lost, 3),
            cell(row.fuel_used, 2),
        ]
    };
    rows.iter().enumerate().map(cells).collect()
}

fn comparison_cells(rows: &[ComparisonEstimates]) -> Vec<[String; 6]> {
    let cells = |(at, row): (usize, &ComparisonEstimates)| {
        let of = &row.comparison;
        [
            part_label(at, row.scenarios, row.part),
            row.policy.clone(),
            cell(of.score, 3),
            cell(of.success, 3),
            skill_cell(of.skill, row.scenarios),
            cell(of.improvement, 3),
        ]
    };
    rows.iter().enumerate().map(cells).collect()
}

fn cell(estimate: Option<Estimate>, digits: usize) -> String {
    let number = |value: f64| {
        let text = format!("{value:.digits$}");
        // A number that rounds to zero has no sign.
        let zero = text.chars().all(|c| matches!(c, '-' | '0' | '.'));
        if zero { text.trim_start_matches('-').to_owned() } else { text }
    };
    let format = |e: Estimate| format!("{} [{}, {}]", number(e.mean), number(e.low), number(e.high));
    estimate.map_or_else(|| "none".to_owned(), format)
}

fn skill_cell(skill: Option<Estimate>, scenarios: usize) -> String {
    match skill {
        Some(known) if known.scenarios < scenarios => format!("{} over {}", cell(skill, 3), known.scenarios),
        skill => cell(skill, 3),
    }
}
