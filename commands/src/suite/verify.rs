//! `sparring suite verify`: recomputes a suite and compares it with its file.

use std::process::ExitCode;

use anyhow::Context;
use env_core::Bracket;
use indicatif::ProgressBar;
use rayon::prelude::*;

use crate::output;
use evaluation::suite::file::{self, LoadedSuite};
use evaluation::suite::{Suite, SuiteEntry, SuiteGroup, SuitePart};

/// Largest number of listed differences.
const MAX_LISTED_DIFFERENCES: usize = 10;

/// Recompute every id, every bracket and the hash of a suite, and compare them with the file.
///
/// The exit code is 1 on any difference. A difference means that the file was changed, or that the worlds or planners of this
/// build differ from those that built the suite: scores of this build would not be comparable.
#[derive(Debug, clap::Args)]
#[command(after_help = after_help())]
pub struct Args {
    /// Name of a built-in suite, or path of a suite file
    #[arg(value_name = "NAME|FILE", default_value = file::DEFAULT_SUITE)]
    suite: String,
}

fn after_help() -> String {
    format!("Built-in suites: {}.\n\n{AFTER_HELP}", file::built_in_names())
}

const AFTER_HELP: &str = "\
Examples:
  sparring suite verify
  sparring suite verify my-suite-v1.json";

/// Verifies a suite and prints the differences; a difference gives exit code 1.
///
/// # Errors
/// Returns an error if the file is no suite.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let LoadedSuite { suite, hash } = match file::load_suite(&args.suite) {
        Ok(loaded) => loaded,
        Err(error) if error.is_difference() => {
            output::print(&format!("{}: {error}", args.suite))?;
            return Ok(ExitCode::FAILURE);
        }
        Err(error) => return Err(error).context(format!("suite {}", args.suite)),
    };
    let count = suite.entries().count();
    let bar = output::progress_bar(count, "brackets")?;
    let differences = differences(&suite, &bar);
    bar.finish_and_clear();
    let mut text = String::new();
    for difference in differences.iter().take(MAX_LISTED_DIFFERENCES) {
        text.push_str(difference);
        text.push('\n');
    }
    if differences.len() > MAX_LISTED_DIFFERENCES {
        text.push_str(&format!("… and {} more\n", differences.len() - MAX_LISTED_DIFFERENCES));
    }
    let verdict = if differences.is_empty() { "all as stored" } else { "DIFFERENT" };
    text.push_str(&format!(
        "{}: {count} scenarios, hash {hash}; ids and hash right, {} of {count} brackets recomputed by planner {} \
         equal: {verdict}",
        suite.name,
        count - differences.len(),
        planner_versions(&suite)
    ));
    output::print(&text)?;
    Ok(if differences.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Lists the versions of the planners that made the brackets, as "1" or "1 and 2".
fn planner_versions(suite: &Suite) -> String {
    let mut versions: Vec<u32> = suite.groups.iter().filter_map(SuiteGroup::planner).collect();
    versions.sort_unstable();
    versions.dedup();
    versions.iter().map(u32::to_string).collect::<Vec<_>>().join(" and ")
}

/// Returns one sentence per scenario whose recomputed bracket differs from the stored one.
#[must_use]
pub fn differences(suite: &Suite, bar: &ProgressBar) -> Vec<String> {
    let entries: Vec<&SuiteEntry> = suite.entries().collect();
    entries
        .into_par_iter()
        .filter_map(|entry| {
            let found = difference(entry);
            bar.inc(1);
            found.map(|what| format!("{} ({}): {what}", entry.scenario.id(), entry.scenario.task().id()))
        })
        .collect()
}

fn difference(entry: &SuiteEntry) -> Option<String> {
    let stored = &entry.bracket;
    let found = match entry.scenario.task().bracket(&entry.scenario) {
        Ok(bracket) => Bracket { reference_plan: stored.reference_plan.clone(), ..bracket },
        Err(error) => return Some(error.to_string()),
    };
    let planners = (found.planner_version, stored.planner_version);
    let numbers = |b: &Bracket| format!("floor {}, reference {}", b.floor, b.reference.score);
    if planners.0 != planners.1 {
        Some(format!("planner {} in this build, {} stored", planners.0, planners.1))
    } else if found != *stored {
        let (computed, stored) = (numbers(&found), numbers(stored));
        let same = computed == stored;
        Some(if same {
            format!("{computed} as stored, but with other plans")
        } else {
            format!("{computed} computed, {stored} stored")
        })
    } else if entry.part == SuitePart::Contested
        && !env_core::admission::is_contested(&entry.scenario, stored)
    {
        Some("it is not contested".to_owned())
    } else {
        None
    }
}
