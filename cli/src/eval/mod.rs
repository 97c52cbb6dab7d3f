//! `sparring eval`: evaluates policies on a frozen suite.
//!
//! The evaluation itself lives in `orchestrator::evaluation`. [`physics`] changes the options of a suite, [`tables`] and
//! [`picture`] print the report.

mod physics;
mod picture;
mod tables;
#[cfg(test)]
mod tests;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, anyhow, bail};
use clap::builder::PossibleValuesParser;

use self::physics::ChangedPhysics;
use super::options::{self, ChosenOption};
use super::output::{self, Format};
use super::worlds;
use orchestrator::evaluation::report::ReportSettings;
use orchestrator::evaluation::suite::Suite;
use orchestrator::evaluation::suite::file::{self, LoadedSuite};
use orchestrator::evaluation::suite_rollout::{SuiteRolloutSettings, roll_out_policy};
use orchestrator::evaluation::{EvaluationReport, PolicyResults};

/// Fly policies over a frozen suite: one table, with 95 % intervals.
///
/// Every policy flies every scenario of the suite, whose seeds no training run is ever given. Two rows stand beside
/// those asked for: `frozen`, the task's trainable reflex at random numbers, and `blind_panel`, the mean of the plans
/// that look at nothing, from the suite's brackets. A policy that does not beat both has learnt nothing.
///
/// Columns are means over scenarios: the world's score; the share of successes by the task's own rule; skill, (score −
/// floor)/(reference − floor) within −1 to 1, over the scenarios where it is defined; the share of agents lost; and
/// fuel used by all agents together, in the world's unit. Intervals are 95 % percentile bootstrap intervals over scenarios, of 2 000
/// resamples; for successes on none or on all of them, the exact binomial interval, since there a resample can show no doubt. Contested scenarios (acting well matters on them) and those drawn as they come are told apart, then
/// together; there the suite decides how many are of which kind. All tasks together stand first where they are of one
/// world; scores and fuel of several have no common mean.
///
/// The worst tenth is the mean score over the tenth of the scenarios on which the policy does worst (CVaR). Where a policy has chance
/// in it these are found by one half of its episodes and told by the other, so that bad luck is not taken for weakness: that takes
/// --rollouts 8 or more. Below stand differences from one of the policies on the same scenarios, which say far more than two
/// intervals side by side.
#[derive(Debug, clap::Args)]
#[command(after_help = after_help())]
pub struct Args {
    /// A built-in suite by its name, or a suite file
    #[arg(long, value_name = "NAME|FILE", default_value = file::DEFAULT_SUITE)]
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
    /// The policy that the others are compared with (the first of --policy; frozen where there is one alone)
    #[arg(long, value_name = "POLICY", value_parser = PossibleValuesParser::new(against_names()))]
    against: Option<String>,
    /// Draw the shares of successes, too: an SVG file
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Fly it under this physics option instead of the suite's, for all its tasks or those named; repeat it for more
    #[arg(long = "physics", value_name = "[TASK|WORLD:]NAME=CHOICE", value_parser = options::parse)]
    options: Vec<ChosenOption>,
    /// How the result is printed
    #[arg(long, value_enum, default_value = "table")]
    format: Format,
}

fn against_names() -> Vec<&'static str> {
    worlds::policy_names().into_iter().chain([BLIND_PANEL]).collect()
}

/// Name of the row of the blind plans.
const BLIND_PANEL: &str = "blind_panel";
/// Name of the untrained policy.
const FROZEN: &str = "frozen";

fn after_help() -> String {
    format!(
        "Policies:\n{}\n\nBuilt-in suites: {}.\n\n{}\n\n{AFTER_HELP}",
        worlds::describe_policies(&worlds::policy_names()),
        file::built_in_names(),
        options::help()
    )
}

const AFTER_HELP: &str = "\
Under other options than the suite's, floors and references are worked out anew, so that skill and success are fair, and \
parts stay what they are in the suite. Such a report does not compare with one of the suite, and says so.

JSON (--format json): one object {suite, suite_hash, planner, physics, comparable, note, seed, rollouts, confidence, \
resamples, scenarios, rows, against, comparisons}. physics are the options that were flown under instead of the suite's, by task; comparable is false \
where there are any, and note then says so in words. \
Each row: {task (an id, or \"all\" where the suite is of one world), part (\"contested\", \"as_they_come\" or \"all\"), policy, scenarios, score, success, \
skill, lost, fuel_used, cvar10}, the last six as {mean, low, high, scenarios}; skill is null where it is nowhere defined, cvar10 where \
there were too few rollouts. Each comparison: {task, part, policy, scenarios, score, success, skill, improvement}, the last four as \
before: mean differences from the policy against, and how likely an episode scores higher.

