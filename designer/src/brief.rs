//! [`DesignBrief`]: everything a designer receives for one request.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use env_core::space::{Levels, START_SCALE};
use env_core::{Recipe, Scenario, Seed, SeedSpace, TaskSpec};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::profile::FailureProfile;

/// Distance in levels, up or down, from which a design may take values of params.
const LEVEL_REACH: u32 = 2;
/// Success rate of the agent on a layout below which new layouts are easier siblings of it.
pub const EASE_BELOW: f64 = 0.3;
/// Success rate of the agent on a layout above which new layouts are harder siblings of it.
pub const HARDEN_ABOVE: f64 = 0.7;

/// Request to a designer: the task and its limits, the agent's failures, and the outcomes of earlier layouts.
#[derive(Debug, Clone, PartialEq)]
pub struct DesignBrief {
    /// Number of layouts to design.
    pub count: usize,
    /// Seed of all random draws. The same brief gives the same designs, unless a language model makes them.
    pub seed: u64,
    /// Task, params and physics to design for, without a layout.
    pub recipe: Arc<Recipe>,
    /// Level of the params; `None` if they belong to no level.
    pub level: Option<u32>,
    /// Params that a design may choose.
    pub param_choices: Vec<ParamChoice>,
    /// Failures of the agent in this task.
    pub profile: FailureProfile,
    /// Mastery of the level; `None` if nothing is known.
    pub mastery: Option<LevelMastery>,
    /// Earlier layouts, newest first.
    pub past_layouts: Vec<PastLayout>,
    /// Time after which the designer returns the layouts it has; `None` is unlimited.
    pub time_limit: Option<Duration>,
}

/// Param that a design may choose, with its allowed values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ParamChoice {
    /// Name of the param.
    pub param: String,
    /// Allowed values in ascending order.
    pub values: Vec<f64>,
}

/// Mastery of a level, as the curriculum estimates it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LevelMastery {
    /// Number of contested scenarios in the estimate.
    pub n: u32,
    /// Mean of the posterior.
    pub mean: f64,
    /// 10 % quantile of the posterior.
    pub q10: f64,
    /// 90 % quantile of the posterior.
    pub q90: f64,
}

/// Rung of a task for which layouts are designed.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct DesignRung {
    /// Level of the params; `None` if they belong to no level.
    pub level: Option<u32>,
    /// Value of the param `start_scale`, 0.01 to 1; `None` in tasks without start rungs.
    pub start_scale: Option<f64>,
}

impl DesignRung {
    /// Creates the rung of a task from the level and the number of the start rung with which a layout is stored. Numbers out of range
    /// are left out.
    #[must_use]
    pub fn from_stored(task: &dyn TaskSpec, level: Option<i64>, start_rung: Option<i64>) -> Self {
        let scale = |rung: i64| task.start_rungs().get(usize::try_from(rung).ok()?).copied();
        Self {
            level: level.and_then(|level| u32::try_from(level).ok()),
            start_scale: start_rung.and_then(scale),
        }
    }
}

/// The parts of the rung that are known, such as `level 3, start scale 0.5`; empty if none is.
impl fmt::Display for DesignRung {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let level = self.level.map(|level| format!("level {level}"));
        let scale = self.start_scale.map(|scale| format!("start scale {scale}"));
        f.write_str(&level.into_iter().chain(scale).collect::<Vec<_>>().join(", "))
    }
}

/// Layout of an earlier request.
#[derive(Debug, Clone, PartialEq)]
pub struct PastLayout {
    /// Design in the language of its world.
    pub design: Value,
    /// Rung for which it was designed.
    pub rung: DesignRung,
    /// Seed of the scenario; `None` if the gate refused the layout.
    pub seed: Option<Seed>,
    /// Outcome of the layout so far.
    pub outcome: LayoutOutcome,
}

/// Outcome of a layout.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum LayoutOutcome {
    /// The gate refused it.
    Refused {
        /// Name of the check, see [`crate::GateCheck::as_str`].
        check: String,
        /// Message of the refusal.
        reason: String,
    },
    /// The gate admitted it, and no episode of it has ended.
    Untested,
    /// The agent has played episodes of it.
    Evaluated {
        /// Number of finished episodes.
        episodes: u32,
        /// Share of successful episodes.
        success_rate: f64,
        /// Mean of (reference − score)/(reference − floor), within [0, 1]; for decoys, of (reference − score)/reference.
        regret: f64,
        /// Share of the criticised episodes with a failure in which the aimed failure mode occurred; `None` if there is no
        /// such episode.
        aimed_share: Option<f64>,
        /// True if the layout is no longer served.
        is_retired: bool,
    },
}

impl LayoutOutcome {
    /// Returns the mean of the posterior Beta(1 + successes, 1 + failures) over the agent's success rate, (1 + s)/(2 + n) after s
    /// successes in n episodes (Laplace's rule of succession); `None` without episodes.
    #[must_use]
    pub fn mean_success(&self) -> Option<f64> {
        match self {
            Self::Evaluated { episodes, success_rate, .. } => {
                let n = f64::from(*episodes);
                Some((1.0 + success_rate * n) / (2.0 + n))
            }
            Self::Refused { .. } | Self::Untested => None,
        }
    }

