//! `sparring simulate-curriculum`: simulates curricula with learners of known ability. The simulation itself lives in
//! `curriculum::simulation`; [`table`] and [`picture`] print its results.

mod picture;
mod table;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::anyhow;
use clap::builder::PossibleValuesParser;
use rayon::prelude::*;
use serde::Serialize;
use serde_json::Value;

use super::names;
use super::output::{self, JsonFlag};
use crate::files;
use curriculum::simulation::{
    Learner, LearnerKind, SimulationPlan, SimulationSummary, SimulationTrace, TrainerKind, simulate,
};
use curriculum::{Hyperparameters, Settings, StrategyKind, Target, TaskPlan};

const ALL: &str = "all";

/// Simulate a curriculum with learners of known ability.
///
/// No world is stepped: a scenario is only a difficulty, in rows of its task's table of levels. A learner succeeds on contested
/// scenarios with a probability that falls from one to zero around its ability: with ability 4 it succeeds on half of the
/// contested scenarios of level 4. Strategies, event fold, settings and rules are those of the service. A simulation of
/// 20 000 episodes takes a fraction of a second.
///
/// One strategy with one learner prints its course; several print one line each.
#[derive(Debug, clap::Args)]
#[command(after_help = after_help())]
pub struct Args {
    /// Strategies to simulate, each once, or `all`
    #[arg(long = "strategy", value_name = "STRATEGY", value_delimiter = ',', default_value = "ladder",
          value_parser = PossibleValuesParser::new(strategy_names()))]
    strategies: Vec<String>,
    /// Learners to simulate, each once, or `all`
    #[arg(long = "learner", value_name = "LEARNER", value_delimiter = ',', default_value = ALL,
          value_parser = PossibleValuesParser::new(learner_names()))]
    learners: Vec<String>,
    /// Trainers that report the learners' results, each once, or `all`
    #[arg(long = "trainer", value_name = "TRAINER", value_delimiter = ',', default_value = "honest",
          value_parser = PossibleValuesParser::new(trainer_names()))]
    trainers: Vec<String>,
    /// Success rate of a learner that never changes, from 0 to 1, instead of `--learner`
    #[arg(long, value_name = "RATE", value_parser = success_rate, conflicts_with = "learners")]
    success: Option<f64>,
    /// Tasks whose tables of levels are used
    #[arg(long = "task", value_name = "TASK", value_delimiter = ',', default_values_t = default_tasks(),
          value_parser = names::parse_task)]
    tasks: Vec<String>,
    /// Number of episodes of each simulation
    #[arg(long, value_name = "N", default_value_t = 20_000, value_parser = clap::value_parser!(u64).range(1..=10_000_000))]
    episodes: u64,
    /// Number of episodes of a group
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1024))]
    group_size: u32,
    /// Target of the ladder [default: half if groups have more than one episode, otherwise mastery]
    #[arg(long, value_parser = ["mastery", "half"])]
    target: Option<String>,
    /// Start at level 0 and skip the placement
    #[arg(long)]
    no_placement: bool,
    /// Set a setting of the strategy, such as replay=0.5; repeat the flag to set several
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = setting)]
    set: Vec<(String, Value)>,
    /// Number of proposals that are queued ahead
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(0..=10_000))]
    ahead: u32,
    /// Seed of the simulation
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Also write a chart to this SVG file
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    #[command(flatten)]
    output: JsonFlag,
}

fn strategy_names() -> Vec<&'static str> {
    [ALL].into_iter().chain(StrategyKind::ALL.map(StrategyKind::name)).collect()
}

fn learner_names() -> Vec<&'static str> {
    [ALL].into_iter().chain(LearnerKind::ALL.map(LearnerKind::name)).collect()
}

fn trainer_names() -> Vec<&'static str> {
    [ALL].into_iter().chain(TrainerKind::ALL.map(TrainerKind::name)).collect()
}

fn success_rate(text: &str) -> Result<f64, String> {
    let rate = text.parse().ok().filter(|rate| (0.0..=1.0).contains(rate));
    rate.ok_or_else(|| "must be a number from 0 to 1".to_owned())
}

fn default_tasks() -> Vec<String> {
    env_core::default_tasks().iter().map(|task| task.id().to_owned()).collect()
}

