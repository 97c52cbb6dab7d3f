//! `sparring design`: designs layouts for an agent's failures and passes each through the gate.
//!
//! [`run`] is the place to start reading. [`brief`] builds the design brief, [`service`] fetches a run from a server,
//! [`designers`] creates the designer, [`design_report`] holds the results, [`table`], [`files`] and [`dry_run`] print them.
//! The designers and the gate themselves live in the crate `designer`.

pub(crate) mod brief;
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

use anyhow::{Context, anyhow, ensure};
use designer::procedural::ProceduralDesigner;
use designer::{DesignBrief, DesignLanguage, DesignOutcome, Designer, Gate, design_language};
use indicatif::ProgressBar;
use tokio::runtime::Runtime;

use self::brief::RunSnapshot;
use self::design_report::{DesignReport, LayoutResult};
use self::designers::DesignerKind;
use super::api::{ApiClient, Connection, ServerArgs, StartService};
use super::llm_args::LlmArgs;
use super::names;
use super::options::{self, ChosenOption};
use super::output::{self, JsonFlag};

/// Design solvable layouts that defeat an agent, and check them at the gate.
///
/// A layout places bodies explicitly, with the bearings and speeds of the agent's failures: debris that meets satellites
/// (kessler), starts of deputies (docking), or starts of satellites and fields of targets (tasking). The failures are read from a run on a server (--run) or from a saved response of
/// GET /v1/runs/{run}/failure_profiles (--profile). Without either, aims and directions vary.
///
/// The gate admits a layout if its numbers are within bounds, its bodies are physically possible, it does what its design
/// aims at, and nothing collides before an agent can act. For a threat, the reference planner must succeed and the blind plans
/// must fail. For a decoy, holding must succeed while an agent that dodges every near body wastes fuel. A
/// layout must also differ from the others of the same call and from the newest ones of the run. Each refused layout is
/// listed with its reason.
///
/// With --layouts the command designs nothing: it checks the layouts of a file, of any world, at the gate.
#[derive(Debug, clap::Args)]
#[command(after_help = after_help())]
pub struct Args {
    /// Run whose failures to design for, by id, prefix or name; it also sets the defaults of task, level, params and physics
    #[arg(long, value_name = "RUN", conflicts_with_all = ["profile", "layouts"])]
    run: Option<String>,
    #[command(flatten)]
    server: ServerArgs,
    /// File with a failure profile: a saved response of GET /v1/runs/{run}/failure_profiles, or one task of it
    #[arg(long, value_name = "FILE", conflicts_with = "layouts")]
    profile: Option<PathBuf>,
    /// Task to design for; with --layouts, check only the layouts of this task [default: the task with the most failures
    /// of the run or profile, otherwise kessler/survival]
    #[arg(long, value_name = "TASK", value_parser = names::parse_task)]
    task: Option<String>,
    /// Level to design for; layouts may use params from two levels below to two above [default: the run's level, or 3
    /// without a run]
    #[arg(long, value_name = "LEVEL", conflicts_with = "layouts")]
    level: Option<u32>,
    /// Fix a param to a value in every layout, overriding the level; repeat the flag to fix several
    #[arg(long = "param", value_name = "NAME=VALUE", value_parser = brief::parse_param, conflicts_with = "layouts")]
    params: Vec<(String, f64)>,
    /// Set a physics option; repeat the flag to set several
    #[arg(long = "physics", value_name = "[TASK|WORLD:]NAME=CHOICE", value_parser = options::parse,
          conflicts_with = "layouts")]
    options: Vec<ChosenOption>,
    /// Designer of the layouts [default: replay with --layouts, otherwise procedural]
    #[arg(long, value_enum)]
    designer: Option<DesignerKind>,
    /// File of layouts to check at the gate
    #[arg(long, value_name = "FILE")]
    layouts: Option<PathBuf>,
    /// Number of layouts to design; with --layouts, the largest number to read (default 1000)
    #[arg(long, value_name = "N", default_value = "8", default_value_if("layouts", clap::builder::ArgPredicate::IsPresent, "1000"),
          value_parser = clap::value_parser!(u32).range(1..=1000))]
    n: u32,
    /// Seed of the designer: the same profile and seed give the same layouts, unless a language model designs
    #[arg(long, default_value_t = 0, conflicts_with = "layouts")]
    seed: u64,
    /// Print the designer's input and design nothing: profile, limits and first ideas, or prompt and schema (llm)
    #[arg(long, conflicts_with_all = ["layouts", "svg", "out"])]
    dry_run: bool,
    /// Write a picture of every admitted layout to this folder, with an index.html
    #[arg(long, value_name = "DIR")]
    svg: Option<PathBuf>,
    /// Write the admitted layouts to this file, in the format of --layouts
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    output: JsonFlag,
    #[command(flatten)]
    llm: LlmArgs,
}

fn after_help() -> String {
    format!("{AFTER_HELP}\n\n{}\n\n{EXAMPLES}", options::help())
}

const AFTER_HELP: &str = "\
Exit codes: 0 at least one layout was admitted (--layouts: all were admitted); 1 no layout was admitted (--layouts: at least \
one was refused); 2 bad input.

Refusals count encounters and deputies from 0: encounters.2.step is the step of the third encounter. \
docs/reference/design-language.md (kessler), design-language-docking.md and design-language-tasking.md explain the design \
languages with pictures.

