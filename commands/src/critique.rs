//! `sparring critique`: explains the failures and actions of one episode.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, anyhow, bail};
use clap::ArgMatches;
use clap::parser::ValueSource;
use env_core::critique::{ActionVerdict, Critique, Encounter, Failure, Verdict};
use env_core::log::Precision;
use env_core::rollout::{read_log, replay, roll_out};
use env_core::{ActionLog, Bracket, EpisodeOutcome, Scenario, StopReason, SuccessRule, admission};
use serde::Deserialize;
use serde_json::{Value, json};

use super::output::{Column, JsonFlag, Report, TextTable, print_json, print_report};
use crate::files;
use env_core::frames::{FrameContent, FrameRange, frames};
use strict_input::{InputError, InputLimits, ParsedInput};

/// Explain why an episode lost score, and what each of its actions was worth.
///
/// The episode is a scenario together with its recorded actions, or a scenario that a built-in policy runs now. The result
/// lists each failure: its step and agent, its angle (the bearing of a body that was met, or the orbit angle), what was lost, and
/// whether or how another action would have avoided it. Each action is compared with the same episode without it (needed, harmless, wasteful or
/// harmful). The deterministic judge scores each step from −1 to 1.
#[derive(Debug, clap::Args)]
#[command(after_help = AFTER_HELP)]
pub struct Args {
    /// JSON file with a scenario, or with an episode (scenario and actions) as the server returns it
    #[arg(value_name = "FILE")]
    scenario: PathBuf,
    /// JSON file with the recorded actions
    #[arg(long, value_name = "FILE", conflicts_with = "policy")]
    actions: Option<PathBuf>,
    /// Run this built-in policy instead: hold, random, blind, frozen, heuristic or reference
    #[arg(long, value_name = "NAME")]
    policy: Option<String>,
    /// Seed of the random choices of --policy [default: 0]
    #[arg(long)]
    seed: Option<u64>,
    /// Also write the telemetry with the observations to this file, one JSON object per step and line
    #[arg(long, value_name = "FILE")]
    telemetry: Option<PathBuf>,
    #[command(flatten)]
    output: JsonFlag,
}

impl Args {
    /// Ignores a policy of the configuration file beside actions of the command line, and a seed of the file without a policy.
    pub fn apply_precedence(&mut self, matches: &ArgMatches) {
        let is_from_file = |flag: &str| matches.value_source(flag) == Some(ValueSource::DefaultValue);
        if is_from_file("policy") && self.actions.is_some() && !is_from_file("actions") {
            self.policy = None;
        }
        if self.policy.is_none() && is_from_file("seed") {
            self.seed = None;
        }
    }
}

const AFTER_HELP: &str = "\
A scenario is {\"task\": \"kessler/survival\", \"params\": {\"debris\": 100}, \"seed\": 7}; task and seed are required, \
params, physics and layout have defaults. Actions are {\"steps\": [[[0, 0.1, 0.0]], [], …], \"precision\": \"f64\", \
\"stopped\": null}, the format of reported results, or only the list of steps. A response of \
GET /v1/runs/{run}/episodes/{episode} is a valid FILE and contains the actions.

Columns: bearing is the direction of the body seen from the agent min(5, step) steps before the encounter (or when it became \
visible, if that is later), in degrees from radial out towards in-track; orbit angle is that of the satellite from local noon, in \
degrees in the direction of motion; left is the number of steps from then on in which an \
agent could act; avoidable says whether an action from then on, within the remaining fuel, would have helped; remedy is the \
cheapest such action that was found. gain is the score with the action minus the score without it.

