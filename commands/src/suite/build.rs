//! `sparring suite build`: draws a suite of scenarios from the evaluation seeds.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::{Context, bail, ensure};
use env_core::admission::admit;
use env_core::{Recipe, Scenario, Seed, SeedSpace, TaskSpec};
use indicatif::ProgressBar;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rayon::prelude::*;

use crate::files;
use crate::options::{self, ChosenOption, TaskOptions};
use crate::{output, worlds};
use evaluation::suite::{Suite, SuiteEntry, SuiteGroup, SuitePart, file};

/// Draws after which a level is given up. In the committed levels, at least 1 in 27 scenarios is contested.
const MAX_DRAWS: usize = 20_000;
/// Default levels of a suite: dense where agents differ.
const DEFAULT_LEVELS: [usize; 8] = [0, 2, 4, 5, 6, 7, 8, 9];
/// Smallest number of draws that are judged in parallel. It does not affect which scenarios are kept.
const MIN_BATCH: usize = 8;

/// Build a suite: draw scenarios, compute their brackets and write them to a file.
///
/// For each task and level the suite gets contested scenarios (the reference succeeds, at most half of the blind plans do)
/// and unselected ones. No threats are placed. Seeds come from the evaluation space, which is reserved: the service never
/// hands them out. They depend only on the suite's name: the same name and options build the same suite.
#[derive(Debug, clap::Args)]
#[command(after_help = after_help())]
pub struct Args {
    /// Name of the suite, from which its seeds are derived
    #[arg(long, value_parser = parse_name)]
    name: String,
    /// Path of the suite file
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Tasks, or the name of a world for all its tasks [default: all tasks of the first world]
    #[arg(long = "task", value_name = "TASK|WORLD", value_delimiter = ',')]
    tasks: Vec<String>,
    /// Levels of each task [default: those of 0, 2 and 4 to 9 that exist]
    #[arg(long, value_name = "LEVEL", value_delimiter = ',')]
    levels: Vec<usize>,
    /// Number of contested scenarios per task and level
    #[arg(long, value_name = "N", default_value_t = 16)]
    contested: usize,
    /// Number of unselected scenarios per task and level
    #[arg(long, value_name = "N", default_value_t = 8)]
    as_they_come: usize,
    /// Set a physics option of the suite, for all its tasks or the named ones; repeat the flag to set several
    #[arg(long = "physics", value_name = "[TASK|WORLD:]NAME=CHOICE", value_parser = options::parse)]
    options: Vec<ChosenOption>,
}

fn after_help() -> String {
    format!("{}\n\n{AFTER_HELP}", options::help())
}

const AFTER_HELP: &str = "\
Examples:
  sparring suite build --name swept-v1 --out swept-v1.json \\
      --physics contact=swept --physics kessler/formation:gravity=j2
  sparring suite build --name my-suite-v1 --task kessler --out my-suite-v1.json
  sparring suite build --name small-v1 --out small-v1.json \\
      --task survival --levels 5,7";

/// Specification of a suite to draw.
#[derive(Clone)]
pub struct SuitePlan {
    /// Name of the suite; its seeds follow from it.
    pub name: String,
    /// Tasks of the suite.
    pub tasks: Vec<&'static dyn TaskSpec>,
    /// Levels of each task.
    pub levels: Vec<usize>,
    /// Contested scenarios per task and level.
    pub contested: usize,
    /// Scenarios without selection per task and level.
    pub as_they_come: usize,
    /// Physics options that are not at their defaults, by task.
    pub options: TaskOptions,
}

impl SuitePlan {
    /// Returns the command line that builds this suite.
    fn command(&self) -> String {
        let levels: Vec<String> = self.levels.iter().map(usize::to_string).collect();
        let tasks: Vec<&str> = self.tasks.iter().map(|task| task.id()).collect();
        let options = self.options.iter().flat_map(|(task, options)| {
            options.iter().map(move |(name, choice)| format!(" --physics {task}:{name}={choice}"))
        });
        format!(
            "sparring {} suite build --name {} --task {} --levels {} --contested {} --as-they-come {}{}",
            env!("CARGO_PKG_VERSION"),
            self.name,
            tasks.join(","),
            levels.join(","),
            self.contested,
            self.as_they_come,
            options.collect::<String>()
        )
    }
}

/// Builds a suite and writes it to a file.
///
/// # Errors
/// Returns an error if a task or level does not exist, contested scenarios are too rare, or the file cannot be written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let plan = args.plan()?;
    let bar = output::progress_bar(plan.tasks.len() * plan.levels.len(), "task levels")?;
    let suite = build(&plan, &bar)?;
    bar.finish_and_clear();
    let text = file::write_suite(&suite)?;
    let hash =
        file::parse_suite(text.as_bytes()).context("the suite that was built cannot be read back")?.hash;
    files::write(&args.out, &text)?;
    output::print(&format!(
        "{}: {} scenarios, {} bytes, hash {hash}",
        args.out.display(),
        suite.entries().count(),
        text.len()
    ))?;
    Ok(ExitCode::SUCCESS)
}

