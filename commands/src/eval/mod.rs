//! `sparring eval`: evaluates policies on a frozen suite.
//!
//! The evaluation itself lives in `evaluation`. [`physics`] changes the options of a suite, [`tables`] and
//! [`picture`] print the report.

mod physics;
mod picture;
mod tables;
#[cfg(test)]
mod tests;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::{Context, anyhow, bail};
use env_core::TaskSpec;
use env_core::policy::PolicyError;
use env_core::policy_factory::PolicyFactory;

use self::physics::ChangedPhysics;
use super::options::{self, ChosenOption};
use super::output::{self, JsonFlag};
use super::worlds;
use crate::files;
use evaluation::report::ReportSettings;
use evaluation::suite::Suite;
use evaluation::suite::file::{self, LoadedSuite};
use evaluation::suite_rollout::{SuiteRolloutSettings, roll_out_policy};
use evaluation::{EvaluationReport, PolicyResults};
use policy_files::PolicyReference;

/// Evaluate policies on a frozen suite, with 95 % confidence intervals.
///
/// Every policy runs every scenario of the suite; no training run gets the seeds of a suite. The table has two more rows for
/// comparison: `frozen`, the task's trainable reflex with random parameters, and `blind_panel`, the mean of the blind plans
/// from the suite's brackets. A policy that does not beat both has learnt nothing.
///
/// Columns are means over scenarios: the world's score; the share of successes by the task's rule; skill, (score −
/// floor)/(reference − floor) clamped to −1 to 1, over the scenarios where it is defined; the share of agents lost; and the
/// fuel used by all agents together, in the world's unit. Intervals are 95 % percentile bootstrap intervals over scenarios
/// with 2 000 resamples. If all scenarios or none are successes, resampling shows no variance, and the exact binomial
/// interval is used. Contested scenarios (on which acting well matters) and unselected ones are listed separately, then
/// together in the suite's proportion. If all tasks are of one world, the rows over all tasks come first; scores and fuel of
/// different worlds have no common mean.
///
/// The worst tenth is the mean score over the tenth of the scenarios with the lowest scores (CVaR). For a stochastic policy,
/// one half of its episodes selects these scenarios and the other half scores them, which avoids selection bias; this
/// needs --rollouts 8 or more. The last table lists paired differences from one policy on the same scenarios, which are far
/// more precise than the comparison of two intervals.
#[derive(Debug, clap::Args)]
#[command(after_help = after_help())]
pub struct Args {
    /// Name of a built-in suite, or path of a suite file
    #[arg(long, value_name = "NAME|FILE", default_value = file::DEFAULT_SUITE)]
    suite: String,
    /// Policies to evaluate, each once; repeat the flag or separate them by commas
    #[arg(long = "policy", value_name = "POLICY", required = true, value_delimiter = ',', value_parser = parse_policy)]
    policies: Vec<String>,
    /// Seed of stochastic policies and of the resampling
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Number of episodes of a stochastic policy per scenario; their mean is one value
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rollouts: u32,
    /// Policy to compare the others with [default: the first of --policy; frozen if there is only one]
    #[arg(long, value_name = "POLICY", value_parser = parse_against)]
    against: Option<String>,
    /// Also write a chart of the success rates to this SVG file
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    /// Override a physics option of the suite, for all its tasks or the named ones; repeat the flag to set several
    #[arg(long = "physics", value_name = "[TASK|WORLD:]NAME=CHOICE", value_parser = options::parse)]
    options: Vec<ChosenOption>,
    #[command(flatten)]
    output: JsonFlag,
}

/// Parses the name of a policy: a built-in one, or a file.
fn parse_policy(text: &str) -> Result<String, String> {
    let known = worlds::policy_names();
    if PolicyReference::parse(text).is_file() || known.contains(&text) {
        return Ok(text.to_owned());
    }
    Err(format!("must be one of {}, onnx:FILE or reflex:FILE", known.join(", ")))
}

/// Parses the policy to compare with, which may be the blind panel.
fn parse_against(text: &str) -> Result<String, String> {
    if text == BLIND_PANEL { Ok(text.to_owned()) } else { parse_policy(text) }
}

/// Name of the row of the blind plans.
const BLIND_PANEL: &str = "blind_panel";
/// Name of the untrained policy.
const FROZEN: &str = "frozen";

fn after_help() -> String {
    format!(
        "Policies:\n{}\n  onnx:FILE: a neural network in an ONNX file, as sparring.export_onnx of the Python package writes it\n  \
         reflex:FILE: the reflexes that a demo has learnt, in the output of `sparring demo --json`\n\nBuilt-in suites: {}.\n\n{}\n\n{AFTER_HELP}",
        worlds::describe_policies(&worlds::policy_names()),
        file::built_in_names(),
        options::help()
    )
}

