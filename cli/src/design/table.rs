//! What is printed for people.

use std::fmt::Write;

use comfy_table::CellAlignment;
use designer::DesignTable;

use super::super::output;
use super::row::{Outcome, Passed, Row};

/// Columns that text is filled to.
const WIDTH: usize = 100;
/// Refused layouts told one by one at most.
const TOLD: usize = 12;

/// Admitted layouts with their encounters, refused ones with why, and what it all comes to.
pub(super) fn text(outcome: &Outcome) -> String {
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

fn admitted(row: &Row, passed: &Passed) -> String {
    let listing = row.listing();
    let aim =
        listing.as_ref().map_or_else(|| "laid out by hand".to_owned(), |l| format!("aimed at {}", l.aim));
    let name = one_line(&row.name);
    let mut text = textwrap::fill(&format!("{name} ({}): {}, {aim}", row.task, passed.claim.as_str()), WIDTH);
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

fn refused(outcome: &Outcome) -> String {
    let all: Vec<_> =
        outcome.rows.iter().filter_map(|row| Some((row, row.verdict.as_ref().err()?))).collect();
    let mut lines: Vec<String> = Vec::new();
    for (row, why) in all.iter().take(TOLD) {
        let aim = row.listing().map_or_else(String::new, |listing| format!(", aimed at {}", listing.aim));
        let told = format!("{}{aim}: refused, {}: {why}", one_line(&row.name), why.check().as_str());
        let indented = textwrap::Options::new(WIDTH).subsequent_indent("  ");
        lines.push(textwrap::fill(&told, indented));
    }
    if all.len() > TOLD {
        lines.push(format!("{} more were refused; --format json has all of them.", all.len() - TOLD));
    }
    lines.join("\n")
}

fn summary(outcome: &Outcome) -> String {
    let admitted = outcome.admitted().count();
    let mut text = match outcome.rows.len() {
        0 => "No layouts.".to_owned(),
        all => format!("{admitted} of {all} admitted"),
    };
    let refused = outcome.refused();
    if !refused.is_empty() {
        let by: Vec<_> = refused.iter().map(|(check, count)| format!("{check} {count}")).collect();
        let _ = write!(text, "; refused by check: {}", by.join(", "));
    }
    let usage = &outcome.usage;
    let seconds = outcome.took.as_secs_f64();
    let _ = write!(text, ". The designer {} took {seconds:.1} s", outcome.designer);
    if usage.rounds > 1 {
        let _ = write!(text, " and {} rounds", usage.rounds);
    }
    if let Some(model) = &usage.model {
        let _ =
            write!(text, ", {} {} tokens in and {} out", one_line(model), usage.tokens_in, usage.tokens_out);
    }
    text.push('.');
    let troubles = outcome.troubles.iter().map(|trouble| textwrap::fill(&one_line(trouble), WIDTH));
    std::iter::once(textwrap::fill(&text, WIDTH)).chain(troubles).collect::<Vec<_>>().join("\n")
}

/// A stranger's words as one line of a terminal: nothing in it moves the cursor or changes colours.
pub(super) fn one_line(words: &str) -> String {
    words.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}
