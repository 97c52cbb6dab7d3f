//! Text report of the designed layouts.

use std::fmt::Write;

use designer::DesignTable;

use super::super::output::{Column, Report, TextTable};
use super::design_report::{DesignReport, GateReport, LayoutResult};

/// Largest number of refused layouts that are listed.
const MAX_LISTED_REFUSALS: usize = 12;

/// Reports the admitted layouts with their encounters, the refused ones with reasons, and a summary.
pub(super) fn text_report(outcome: &DesignReport) -> Report {
    let mut report = Report::default();
    for row in &outcome.rows {
        if let Ok(passed) = &row.verdict {
            add_admitted(&mut report, row, passed);
        }
    }
    add_refused(&mut report, outcome);
    report.paragraph(summary(outcome));
    for warning in &outcome.warnings {
        report.line(one_line(warning));
    }
    report
}

fn add_admitted(report: &mut Report, row: &LayoutResult, passed: &GateReport) {
    let listing = row.listing();
    let aim =
        listing.as_ref().map_or_else(|| "without a design".to_owned(), |l| format!("aimed at {}", l.aim));
    let name = one_line(&row.name);
    report.paragraph(format!("{name} ({}): {}, {aim}", row.task, passed.kind.as_str()));
    let bracket = &passed.bracket;
    let novelty = passed.novelty.map_or_else(String::new, |novelty| format!(", novelty {novelty:.3}"));
    report.line(format!(
        "admitted in round {}: hold {:.3}, floor {:.3}, reference {:.3}{novelty}",
        row.round,
        bracket.hold_score(),
        bracket.floor,
        bracket.reference.score,
    ));
    if let Some(listing) = listing {
        report.table(encounters(listing));
    }
}

fn encounters(listing: DesignTable) -> TextTable {
    let DesignTable { header, rows, .. } = listing;
    let last = header.len().saturating_sub(1);
    let column = |(index, &title): (usize, &&str)| {
        if index == last { Column::text(title) } else { Column::number(title) }
    };
    let mut table = TextTable::new(header.iter().enumerate().map(column));
    rows.into_iter().for_each(|row| table.add_row(row));
    table
}

fn add_refused(report: &mut Report, outcome: &DesignReport) {
    let all: Vec<_> =
        outcome.rows.iter().filter_map(|row| Some((row, row.verdict.as_ref().err()?))).collect();
    for (at, (row, why)) in all.iter().take(MAX_LISTED_REFUSALS).enumerate() {
        let aim = row.listing().map_or_else(String::new, |listing| format!(", aimed at {}", listing.aim));
        let line = format!("{}{aim}: refused, {}: {why}", one_line(&row.name), why.check().as_str());
        if at == 0 {
            report.paragraph(line);
        } else {
            report.line(line);
        }
    }
    if all.len() > MAX_LISTED_REFUSALS {
        let more = all.len() - MAX_LISTED_REFUSALS;
        report.line(format!("{more} more were refused; --json has all of them."));
    }
}

fn summary(outcome: &DesignReport) -> String {
    let admitted = outcome.admitted().count();
    let mut text = match outcome.rows.len() {
        0 => "No layouts.".to_owned(),
        all => format!("{admitted} of {all} admitted"),
    };
    let refused = outcome.refused_by_check();
    if !refused.is_empty() {
        let by: Vec<_> = refused.iter().map(|(check, count)| format!("{count} {}", check.defect())).collect();
        let _ = write!(text, "; refused: {}", by.join(", "));
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
    text
}

/// Replaces control characters of foreign text, so that it cannot move the cursor or change colours.
pub(super) fn one_line(words: &str) -> String {
    words.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}