A file of layouts is JSON: {\"layouts\": [{\"name\": \"from below\", \"scenario\": {\"task\": \"kessler/survival\", \"params\": \
{\"debris\": 0, \"fuel\": 20}, \"seed\": 5, \"layout\": {\"mode\": \"extend\", \"bodies\": {\"debris\": [[15, -85.9, 2.3, \
4.4]]}}}}]}. A body is x, y, vx, vy. A layout whose provenance is a design must equal the result of that design.

JSON (--json): one object {designer, layouts, summary, warnings}. Each layout: {name, designer, round, task, design, \
kind, admitted, check, refusal, scenario, scenario_id, hold, floor, reference, panel_successes, novelty}; values that the gate \
did not compute are null. summary is {admitted, refused: {check: count}, rounds, tokens_in, tokens_out, cost, model, prompt_version, seconds}.";

const EXAMPLES: &str = "\
Examples:
  sparring design --task kessler/survival --level 4 --n 4
  sparring design --run my-run --svg pictures --out mine.json
  curl -s http://127.0.0.1:8700/v1/runs/my-run/failure_profiles > profile.json
  sparring design --profile profile.json
  sparring design --profile profile.json --task kessler/eco_station --dry-run
  sparring design --run my-run --designer llm \\
      --llm-url http://127.0.0.1:8080/v1 --llm-model name
  sparring design --layouts mine.json --json";

/// Designs layouts, passes them through the gate and prints the result.
///
/// # Errors
/// Returns an error if a server, profile or file cannot be read, the task has no design language, or params are invalid.
pub fn run(args: &Args, start: StartService) -> anyhow::Result<ExitCode> {
    args.check()?;
    if args.dry_run {
        let runtime = runtime()?;
        let brief = build_brief(args, &runtime, start)?;
        dry_run::show(args, &brief, language_of(&brief)?)?;
        return Ok(ExitCode::SUCCESS);
    }
    let outcome = design_layouts(args, start)?;
    print_report(args, &outcome)?;
    let admitted = outcome.admitted().count();
    let is_success = if args.layouts.is_some() { admitted == outcome.rows.len() } else { admitted > 0 };
    Ok(if is_success { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Designs the layouts that the arguments ask for, or reads them from a file.
fn design_layouts(args: &Args, start: StartService) -> anyhow::Result<DesignReport> {
    if args.layouts.is_some() {
        return designers::judge_file(args);
    }
    let runtime = runtime()?;
    let mut designer = designers::create_designer(args)?;
    let brief = build_brief(args, &runtime, start)?;
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
    let DesignOutcome { usage, warnings, .. } = designed;
    Ok(DesignReport { designer: name, rows, usage, warnings, elapsed: started.elapsed() })
}

fn runtime() -> anyhow::Result<Runtime> {
    Ok(tokio::runtime::Builder::new_multi_thread().enable_all().build()?)
}

/// Builds the brief from the arguments, and from the service if `--run` is given.
fn build_brief(args: &Args, runtime: &Runtime, start: StartService) -> anyhow::Result<DesignBrief> {
    let Some(run) = &args.run else { return brief::build(args, RunSnapshot::default()) };
    runtime.block_on(async {
        let connection = Connection::open(&args.server, start).await.context("--run")?;
        let brief = brief_for_run(args, &connection.api, run).await;
        connection.close().await;
        brief
    })
}

async fn brief_for_run(args: &Args, api: &ApiClient, run: &str) -> anyhow::Result<DesignBrief> {
    let snapshot = service::fetch_run(api, run).await?;
    let run = snapshot.run.clone().unwrap_or_default();
    let mut brief = brief::build(args, snapshot)?;
    let task = brief.recipe.task().id();
    brief.past_layouts = service::past_layouts(api, &run, task).await?;
    Ok(brief)
}

impl Args {
    /// Checks rules that clap cannot express.
    fn check(&self) -> anyhow::Result<()> {
        match (self.designer, &self.layouts) {
            (Some(DesignerKind::Replay), None) => Err(anyhow!("--designer replay needs --layouts FILE")),
            (Some(DesignerKind::Procedural | DesignerKind::Llm), Some(_)) => Err(anyhow!(
                "--layouts cannot be combined with this --designer: the layouts come from the file"
            )),
            _ => Ok(()),
        }?;
        // Checked before any design, since model calls may cost money.
        if let Some(out) = &self.out {
            let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty());
            let fine = folder.is_none_or(std::path::Path::is_dir) && !out.is_dir();
            ensure!(fine, "--out: {} cannot be written; choose a file in an existing folder", out.display());
        }
        if let Some(folder) = self.svg.as_ref().filter(|folder| folder.exists() && !folder.is_dir()) {
            return Err(anyhow!("--svg: {} is not a folder", folder.display()));
        }
        if let (Some(read), Some(out)) = (&self.layouts, &self.out) {
            let written = out.canonicalize().ok();
            ensure!(
                written.is_none() || written != read.canonicalize().ok(),
                "--out: {} is the input file; choose another file",
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
            "--task: {} has no design language; choose one of {known}, or check existing layouts with --layouts",
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
    if args.output.json {
        output::print_json(&outcome.json())?;
    } else {
        let mut report = table::text_report(outcome);
        for sentence in written {
            report.line(sentence);
        }
        output::print_report(&report)?;
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