impl Args {
    fn plan(&self) -> anyhow::Result<SuitePlan> {
        let taken = file::built_in(&self.name).is_some();
        ensure!(!taken, "{} is a built-in suite; choose another name", self.name);
        let tasks =
            if self.tasks.is_empty() { env_core::default_tasks() } else { tasks_by_name(&self.tasks)? };
        let levels = if self.levels.is_empty() {
            let fewest = tasks.iter().map(|task| task.levels().len()).min().unwrap_or(0);
            DEFAULT_LEVELS.into_iter().filter(|&level| level < fewest).collect()
        } else {
            self.levels.clone()
        };
        ensure!(self.contested + self.as_they_come > 0, "a suite needs at least one scenario per level");
        let options = options::by_task(&self.options, &tasks)?;
        Ok(SuitePlan {
            name: self.name.clone(),
            options,
            tasks,
            levels,
            contested: self.contested,
            as_they_come: self.as_they_come,
        })
    }
}

/// Finds tasks by their ids, and all tasks of a world by its name; each task appears once.
///
/// # Errors
/// Returns an error if a name is neither a task nor a world.
pub(super) fn tasks_by_name(names: &[String]) -> anyhow::Result<Vec<&'static dyn TaskSpec>> {
    let mut tasks: Vec<&'static dyn TaskSpec> = Vec::new();
    for name in names {
        let meant = match (env_core::task(name), env_core::world(name)) {
            (Some(task), _) => vec![task],
            (None, Some(world)) => world.tasks(),
            (None, None) => {
                let tasks = env_core::tasks().map(TaskSpec::id).collect::<Vec<_>>().join(", ");
                let worlds = worlds::names().join(", ");
                bail!("{name:?} is neither a task ({tasks}) nor a world ({worlds})");
            }
        };
        for task in meant {
            if !tasks.iter().any(|known| known.id() == task.id()) {
                tasks.push(task);
            }
        }
    }
    Ok(tasks)
}

/// Draws a suite. The same plan gives the same suite for any number of threads.
///
/// # Errors
/// Returns an error if a task lacks a level, or contested scenarios are too rare.
pub fn build(plan: &SuitePlan, bar: &ProgressBar) -> anyhow::Result<Suite> {
    let mut groups = Vec::with_capacity(plan.tasks.len() * plan.levels.len());
    for task in &plan.tasks {
        for &level in &plan.levels {
            let top = task.levels().len() - 1;
            ensure!(level <= top, "{} has no level {level}; its levels are 0 to {top}", task.id());
            let recipe = Recipe::at_level(*task, level)?;
            let recipe = Arc::new(options::apply(recipe, plan.options.get(task.id()))?);
            let mut entries = draw(plan, &recipe, level, SuitePart::Contested)?;
            entries.extend(draw(plan, &recipe, level, SuitePart::AsTheyCome)?);
            groups.push(SuiteGroup { level, recipe, entries });
            bar.inc(1);
        }
    }
    let planner =
        groups.iter().flat_map(|g| &g.entries).map(|e| e.bracket.planner_version).max().unwrap_or(0);
    Ok(Suite { name: plan.name.clone(), planner, created_by: plan.command(), groups })
}

fn draw(
    plan: &SuitePlan,
    recipe: &Arc<Recipe>,
    level: usize,
    part: SuitePart,
) -> anyhow::Result<Vec<SuiteEntry>> {
    let wanted = if part == SuitePart::Contested { plan.contested } else { plan.as_they_come };
    let mut seeds = seeds(&plan.name, recipe.task().id(), level, part);
    let mut entries = Vec::with_capacity(wanted);
    let mut draws = 0;
    while entries.len() < wanted {
        if draws >= MAX_DRAWS {
            let found = entries.len();
            bail!("{} level {level}: {found} of {wanted} found in {draws} draws", recipe.task().id());
        }
        let missing = wanted - entries.len();
        let batch = if part == SuitePart::Contested { missing.max(MIN_BATCH) } else { missing };
        let drawn: Vec<Scenario> = (0..batch).map(|_| Scenario::new(Arc::clone(recipe), seeds())).collect();
        draws += batch;
        let selected: Vec<Option<SuiteEntry>> =
            drawn.into_par_iter().map(|scenario| select(scenario, part)).collect();
        entries.extend(selected.into_iter().flatten().take(missing));
    }
    Ok(entries)
}

/// Returns the entry of a scenario, or `None` if the scenario does not belong to this part of the suite.
fn select(scenario: Scenario, part: SuitePart) -> Option<SuiteEntry> {
    let admission = admit(&scenario);
    let wanted = part == SuitePart::AsTheyCome || admission.contested;
    let mut bracket = admission.bracket.filter(|_| wanted)?;
    bracket.reference_plan =
        env_core::ActionLog::new(bracket.reference_plan.dim(), bracket.reference_plan.precision());
    Some(SuiteEntry { part, scenario, bracket })
}

/// Returns a generator of evaluation seeds. Each suite, task, level and part has its own stream, so that an added level does
/// not shift the others.
fn seeds(suite: &str, task: &str, level: usize, part: SuitePart) -> impl FnMut() -> Seed {
    let key = blake3::derive_key("sparring suite seeds 1", suite.as_bytes());
    let part = if part == SuitePart::Contested { "contested" } else { "as they come" };
    let place = blake3::hash(format!("{task} {level} {part}").as_bytes());
    let mut stream = [0; 8];
    stream.copy_from_slice(&place.as_bytes()[..8]);
    let mut generator = ChaCha8Rng::from_seed(key);
    generator.set_stream(u64::from_le_bytes(stream));
    move || Seed::in_space(SeedSpace::Evaluation, generator.next_u64())
}

pub(crate) fn parse_name(name: &str) -> Result<String, String> {
    let good = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    if name.is_empty() || name.len() > 64 || !name.chars().all(good) {
        return Err("a name must have 1 to 64 lowercase letters, digits and hyphens".to_owned());
    }
    Ok(name.to_owned())
}
