//! What a designer is told: the task and its limits, what the agent fails at, and how earlier layouts fared.

use std::sync::Arc;
use std::time::Duration;

use env_core::space::Levels;
use env_core::{Recipe, Scenario, Seed, SeedSpace};
use serde_json::Value;

use crate::profile::Profile;

/// Levels to either side of the run's from which a design may take its params.
const REACH: u32 = 2;

/// What a designer is asked for.
#[derive(Debug, Clone)]
pub struct Brief {
    /// How many layouts are wanted.
    pub count: usize,
    /// What its draws follow from: the same brief and seed make the same designs, where no language model takes part.
    pub seed: u64,
    /// Task, params and physics to design for, without a layout.
    pub base: Arc<Recipe>,
    /// The level that the params are of.
    pub level: Option<u32>,
    /// Params that a design may choose, and from what.
    pub limits: Vec<Limit>,
    /// What the agent fails at.
    pub profile: Profile,
    /// How well it does at this level: none where nothing is known.
    pub standing: Option<Standing>,
    /// How earlier layouts fared, the newest first.
    pub fates: Vec<Past>,
    /// How long designing may take: whoever designs ends then with what there is. No limit if none.
    pub patience: Option<Duration>,
}

/// A param that a design may choose.
#[derive(Debug, Clone, PartialEq)]
pub struct Limit {
    /// The param.
    pub param: String,
    /// What it may be, as the levels have it, ascending.
    pub values: Vec<f64>,
}

/// Mastery of the level, as the curriculum knows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Standing {
    /// Contested scenarios it rests on.
    pub n: u32,
    /// The posterior's mean.
    pub mean: f64,
    /// Its 10 % quantile.
    pub q10: f64,
    /// Its 90 % quantile.
    pub q90: f64,
}

/// An earlier layout.
#[derive(Debug, Clone, PartialEq)]
pub struct Past {
    /// The design, in its world's language.
    pub design: Value,
    /// The seed of the sky it was put into, where it was let through.
    pub sky: Option<Seed>,
    /// What became of it.
    pub fate: Fate,
}

/// What became of a layout.
#[derive(Debug, Clone, PartialEq)]
pub enum Fate {
    /// The gate refused it.
    Refused {
        /// Which check ([`crate::gate::CHECKS`]).
        check: String,
        /// Why.
        reason: String,
    },
    /// It was let through; nobody has flown it yet.
    Fresh,
    /// The agent has flown it.
    Flown {
        /// Episodes.
        episodes: u32,
        /// The share of them that succeeded.
        success: f64,
        /// The mean of (reference − score)/(reference − floor) within [0, 1]; on decoys of (reference − score)/reference.
        regret: f64,
        /// Of the criticised episodes in which something went wrong, the share in which the aimed failure mode did; none
        /// where there is no such episode.
        as_aimed: Option<f64>,
        /// Whether it serves no longer.
        retired: bool,
    },
}

impl Fate {
    /// What a layout is worth to who looks for failures of the mode it aims at: its regret, as far as that mode is to blame.
    /// None where nobody has flown it.
    #[must_use]
    pub fn worth(&self) -> Option<f64> {
        match self {
            Self::Flown { regret, as_aimed, .. } => Some(regret * as_aimed.unwrap_or(1.0)),
            Self::Refused { .. } | Self::Fresh => None,
        }
    }
}

impl Brief {
    /// A brief for a recipe by itself: nothing is known of the agent, and params are fixed.
    #[must_use]
    pub fn new(base: Arc<Recipe>, count: usize, seed: u64) -> Self {
        let profile = Profile::blank(base.task().id());
        Self {
            count,
            seed,
            base,
            level: None,
            limits: Vec::new(),
            profile,
            standing: None,
            fates: Vec::new(),
            patience: None,
        }
    }

    /// The same for a level of a table: a design may choose among what the levels around it have.
    #[must_use]
    pub fn at_level(mut self, levels: &Levels, level: u32) -> Self {
        self.level = Some(level);
        self.limits = limits(levels, level);
        self
    }

    /// A scenario of the recipe under the brief's `number`-th seed: a sky to put a design into.
    #[must_use]
    pub fn sky(&self, number: u64) -> Scenario {
        let mut bits = [0; 8];
        let mut hasher = blake3::Hasher::new_derive_key("sparring 2026 skies of designs");
        hasher.update(&self.seed.to_le_bytes());
        hasher.update(&number.to_le_bytes());
        hasher.finalize_xof().fill(&mut bits);
        // User seeds: whoever sees a layout may fly it by hand.
        self.under(Seed::in_space(SeedSpace::User, u64::from_le_bytes(bits)))
    }

    /// A scenario of the recipe under this seed.
    #[must_use]
    pub fn under(&self, seed: Seed) -> Scenario {
        Scenario::new(Arc::clone(&self.base), seed)
    }

    /// A param of the base.
    #[must_use]
    pub fn param(&self, name: &str) -> f64 {
        self.base.param(name).unwrap_or(0.0)
    }

    /// The largest value a param may have: the base's, or more within its limits.
    #[must_use]
    pub fn most(&self, name: &str) -> f64 {
        let limit = self.limits.iter().find(|limit| limit.param == name);
        limit.and_then(|limit| limit.values.last()).copied().unwrap_or(0.0).max(self.param(name))
    }
}

/// What a design may choose at a level: of each param that changes around it, the values it has there.
fn limits(levels: &Levels, level: u32) -> Vec<Limit> {
    let top = u32::try_from(levels.len() - 1).unwrap_or(u32::MAX);
    let around = level.saturating_sub(REACH)..=level.saturating_add(REACH).min(top);
    let column = |name: &String| {
        let of = |level: u32| levels.params(level as usize).find(|(n, _)| n == name).map(|(_, value)| value);
        let mut values: Vec<f64> = around.clone().filter_map(of).collect();
        values.sort_by(f64::total_cmp);
        values.dedup();
        Limit { param: name.clone(), values }
    };
    levels.columns().iter().map(column).filter(|limit| limit.values.len() > 1).collect()
}
