//! Compact form of a brief. Recipes and designs are JSON text inside, the form in which the database keeps them.

use std::sync::Arc;
use std::time::Duration;

use designer::brief::{DesignRung, LayoutOutcome, LevelMastery, ParamChoice, PastLayout};
use designer::{DesignBrief, FailureProfile};
use env_core::{Recipe, Seed};
use serde::{Deserialize, Serialize};

use crate::wire::{MAX_ENTRIES, WireError, list};

/// Brief of a designer.
#[derive(Serialize, Deserialize)]
pub(super) struct WireBrief {
    count: u32,
    seed: u64,
    recipe: String,
    level: Option<u32>,
    #[serde(deserialize_with = "list::<_, _, MAX_ENTRIES>")]
    param_choices: Vec<ParamChoice>,
    profile: FailureProfile,
    mastery: Option<LevelMastery>,
    #[serde(deserialize_with = "list::<_, _, MAX_ENTRIES>")]
    past_layouts: Vec<WirePastLayout>,
    time_limit_ms: Option<u64>,
}

#[derive(Serialize, Deserialize)]
struct WirePastLayout {
    design: String,
    rung: DesignRung,
    seed: Option<u64>,
    outcome: LayoutOutcome,
}

impl From<&DesignBrief> for WireBrief {
    fn from(brief: &DesignBrief) -> Self {
        let past = |layout: &PastLayout| WirePastLayout {
            design: layout.design.to_string(),
            rung: layout.rung,
            seed: layout.seed.map(Seed::get),
            outcome: layout.outcome.clone(),
        };
        let millis = |limit: Duration| u64::try_from(limit.as_millis()).unwrap_or(u64::MAX);
        Self {
            count: u32::try_from(brief.count).unwrap_or(u32::MAX),
            seed: brief.seed,
            recipe: brief.recipe.to_json().to_string(),
            level: brief.level,
            param_choices: brief.param_choices.clone(),
            profile: brief.profile.clone(),
            mastery: brief.mastery,
            past_layouts: brief.past_layouts.iter().map(past).collect(),
            time_limit_ms: brief.time_limit.map(millis),
        }
    }
}

impl WireBrief {
    pub(super) fn read(self) -> Result<DesignBrief, WireError> {
        let past = |layout: WirePastLayout| -> Result<_, WireError> {
            Ok(PastLayout {
                design: serde_json::from_str(&layout.design)?,
                rung: layout.rung,
                seed: layout.seed.map(Seed::new).transpose()?,
                outcome: layout.outcome,
            })
        };
        let recipe = Recipe::from_json(&serde_json::from_str(&self.recipe)?)?;
        Ok(DesignBrief {
            count: self.count as usize,
            seed: self.seed,
            recipe: Arc::new(recipe),
            level: self.level,
            param_choices: self.param_choices,
            profile: self.profile,
            mastery: self.mastery,
            past_layouts: self.past_layouts.into_iter().map(past).collect::<Result<_, _>>()?,
            time_limit: self.time_limit_ms.map(Duration::from_millis),
        })
    }
}
