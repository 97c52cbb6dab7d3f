//! `sparring demo`: runs the whole training loop with a built-in learner.
//!
//! The demo creates a run on a server and trains over HTTP as any trainer would; the crate `cli` starts the server. [`train`] is the loop and the
//! place to start reading. [`learner`] holds the optimiser, [`trainee`] the population of one task, [`rollouts`] the episode
//! runner, [`feed`] and [`http`] the client of the service, [`show`] and [`summary`] the output.

mod designs;
mod feed;
mod http;
mod learner;
mod rollouts;
mod show;
mod summary;
#[cfg(test)]
mod tests;
mod train;
mod trainee;

use std::collections::BTreeMap;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use api_types::{DesignSettingsRequest, DesignerChoice, RunRequest, TaskSettingsRequest};
use clap::ValueEnum;
use curriculum::{StrategyKind, Target};
use env_core::{Recipe, World};

use self::http::HttpFeed;
use self::show::ProgressScreen;
use self::summary::DemoSummary;
use self::train::{MEMBERS, Progress, TrainingPlan, train};
use self::trainee::LearnerMode;
use super::interrupt::INTERRUPTED;
use super::interrupt::StopSignal;
use super::llm_args::LlmArgs;
use super::options::{self, ChosenOption, TaskOptions};
use super::output::OutputTarget;
use super::{names, output, worlds};

/// Train a built-in learner against the service, over HTTP as any trainer would.
///
/// The service listens on a free port of this machine; the first line of the output has the URL of its dashboard, which shows
/// the run live. The learner is the task's reflex policy: a rule with a few numeric
/// parameters and no search (in kessler: how far to look ahead, what to dodge, when, how hard, and in which direction).
/// The cross-entropy method improves the parameters from the reported scores; a population of 12 runs every scenario. The
/// learner starts at level 0 of every task and climbs as it masters them. At the end, the demo pauses its run. The controls
/// `hold`, `blind` and `frozen` (random parameters) show how far a run gets without learning.
#[derive(Debug, clap::Args)]
#[command(after_help = after_help())]
pub struct Args {
    /// Number of episodes over all tasks [default: 60 000, fewer for tasks with long episodes]
    #[arg(long, value_name = "N", value_parser = parse_episodes)]
    episodes: Option<usize>,
    /// Path of the database of the run; it is created if it does not exist
    #[arg(long, default_value = "sparring-demo.sqlite3", value_name = "PATH", conflicts_with = "url")]
    pub db: PathBuf,
    /// Use a temporary database that is deleted at the end; overrides --db
    #[arg(long, conflicts_with = "url")]
    pub temporary: bool,
    /// Exit after the training. Otherwise, on a terminal, the dashboard stays up until Ctrl-C
    #[arg(long)]
    exit: bool,
    /// Seed of the run's scenarios and of the learner, from 0 to 2^51 − 1
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(..1 << 51))]
    seed: u64,
    /// Learner or control that runs the episodes
    #[arg(long, value_enum, default_value = "learn")]
    learner: LearnerMode,
    /// Designer of layouts for the learner's weaknesses
    #[arg(long, value_enum, default_value = "auto")]
    designer: DesignerArg,
    /// Task to train on, such as survival or docking/single; repeat the flag for several [default: all tasks of the first
    /// world]
    #[arg(long = "task", value_name = "TASK", value_delimiter = ',', value_parser = names::parse_task)]
    tasks: Vec<String>,
    /// Set a physics option, for all tasks or the named ones; repeat the flag to set several
    #[arg(long = "physics", value_name = "[TASK|WORLD:]NAME=CHOICE", value_parser = options::parse)]
    options: Vec<ChosenOption>,
    /// Base URL of a running service to train against, such as http://127.0.0.1:8700 [default: start one]
    #[arg(long, value_name = "URL")]
    pub url: Option<String>,
    /// Print the result as one JSON object to stdout, and text to stderr
    #[arg(long)]
    json: bool,
    /// Language model of the designer.
    #[command(flatten)]
    pub llm: LlmArgs,
}

/// Designer of the run, under the names that the API uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum DesignerArg {
    /// The service's language model if it has one, otherwise the procedural designer
    Auto,
    /// Samples from the failure profile and edits what worked
    Procedural,
    /// No designer: only the curriculum chooses scenarios
    Off,
}

impl From<DesignerArg> for DesignerChoice {
    fn from(designer: DesignerArg) -> Self {
        match designer {
            DesignerArg::Auto => Self::Auto,
            DesignerArg::Procedural => Self::Procedural,
            DesignerArg::Off => Self::Off,
        }
    }
}