    /// Returns the regret that the aimed failure mode caused; `None` without episodes. A high value makes the layout a good
    /// parent of new designs.
    #[must_use]
    pub fn aimed_regret(&self) -> Option<f64> {
        match self {
            Self::Evaluated { regret, aimed_share, .. } => Some(regret * aimed_share.unwrap_or(1.0)),
            Self::Refused { .. } | Self::Untested => None,
        }
    }
}

impl DesignBrief {
    /// Creates a brief for a recipe, with fixed params and without knowledge of the agent.
    #[must_use]
    pub fn new(recipe: Arc<Recipe>, count: usize, seed: u64) -> Self {
        let profile = FailureProfile::empty(recipe.task().id());
        Self {
            count,
            seed,
            recipe,
            level: None,
            param_choices: Vec::new(),
            profile,
            mastery: None,
            past_layouts: Vec::new(),
            time_limit: None,
        }
    }

    /// Sets the level, and lets a design choose params among the values of the levels around it.
    #[must_use]
    pub fn at_level(mut self, levels: &Levels, level: u32) -> Self {
        self.level = Some(level);
        self.param_choices = choices_around(levels, level);
        self
    }

    /// Returns the rung at which layouts are wanted.
    #[must_use]
    pub fn rung(&self) -> DesignRung {
        let has_start_rungs = !self.recipe.task().start_rungs().is_empty();
        let start_scale = self.recipe.param(START_SCALE.name).filter(|_| has_start_rungs);
        DesignRung { level: self.level, start_scale }
    }

    /// Returns the `number`-th base scenario of the brief, in which a design can be built.
    #[must_use]
    pub fn base_scenario(&self, number: u64) -> Scenario {
        let mut bits = [0; 8];
        let mut hasher = blake3::Hasher::new_derive_key("sparring 2026 skies of designs");
        hasher.update(&self.seed.to_le_bytes());
        hasher.update(&number.to_le_bytes());
        hasher.finalize_xof().fill(&mut bits);
        // User seeds, since people may run layouts by hand.
        self.scenario(Seed::in_space(SeedSpace::User, u64::from_le_bytes(bits)))
    }

    /// Returns the scenario of the recipe with a seed.
    #[must_use]
    pub fn scenario(&self, seed: Seed) -> Scenario {
        Scenario::new(Arc::clone(&self.recipe), seed)
    }

    /// Returns a param of the recipe; 0 if the task does not have it.
    #[must_use]
    pub fn param(&self, name: &str) -> f64 {
        self.recipe.param(name).unwrap_or(0.0)
    }

    /// Returns the largest value that a param can have in a design.
    #[must_use]
    pub fn max_param(&self, name: &str) -> f64 {
        let choice = self.param_choices.iter().find(|choice| choice.param == name);
        choice.and_then(|choice| choice.values.last()).copied().unwrap_or(0.0).max(self.param(name))
    }
}

/// Returns the params that differ between the levels around `level`, with their values in these levels.
fn choices_around(levels: &Levels, level: u32) -> Vec<ParamChoice> {
    let last = u32::try_from(levels.len() - 1).unwrap_or(u32::MAX);
    let around = level.saturating_sub(LEVEL_REACH)..=level.saturating_add(LEVEL_REACH).min(last);
    let choice = |name: &String| {
        let at = |level: u32| levels.params(level as usize).find(|(n, _)| n == name).map(|(_, value)| value);
        let mut values: Vec<f64> = around.clone().filter_map(at).collect();
        values.sort_by(f64::total_cmp);
        values.dedup();
        ParamChoice { param: name.clone(), values }
    };
    levels.columns().iter().map(choice).filter(|choice| choice.values.len() > 1).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rungs_name_level_and_start_scale() {
        let task = env_core::task("docking/single").unwrap();
        let scales = task.start_rungs();
        let text = |level, start_rung| DesignRung::from_stored(task, level, start_rung).to_string();
        assert_eq!(text(Some(3), Some(0)), format!("level 3, start scale {}", scales[0]));
        assert_eq!([text(Some(3), None), text(Some(-1), Some(scales.len() as i64))], ["level 3", ""]);
        let recipe = Recipe::at_level(task, 2).unwrap().with_param(START_SCALE.name, 0.25).unwrap();
        let brief = DesignBrief::new(Arc::new(recipe), 1, 1).at_level(task.levels(), 2);
        assert_eq!(brief.rung().to_string(), "level 2, start scale 0.25");
    }

    /// Laplace's rule: one success and one failure more than was observed.
    #[test]
    fn mean_success_shrinks_to_one_half() {
        let mean = |episodes, success_rate| {
            let (regret, aimed_share, is_retired) = (0.0, None, false);
            let outcome =
                LayoutOutcome::Evaluated { episodes, success_rate, regret, aimed_share, is_retired };
            outcome.mean_success()
        };
        assert_eq!([mean(2, 0.0), mean(8, 1.0), mean(4, 0.5)], [Some(0.25), Some(0.9), Some(0.5)]);
        assert_eq!(LayoutOutcome::Untested.mean_success(), None);
    }
}
