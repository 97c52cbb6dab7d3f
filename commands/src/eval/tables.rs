//! Formats an evaluation report as text tables.

use api_types::{ComparisonEstimates, Estimate, EvaluationEstimates, SuiteSection};
use evaluation::EvaluationReport;
use evaluation::report::ALL_LABEL;

use crate::output::{Column, Report, TextTable};

/// Reports one table per task, then the comparisons. If all tasks belong to one world, a joint table comes first.
pub(super) fn text_report(report: &EvaluationReport) -> Report {
    let mut text = Report::default();
    text.paragraph(format!(
        "{}: {} scenarios, hash {}…, planner {}; means with {:.0} % bootstrap intervals over scenarios",
        report.suite,
        report.scenarios,
        report.suite_hash.get(..16).unwrap_or_default(),
        report.planner,
        100.0 * report.confidence
    ));
    if let Some(note) = &report.note {
        text.paragraph(note);
    }
    for block in report.rows.chunk_by(|a, b| a.task == b.task) {
        let mut table = result_table();
        for row in block.chunk_by(|a, b| a.part == b.part).flat_map(part_cells) {
            table.add_row(row);
        }
        text.paragraph(title(block.first().map(|row| row.task.as_str()))).table(table);
    }
    if let Some(against) = &report.against {
        text.paragraph(format!(
            "Differences from {against} on the same scenarios; better: probability that an episode scores higher (ties count half)"
        ));
        for block in report.comparisons.chunk_by(|a, b| a.task == b.task) {
            let mut table = comparison_table();
            for row in block.chunk_by(|a, b| a.part == b.part).flat_map(comparison_cells) {
                table.add_row(row);
            }
            text.paragraph(title(block.first().map(|row| row.task.as_str()))).table(table);
        }
    }
    text
}

fn result_table() -> TextTable {
    TextTable::new([
        Column::text("scenarios"),
        Column::text("policy"),
        Column::number("score"),
        Column::number("worst tenth").optional(1),
        Column::number("success"),
        Column::number("skill"),
        Column::number("lost").optional(2),
        Column::number("fuel used").optional(3),
    ])
}

fn comparison_table() -> TextTable {
    TextTable::new([
        Column::text("scenarios"),
        Column::text("policy"),
        Column::number("score"),
        Column::number("success"),
        Column::number("skill"),
        Column::number("better").optional(1),
    ])
}

fn title(task: Option<&str>) -> &str {
    match task {
        Some(ALL_LABEL) => "all tasks",
        Some(task) => task,
        None => "",
    }
}

/// Returns the label of a part.
fn part_label(scenarios: usize, part: SuiteSection) -> String {
    format!("{scenarios} {}", part.label())
}

fn part_cells(rows: &[EvaluationEstimates]) -> Vec<[String; 8]> {
    let cells = |row: &EvaluationEstimates| {
        [
            part_label(row.scenarios, row.part),
            row.policy.clone(),
            cell(row.score, 3),
            cell(row.cvar10, 3),
            cell(row.success, 3),
            skill_cell(row.skill, row.scenarios),
            cell(row.lost, 3),
            cell(row.fuel_used, 2),
        ]
    };
    rows.iter().map(cells).collect()
}

fn comparison_cells(rows: &[ComparisonEstimates]) -> Vec<[String; 6]> {
    let cells = |row: &ComparisonEstimates| {
        let of = &row.comparison;
        [
            part_label(row.scenarios, row.part),
            row.policy.clone(),
            cell(of.score, 3),
            cell(of.success, 3),
            skill_cell(of.skill, row.scenarios),
            cell(of.improvement, 3),
        ]
    };
    rows.iter().map(cells).collect()
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
