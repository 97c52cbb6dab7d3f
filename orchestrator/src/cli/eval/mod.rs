//! `sparring eval`: policies on a frozen suite.

mod fly;
mod physics;
mod report;
#[cfg(test)]
mod tests;

use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::builder::PossibleValuesParser;

use self::fly::Row;
use self::physics::Physics;
use self::report::Report;
use super::options::{self, Chosen};
use super::output::{self, Format};
use super::suite::{Suite, file};
use super::worlds;

/// Fly policies over a frozen suite: one table, with 95 % intervals.
///
/// Every policy flies every scenario of the suite, whose seeds no training run is ever given. Two rows stand beside
/// those asked for: `frozen`, the task's trainable reflex at random numbers, and `blind_panel`, the mean of the plans
/// that look at nothing, from the suite's brackets. A policy that does not beat both has learnt nothing.
///
/// Columns are means over scenarios: the world's score; the share of successes by the task's own rule; skill, (score −
/// floor)/(reference − floor) within −1 to 1, over the scenarios where it is defined; the share of agents lost; and
/// fuel used by all agents together, in the world's unit. Intervals are 95 % percentile bootstrap intervals over scenarios, of 2 000
/// resamples. Contested scenarios (acting well matters on them) and those drawn as they come are told apart, then
/// together; there the suite decides how many are of which kind. All tasks together stand first where they are of one
/// world; scores and fuel of several have no common mean.
#[derive(Debug, clap::Args)]
#[command(after_help = after_help())]
pub struct Args {
    /// A built-in suite by its name, or a suite file
    #[arg(long, value_name = "NAME|FILE", default_value = file::DEFAULT)]
    suite: String,
    /// The policies, each once: repeat the option, or separate them by commas
    #[arg(long = "policy", value_name = "POLICY", required = true, value_delimiter = ',',
          value_parser = PossibleValuesParser::new(worlds::policy_names()))]
    policies: Vec<String>,
    /// What policies with chance in them and the resamples draw from
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// How often policies with chance in them fly each scenario: their mean counts as one
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rollouts: u32,
    /// Fly it under this physics option instead of the suite's, for all its tasks or those named; repeat it for more
    #[arg(long = "physics", value_name = "[TASK|WORLD:]NAME=CHOICE", value_parser = options::parse)]
    options: Vec<Chosen>,
    /// How the result is printed
    #[arg(long, value_enum, default_value = "table")]
    format: Format,
}

fn after_help() -> String {
    format!(
        "Policies:\n{}\n\nBuilt-in suites: {}.\n\n{}\n\n{AFTER_HELP}",
        worlds::policies_in_words(&worlds::policy_names()),
        file::names(),
        options::help()
    )
}

const AFTER_HELP: &str = "\
Under other options than the suite's, floors and references are worked out anew, so that skill and success are fair, and \
parts stay what they are in the suite. Such a report does not compare with one of the suite, and says so.

JSON (--format json): one object {suite, suite_hash, planner, physics, comparable, note, seed, rollouts, confidence, \
resamples, scenarios, rows}. physics are the options that were flown under instead of the suite's, by task; comparable is false \
where there are any, and note then says so in words. \
Each row: {task (an id, or \"all\" where the suite is of one world), part (\"contested\", \"as_they_come\" or \"all\"), policy, scenarios, score, success, \
skill, lost, fuel_used}, the last five as {mean, low, high, scenarios}; skill is null where it is nowhere defined.

Examples:
  sparring eval --policy heuristic
  sparring eval --suite docking-heldout-v1 --policy hold,blind,heuristic,reference --format json
  sparring eval --policy heuristic --physics contact=swept --physics gravity=j2
  sparring eval --suite my-suite-v1.json --policy frozen --rollouts 8 --seed 1";

/// Flies the policies and prints what they earned.
///
/// # Errors
/// A suite that cannot be used, or stdout that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let (suite, hash) = file::open(&args.suite).with_context(|| format!("suite {}", args.suite))?;
    check(&suite, args)?;
    let (suite, physics) = under(suite, args)?;
    let rows = fly_all(&suite, args)?;
    let report = Report::new(&suite, hash, args, physics, &rows);
    match args.format {
        Format::Table => output::print(&report.tables())?,
        Format::Json => output::print_json(&report)?,
    }
    Ok(ExitCode::SUCCESS)
}

/// The suite as it is to be flown, and how that is not as it was built.
fn under(suite: Suite, args: &Args) -> anyhow::Result<(Suite, Option<Physics>)> {
    let options = options::by_task(&args.options, &suite.tasks())?;
    let bar = output::progress(suite.entries().count(), "brackets")?;
    let other = physics::under(&suite, options, &bar)?;
    bar.finish_and_clear();
    Ok(match other {
        Some((other, physics)) => (other, Some(physics)),
        None => (suite, None),
    })
}

/// Every task of the suite must have every policy asked for: a row is flown on all of it.
fn check(suite: &Suite, args: &Args) -> anyhow::Result<()> {
    for group in &suite.groups {
        let task = group.recipe.task();
        let known: Vec<&str> = task.policies().iter().map(|spec| spec.name).collect();
        if let Some(name) = args.policies.iter().find(|name| !known.contains(&name.as_str())) {
            let (task, known) = (task.id(), known.join(", "));
            bail!("suite {} has scenarios of {task}, which has no policy {name}; it has {known}", suite.name);
        }
    }
    Ok(())
}

/// The policies asked for, then `frozen`, then the blind panel.
fn fly_all(suite: &Suite, args: &Args) -> anyhow::Result<Vec<Row>> {
    let mut names: Vec<&str> = Vec::new();
    for name in args.policies.iter().map(String::as_str).chain(["frozen"]) {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    let bar = output::progress(names.len() * suite.entries().count(), "episodes")?;
    let flown = names.into_iter().map(|name| fly::fly(suite, name, args.seed, args.rollouts, &bar));
    let mut rows = flown.collect::<anyhow::Result<Vec<_>>>()?;
    bar.finish_and_clear();
    rows.push(fly::blind_panel(suite));
    Ok(rows)
}