fn setting(text: &str) -> Result<(String, Value), String> {
    let (name, value) = text.split_once('=').ok_or("a setting must be NAME=VALUE, such as replay=0.5")?;
    let value = serde_json::from_str(value).unwrap_or_else(|_| Value::from(value));
    Ok((name.to_owned(), value))
}

fn after_help() -> String {
    let mut text = "Strategies, with their settings and defaults:".to_owned();
    for kind in StrategyKind::ALL {
        text.push_str(&format!("\n  {}: {}", kind.name(), kind.description()));
        let settings = kind.hyperparameters().iter().map(|hyper| match hyper.range.default_json() {
            Value::String(word) => format!("{}={word}", hyper.name),
            value => format!("{}={value}", hyper.name),
        });
        let settings: Vec<String> = settings.collect();
        if !settings.is_empty() {
            text.push_str(&format!(" ({})", settings.join(", ")));
        }
    }
    text.push_str("\n\nLearners:");
    for kind in LearnerKind::ALL {
        text.push_str(&format!("\n  {}: {}", kind.name(), kind.description()));
    }
    text.push_str("\n\nTrainers:");
    for kind in TrainerKind::ALL {
        text.push_str(&format!("\n  {}: {}", kind.name(), kind.description()));
    }
    text + AFTER_HELP
}

const AFTER_HELP: &str = "

Columns: ability is the learner's final ability and difficulty the mean difficulty of its scenarios over the last tenth, both in \
levels and averaged over the tasks. success, contested (success on contested scenarios) and zero variance (share of zero-variance \
groups) are of the second half of the groups that the learner learnt from. learnt from is the share of those groups among all, up \
and down count level moves, and placed after is the episode after which every task was placed. With several trainers, level is the \
mean level, shown the mean of the mastery that the run shows, true the success rate of the slots behind it, and missing the share of \
missing outcomes.

JSON (--json): one object {episodes, group_size, tasks, seed, simulations}, each simulation {strategy, learner, trainer, summary, moves}.

Examples:
  sparring simulate-curriculum --strategy ladder --learner fast
  sparring simulate-curriculum --strategy all --learner slow,fast \\
      --svg curricula.svg
  sparring simulate-curriculum --strategy plr --learner fast \\
      --set score=learnability --set replay=0.5
  sparring simulate-curriculum --success 0.5 --trainer all \\
      --group-size 1 --no-placement";

/// Finished simulation of one strategy with one learner.
#[derive(Debug)]
pub(super) struct CompletedSimulation {
    strategy: StrategyKind,
    learner: LearnerName,
    trainer: TrainerKind,
    track: SimulationTrace,
    summary: SimulationSummary,
}

/// Runs the simulations and prints their results.
///
/// # Errors
/// Returns an error if a setting is invalid or a file cannot be written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    output::reject_duplicates("--strategy", &args.strategies)?;
    output::reject_duplicates("--learner", &args.learners)?;
    output::reject_duplicates("--trainer", &args.trainers)?;
    args.svg.as_deref().map_or(Ok(()), files::check_writable)?;
    let bar = output::progress_bar(combinations(args).len(), "simulations")?;
    let simulated = simulate_all(args, &|| bar.inc(1))?;
    bar.finish_and_clear();
    if args.output.json {
        output::print_json(&report(args, &simulated))?;
    } else {
        output::print_report(&table::text_report(&simulated, args.episodes))?;
    }
    if let Some(path) = &args.svg {
        let drawn = picture::draw(&simulated, args.episodes).map_err(|error| anyhow!("{error}"))?;
        files::write(path, drawn)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Learner of a simulation: one that learns, or one with a constant success rate.
#[derive(Debug, Clone, Copy, PartialEq)]
enum LearnerName {
    Kind(LearnerKind),
    Constant(f64),
}

impl LearnerName {
    fn learner(self, tasks: &[String]) -> Learner {
        match self {
            Self::Kind(kind) => Learner::new(kind, tasks),
            Self::Constant(success) => Learner::constant(success),
        }
    }
}

impl std::fmt::Display for LearnerName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Kind(kind) => f.write_str(kind.name()),
            Self::Constant(success) => write!(f, "success {success}"),
        }
    }
}

