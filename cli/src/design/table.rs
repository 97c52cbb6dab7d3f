//! Text report of the designed layouts.

use std::fmt::Write;

use comfy_table::CellAlignment;
use designer::DesignTable;

use super::super::output;
use super::design_report::{DesignReport, GateReport, LayoutResult};

/// Width of wrapped text, in characters.
const TEXT_WIDTH: usize = 100;
/// Largest number of refused layouts that are listed.
const MAX_LISTED_REFUSALS: usize = 12;

/// Formats the admitted layouts with their encounters, the refused ones with reasons, and a summary.
pub(super) fn text(outcome: &DesignReport) -> String {
    let mut parts: Vec<String> = Vec::new();
    for row in &outcome.rows {
        if let Ok(passed) = &row.verdict {
            parts.push(admitted(row, passed));
        }
    }
    let refused = refused(outcome);
    if !refused.is_empty() {
        parts.push(refused);
    }
    parts.push(summary(outcome));
    parts.join("\n\n") + "\n"
}

fn admitted(row: &LayoutResult, passed: &GateReport) -> String {
    let listing = row.listing();
    let aim =
        listing.as_ref().map_or_else(|| "without a design".to_owned(), |l| format!("aimed at {}", l.aim));
    let name = one_line(&row.name);
    let mut text =
        textwrap::fill(&format!("{name} ({}): {}, {aim}", row.task, passed.kind.as_str()), TEXT_WIDTH);
    let bracket = &passed.bracket;
    let novelty = passed.novelty.map_or_else(String::new, |novelty| format!(", novelty {novelty:.3}"));
    let _ = write!(
        text,
        "\nadmitted in round {}: hold {:.3}, floor {:.3}, reference {:.3}{novelty}",
        row.round,
        bracket.hold_score(),
        bracket.floor,
        bracket.reference.score,
    );
    if let Some(listing) = listing {
        let _ = write!(text, "\n{}", encounters(listing));
    }
    text
}

fn encounters(listing: DesignTable) -> String {
    let DesignTable { header, rows, .. } = listing;
    let mut table = output::table(&header, 0);
    if let Some(last) = header.len().checked_sub(1).and_then(|last| table.column_mut(last)) {
        last.set_cell_alignment(CellAlignment::Left);
    }
    table.add_rows(rows);
    table.to_string()
}

fn refused(outcome: &DesignReport) -> String {
    let all: Vec<_> =
        outcome.rows.iter().filter_map(|row| Some((row, row.verdict.as_ref().err()?))).collect();
    let mut lines: Vec<String> = Vec::new();
    for (row, why) in all.iter().take(MAX_LISTED_REFUSALS) {
        let aim = row.listing().map_or_else(String::new, |listing| format!(", aimed at {}", listing.aim));
        let line = format!("{}{aim}: refused, {}: {why}", one_line(&row.name), why.check().as_str());
        let indented = textwrap::Options::new(TEXT_WIDTH).subsequent_indent("  ");
        lines.push(textwrap::fill(&line, indented));
    }
    if all.len() > MAX_LISTED_REFUSALS {
        lines.push(format!(
            "{} more were refused; --format json has all of them.",
            all.len() - MAX_LISTED_REFUSALS
        ));
    }
    lines.join("\n")
}

fn summary(outcome: &DesignReport) -> String {
    let admitted = outcome.admitted().count();
    let mut text = match outcome.rows.len() {
        0 => "No layouts.".to_owned(),
        all => format!("{admitted} of {all} admitted"),
    };
    let refused = outcome.refused_by_check();
    if !refused.is_empty() {
        let by: Vec<_> = refused.iter().map(|(check, count)| format!("{check} {count}")).collect();
        let _ = write!(text, "; refused by check: {}", by.join(", "));
    }
    let usage = &outcome.usage;
    let seconds = outcome.elapsed.as_secs_f64();
    let _ = write!(text, ". The designer {} took {seconds:.1} s", outcome.designer);
    if usage.rounds > 1 {
        let _ = write!(text, " and {} rounds", usage.rounds);
    }
    if let Some(model) = &usage.model {
        let _ =
            write!(text, ", {} {} tokens in and {} out", one_line(model), usage.tokens_in, usage.tokens_out);
    }
    text.push('.');
    let warnings = outcome.warnings.iter().map(|warning| textwrap::fill(&one_line(warning), TEXT_WIDTH));
    std::iter::once(textwrap::fill(&text, TEXT_WIDTH)).chain(warnings).collect::<Vec<_>>().join("\n")
}

/// Replaces control characters of foreign text, so that it cannot move the cursor or change colours.
pub(super) fn one_line(words: &str) -> String {
    words.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}
