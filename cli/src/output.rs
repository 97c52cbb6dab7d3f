//! What subcommands print: results to stdout, progress to stderr.

use std::io::{ErrorKind, Write};
use std::path::Path;

use anyhow::{Context, anyhow};
use clap::ValueEnum;
use comfy_table::{CellAlignment, ContentArrangement, LineStyle, Table, TableStyle};
use indicatif::{ProgressBar, ProgressStyle};

/// How results are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Format {
    /// A table for people.
    Table,
    /// One JSON object for machines.
    Json,
}

/// Writes lines to stdout. A reader that has gone away (`sparring … | head`) has seen what it wanted.
pub(super) fn print(text: &str) -> anyhow::Result<()> {
    print_if_read(text).map(drop)
}

/// The same; false where nobody reads any more.
pub(super) fn print_if_read(text: &str) -> anyhow::Result<bool> {
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{}", text.trim_end()).and_then(|()| out.flush()) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(false),
        Err(error) => Err(error).context("stdout cannot be written"),
    }
}

/// The same for one JSON value, on one line: the last line of stdout is the object, for whoever reads line by line.
pub(super) fn print_json(value: &impl serde::Serialize) -> anyhow::Result<()> {
    print(&serde_json::to_string(value)?)
}

/// That nothing is asked for twice.
pub(super) fn once(flag: &str, asked: &[String]) -> anyhow::Result<()> {
    let twice = asked.iter().enumerate().find(|(at, name)| asked[..*at].contains(name));
    twice.map_or(Ok(()), |(_, name)| Err(anyhow!("{flag} names {name} twice")))
}

/// That there is a folder for a file which is written after long work.
pub(super) fn may_write(path: Option<&Path>) -> anyhow::Result<()> {
    let folder = path.and_then(Path::parent).filter(|folder| !folder.as_os_str().is_empty());
    match folder {
        Some(folder) if !folder.is_dir() => Err(anyhow!("there is no folder {}", folder.display())),
        _ => Ok(()),
    }
}

/// Lines above, under the header and below, and none between rows.
const STYLE: TableStyle = {
    let line = LineStyle::none().fill('─').junction('─');
    TableStyle::new().top_border(line).header_separator(line).bottom_border(line)
};

/// A table in the house's style: the first `words` columns to the left, numbers to the right.
pub(super) fn table(header: &[&str], words: usize) -> Table {
    let mut table = Table::new();
    table.load_style(STYLE).set_content_arrangement(ContentArrangement::Dynamic);
    if cfg!(test) {
        table.force_no_tty(); // a snapshot must not depend on the terminal it was taken in
    }
    table.set_header(header.to_vec());
    for index in words..header.len() {
        if let Some(column) = table.column_mut(index) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table
}

/// A progress bar on stderr; nothing where stderr is no terminal.
pub(super) fn progress(length: usize, what: &'static str) -> anyhow::Result<ProgressBar> {
    let style = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len}, {eta} left")?;
    Ok(ProgressBar::new(length as u64).with_style(style).with_message(what))
}