/// Strategy, learner and trainer of a simulation.
#[derive(Debug, Clone, Copy)]
struct Combination {
    strategy: StrategyKind,
    learner: LearnerName,
    trainer: TrainerKind,
}

/// Returns every requested strategy with every requested learner and trainer.
fn combinations(args: &Args) -> Vec<Combination> {
    let learners: Vec<LearnerName> = match args.success {
        Some(success) => vec![LearnerName::Constant(success)],
        None => {
            let kinds = kinds(&args.learners, LearnerKind::ALL, LearnerKind::name);
            kinds.into_iter().map(LearnerName::Kind).collect()
        }
    };
    let trainers = kinds(&args.trainers, TrainerKind::ALL, TrainerKind::name);
    let mut combinations = Vec::new();
    for strategy in kinds(&args.strategies, StrategyKind::ALL, StrategyKind::name) {
        for &learner in &learners {
            combinations.extend(trainers.iter().map(|&trainer| Combination { strategy, learner, trainer }));
        }
    }
    combinations
}

/// Runs all requested simulations in parallel; `done` is called after each.
fn simulate_all(args: &Args, done: &(dyn Fn() + Sync)) -> anyhow::Result<Vec<CompletedSimulation>> {
    let one = |Combination { strategy, learner, trainer }| {
        let plan = SimulationPlan { trainer, ..plan(args, strategy)? };
        let track = simulate(&plan, learner.learner(&args.tasks)).map_err(|error| anyhow!("{error}"))?;
        done();
        let summary = SimulationSummary::new(&track);
        Ok(CompletedSimulation { strategy, learner, trainer, summary, track })
    };
    combinations(args).into_par_iter().map(one).collect()
}

/// Returns the requested kinds, each once.
fn kinds<K: Copy, const N: usize>(names: &[String], all: [K; N], name_of: fn(K) -> &'static str) -> Vec<K> {
    let every = names.iter().any(|name| name == ALL);
    all.into_iter().filter(|kind| every || names.iter().any(|name| name == name_of(*kind))).collect()
}

fn plan(args: &Args, strategy: StrategyKind) -> anyhow::Result<SimulationPlan> {
    let tasks = args.tasks.iter().map(|task| TaskPlan::standard(task)).collect::<Result<Vec<_>, _>>();
    let hyperparameters: BTreeMap<String, Value> = args.set.iter().cloned().collect();
    let target = match args.target.as_deref() {
        Some("mastery") => Target::Mastery,
        Some(_) => Target::Half,
        None => Target::default_for_group_size(args.group_size),
    };
    let settings = Settings {
        target,
        placement: !args.no_placement,
        hyperparameters: Hyperparameters::parse(strategy, &hyperparameters)?,
        ..Settings::ladder(tasks?).with_strategy(strategy)
    };
    let (episodes, group_size, seed) = (args.episodes, args.group_size, args.seed);
    let (trainer, queue_length) = (TrainerKind::Honest, args.ahead as usize);
    Ok(SimulationPlan { settings, trainer, episodes, group_size, queue_length, seed })
}

#[derive(Serialize)]
struct SimulationReport<'a> {
    episodes: u64,
    group_size: u32,
    tasks: &'a [String],
    seed: u64,
    simulations: Vec<SimulationEntry<'a>>,
}

#[derive(Serialize)]
struct SimulationEntry<'a> {
    strategy: StrategyKind,
    learner: String,
    trainer: &'static str,
    summary: &'a SimulationSummary,
    moves: Vec<Value>,
}

fn report<'a>(args: &'a Args, simulated: &'a [CompletedSimulation]) -> SimulationReport<'a> {
    let one = |of: &'a CompletedSimulation| SimulationEntry {
        strategy: of.strategy,
        learner: of.learner.to_string(),
        trainer: of.trainer.name(),
        summary: &of.summary,
        moves: of
            .track
            .moves
            .iter()
            .map(|made| serde_json::json!({"episode": made.episodes_before, "move": made.level_move}))
            .collect(),
    };
    SimulationReport {
        episodes: args.episodes,
        group_size: args.group_size,
        tasks: &args.tasks,
        seed: args.seed,
        simulations: simulated.iter().map(one).collect(),
    }
}
