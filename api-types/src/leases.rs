//! Leases of groups of episodes.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

/// Request for a lease.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LeaseRequest {
    /// Number of groups, from 1 to 1 024; with `form: columns` from 1 to 100 000.
    #[schema(minimum = 1, maximum = 100_000)]
    #[serde(deserialize_with = "crate::integers::lease_groups")]
    pub groups: u32,
    /// Number of episodes of one scenario in each group (default: group_size of the run).
    #[schema(minimum = 1, maximum = 1024)]
    #[serde(
        default,
        skip_serializing_if = "Option::is_none",
        deserialize_with = "crate::integers::optional::<_, 1, 1024>"
    )]
    pub group_size: Option<u32>,
    /// Policy version that will run the episodes (default 0).
    #[serde(default)]
    pub policy_version: u32,
    /// Duration of the lease, seconds, from 1 to 86 400 (default 600).
    #[schema(minimum = 1, maximum = 86_400, default = 600)]
    #[serde(default = "default_ttl_s", deserialize_with = "crate::integers::required::<_, 1, 86_400>")]
    pub ttl_s: u32,
    /// `train` (default), `probe` or `eval`.
    #[serde(default)]
    pub purpose: LeasePurpose,
    /// `groups` (default): each group has its scenario and bracket, and every log is replayed. `columns`: for 10⁵ episodes per second
    /// and more. Groups are ranges of seeds without brackets, results are columns, and some groups are audited.
    #[serde(default)]
    pub form: LeaseForm,
    /// True to replace groups whose episodes all have the same score, at most as many as `groups` (default false). The response to
    /// their results lists the replacements.
    #[serde(default)]
    pub refill: bool,
    /// With `purpose: eval`: id of the evaluation. The lease has at most `groups` of its scenarios that no other active lease has.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub evaluation: Option<String>,
    /// `lease` (default): the response has all scenarios, and each group counts from then on. `begin`: the trainer receives a
    /// scenario when it begins the group, and groups that it never begins are returned without loss.
    #[serde(default)]
    pub disclosure: LeaseDisclosure,
}

impl LeaseRequest {
    /// Request for a number of training groups, with defaults for all other fields.
    #[must_use]
    pub fn new(groups: u32) -> Self {
        Self {
            groups,
            group_size: None,
            policy_version: 0,
            ttl_s: default_ttl_s(),
            purpose: LeasePurpose::default(),
            form: LeaseForm::default(),
            refill: false,
            evaluation: None,
            disclosure: LeaseDisclosure::default(),
        }
    }
}

const fn default_ttl_s() -> u32 {
    600
}

/// Purpose of a lease.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum LeasePurpose {
    /// Training: the agent explores and learns from the episodes.
    #[default]
    Train,
    /// Measurement of mastery: the agent neither explores nor learns.
    Probe,
    /// Evaluation: results do not move the curriculum. Scenarios have evaluation seeds at the current levels.
    Eval,
}

/// When a lease discloses its scenarios.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum LeaseDisclosure {
    /// All with the lease.
    #[default]
    Lease,
    /// Group by group, when the trainer begins them.
    Begin,
}

/// Request to begin groups of a lease with `disclosure: begin`.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BeginGroupsRequest {
    /// Numbers of the groups to begin, at least one and at most 1 024.
    #[schema(min_items = 1, max_items = 1024, value_type = Vec<u32>)]
    pub groups: Vec<i64>,
}

/// Group of a lease whose scenario is not disclosed yet.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct UndisclosedGroup {
    /// Number of the group in the lease.
    pub group: i64,
    /// Id of the task.
    pub task: String,
}

/// Form in which the episodes of a lease are named and reported.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum LeaseForm {
    /// Groups of episodes, reported one by one.
    #[default]
    Groups,
    /// Ranges of seeds, reported together as columns.
    Columns,
}

/// Lease of groups. Recipes are listed once; each group refers to a recipe and a seed.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct Lease {
    /// Id of the lease.
    pub lease: String,
    /// Id of the run.
    pub run: String,
    /// Purpose of the lease.
    pub purpose: LeasePurpose,
    /// Form of the results.
    pub form: LeaseForm,
    /// Status of the lease.
    pub status: LeaseStatus,
    /// Number of episodes in each group.
    pub group_size: i64,
    /// Policy version of the request.
    pub policy_version: i64,
    /// Time at which the lease expires, RFC 3339.
    pub expires_at: String,
    /// Scenarios without their seeds: world, task, params, physics and layout.
    #[schema(value_type = Vec<Object>)]
    pub recipes: Vec<Value>,
    /// When the lease discloses its scenarios.
    pub disclosure: LeaseDisclosure,
    /// Disclosed groups of the lease; for a lease of columns only the audited groups.
    pub groups: Vec<LeasedGroup>,
    /// Groups that can be begun; omitted if there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub undisclosed: Vec<UndisclosedGroup>,
    /// All groups of a lease of columns, as ranges of seeds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ranges: Option<Vec<SeedRange>>,
}

