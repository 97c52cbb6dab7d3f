//! `sparring design`: layouts that hit what an agent fails at, each through the gate.

mod brief;
mod files;
mod plan;
mod row;
mod service;
mod table;
#[cfg(test)]
mod tests;
mod who;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{anyhow, ensure};
use designer::procedural::ProceduralDesigner;
use designer::{DesignBrief, DesignOutcome, Designer, Gate, DesignLanguage, design_language};
use indicatif::ProgressBar;
use tokio::runtime::Runtime;

use self::brief::Told;
use self::row::{Outcome, Row};
use self::who::Who;
use super::llm_args::LlmArgs;
use super::options::{self, Chosen};
use super::output::{Format, print, print_json};

/// Design layouts that defeat an agent and can be solved, and pass them through the gate.
///
/// A layout is explicit bodies: debris that meets satellites from where, and as fast as, what takes the agent came. What the
/// agent fails at is read from a run on a server (--run) or from a saved answer of GET /v1/runs/{run}/failures (--profile);
/// with neither, nothing is known of it and debris comes from everywhere. Every layout passes the gate: its numbers are
/// within bounds, its bodies can be where it says, its aim is kept, nothing touches before anybody could act, the reference
/// planner succeeds within fuel, and acting blindly does not (a threat), or holding succeeds and a nervous agent wastes fuel
/// (a decoy); and it is not like another of the same call, or like the newest of the run. Refused layouts are told with a sentence each.
///
/// With --layouts nothing is designed: the layouts of a file, of any world, pass through the gate.
#[derive(Debug, clap::Args)]
#[command(after_help = after_help())]
pub struct Args {
    /// A run whose agent's failures to design for: its task, level, params and physics hold unless told otherwise
    #[arg(long, value_name = "RUN", conflicts_with_all = ["profile", "layouts"])]
    run: Option<String>,
    /// Where the service listens that knows the run
    #[arg(long, value_name = "URL", default_value = "http://127.0.0.1:8700", requires = "run")]
    url: String,
    /// A failure profile to design for: a saved answer of GET /v1/runs/{run}/failures, or one task of it
    #[arg(long, value_name = "FILE", conflicts_with = "layouts")]
    profile: Option<PathBuf>,
    /// The task; of a run or a profile with several the one with the most failures, else kessler/survival; of --layouts
    /// all that are of this one
    #[arg(long, value_name = "TASK")]
    task: Option<String>,
    /// The level to design for: the run's own, or 3 without a run. Layouts may take params from two levels to either side
    #[arg(long, value_name = "LEVEL", conflicts_with = "layouts")]
    level: Option<u32>,
    /// This param has this value in every layout, whatever the level says; repeat it for more
    #[arg(long = "param", value_name = "NAME=VALUE", value_parser = brief::param, conflicts_with = "layouts")]
    params: Vec<(String, f64)>,
    /// Design under this physics option; repeat it for more
    #[arg(long = "physics", value_name = "[TASK|WORLD:]NAME=CHOICE", value_parser = options::parse,
          conflicts_with = "layouts")]
    options: Vec<Chosen>,
    /// Who designs: procedural, or replay where --layouts is given
    #[arg(long, value_enum)]
    designer: Option<Who>,
    /// A file of layouts to pass through the gate
    #[arg(long, value_name = "FILE")]
    layouts: Option<PathBuf>,
    /// How many layouts are wanted; of --layouts, how many are read at most (1000)
    #[arg(long, value_name = "N", default_value = "8", default_value_if("layouts", clap::builder::ArgPredicate::IsPresent, "1000"),
          value_parser = clap::value_parser!(u32).range(1..=1000))]
    n: u32,
    /// What is drawn follows from this: the same profile and seed make the same layouts, where no language model takes part
    #[arg(long, default_value_t = 0, conflicts_with = "layouts")]
    seed: u64,
    /// Design nothing; show what the designer would be told: profile, limits and first ideas, or prompt and schema (llm)
    #[arg(long, conflicts_with_all = ["layouts", "svg", "out"])]
    dry_run: bool,
    /// Draw every admitted layout into this folder, with an index.html
    #[arg(long, value_name = "DIR")]
    svg: Option<PathBuf>,
    /// Write the admitted layouts to this file, as --layouts reads them
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// How the result is printed
    #[arg(long, value_enum, default_value = "table")]
    format: Format,
    #[command(flatten)]
    llm: LlmArgs,
}

