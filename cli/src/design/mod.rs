//! `sparring design`: designs layouts for an agent's failures and passes each through the gate.
//!
//! [`run`] is the place to start reading. [`brief`] builds the design brief, [`service`] fetches a run from a server,
//! [`designers`] creates the designer, [`design_report`] holds the results, [`table`], [`files`] and [`dry_run`] print them.
//! The designers and the gate themselves live in the crate `designer`.

mod brief;
mod design_report;
mod designers;
mod dry_run;
mod files;
mod service;
mod table;
#[cfg(test)]
mod tests;

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{anyhow, ensure};
use designer::procedural::ProceduralDesigner;
use designer::{DesignBrief, DesignLanguage, DesignOutcome, Designer, Gate, design_language};
use indicatif::ProgressBar;
use tokio::runtime::Runtime;

use self::brief::RunSnapshot;
use self::design_report::{DesignReport, LayoutResult};
use self::designers::DesignerKind;
use super::llm_args::LlmArgs;
use super::options::{self, ChosenOption};
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
    #[arg(long = "param", value_name = "NAME=VALUE", value_parser = brief::parse_param, conflicts_with = "layouts")]
    params: Vec<(String, f64)>,
    /// Design under this physics option; repeat it for more
    #[arg(long = "physics", value_name = "[TASK|WORLD:]NAME=CHOICE", value_parser = options::parse,
          conflicts_with = "layouts")]
    options: Vec<ChosenOption>,
    /// Who designs: procedural, or replay where --layouts is given
    #[arg(long, value_enum)]
    designer: Option<DesignerKind>,
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

/// Designs layouts, passes them through the gate and prints the result.
///
/// # Errors
/// Returns an error if a server, profile or file cannot be read, the task has no design language, or params are invalid.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    args.check()?;
    if args.dry_run {
        let runtime = runtime()?;
        let brief = build_brief(args, &runtime)?;
        dry_run::show(args, &brief, language_of(&brief)?)?;
        return Ok(ExitCode::SUCCESS);
    }
    let outcome = design_layouts(args)?;
    print_report(args, &outcome)?;
    let admitted = outcome.admitted().count();
    let is_success = if args.layouts.is_some() { admitted == outcome.rows.len() } else { admitted > 0 };
    Ok(if is_success { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Designs the layouts that the arguments ask for, or reads them from a file.
fn design_layouts(args: &Args) -> anyhow::Result<DesignReport> {
    if args.layouts.is_some() {
        return designers::judge_file(args);
    }
    let runtime = runtime()?;
    let mut designer = designers::create_designer(args)?;
    let brief = build_brief(args, &runtime)?;
    let known = brief.past_layouts.iter().map(|past| past.design.clone()).collect();
    let mut gate = Gate::new(language_of(&brief)?, known);
    let spinner = Spinner::new(&format!("{} designs {} layouts", designer.name(), brief.count));
    let started = Instant::now();
    let designed = runtime.block_on(designer.design(&brief, &mut gate));
    drop(spinner);
    let (name, task) = (designer.name(), brief.recipe.task().id());
    let has_fallback = name != ProceduralDesigner.name();
    let mut designed = match designed {
        // As in the service, the procedural designer replaces a language model that fails.
        Err(error) if has_fallback => {
            DesignOutcome { warnings: vec![error.to_string()], ..DesignOutcome::default() }
        }
        designed => designed?,
    };
    let missing = brief.count - designed.admitted().min(brief.count);
    let judged = std::mem::take(&mut designed.judged);
    let mut rows: Vec<LayoutResult> =
        judged.into_iter().map(|judged| LayoutResult::new(name, task, judged)).collect();
    if has_fallback && missing > 0 {
        let more = ProceduralDesigner::design_layouts(&DesignBrief { count: missing, ..brief }, &mut gate);
        designed.warnings.push(format!("the procedural designer stands in for {missing} layouts of {name}"));
        rows.extend(
            more.judged.into_iter().map(|judged| LayoutResult::new(ProceduralDesigner.name(), task, judged)),
        );
    }
    let DesignOutcome { usage, warnings: troubles, .. } = designed;
    Ok(DesignReport { designer: name, rows, usage, troubles, elapsed: started.elapsed() })
}

fn runtime() -> anyhow::Result<Runtime> {
    Ok(tokio::runtime::Builder::new_current_thread().enable_all().build()?)
}

/// Builds the brief from the arguments, and from the service if `--run` is given.
fn build_brief(args: &Args, runtime: &Runtime) -> anyhow::Result<DesignBrief> {
    let Some(run) = &args.run else { return brief::build(args, RunSnapshot::default()) };
    let mut brief = brief::build(args, runtime.block_on(service::ask(&args.url, run))?)?;
    let task = brief.recipe.task().id();
    brief.past_layouts = runtime.block_on(service::past(&args.url, run, task))?;
    Ok(brief)
}

impl Args {
    /// Checks rules that clap cannot express.
    fn check(&self) -> anyhow::Result<()> {
        match (self.designer, &self.layouts) {
            (Some(DesignerKind::Replay), None) => {
                Err(anyhow!("--designer replay: say which file with --layouts"))
            }
            (Some(DesignerKind::Procedural | DesignerKind::Llm), Some(_)) => {
                Err(anyhow!("--layouts: these are read, not designed; leave --designer out"))
            }
            _ => Ok(()),
        }?;
        // Checked before any design, since model calls may cost money.
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

/// Returns the design language of the brief's task.
fn language_of(brief: &DesignBrief) -> anyhow::Result<&'static dyn DesignLanguage> {
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

/// Writes the files, then prints the report: users read the last output.
fn print_report(args: &Args, outcome: &DesignReport) -> anyhow::Result<()> {
    let pictures = args.svg.as_ref().map(|folder| files::write_pictures(folder, outcome));
    let layouts = args.out.as_ref().map(|path| files::write_layouts(path, outcome));
    let (mut written, mut failed) = (Vec::new(), None);
    for done in [pictures, layouts].into_iter().flatten() {
        match done {
            Ok(sentence) => written.push(sentence),
            Err(error) => failed = failed.or(Some(error)),
        }
    }
    // The report is printed even if a file could not be written.
    match args.format {
        Format::Json => print_json(&outcome.json())?,
        Format::Table => {
            let parts = std::iter::once(table::text(outcome)).chain(written);
            print(&parts.collect::<Vec<_>>().join("\n"))?;
        }
    }
    failed.map_or(Ok(()), Err)
}

/// Spinner on stderr during long work; hidden if stderr is no terminal.
struct Spinner(ProgressBar);

impl Spinner {
    fn new(message: &str) -> Self {
        let spinner = ProgressBar::new_spinner().with_message(message.to_owned());
        spinner.enable_steady_tick(Duration::from_millis(200));
        Self(spinner)
    }
}

impl Drop for Spinner {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}