/// Groups of a lease of columns that share a recipe. Group `first + i` has the seed `seed + i`, for i below `groups`. Its episodes
/// are those of the lease from `(first + i) × group_size` on, named `ep_<lease>_<index>`.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct SeedRange {
    /// Index into the `recipes` of the lease.
    pub recipe: usize,
    /// Id of the task.
    pub task: String,
    /// Level of the scenarios.
    pub level: Option<i64>,
    /// Role of the groups: `placement`, `frontier`, `rehearsal` or `sample`.
    pub role: GroupRole,
    /// Number of the first group in the lease.
    pub first_group: i64,
    /// Number of groups in the range.
    pub groups: i64,
    /// Seed of the first group.
    pub seed: u64,
}

/// Episodes of one scenario. Recipe and seed make the scenario; all other fields are for the trainer, never for the agent.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct LeasedGroup {
    /// Number of the group in the lease, from 0.
    pub group: i64,
    /// Index into the `recipes` of the lease.
    pub recipe: usize,
    /// Seed that makes the recipe a scenario.
    pub seed: u64,
    /// Id of the scenario.
    pub scenario: String,
    /// Id of the task.
    pub task: String,
    /// Level of the scenario.
    pub level: Option<i64>,
    /// Role of the group.
    pub role: GroupRole,
    /// True if the agent is to learn from the group; some strategies only measure with it.
    pub train: bool,
    /// Id of the layout, if the group was designed.
    pub layout: Option<String>,
    /// True if the scenario is contested: the reference succeeds and most blind plans do not.
    pub contested: bool,
    /// State of the group.
    pub state: GroupState,
    /// Ids under which to report the episodes.
    pub episodes: Vec<String>,
    /// Bracket of the scenario; null if the group is audited and no log was reported yet.
    pub bracket: Option<ScenarioBracket>,
}

/// Scores between which the skill of an episode is measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ScenarioBracket {
    /// Version of the reference planner.
    pub planner_version: u32,
    /// Score without acting on observations: mean score of the blind panel in `kessler/survival` and `kessler/eco_station`,
    /// best score of the blind panel in `tasking`, but at least 0, and score of `hold` in other tasks.
    pub floor: f64,
    /// Score of the `hold` policy, which never acts.
    pub hold: f64,
    /// Score of the reference planner, which knows the whole scenario.
    pub reference: f64,
    /// Number of blind plans that succeed.
    pub panel_successes: usize,
    /// Number of blind plans.
    pub panel_size: usize,
}

/// Lease without its groups.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct LeaseSummary {
    /// Id of the lease.
    pub lease: String,
    /// Purpose of the lease.
    pub purpose: LeasePurpose,
    /// Form of the results.
    pub form: LeaseForm,
    /// Status of the lease.
    pub status: LeaseStatus,
    /// Number of groups in the lease.
    pub groups: i64,
    /// Number of episodes in each group.
    pub group_size: i64,
    /// Time of creation, RFC 3339.
    pub created_at: String,
    /// Time at which the lease expires, RFC 3339.
    pub expires_at: String,
}

/// Page of the leases of a run.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct LeasePage {
    /// Leases of the page, oldest first.
    pub leases: Vec<LeaseSummary>,
    /// Cursor of the next page; null on the last page.
    pub next: Option<String>,
}

/// Status of a lease.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum LeaseStatus {
    /// The lease accepts results until it expires.
    Active,
    /// All groups of the lease are closed.
    Done,
    /// The client returned the lease before all groups were closed.
    Released,
    /// The lease expired before all groups were closed.
    Expired,
}

/// Role of a group: the role of its proposal in the curriculum, or its origin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum GroupRole {
    /// Search for the first level of a new run.
    Placement,
    /// Scenario at the current level.
    Frontier,
    /// Scenario at a level that was passed before.
    Rehearsal,
    /// Draw of a strategy without levels, or for an evaluation lease.
    Sample,
    /// Scenario that the agent has not seen.
    Explore,
    /// Repeated scenario with a learning signal.
    Replay,
    /// Edit of a repeated scenario.
    Edit,
    /// Scenario with one param at its bound.
    Boundary,
    /// Scenario at the rung that a sampler chose.
    Rung,
    /// Scenario drawn from all rungs, so that none is forgotten.
    Coverage,
    /// Scenario of a designed layout.
    Designed,
    /// Scenario of an evaluation suite.
    Suite,
}

/// State of a group.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum GroupState {
    /// Episodes of the group are missing.
    Open,
    /// All episodes of the group finished.
    Complete,
    /// At least `min_group` episodes finished, but not all.
    Partial,
    /// Fewer than `min_group` episodes finished.
    Lost,
}