const AFTER_HELP: &str = "\
With overridden physics options, floors and references are recomputed, so skill and success stay valid; the parts stay those of \
the suite. Such a report is not comparable with one of the unmodified suite, and says so.

JSON (--json): one object {suite, suite_hash, planner, physics, comparable, note, seed, rollouts, confidence, \
resamples, scenarios, rows, against, comparisons}. physics has the overridden options by task; comparable is false if there \
are any, and note then explains it. Each row: {task (an id, or \"all\" if the suite is of one world), part (\"contested\", \
\"as_they_come\" or \"all\"), policy, scenarios, score, success, skill, lost, fuel_used, cvar10}, the last six as {mean, low, \
high, scenarios}; skill is null if it is defined on no scenario, cvar10 if there are too few rollouts. Each comparison: {task, \
part, policy, scenarios, score, success, skill, improvement}, the last four in the same format: mean differences from the \
policy against, and the probability that an episode scores higher.

Examples:
  sparring eval --policy heuristic
  sparring eval --suite docking-heldout-v1 --policy hold,blind,heuristic --json
  sparring eval --policy heuristic --physics contact=swept --physics gravity=j2
  sparring eval --policy hold,random,heuristic --rollouts 8 \\
      --against heuristic --svg policies.svg
  sparring eval --suite my-suite-v1.json --policy frozen --rollouts 8
  sparring eval --policy onnx:model.onnx --against heuristic
  sparring demo --json --exit > demo.json
  sparring eval --policy reflex:demo.json";

/// Evaluates the policies and prints the report.
///
/// # Errors
/// Returns an error if the suite cannot be used, a policy cannot act in a task, or a file cannot be read or written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    output::reject_duplicates("--policy", &args.policies)?;
    args.svg.as_deref().map_or(Ok(()), files::check_writable)?;
    let LoadedSuite { suite, hash } =
        file::load_suite(&args.suite).with_context(|| format!("--suite {}", args.suite))?;
    let policies = open_policies(&suite, args)?;
    let (suite, physics) = with_physics(suite, args)?;
    let results = roll_out_policies(&suite, args, &policies)?;
    let report = build_report(&suite, hash, args, physics, &results);
    if args.output.json {
        output::print_json(&report)?;
    } else {
        output::print_report(&tables::text_report(&report))?;
    }
    if let Some(path) = &args.svg {
        let drawn = picture::draw(&report).map_err(|error| anyhow!("{error}"))?;
        files::write(path, drawn)?;
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

/// Opens the requested policies and the one they are compared with, then `frozen`, and checks that each can act in every task of the
/// suite, since a row covers the whole suite.
fn open_policies(suite: &Suite, args: &Args) -> anyhow::Result<Vec<Arc<dyn PolicyFactory>>> {
    let mut names: Vec<&str> = Vec::new();
    for name in args.policies.iter().chain(&args.against).map(String::as_str).chain([FROZEN]) {
        if !names.contains(&name) && name != BLIND_PANEL {
            names.push(name);
        }
    }
    let open = |name: &str| -> anyhow::Result<Arc<dyn PolicyFactory>> {
        let factory = policy_files::open(&PolicyReference::parse(name))
            .with_context(|| format!("the policy {name} cannot be used"))?;
        for task in suite.tasks() {
            check_policy(suite, task, &*factory)?;
        }
        Ok(factory)
    };
    names.into_iter().map(open).collect()
}

/// Checks that a policy can act in a task of the suite.
fn check_policy(
    suite: &Suite,
    task: &'static dyn TaskSpec,
    factory: &dyn PolicyFactory,
) -> anyhow::Result<()> {
    match factory.check(task) {
        Ok(()) => Ok(()),
        Err(PolicyError::Unknown { name, known }) => {
            bail!(
                "suite {} has scenarios of {}, which has no policy {name}; it has {known}",
                suite.name,
                task.id()
            )
        }
        Err(error) => {
            Err(error).with_context(|| format!("suite {} has scenarios of {}", suite.name, task.id()))
        }
    }
}

/// Evaluates the policies, then the blind panel.
fn roll_out_policies(
    suite: &Suite,
    args: &Args,
    policies: &[Arc<dyn PolicyFactory>],
) -> anyhow::Result<Vec<PolicyResults>> {
    let bar = output::progress_bar(policies.len() * suite.entries().count(), "episodes")?;
    let settings = SuiteRolloutSettings { seed: args.seed, rollouts: args.rollouts };
    let flown = policies.iter().map(|policy| roll_out_policy(suite, &**policy, settings, &|| bar.inc(1)));
    let mut flown = flown.collect::<Result<Vec<_>, _>>()?;
    bar.finish_and_clear();
    flown.push(PolicyResults::blind_panel(suite));
    Ok(flown)
}