/// Largest default number of episodes; runs of the shortest tasks use it.
const MAX_EPISODES: usize = 60_000;
/// Environment steps that the default number of episodes aims at, if every episode reaches its horizon.
const STEP_BUDGET: usize = 6_000_000;
/// Smallest default number of episodes: one level takes two blocks of 32 contested scenarios with 12 episodes each.
const MIN_EPISODES: usize = 20_000;

fn after_help() -> String {
    format!(
        "\
Controls:
{}

Default of --episodes: as many as fit {} million steps at the longest horizon of the tasks, but at least {MIN_EPISODES} and \
at most {MAX_EPISODES}: {}.

{}

{AFTER_HELP}",
        worlds::describe_policies(&["hold", "blind", "frozen"]),
        STEP_BUDGET / 1_000_000,
        describe_default_episodes(),
        options::help()
    )
}

/// Describes the default number of episodes of each world.
fn describe_default_episodes() -> String {
    let world = |world: &'static dyn World| {
        let tasks: Vec<String> = world.tasks().iter().map(|task| task.id().to_owned()).collect();
        format!("{} for {}", default_episodes(&tasks), world.name())
    };
    env_core::worlds().map(world).collect::<Vec<_>>().join(", ")
}

const AFTER_HELP: &str = "\
Progress goes to stderr: a live table on a terminal, otherwise a line every five seconds and one per change of level. Ctrl-C \
stops after the current batch; the summary is still printed, and the exit code is 130.

JSON (--json), the last output on stdout: one object {learner, seed, episodes, seconds, stopped, run, db, physics, designed, \
tasks}; physics has the requested options by task; designed is the share of groups with designed layouts. tasks has one \
object per task id: {level, episodes, success, success_q10, success_q90, success_scenarios, plain_success, score, skill, \
last_generation, generations, params, learnt, numbers, designs, moves, warnings}; success is the mean of the mastery estimate \
at the current level, over the last success_scenarios contested scenarios (0.5 without any); plain_success is over all episodes.

Examples:
  sparring demo
  sparring demo --learner frozen --seed 3
  sparring demo --task survival --physics contact=swept
  sparring demo --task survival --episodes 20000 --db run.sqlite3 --json";

pub(crate) fn parse_episodes(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(number @ 1..=100_000_000) => Ok(number),
        Ok(number) => Err(format!("{number} is outside 1 to 100000000")),
        Err(error) => Err(format!("{error}")),
    }
}

/// Server that the demo trains against.
#[derive(Debug)]
pub struct DemoServer {
    /// URL of the server.
    pub url: String,
    /// True if the demo started the server.
    pub is_own: bool,
    /// Path of the server's database, if the demo created it and keeps it.
    pub kept: Option<PathBuf>,
}

/// Checks the arguments before a database is created.
///
/// # Errors
/// Returns an error if a server would reject a physics option.
pub fn check(args: &Args) -> anyhow::Result<()> {
    check_options(args, &task_ids(args)).map(drop)
}

/// Trains, prints the summary, and on a terminal keeps the dashboard of an own server up until Ctrl-C.
///
/// # Errors
/// Returns an error if the server cannot be reached, or if it refuses a result.
pub async fn run(args: &Args, server: &DemoServer) -> anyhow::Result<ExitCode> {
    let (progress, run) = train_at(&server.url, args).await?;
    print_summary(args, &progress, &run, server.kept.as_deref())?;
    if progress.stopped {
        return Ok(ExitCode::from(INTERRUPTED));
    }
    if server.is_own && args.stays_up() {
        output::print(&format!("\nOpen {} (Ctrl-C to stop)", dashboard_url(&server.url, &run)))?;
        StopSignal::install()?.received().await?;
    }
    Ok(ExitCode::SUCCESS)
}

impl Args {
    /// Returns true if the dashboard stays up after the training.
    fn stays_up(&self) -> bool {
        !self.exit && !self.json && std::io::stdout().is_terminal() && std::io::stdin().is_terminal()
    }
}

/// Returns the URL of a run's page.
fn dashboard_url(service: &str, run: &str) -> String {
    format!("{}/dashboard/#/runs/{run}", service.trim_end_matches('/'))
}