fn after_help() -> String {
    format!("{AFTER_HELP}\n\n{}\n\n{EXAMPLES}", options::help())
}

const AFTER_HELP: &str = "\
Exit codes: 0 at least one layout was admitted (--layouts: none was refused); 1 none was (--layouts: one was refused); 2 bad \
input.

Encounters are counted from 0, as refusals name them: encounters.2.step is the step of the third. Bearings are where the \
debris is, seen from the satellite, five steps before; docs/designer.md tells the language with pictures.

A file of layouts is JSON: {\"layouts\": [{\"name\": \"from below\", \"scenario\": {\"task\": \"kessler/survival\", \"params\": \
{\"debris\": 0, \"fuel\": 20}, \"seed\": 5, \"layout\": {\"mode\": \"extend\", \"bodies\": {\"debris\": [[15, -85.9, 2.3, \
4.4]]}}}}]}. A body is x, y, vx, vy. A layout whose provenance is a design must be what that design comes to.

JSON (--format json): one object {designer, layouts, summary, troubles}. Each layout: {name, designer, round, task, design, \
claim, admitted, check, refusal, scenario, scenario_id, hold, floor, reference, panel_success, novelty}; what the gate did not \
come to is null. summary is {admitted, refused: {check: count}, rounds, tokens_in, tokens_out, cost, model, prompt, seconds}.";

const EXAMPLES: &str = "\
Examples:
  sparring design --task kessler/survival --level 4 --n 4
  sparring design --run my-run --svg pictures --out mine.json
  curl -s http://127.0.0.1:8700/v1/runs/my-run/failures > profile.json && sparring design --profile profile.json
  sparring design --profile profile.json --task kessler/eco_station --dry-run
  sparring design --run my-run --designer llm --llm-url http://127.0.0.1:8080/v1 --llm-model name
  sparring design --layouts mine.json --format json";

/// Designs and gates.
///
/// # Errors
/// A server, profile or file that cannot be read, a task nobody designs for, params that cannot be.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    args.check()?;
    if args.dry_run {
        let runtime = runtime()?;
        let brief = asked(args, &runtime)?;
        plan::show(args, &brief, speaks(&brief)?)?;
        return Ok(ExitCode::SUCCESS);
    }
    let outcome = designed(args)?;
    tell(args, &outcome)?;
    let admitted = outcome.admitted().count();
    let well = if args.layouts.is_some() { admitted == outcome.rows.len() } else { admitted > 0 };
    Ok(if well { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// What comes of these arguments.
fn designed(args: &Args) -> anyhow::Result<Outcome> {
    if args.layouts.is_some() {
        return who::replay(args);
    }
    let runtime = runtime()?;
    let mut designer = who::designer(args)?;
    let brief = asked(args, &runtime)?;
    let known = brief.past_layouts.iter().map(|past| past.design.clone()).collect();
    let mut gate = Gate::new(speaks(&brief)?, known);
    let busy = Busy::new(&format!("{} designs {} layouts", designer.name(), brief.count));
    let started = Instant::now();
    let designed = runtime.block_on(designer.design(&brief, &mut gate));
    drop(busy);
    let (name, task) = (designer.name(), brief.recipe.task().id());
    let instead = name != ProceduralDesigner.name();
    let mut designed = match designed {
        // As in the service: what a language model does not do the procedural designer does.
        Err(error) if instead => DesignOutcome { warnings: vec![error.to_string()], ..DesignOutcome::default() },
        designed => designed?,
    };
    let missing = brief.count - designed.admitted().min(brief.count);
    let judged = std::mem::take(&mut designed.judged);
    let mut rows: Vec<Row> = judged.into_iter().map(|judged| Row::of(name, task, judged)).collect();
    if instead && missing > 0 {
        let more = ProceduralDesigner::design_layouts(&DesignBrief { count: missing, ..brief }, &mut gate);
        designed.warnings.push(format!("the procedural designer stands in for {missing} layouts of {name}"));
        rows.extend(more.judged.into_iter().map(|judged| Row::of(ProceduralDesigner.name(), task, judged)));
    }
    let DesignOutcome { usage, warnings: troubles, .. } = designed;
    Ok(Outcome { designer: name, rows, usage, troubles, took: started.elapsed() })
}

fn runtime() -> anyhow::Result<Runtime> {
    Ok(tokio::runtime::Builder::new_current_thread().enable_all().build()?)
}

/// The brief that is asked for; what a service knows is asked of it.
fn asked(args: &Args, runtime: &Runtime) -> anyhow::Result<DesignBrief> {
    let Some(run) = &args.run else { return brief::of(args, Told::default()) };
    let mut brief = brief::of(args, runtime.block_on(service::ask(&args.url, run))?)?;
    let task = brief.recipe.task().id();
    brief.past_layouts = runtime.block_on(service::past(&args.url, run, task))?;
    Ok(brief)
}

impl Args {
    /// What clap cannot tell.
    fn check(&self) -> anyhow::Result<()> {
        match (self.designer, &self.layouts) {
            (Some(Who::Replay), None) => Err(anyhow!("--designer replay: say which file with --layouts")),
            (Some(Who::Procedural | Who::Llm), Some(_)) => {
                Err(anyhow!("--layouts: these are read, not designed; leave --designer out"))
            }
            _ => Ok(()),
        }?;
        // Before anything is designed, which may cost something.
        if let Some(out) = &self.out {
            let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty());
            let fine = folder.is_none_or(std::path::Path::is_dir) && !out.is_dir();
            ensure!(
                fine,
                "--out: {} cannot be written; name a file in a folder that is there",
                out.display()
            );
        }
        if let Some(folder) = self.svg.as_ref().filter(|folder| folder.exists() && !folder.is_dir()) {
            return Err(anyhow!("--svg: {} is no folder", folder.display()));
        }
        if let (Some(read), Some(out)) = (&self.layouts, &self.out) {
            let written = out.canonicalize().ok();
            ensure!(
                written.is_none() || written != read.canonicalize().ok(),
                "--out: {} is what is read; name another file to write",
                out.display()
            );
        }
        Ok(())
    }
}

fn speaks(brief: &DesignBrief) -> anyhow::Result<&'static dyn DesignLanguage> {
    let task = brief.recipe.task();
    design_language(task).ok_or_else(|| {
        let known = env_core::tasks().filter(|task| design_language(*task).is_some()).map(env_core::TaskSpec::id);
        let known = known.collect::<Vec<_>>().join(", ");
        anyhow!(
            "--task: nobody designs for {} yet; choose one of {known}, or pass layouts through the gate with --layouts",
            task.id()
        )
    })
}

/// Files first: what is printed last is what people read.
fn tell(args: &Args, outcome: &Outcome) -> anyhow::Result<()> {
    let pictures = args.svg.as_ref().map(|folder| files::pictures(folder, outcome));
    let layouts = args.out.as_ref().map(|path| files::layouts(path, outcome));
    let (mut written, mut failed) = (Vec::new(), None);
    for done in [pictures, layouts].into_iter().flatten() {
        match done {
            Ok(told) => written.push(told),
            Err(error) => failed = failed.or(Some(error)),
        }
    }
    // What was designed is shown though it could not be written.
    match args.format {
        Format::Json => print_json(&outcome.json())?,
        Format::Table => {
            let parts = std::iter::once(table::text(outcome)).chain(written);
            print(&parts.collect::<Vec<_>>().join("\n"))?;
        }
    }
    failed.map_or(Ok(()), Err)
}

/// A sign of life on stderr while it takes long; nothing where stderr is no terminal.
struct Busy(ProgressBar);

impl Busy {
    fn new(what: &str) -> Self {
        let spinner = ProgressBar::new_spinner().with_message(what.to_owned());
        spinner.enable_steady_tick(Duration::from_millis(200));
        Self(spinner)
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
