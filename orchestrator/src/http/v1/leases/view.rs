//! A lease as it is answered: whole, and without its groups.

use env_core::{Recipe, RecipeId};
use serde::Serialize;
use serde_json::Value;
use sqlx::SqliteConnection;
use utoipa::ToSchema;

use super::super::super::problem::Problem;
use crate::clock::rfc3339;
use crate::ids::{EpisodeId, LayoutId, LeaseId};
use crate::store::columns::{self, SeedRangeRow};
use crate::store::groups::GroupRow;
use crate::store::leases::LeaseRow;
use crate::store::scenarios::ScenarioLoader;
use crate::store::to_u64;
use crate::leases::bracket_view::BracketView;
use crate::leases::scenario_cache::ScenarioCache;

/// A lease: recipes once each, and groups that name a recipe and a seed.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct Lease {
    /// Its id.
    lease: String,
    /// Its run.
    run: String,
    /// What it is for.
    purpose: String,
    /// `groups` or `columns`.
    form: String,
    /// `active`, `done`, `released` or `expired`.
    status: String,
    /// Episodes in each group.
    group_size: i64,
    /// The policy it was taken for.
    policy_version: i64,
    /// Until when it holds, RFC 3339.
    expires_at: String,
    /// Scenarios without their seeds: world, task, params, physics, layout.
    #[schema(value_type = Vec<Object>)]
    recipes: Vec<Value>,
    /// The groups; of a lease of columns, those that are audited.
    groups: Vec<Group>,
    /// Of a lease of columns, all its groups by ranges of seeds.
    #[serde(skip_serializing_if = "Option::is_none")]
    ranges: Option<Vec<Range>>,
}

/// Groups of a lease of columns that share a recipe: group `first + i` has the seed `seed + i`, for i below `groups`; its episodes
/// are the lease's from `(first + i) × group_size` on, named `ep_<lease>_<index>`.
#[derive(Serialize, ToSchema)]
struct Range {
    /// Index into `recipes`.
    recipe: usize,
    /// The task.
    task: String,
    /// The level.
    level: Option<i64>,
    /// `placement`, `frontier`, `rehearsal` or `sample`.
    role: String,
    /// The number of its first group.
    first: i64,
    /// How many groups.
    groups: i64,
    /// The seed of the first; each next has the next.
    seed: u64,
}

/// Episodes of one scenario. Everything but recipe and seed is for the trainer, never for the agent.
#[derive(Serialize, ToSchema)]
struct Group {
    /// Its number in the lease.
    group: i64,
    /// Index into `recipes`.
    recipe: usize,
    /// The seed that makes the recipe a scenario.
    seed: u64,
    /// The scenario's id.
    scenario: String,
    /// The task.
    task: String,
    /// The level.
    level: Option<i64>,
    /// `placement`, `frontier`, `rehearsal`, `sample`, `explore`, `replay`, `edit`, `boundary`, `designed` or `suite`.
    role: String,
    /// Whether to learn from it: some curricula only want to know how it goes.
    train: bool,
    /// The layout's id, where it was designed.
    layout: Option<String>,
    /// Whether acting well matters on this scenario.
    contested: bool,
    /// `open`, `complete`, `partial` or `lost`.
    state: String,
    /// What to report them as.
    episodes: Vec<String>,
    /// What the scenario is worth; none where it is audited and no log of it came yet.
    bracket: Option<BracketView>,
}

/// A lease without its groups.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct LeaseHead {
    /// Its id.
    lease: String,
    /// What it is for.
    purpose: String,
    /// `groups` or `columns`.
    form: String,
    /// `active`, `done`, `released` or `expired`.
    status: String,
    /// How many groups.
    groups: i64,
    /// Episodes in each.
    group_size: i64,
    /// When it was granted, RFC 3339.
    created_at: String,
    /// Until when it holds, RFC 3339.
    expires_at: String,
}

