//! HTML page of a comparison. The template escapes all text that users wrote.

use clock::rfc3339;
use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::gather::{Comparison, TaskComparison};
use super::tables::{TextTable, differing_settings, evaluation_tables, final_table, run_table};
use crate::report::page::STYLE;

/// Title of the report.
pub(super) const TITLE: &str = "Comparison of runs";
/// Explanation of the curves of groups.
pub(super) const MEANS: &str = "Curves of groups are means over their runs with 95 % intervals by Student's t \
     (of two runs: minimum to maximum). They end with the shortest run of the group.";
/// Explanation of the final values.
pub(super) const FINAL: &str =
    "Values at the end: means of the last tenth of a run's points, and the level at the end.";
/// Explanation of the evaluations.
pub(super) const EVALUATIONS: &str = "Newest evaluation of the highest policy version of each run, over all \
     scenarios: mean [95 % interval]. Differences to the baseline are means over the same scenarios.";

/// Renders the whole page.
///
/// # Errors
/// Returns an error if a figure cannot be drawn or an evaluation cannot be read.
pub(in crate::report) fn render(comparison: &Comparison) -> anyhow::Result<String> {
    let tasks = comparison
        .tasks
        .iter()
        .map(|task| task_section(comparison, task))
        .collect::<anyhow::Result<Vec<_>>>()?;
    let evaluations = evaluation_tables(comparison)?;
    let (settings, all) = differing_settings(comparison);
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'";
                title { (TITLE) " · Sparring" }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { (TITLE) }
                p .soft { (comparison.describe()) ". As of " (rfc3339(comparison.now)) "; all times are UTC." }
                (table(&run_table(comparison)))
                @if comparison.tasks.is_empty() { p .soft { "No results yet." } }
                @for task in tasks { (task) }
                @if !evaluations.is_empty() {
                    h2 { "Evaluations" }
                    p .soft { (EVALUATIONS) }
                    @for (suite, of) in &evaluations { h3 { (suite) } (table(of)) }
                }
                h2 { "Settings" }
                p .soft { (settings.rows.len()) " of " (all) " settings differ." }
                @if !settings.rows.is_empty() { (table(&settings)) }
            }
        }
    };
    Ok(page.into_string())
}

fn task_section(comparison: &Comparison, task: &TaskComparison) -> anyhow::Result<Markup> {
    let pictures = task
        .figures
        .iter()
        .map(|figure| Ok((figure.title.as_str(), figure.svg()?)))
        .collect::<anyhow::Result<Vec<_>>>()?;
    Ok(html! {
        h2 { (task.task) }
        div .pictures { @for (title, picture) in &pictures {
            figure { (PreEscaped(picture)) figcaption { strong { (title) } } }
        } }
        @if task.figures.iter().any(super::figure::Figure::has_means) { p .soft { (MEANS) } }
        (table(&final_table(comparison, task)))
        p .soft { (FINAL) }
    })
}

fn table(of: &TextTable) -> Markup {
    html! {
        div .wide { table {
            thead { tr { @for title in &of.head { th .foreign { (title) } } } }
            tbody { @for row in &of.rows { tr { @for text in row { td .foreign { (text) } } } } }
        } }
    }
}