fn print_summary(args: &Args, progress: &Progress, run: &str, db: Option<&Path>) -> anyhow::Result<()> {
    let report = summary::text_report(progress, run, db);
    if args.json {
        // A closed stderr must not suppress the JSON object.
        let _ = writeln!(std::io::stderr().lock(), "{}", report.render(OutputTarget::stderr()));
        output::print_json(&DemoSummary::new(progress, run, db))
    } else {
        output::print_report(&report)
    }
}

async fn train_at(url: &str, args: &Args) -> anyhow::Result<(Progress, String)> {
    let tasks = task_ids(args);
    let options = check_options(args, &tasks)?;
    let episodes = args.episodes.unwrap_or_else(|| default_episodes(&tasks));
    let feed = HttpFeed::create(url, &run_request(args, &tasks, &options)).await?;
    // A closed stderr loses progress lines and nothing else.
    let _ = writeln!(std::io::stderr().lock(), "Dashboard: {}", dashboard_url(url, feed.run()));
    let plan = TrainingPlan { kind: args.learner, seed: args.seed, episodes, tasks, options };
    let mut screen = ProgressScreen::new(episodes)?;
    let trained = train(&feed, plan, &mut screen, &stop_on_ctrl_c()).await;
    screen.close();
    let progress = trained?;
    if let Err(error) = feed.pause().await {
        // A token may not permit it: only admins pause runs.
        let _ =
            writeln!(std::io::stderr().lock(), "The run stays active, since it cannot be paused: {error:#}");
    }
    Ok((progress, feed.run().to_owned()))
}

/// Returns the physics options by task.
///
/// # Errors
/// Returns an error if a server would reject an option.
fn check_options(args: &Args, tasks: &[String]) -> anyhow::Result<TaskOptions> {
    let specs: Vec<_> = tasks.iter().filter_map(|task| env_core::task(task)).collect();
    let options = options::by_task(&args.options, &specs)?;
    for task in specs {
        options::apply(Recipe::new(task)?, options.get(task.id()))?;
    }
    Ok(options)
}

/// Returns the ids of the tasks to train on, each once.
fn task_ids(args: &Args) -> Vec<String> {
    if args.tasks.is_empty() {
        return env_core::default_tasks().iter().map(|task| task.id().to_owned()).collect();
    }
    let mut tasks = args.tasks.clone();
    tasks.sort_unstable();
    tasks.dedup();
    tasks
}

/// Returns the request that creates the demo's run.
fn run_request(args: &Args, tasks: &[String], options: &TaskOptions) -> RunRequest {
    let physics = |options: &BTreeMap<String, String>| TaskSettingsRequest {
        physics: Some(options.clone()),
        ..Default::default()
    };
    let learner =
        args.learner.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned());
    RunRequest {
        // Names and tags distinguish runs of the learner from those of its controls, and group them.
        name: Some(format!("sparring demo: {learner}, seed {}", args.seed)),
        tags: vec!["demo".to_owned(), format!("demo-{learner}")],
        seed: Some(args.seed),
        strategy: Some(StrategyKind::Ladder),
        target: Some(Target::Mastery),
        // Placement finds the level at which a trained agent should start. This learner is untrained: a probe of 16
        // scenarios would measure only its luck, and the luck of the controls.
        placement: Some(false),
        group_size: Some(MEMBERS as u32),
        tasks: Some(tasks.to_vec()),
        design: DesignSettingsRequest { designer: Some(args.designer.into()), ..Default::default() },
        task_settings: options.iter().map(|(&task, options)| (task.to_owned(), physics(options))).collect(),
        ..RunRequest::default()
    }
}

/// Returns the default number of episodes for these tasks, derived from their longest horizon.
fn default_episodes(tasks: &[String]) -> usize {
    let horizon = |task: &String| {
        let task = env_core::task(task)?;
        let recipe = Recipe::at_level(task, 0).ok()?;
        usize::try_from(task.horizon(&recipe)).ok()
    };
    let longest = tasks.iter().filter_map(horizon).max().unwrap_or(1);
    (STEP_BUDGET / longest.max(1)).clamp(MIN_EPISODES, MAX_EPISODES)
}

/// Returns a flag that the first Ctrl-C sets. The second Ctrl-C exits the process.
fn stop_on_ctrl_c() -> Arc<AtomicBool> {
    let stop = Arc::new(AtomicBool::new(false));
    let interrupted = Arc::clone(&stop);
    tokio::spawn(async move {
        while tokio::signal::ctrl_c().await.is_ok() {
            if interrupted.swap(true, Ordering::Relaxed) {
                std::process::exit(INTERRUPTED.into());
            }
        }
    });
    stop
}
