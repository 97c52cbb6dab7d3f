//! Design brief from a run, a failure profile, or the command line alone.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, anyhow, ensure};
use designer::brief::LevelMastery;
use designer::profile::ProfileError;
use designer::{DesignBrief, FailureProfile, design_language};
use env_core::{Recipe, TaskSpec};

use super::Args;
use crate::files;
use crate::options;
use curriculum::TaskPlan;

/// Level of the brief if neither a run nor `--level` gives one.
pub(super) const DEFAULT_LEVEL: u32 = 3;
/// Task of the brief if neither a run, a profile nor `--task` gives one.
const DEFAULT_TASK: &str = "kessler/survival";

/// State of a run on a service; empty without `--run`.
#[derive(Debug, Default)]
pub(super) struct RunSnapshot {
    /// Id of the run.
    pub(super) run: Option<String>,
    /// Tasks of the run.
    pub(super) tasks: Vec<TaskSnapshot>,
}

/// State of one task of a run.
#[derive(Debug)]
pub(super) struct TaskSnapshot {
    /// Levels, params and physics of the task.
    pub(super) plan: TaskPlan,
    /// Current level, or the level that is probed.
    pub(super) level: Option<u32>,
    /// Mastery of the current level.
    pub(super) mastery: Option<LevelMastery>,
    /// Failure profile of the agent.
    pub(super) profile: FailureProfile,
}

/// Parses a param given as `NAME=VALUE`.
///
/// # Errors
/// Returns a message if there is no `=` or the value is no finite number.
pub(crate) fn parse_param(text: &str) -> Result<(String, f64), String> {
    let (name, value) = text.split_once('=').ok_or("a param must be NAME=VALUE, such as fuel=20")?;
    let number = value.parse::<f64>().ok().filter(|value| value.is_finite());
    let number = number.ok_or_else(|| format!("{name} must be a number, got {value:?}"))?;
    Ok((name.to_owned(), number))
}

/// Builds the brief from the arguments and the run.
///
/// # Errors
/// Returns an error if a profile cannot be read, or a task, level, param or option is invalid.
pub(super) fn build(args: &Args, run: RunSnapshot) -> anyhow::Result<DesignBrief> {
    let known = select_task(args, run)?;
    let task = task_by_id(&known.plan.task)?;
    let recipe = build_recipe(args, task, &known)?;
    let mut brief = DesignBrief::new(Arc::new(recipe), args.n as usize, args.seed);
    if let Some(level) = known.level {
        brief = brief.at_level(&known.plan.levels, level);
    }
    // Params from the command line are fixed.
    brief.param_choices.retain(|limit| args.params.iter().all(|(name, _)| *name != limit.param));
    brief.profile = known.profile;
    brief.mastery = known.mastery;
    Ok(brief)
}

/// Selects the task, with its level, mastery and failures.
fn select_task(args: &Args, run: RunSnapshot) -> anyhow::Result<TaskSnapshot> {
    let mut known = match (run.run, &args.profile) {
        (Some(id), _) => task_of_run(&id, run.tasks, args.task.as_deref())?,
        (None, Some(path)) => task_of_profile(read_profile(path, args.task.as_deref())?)?,
        (None, None) => task_of_profile(FailureProfile::empty(
            task_by_id(args.task.as_deref().unwrap_or(DEFAULT_TASK))?.id(),
        ))?,
    };
    if let Some(level) = args.level {
        let top = known.plan.hardest_level();
        ensure!(level <= top, "--level: it is {level}; {} has levels 0 to {top}", known.plan.task);
        if known.level != Some(level) {
            known.mastery = None; // it belongs to another level
        }
        known.level = Some(level);
    }
    Ok(known)
}

fn task_by_id(id: &str) -> anyhow::Result<&'static dyn TaskSpec> {
    env_core::task(id).ok_or_else(|| {
        let known = env_core::tasks().map(TaskSpec::id).collect::<Vec<_>>().join(", ");
        anyhow!("--task: there is no task {id:?}; known are {known}")
    })
}

/// Returns the requested task, or the task with the most failures among those with a design language.
fn task_of_run(
    run: &str,
    mut tasks: Vec<TaskSnapshot>,
    wanted: Option<&str>,
) -> anyhow::Result<TaskSnapshot> {
    let held = tasks.iter().map(|of| of.plan.task.as_str()).collect::<Vec<_>>().join(", ");
    let at = match wanted {
        Some(wanted) => tasks.iter().position(|of| of.plan.task == wanted),
        None => {
            let has_language = |of: &TaskSnapshot| {
                env_core::task(&of.plan.task).is_some_and(|task| design_language(task).is_some())
            };
            let known = tasks.iter().enumerate().filter(|(_, of)| has_language(of));
            known
                .max_by(|a, b| a.1.profile.total_weight().total_cmp(&b.1.profile.total_weight()))
                .map(|(at, _)| at)
        }
    };
    let none = || match wanted {
        Some(wanted) => anyhow!("--task: run {run} does not have {wanted:?}; its tasks are {held}"),
        None => anyhow!("--run: no task of {run} has a design language; its tasks are {held}"),
    };
    at.map(|at| tasks.swap_remove(at)).ok_or_else(none)
}

fn task_of_profile(profile: FailureProfile) -> anyhow::Result<TaskSnapshot> {
    let plan = TaskPlan::standard(task_by_id(&profile.task)?.id())?;
    Ok(TaskSnapshot { plan, level: Some(DEFAULT_LEVEL), mastery: None, profile })
}

fn read_profile(path: &Path, task: Option<&str>) -> anyhow::Result<FailureProfile> {
    let text = files::read_text(path).context("--profile")?;
    FailureProfile::parse(&text, task).map_err(|error| match error {
        ProfileError::Json(fault) => anyhow!(
            "--profile: {} is no failure profile ({fault}); what GET /v1/runs/{{run}}/failure_profiles answers is one, or one task of it",
            path.display()
        ),
        other => anyhow!("--profile: {}: {other}", path.display()),
    })
}

/// Builds the recipe from the task, its params and the physics options.
fn build_recipe(args: &Args, task: &'static dyn TaskSpec, known: &TaskSnapshot) -> anyhow::Result<Recipe> {
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