Each line of the telemetry is a frame {step, actions, reward, done, state, observation}: first the start, then one frame per \
step. state is the true state with hidden bodies, observation what the agents observed. Conjunction warnings are included if \
the scenario enables them: {\"task\": \"kessler/survival\", \"seed\": 7, \"physics\": {\"warnings\": \"exact\"}}.

JSON (--json): one object {scenario_id, task, outcome, skill, success, floor, reference, failures, actions, assessment}; \
skill, success, floor and reference are null if the start is not fair.

Examples:
  sparring critique scenario.json --policy hold
  sparring critique scenario.json --actions flown.json --json
  sparring critique scenario.json --policy hold --telemetry flight.jsonl
  jq .observation.conjunctions flight.jsonl
  curl -s http://127.0.0.1:8700/v1/runs/my-run/episodes/ep_42-x7k2p9_3 | \\
      sparring critique /dev/stdin";

/// Actions listed at most in the table.
const MAX_LISTED_ACTIONS: usize = 24;

/// Criticises an episode and prints the result.
///
/// # Errors
/// Returns an error if a file cannot be read, the policy does not exist, or the actions do not belong to the scenario.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let file = read(&args.scenario)?;
    let context = || args.scenario.display().to_string();
    // An episode of the server has its scenario in a field; a scenario file is the scenario itself.
    let scenario = Scenario::from_json(file.get("scenario").unwrap_or(&file)).with_context(context)?;
    let log = action_log(args, &scenario, file.get("scenario").and_then(|_| file.get("actions")))?;
    let flown = replay(&scenario, &log)?;
    if let Some(path) = &args.telemetry {
        for input in std::iter::once(&args.scenario).chain(&args.actions) {
            let written = path.canonicalize().ok();
            anyhow::ensure!(
                written.is_none() || written != input.canonicalize().ok(),
                "--telemetry: {} is an input file; choose another file",
                path.display()
            );
        }
        write_frames(&scenario, &log, path)?;
    }
    let report = CritiqueReport {
        critique: scenario.task().critique(&scenario, &log)?,
        bracket: admission::admit(&scenario).bracket,
        scenario,
        flown,
    };
    if args.output.json {
        print_json(&report.json())?;
    } else {
        print_report(&report.text_report())?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Writes the frames of the episode, one per line.
fn write_frames(scenario: &Scenario, log: &ActionLog, path: &Path) -> anyhow::Result<()> {
    // A file has no size limit; only HTTP responses are bounded.
    let frames = frames(scenario, log, FrameContent::Telemetry, FrameRange::all(usize::MAX))?;
    let fault = |error: std::io::Error| files::write_fault(path, &error);
    let mut out = BufWriter::new(File::create(path).map_err(fault)?);
    for frame in frames {
        serde_json::to_writer(&mut out, &frame).map_err(|error| fault(error.into()))?;
        out.write_all(b"\n").map_err(fault)?;
    }
    out.flush().map_err(fault)
}

fn read(path: &Path) -> anyhow::Result<Value> {
    let text = files::read(path)?;
    let parsed = strict_input::parse_json(&text, InputLimits::FILE).and_then(ParsedInput::finite);
    parsed.map_err(|error| match error {
        InputError::Malformed(why) => anyhow!("{} is not JSON: {why}", path.display()),
        InputError::TooLarge(why) => anyhow!("{} is too large: {why}", path.display()),
        InputError::Field(fault) => anyhow!("{}: {fault}", path.display()),
    })
}

/// Returns the actions: rolled out by a policy, from their own file, or from the scenario's file.
fn action_log(args: &Args, scenario: &Scenario, embedded: Option<&Value>) -> anyhow::Result<ActionLog> {
    if let Some(name) = &args.policy {
        let mut policy = scenario.task().policy(name, scenario, args.seed.unwrap_or(0))?;
        return Ok(roll_out(scenario, &mut *policy)?.log);
    }
    if let Some(seed) = args.seed {
        bail!("--seed {seed} needs --policy NAME");
    }
    let (actions, path) = match (&args.actions, embedded.filter(|value| !value.is_null())) {
        (Some(path), _) => (read(path)?, path),
        (None, Some(value)) => (value.clone(), &args.scenario),
        (None, None) => {
            bail!("{} contains no actions: add --actions FILE or --policy NAME", args.scenario.display())
        }
    };
    parse_actions(scenario, actions).with_context(|| path.display().to_string())
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ActionsFile {
    steps: Vec<Value>,
    #[serde(default)]
    precision: Option<String>,
    #[serde(default)]
    stopped: Option<String>,
}

pub(crate) fn parse_actions(scenario: &Scenario, value: Value) -> anyhow::Result<ActionLog> {
    let actions = match value {
        Value::Array(steps) => ActionsFile { steps, precision: None, stopped: None },
        other => strict_input::from_value(other)?,
    };
    let precision = match actions.precision.as_deref() {
        None | Some("f64") => Precision::F64,
        Some("f32") => Precision::F32,
        Some(other) => bail!("precision is {other:?}; choose f32 or f64"),
    };
    let stopped = match actions.stopped.as_deref() {
        None => None,
        Some(word) => Some(StopReason::from_name(word).ok_or_else(|| {
            anyhow!("stopped is {word:?}; choose one of unparsable, too_long, too_late, or leave it out")
        })?),
    };
    Ok(read_log(scenario, &actions.steps, precision, stopped)?)
}

/// Episode with its critique and bracket.
struct CritiqueReport {
    scenario: Scenario,
    flown: EpisodeOutcome,
    bracket: Option<Bracket>,
    critique: Critique,
}

impl CritiqueReport {
    fn success(&self) -> Option<bool> {
        let bracket = self.bracket.as_ref()?;
        Some(admission::is_success(&self.scenario, SuccessRule::Task, bracket, &self.flown))
    }

    fn skill(&self) -> Option<f64> {
        self.bracket.as_ref().and_then(|bracket| bracket.skill(self.flown.score))
    }

    fn json(&self) -> Value {
        json!({
            "scenario_id": self.scenario.id().to_string(),
            "task": self.scenario.task().id(),
            "outcome": store::brackets::StoredOutcome::from(self.flown),
            "skill": self.skill(),
            "success": self.success(),
            "floor": self.bracket.as_ref().map(|b| b.floor),
            "reference": self.bracket.as_ref().map(|b| b.reference.score),
            "failures": self.critique.failures,
            "actions": self.critique.actions,
            "assessment": self.critique.assessment,
        })
    }

    fn text_report(&self) -> Report {
        let mut report = Report::default();
        report.paragraph(self.outcome());
        if self.critique.failures.is_empty() {
            report.paragraph("No failures.");
        } else {
            report.table(self.failures());
            let words = self.critique.failures.iter().map(|failure| failure.explanation.as_str());
            for words in words.filter(|words| !words.is_empty()) {
                report.line(words);
            }
        }
        add_verdicts(&mut report, &self.critique.actions);
        let judged = &self.critique.assessment;
        let words = format!("Judge: {:+.2}, {}. {}", judged.value, judged.case, judged.explanation);
        report.paragraph(words.trim_end());
        report
    }

    fn outcome(&self) -> String {
        let EpisodeOutcome { score, steps, lost, fuel_used, time_s, .. } = self.flown;
        let task = self.scenario.task();
        let agents = task.agents(self.scenario.recipe());
        let mut text = format!("{}: score {score:.3}, {lost} of {agents} lost, {steps} steps", task.id());
        // A world that measures time spends no fuel.
        text += &match time_s {
            Some(time_s) => format!(" in {time_s:.0} s"),
            None => format!(", fuel used {fuel_used:.2}"),
        };
        if let Some(bracket) = &self.bracket {
            text += &format!("; floor {:.3}, reference {:.3}", bracket.floor, bracket.reference.score);
        }
        if let Some(skill) = self.skill() {
            text += &format!(", skill {skill:.2}");
        }
        if let Some(success) = self.success() {
            text += if success { "; a success" } else { "; no success" };
        }
        text + "."
    }

    fn failures(&self) -> TextTable {
        let task = self.scenario.task();
        let unit = task.speed_bands().unit;
        let columns = vec![
            Column::text("failure"),
            Column::text("avoidable"),
            Column::text("remedy").optional(3),
            Column::number("step"),
            Column::number("agent"),
            Column::number(task.sector_quantity().name),
            Column::number(format!("speed, {unit}")).optional(1),
            Column::number("seen").optional(2),
            Column::number("left").optional(2),
        ];
        table_without_empty_columns(columns, self.critique.failures.iter().map(failure_row).collect())
    }
}

/// Builds a table without the columns in which every cell is empty.
fn table_without_empty_columns(columns: Vec<Column>, rows: Vec<Vec<String>>) -> TextTable {
    let is_used = |column: usize| rows.iter().any(|row| row.get(column).is_some_and(|cell| !cell.is_empty()));
    let used: Vec<bool> = (0..columns.len()).map(is_used).collect();
    let mut table = TextTable::new(columns.into_iter().zip(&used).filter(|(_, used)| **used).map(|(c, _)| c));
    for row in rows {
        table.add_row(row.into_iter().zip(&used).filter(|(_, used)| **used).map(|(cell, _)| cell));
    }
    table
}

fn failure_row(failure: &Failure) -> Vec<String> {
    let met = failure.encounter.as_ref();
    let of = |what: fn(&Encounter) -> String| met.map_or_else(String::new, what);
    // A failure without an encounter, such as a crash on the Earth, has the same values as measures.
    let measure = |name: &str| failure.measures.iter().find(|m| m.name == name).map(|m| m.value);
    let yes_or_no = |yes: bool| if yes { "yes" } else { "no" }.to_owned();
    let avoidable = match met {
        Some(met) => met.avoidable.map_or_else(|| "never seen".to_owned(), yes_or_no),
        None => measure("avoidable").map_or_else(String::new, |share| yes_or_no(share > 0.0)),
    };
    let remedy = match met {
        Some(met) => met.cheapest_avoidance.as_ref().map(|remedy| {
            let values: Vec<_> = remedy.values.iter().map(|v| format!("{v:.3}")).collect();
            format!("step {}: {} for {:.2}", remedy.step, values.join(" "), remedy.cost)
        }),
        None => measure("cheapest_step")
            .zip(measure("cheapest_cost"))
            .map(|(step, cost)| format!("step {step:.0}: for {cost:.2}")),
    };
    vec![
        failure.mode.to_owned(),
        avoidable,
        remedy.unwrap_or_default(),
        failure.step.to_string(),
        failure.agent.to_string(),
        failure.sector_deg().map_or_else(String::new, |angle| format!("{angle:.0}°")),
        of(|e| format!("{:.2}", e.relative_speed)),
        of(|e| e.first_visible_step.map_or_else(String::new, |step| step.to_string())),
        of(|e| e.steps_left.to_string()),
    ]
}

const fn verdict_name(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Needed => "needed",
        Verdict::Harmless => "harmless",
        Verdict::Wasteful => "wasteful",
        Verdict::Harmful => "harmful",
    }
}

/// Adds the counts of verdicts and the actions with the largest gain or loss.
fn add_verdicts(report: &mut Report, actions: &[ActionVerdict]) {
    if actions.is_empty() {
        report.paragraph("No action was judged.");
        return;
    }
    // A world without fuel has no costs.
    let has_costs = actions.iter().any(|action| action.cost != 0.0);
    let cost_text = |cost: f64| if has_costs { format!("{cost:.2}") } else { String::new() };
    let sums = [Verdict::Needed, Verdict::Harmless, Verdict::Wasteful, Verdict::Harmful].map(|verdict| {
        let of = || actions.iter().filter(|action| action.verdict == verdict);
        // The sum of an empty iterator is −0.
        let cost = of().map(|action| action.cost).sum::<f64>() + 0.0;
        vec![verdict_name(verdict).to_owned(), of().count().to_string(), cost_text(cost)]
    });
    let columns = vec![Column::text("verdict"), Column::number("actions"), Column::number("cost")];
    let sums = table_without_empty_columns(columns, sums.to_vec());
    let mut listed: Vec<&ActionVerdict> = actions.iter().collect();
    listed.sort_by(|a, b| b.gain.abs().total_cmp(&a.gain.abs()).then(b.cost.total_cmp(&a.cost)));
    listed.truncate(MAX_LISTED_ACTIONS);
    listed.sort_by_key(|action| (action.step, action.agent));
    let columns = vec![
        Column::text("verdict"),
        Column::number("step"),
        Column::number("agent"),
        Column::number("cost"),
        Column::number("gain"),
    ];
    let row = |action: &&ActionVerdict| {
        let ActionVerdict { step, agent, cost, verdict, gain } = **action;
        let name = verdict_name(verdict).to_owned();
        vec![name, step.to_string(), agent.to_string(), cost_text(cost), format!("{gain:+.3}")]
    };
    let table = table_without_empty_columns(columns, listed.iter().map(row).collect());
    report.separate_table(sums).separate_table(table);
    let hidden = actions.len() - listed.len();
    if hidden > 0 {
        report.line(format!("{hidden} more with less effect; --json lists all of them."));
    }
}

#[cfg(test)]
mod tests;