impl LeaseHead {
    /// Of its row.
    pub(super) fn of(row: LeaseRow) -> Self {
        Self {
            lease: LeaseId { number: row.id, token: row.token }.to_string(),
            purpose: row.purpose.to_string(),
            form: row.form.to_string(),
            status: row.status.to_string(),
            groups: row.groups,
            group_size: row.group_size,
            created_at: rfc3339(row.created_at),
            expires_at: rfc3339(row.expires_at),
        }
    }
}

/// A lease as it is answered.
pub(super) async fn describe(
    conn: &mut SqliteConnection,
    row: LeaseRow,
    groups: Vec<GroupRow>,
) -> Result<Lease, Problem> {
    let mut recipes = Recipes::default();
    let ranges = if row.is_columns() { Some(ranges(conn, &mut recipes, row.id).await?) } else { None };
    let sets = ScenarioCache::of_groups(conn, &groups).await?;
    view_of(row, groups, &sets, (recipes, ranges))
}

/// The same of one whose sets are at hand.
pub(super) fn described(row: LeaseRow, groups: Vec<GroupRow>, sets: &ScenarioCache) -> Result<Lease, Problem> {
    view_of(row, groups, sets, (Recipes::default(), None))
}

fn view_of(
    row: LeaseRow,
    rows: Vec<GroupRow>,
    sets: &ScenarioCache,
    (mut recipes, ranges): (Recipes, Option<Vec<Range>>),
) -> Result<Lease, Problem> {
    let lease = row.lease_id();
    let mut groups = Vec::new();
    for group in rows {
        let (scenario, bracket) = sets.get(&group.scenario, row.is_columns())?;
        let recipe = recipes.place(scenario.recipe());
        groups.push(view(&lease, &row, group, recipe, scenario, bracket));
    }
    Ok(Lease {
        lease: lease.to_string(),
        run: row.run,
        purpose: row.purpose.to_string(),
        form: row.form.to_string(),
        status: row.status.to_string(),
        group_size: row.group_size,
        policy_version: row.policy_version,
        expires_at: rfc3339(row.expires_at),
        recipes: recipes.bodies,
        groups,
        ranges,
    })
}

/// Recipes, once each.
#[derive(Default)]
struct Recipes {
    ids: Vec<RecipeId>,
    bodies: Vec<Value>,
}

impl Recipes {
    fn place(&mut self, recipe: &Recipe) -> usize {
        let id = recipe.id();
        self.ids.iter().position(|known| *known == id).unwrap_or_else(|| {
            self.ids.push(id);
            self.bodies.push(recipe.to_json());
            self.bodies.len() - 1
        })
    }
}

async fn ranges(
    conn: &mut SqliteConnection,
    recipes: &mut Recipes,
    lease: i64,
) -> Result<Vec<Range>, Problem> {
    let (mut loader, mut ranges) = (ScenarioLoader::default(), Vec::new());
    for row in columns::ranges(conn, lease).await? {
        let recipe = recipes.place(&*loader.recipe(conn, &row.recipe).await?);
        let SeedRangeRow { task, level, role, first, groups, seed, .. } = row;
        let role = role.to_string();
        ranges.push(Range { recipe, task, level, role, first, groups, seed: to_u64(seed) });
    }
    Ok(ranges)
}

fn view(
    lease: &LeaseId,
    row: &LeaseRow,
    group: GroupRow,
    recipe: usize,
    scenario: &env_core::Scenario,
    bracket: Option<&env_core::Bracket>,
) -> Group {
    let first = group.number * row.group_size;
    let name = |index| EpisodeId { lease: lease.clone(), index }.to_string();
    Group {
        group: group.number,
        recipe,
        seed: scenario.seed().get(),
        scenario: scenario.id().to_string(),
        contested: group.is_contested,
        episodes: (first..first + row.group_size).map(name).collect(),
        bracket: bracket.map(|bracket| BracketView::of(scenario, bracket)),
        task: group.task,
        level: group.level,
        role: group.role.to_string(),
        train: group.is_for_training,
        layout: group.layout.map(|id| LayoutId(id).to_string()),
        state: group.state.to_string(),
    }
}
