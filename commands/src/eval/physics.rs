//! Changes the physics options of a suite and recomputes its brackets.

use std::sync::Arc;

use anyhow::Context;
use env_core::admission::{admit, is_contested};
use env_core::{ActionLog, Recipe, Scenario};
use indicatif::ProgressBar;
use rayon::prelude::*;

use crate::options::{self, TaskOptions};
use evaluation::suite::{Suite, SuiteEntry, SuiteGroup, SuitePart};

/// Difference between the evaluated physics and those of the suite.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ChangedPhysics {
    /// Options from the command line, by task.
    pub(super) options: TaskOptions,
    /// Number of the suite's contested scenarios that remain contested.
    still_contested: usize,
    /// Number of the suite's contested scenarios.
    contested: usize,
}

impl ChangedPhysics {
    /// Describes the change and its effect on the comparison.
    pub(super) fn note(&self) -> String {
        format!(
            "Evaluated with other physics than the suite's ({}), with recomputed floors and references. Of the suite's {} \
             contested scenarios, {} remain contested. These numbers are not comparable with those of the suite.",
            options::describe(&self.options),
            self.contested,
            self.still_contested
        )
    }
}

/// Applies options to a suite and recomputes its brackets. Returns `None` if the suite has these options already.
///
/// # Errors
/// Returns an error if options contradict each other or the suite's own, or a scenario cannot start under them.
pub(super) fn change_physics(
    suite: &Suite,
    options: TaskOptions,
    bar: &ProgressBar,
) -> anyhow::Result<Option<(Suite, ChangedPhysics)>> {
    let recipes = suite.groups.iter().map(|group| {
        let recipe = Recipe::clone(&group.recipe);
        options::apply(recipe, options.get(group.recipe.task().id()))
    });
    let recipes = recipes.collect::<anyhow::Result<Vec<_>>>()?;
    if recipes.iter().zip(&suite.groups).all(|(recipe, group)| *recipe == *group.recipe) {
        return Ok(None);
    }
    let mut groups = Vec::with_capacity(recipes.len());
    for (recipe, group) in recipes.into_iter().zip(&suite.groups) {
        let recipe = Arc::new(recipe);
        let entries = group.entries.par_iter().map(|entry| {
            bar.inc(1);
            rebuild_entry(entry, &recipe)
        });
        let entries = entries.collect::<anyhow::Result<_>>()?;
        groups.push(SuiteGroup { level: group.level, recipe, entries });
    }
    let planner = groups.iter().filter_map(SuiteGroup::planner).max().unwrap_or(suite.planner);
    let changed = Suite { groups, planner, ..suite.clone() };
    let chosen = || changed.entries().filter(|entry| entry.part == SuitePart::Contested);
    let physics = ChangedPhysics {
        options,
        still_contested: chosen().filter(|entry| is_contested(&entry.scenario, &entry.bracket)).count(),
        contested: chosen().count(),
    };
    Ok(Some((changed, physics)))
}

fn rebuild_entry(entry: &SuiteEntry, recipe: &Arc<Recipe>) -> anyhow::Result<SuiteEntry> {
    let scenario = Scenario::new(Arc::clone(recipe), entry.scenario.seed());
    let admission = admit(&scenario);
    let context = || format!("scenario {} cannot run with these options", entry.scenario.id());
    admission.fair.with_context(context)?;
    let mut bracket = admission.bracket.with_context(context)?;
    bracket.reference_plan = ActionLog::new(bracket.reference_plan.dim(), bracket.reference_plan.precision());
    Ok(SuiteEntry { part: entry.part, scenario, bracket })
}
