//! What the designer is told, from a run, a profile, or the command line alone.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, anyhow, ensure};
use designer::brief::LevelMastery;
use designer::profile::ProfileError;
use designer::{DesignBrief, FailureProfile, design_language};
use env_core::{Recipe, TaskSpec};

use super::Args;
use crate::options;
use curriculum::TaskPlan;

/// The level without a run that has one.
const LEVEL: u32 = 3;
/// The task where nobody says.
const TASK: &str = "kessler/survival";

/// What a service tells of a run; nothing without one.
#[derive(Debug, Default)]
pub(super) struct Told {
    /// The run.
    pub(super) run: Option<String>,
    /// Its tasks.
    pub(super) tasks: Vec<OfRun>,
}

/// A task of a run.
#[derive(Debug)]
pub(super) struct OfRun {
    /// Its levels, params and physics.
    pub(super) plan: TaskPlan,
    /// Where it stands, or is probed.
    pub(super) level: Option<u32>,
    /// How well it does there.
    pub(super) standing: Option<LevelMastery>,
    /// What it fails at.
    pub(super) profile: FailureProfile,
}

/// `--param NAME=VALUE`.
pub(super) fn param(text: &str) -> Result<(String, f64), String> {
    let (name, value) = text.split_once('=').ok_or("a param is NAME=VALUE, as fuel=20")?;
    let number = value.parse::<f64>().ok().filter(|value| value.is_finite());
    let number = number.ok_or_else(|| format!("{name} is {value:?}; a number is wanted"))?;
    Ok((name.to_owned(), number))
}

/// The brief that these arguments ask for.
///
/// # Errors
/// A profile that cannot be read, a task, level, param or option that cannot be.
pub(super) fn of(args: &Args, told: Told) -> anyhow::Result<DesignBrief> {
    let known = known(args, told)?;
    let task = task(&known.plan.task)?;
    let recipe = recipe(args, task, &known)?;
    let mut brief = DesignBrief::new(Arc::new(recipe), args.n as usize, args.seed);
    if let Some(level) = known.level {
        brief = brief.at_level(&known.plan.levels, level);
    }
    // What was said by hand stays.
    brief.param_choices.retain(|limit| args.params.iter().all(|(name, _)| *name != limit.param));
    brief.profile = known.profile;
    brief.mastery = known.standing;
    Ok(brief)
}

/// The task, its level and what is known of it there.
fn known(args: &Args, told: Told) -> anyhow::Result<OfRun> {
    let mut known = match (told.run, &args.profile) {
        (Some(run), _) => of_run(&run, told.tasks, args.task.as_deref())?,
        (None, Some(path)) => of_profile(profile(path, args.task.as_deref())?)?,
        (None, None) => of_profile(FailureProfile::empty(task(args.task.as_deref().unwrap_or(TASK))?.id()))?,
    };
    if let Some(level) = args.level {
        let top = known.plan.hardest_level();
        ensure!(level <= top, "--level: it is {level}; {} has levels 0 to {top}", known.plan.task);
        if known.level != Some(level) {
            known.standing = None; // that is of another level
        }
        known.level = Some(level);
    }
    Ok(known)
}

fn task(id: &str) -> anyhow::Result<&'static dyn TaskSpec> {
    env_core::task(id).ok_or_else(|| {
        let known = env_core::tasks().map(TaskSpec::id).collect::<Vec<_>>().join(", ");
        anyhow!("--task: there is no task {id:?}; known are {known}")
    })
}

/// The task that is asked for, or the one with the most failures among those that can be designed for.
fn of_run(run: &str, mut tasks: Vec<OfRun>, wanted: Option<&str>) -> anyhow::Result<OfRun> {
    let held = tasks.iter().map(|of| of.plan.task.as_str()).collect::<Vec<_>>().join(", ");
    let at = match wanted {
        Some(wanted) => tasks.iter().position(|of| of.plan.task == wanted),
        None => {
            let designed =
                |of: &OfRun| env_core::task(&of.plan.task).is_some_and(|task| design_language(task).is_some());
            let known = tasks.iter().enumerate().filter(|(_, of)| designed(of));
            known.max_by(|a, b| a.1.profile.total_weight().total_cmp(&b.1.profile.total_weight())).map(|(at, _)| at)
        }
    };
    let none = || match wanted {
        Some(wanted) => anyhow!("--task: run {run} does not have {wanted:?}; its tasks are {held}"),
        None => anyhow!("--run: nobody designs for a task of {run} yet; its tasks are {held}"),
    };
    at.map(|at| tasks.swap_remove(at)).ok_or_else(none)
}

fn of_profile(profile: FailureProfile) -> anyhow::Result<OfRun> {
    let plan = TaskPlan::standard(task(&profile.task)?.id())?;
    Ok(OfRun { plan, level: Some(LEVEL), standing: None, profile })
}

fn profile(path: &Path, task: Option<&str>) -> anyhow::Result<FailureProfile> {
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("--profile: {} cannot be read", path.display()))?;
    FailureProfile::parse(&text, task).map_err(|error| match error {
        ProfileError::Json(fault) => anyhow!(
            "--profile: {} is no failure profile ({fault}); what GET /v1/runs/{{run}}/failures answers is one, or one task of it",
            path.display()
        ),
        other => anyhow!("--profile: {}: {other}", path.display()),
    })
}

/// Task, params and physics.
fn recipe(args: &Args, task: &'static dyn TaskSpec, known: &OfRun) -> anyhow::Result<Recipe> {
    let params = known.plan.params(known.level);
    let mut recipe = Recipe::with_params(task, params.iter().map(|(name, value)| (name.as_str(), *value)))?;
    for (name, value) in &args.params {
        recipe = recipe.with_param(name, *value).context("--param")?;
    }
    let mut physics = known.plan.physics.clone();
    let chosen = options::by_task(&args.options, &[task]).context("--physics")?;
    physics.extend(chosen.into_values().flatten());
    options::apply(recipe, Some(&physics)).context("--physics")
}
