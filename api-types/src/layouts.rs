//! Layouts of all runs.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::{IntoParams, ToSchema};

use crate::{DesignSummary, EpisodeOutcome, ScenarioBracket};

/// Query of the layouts of all runs.
#[derive(Debug, Clone, Default, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct LayoutQuery {
    /// Id of the task.
    pub task: Option<String>,
    /// State: `active` or `retired`.
    pub state: Option<String>,
    /// Failure mode that the layout aims at.
    pub aim: Option<String>,
    /// Largest number of layouts on a page, from 1 to 500 (default 50).
    #[param(minimum = 1, maximum = 500, default = 50)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 500>")]
    pub limit: Option<u32>,
    /// Field `next` of the previous page.
    pub cursor: Option<String>,
}

/// Layout with its bodies.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct Layout {
    /// The design, as lists show it.
    #[serde(flatten)]
    pub summary: DesignSummary,
    /// Design in the language of its world: aim, params and parts (encounters, deputies or fields).
    #[schema(value_type = Option<Object>)]
    pub design: Option<Value>,
    /// Id of the scenario.
    pub scenario_id: String,
    /// Complete scenario with its bodies; `POST /v1/scenarios` accepts it unchanged.
    #[schema(value_type = Object)]
    pub scenario: Value,
    /// Bracket of the scenario.
    pub bracket: ScenarioBracket,
    /// Outcome of the reference plan, which shows that the layout is solvable.
    pub reference_outcome: EpisodeOutcome,
}
