//! Output of the subcommands: results on stdout, progress on stderr, and checks of output arguments.
//!
//! [`report`] has prose and tables, [`table`] fits a table to the terminal, [`target`] knows the width of the terminal.

mod report;
mod table;
mod target;

use std::io::{ErrorKind, Write};

use anyhow::{Context, anyhow};
use indicatif::{ProgressBar, ProgressStyle};

pub use self::report::Report;
pub use self::table::{Column, TextTable};
pub use self::target::OutputTarget;

/// The flag `--json`, which all subcommands with results share.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub struct JsonFlag {
    /// Print the result as one JSON object
    #[arg(long)]
    pub json: bool,
}

/// Writes text to stdout. A closed stdout (`sparring … | head`) is no error.
///
/// # Errors
/// Returns an error if stdout cannot be written for another reason.
pub fn print(text: &str) -> anyhow::Result<()> {
    print_unless_closed(text).map(drop)
}

/// Writes text to stdout. Returns false if stdout is closed.
///
/// # Errors
/// Returns an error if stdout cannot be written for another reason.
pub fn print_unless_closed(text: &str) -> anyhow::Result<bool> {
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{}", text.trim_end()).and_then(|()| out.flush()) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(false),
        Err(error) => Err(error).context("stdout cannot be written"),
    }
}

/// Writes a report to stdout, formatted for its terminal or for a pipe.
///
/// # Errors
/// Returns an error if stdout cannot be written.
pub fn print_report(report: &Report) -> anyhow::Result<()> {
    print(&report.render(OutputTarget::stdout()))
}

/// Writes a JSON value to stdout as one line, so that programs can read stdout line by line.
///
/// # Errors
/// Returns an error if the value cannot be serialised or stdout cannot be written.
pub fn print_json(value: &impl serde::Serialize) -> anyhow::Result<()> {
    print(&serde_json::to_string(value)?)
}

/// Checks that a repeated flag names nothing twice.
///
/// # Errors
/// Returns an error that names the first duplicate.
pub fn reject_duplicates(flag: &str, names: &[String]) -> anyhow::Result<()> {
    let twice = names.iter().enumerate().find(|(at, name)| names[..*at].contains(name));
    twice.map_or(Ok(()), |(_, name)| Err(anyhow!("{flag} names {name} twice")))
}

/// Formats an error with its causes. A cause that the message before it already ends with is left out.
pub fn error_text(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if text.ends_with(&cause) {
            continue;
        }
        if !text.is_empty() {
            text.push_str(": ");
        }
        text.push_str(&cause);
    }
    text
}

/// Creates a progress bar on stderr; it is hidden if stderr is no terminal.
///
/// # Errors
/// Returns an error if the template of the bar is invalid.
pub fn progress_bar(length: usize, label: &'static str) -> anyhow::Result<ProgressBar> {
    let style = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len}, {eta} left")?;
    Ok(ProgressBar::new(length as u64).with_style(style).with_message(label))
}
