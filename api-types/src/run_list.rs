//! List of runs: search, filters, order and groups.

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use crate::{MissingShard, RunSummary};

/// Page of the list of runs.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct RunPage {
    /// Runs of the page, in the order of the query.
    pub runs: Vec<RunSummary>,
    /// Number of runs on all pages; null on all pages but the first.
    pub total: Option<i64>,
    /// Cursor of the next page; null on the last page.
    pub next: Option<String>,
    /// Shards whose runs the page and the number lack; empty for a server without peers.
    #[serde(default)]
    #[schema(required = true)]
    pub missing_shards: Vec<MissingShard>,
}

/// Query of the runs.
#[derive(Debug, Clone, Default, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct RunQuery {
    /// True for archived runs, false for the others (default false).
    #[serde(default)]
    pub archived: bool,
    /// Words that all occur in the id, the name, the note or a tag of a run, at most 200 characters and 8 words. ASCII letters of
    /// either case are equal.
    #[param(max_length = 200, example = "baseline lr")]
    pub search: Option<String>,
    /// Tag of the runs to list; an empty text selects runs without tags (default: runs with any tags).
    pub tag: Option<String>,
    /// Strategy of the runs to list (default: all).
    pub strategy: Option<String>,
    /// Ids of all tasks of the runs to list, in any order, separated by commas (default: any tasks).
    #[param(example = "kessler/survival")]
    pub tasks: Option<String>,
    /// Activity of the runs to list (default: any). `archived` lists archived runs.
    #[param(inline)]
    pub activity: Option<RunActivity>,
    /// Value to sort by (default `created`). Runs without the value come last.
    #[param(inline)]
    pub sort: Option<RunSort>,
    /// Direction of the order (default `asc`).
    #[param(inline)]
    pub order: Option<SortOrder>,
    /// Largest number of runs on a page, from 1 to 500 (default 50).
    #[param(minimum = 1, maximum = 500, default = 50)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 500>")]
    pub limit: Option<u32>,
    /// Field `next` of the previous page.
    pub cursor: Option<String>,
}

/// Query of the groups of runs. The filters are those of the list of runs.
#[derive(Debug, Clone, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct RunGroupQuery {
    /// Property whose values are the groups.
    #[param(inline)]
    pub by: RunGroupProperty,
    /// True for archived runs, false for the others (default false).
    #[serde(default)]
    pub archived: bool,
    /// Words that all occur in the id, the name, the note or a tag of a run, at most 200 characters and 8 words.
    #[param(max_length = 200)]
    pub search: Option<String>,
    /// Tag of the runs; an empty text selects runs without tags (default: runs with any tags).
    pub tag: Option<String>,
    /// Strategy of the runs (default: all).
    pub strategy: Option<String>,
    /// Ids of all tasks of the runs, in any order, separated by commas (default: any tasks).
    pub tasks: Option<String>,
    /// Activity of the runs (default: any). `archived` selects archived runs.
    #[param(inline)]
    pub activity: Option<RunActivity>,
}

/// Groups of the runs that match.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct RunGroupList {
    /// Groups in alphabetical order of their values, at most 1 000.
    pub groups: Vec<RunGroup>,
    /// Shards whose runs the groups lack; empty for a server without peers.
    #[serde(default)]
    #[schema(required = true)]
    pub missing_shards: Vec<MissingShard>,
}

/// Runs that share the value of a property.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct RunGroup {
    /// Value of the property, in the form of the filter with its name; empty for runs without tags.
    pub value: String,
    /// Number of its runs.
    pub runs: i64,
    /// Number of their finished episodes, columns included.
    pub episodes: i64,
    /// Time of their latest results, RFC 3339; null before there are any.
    pub last_results_at: Option<String>,
}

/// Activity of a run: what it does now.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RunActivity {
    /// The run is active and has no results yet.
    Waiting,
    /// The run is active and had results in the last 60 seconds.
    Running,
    /// The run is active, and its latest results are older.
    Idle,
    /// The run is paused.
    Paused,
    /// The run is archived.
    Archived,
}

/// Value by which runs are sorted. Runs with equal values are sorted by their ids.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RunSort {
    /// Time of the creation.
    #[default]
    Created,
    /// Name; ASCII letters of either case are equal.
    Name,
    /// Number of finished episodes.
    Episodes,
    /// Time of the latest results.
    LastResults,
    /// Mean skill of the latest episodes.
    Skill,
}

/// Direction of an order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SortOrder {
    /// The lowest value comes first.
    #[default]
    Asc,
    /// The highest value comes first.
    Desc,
}

/// Property by which runs are grouped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RunGroupProperty {
    /// Strategy of the run.
    Strategy,
    /// All tasks of the run.
    Tasks,
    /// Tag: a run is in the group of each of its tags.
    Tag,
    /// Activity of the run.
    Activity,
}