Examples:
  sparring eval --policy heuristic
  sparring eval --suite docking-heldout-v1 --policy hold,blind,heuristic,reference --format json
  sparring eval --policy heuristic --physics contact=swept --physics gravity=j2
  sparring eval --policy hold,random,heuristic --rollouts 8 --against heuristic --svg policies.svg
  sparring eval --suite my-suite-v1.json --policy frozen --rollouts 8 --seed 1";

/// Evaluates the policies and prints the report.
///
/// # Errors
/// Returns an error if the suite cannot be used, a policy is missing in a task, or a file cannot be written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    output::reject_duplicates("--policy", &args.policies)?;
    output::check_folder_exists(args.svg.as_deref())?;
    let LoadedSuite { suite, hash } =
        file::load_suite(&args.suite).with_context(|| format!("suite {}", args.suite))?;
    check_policies(&suite, args)?;
    let (suite, physics) = with_physics(suite, args)?;
    let results = roll_out_policies(&suite, args)?;
    let report = build_report(&suite, hash, args, physics, &results);
    match args.format {
        Format::Table => output::print(&tables::tables(&report))?,
        Format::Json => output::print_json(&report)?,
    }
    if let Some(path) = &args.svg {
        let drawn = picture::draw(&report).map_err(|error| anyhow!("{error}"))?;
        std::fs::write(path, drawn).with_context(|| path.display().to_string())?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Builds the report and notes the physics that differ from the suite's.
fn build_report(
    suite: &Suite,
    hash: String,
    args: &Args,
    physics: Option<ChangedPhysics>,
    results: &[PolicyResults],
) -> EvaluationReport {
    let first = || match args.policies.as_slice() {
        [one] if one != FROZEN => Some(FROZEN.to_owned()),
        several => several.first().cloned(),
    };
    let settings = ReportSettings {
        seed: args.seed,
        rollouts: args.rollouts,
        against: args.against.clone().or_else(first),
    };
    let mut report = EvaluationReport::new(suite, hash, &settings, results);
    report.comparable = physics.is_none();
    report.note = physics.as_ref().map(ChangedPhysics::note);
    report.physics = physics.map(|physics| physics.options).unwrap_or_default();
    report
}

/// Returns the suite under the options of the command line, and the changed physics if there are any.
fn with_physics(suite: Suite, args: &Args) -> anyhow::Result<(Suite, Option<ChangedPhysics>)> {
    let options = options::by_task(&args.options, &suite.tasks())?;
    let bar = output::progress_bar(suite.entries().count(), "brackets")?;
    let changed = physics::change_physics(&suite, options, &bar)?;
    bar.finish_and_clear();
    Ok(match changed {
        Some((changed, physics)) => (changed, Some(physics)),
        None => (suite, None),
    })
}

/// Checks that every task of the suite has every requested policy, since a row covers the whole suite.
fn check_policies(suite: &Suite, args: &Args) -> anyhow::Result<()> {
    for group in &suite.groups {
        let task = group.recipe.task();
        let known: Vec<&str> = task.policies().iter().map(|spec| spec.name).collect();
        let asked = args.policies.iter().chain(args.against.iter().filter(|name| *name != BLIND_PANEL));
        if let Some(name) = asked.into_iter().find(|name| !known.contains(&name.as_str())) {
            let (task, known) = (task.id(), known.join(", "));
            bail!("suite {} has scenarios of {task}, which has no policy {name}; it has {known}", suite.name);
        }
    }
    Ok(())
}

/// Evaluates the requested policies and the one they are compared with, then `frozen`, then the blind panel.
fn roll_out_policies(suite: &Suite, args: &Args) -> anyhow::Result<Vec<PolicyResults>> {
    let mut names: Vec<&str> = Vec::new();
    for name in args.policies.iter().chain(&args.against).map(String::as_str).chain([FROZEN]) {
        if !names.contains(&name) && name != BLIND_PANEL {
            names.push(name);
        }
    }
    let bar = output::progress_bar(names.len() * suite.entries().count(), "episodes")?;
    let settings = SuiteRolloutSettings { seed: args.seed, rollouts: args.rollouts };
    let flown = names.into_iter().map(|name| roll_out_policy(suite, name, settings, &|| bar.inc(1)));
    let mut flown = flown.collect::<Result<Vec<_>, _>>()?;
    bar.finish_and_clear();
    flown.push(PolicyResults::blind_panel(suite));
    Ok(flown)
}
