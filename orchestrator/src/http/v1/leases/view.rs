//! Conversion of stored leases to responses, with their groups and without.

use crate::api_enums::ConvertEnum;
use api_types::{Lease, LeaseSummary, LeasedGroup, SeedRange, UndisclosedGroup};
use env_core::{Recipe, RecipeId};
use serde_json::Value;
use sqlx::SqliteConnection;
use store::columns::{self, SeedRangeRow};
use store::groups::{GroupRow, GroupState};
use store::ids::{EpisodeId, LayoutId, LeaseId};
use store::leases::LeaseRow;
use store::scenarios::ScenarioLoader;
use store::to_u64;

use crate::http::problem::Problem;
use crate::leases::bracket_view::scenario_bracket;
use crate::leases::scenario_cache::ScenarioCache;
use clock::rfc3339;

/// Converts the row of a lease, without its groups.
pub(super) fn lease_summary(row: LeaseRow) -> LeaseSummary {
    LeaseSummary {
        lease: LeaseId { number: row.id, suffix: row.id_suffix }.to_string(),
        purpose: row.purpose.convert(),
        form: row.form.convert(),
        status: row.status.convert(),
        groups: row.groups,
        group_size: row.group_size,
        created_at: rfc3339(row.created_at),
        expires_at: rfc3339(row.expires_at),
    }
}

/// Converts a lease and loads its ranges and scenarios.
///
/// # Errors
/// Returns a problem if a scenario cannot be read.
pub(super) async fn load_lease(
    conn: &mut SqliteConnection,
    row: LeaseRow,
    groups: Vec<GroupRow>,
) -> Result<Lease, Problem> {
    let mut recipes = RecipeTable::default();
    let ranges = if row.is_columns() { Some(load_ranges(conn, &mut recipes, row.id).await?) } else { None };
    let scenarios = ScenarioCache::of_groups(conn, &groups).await?;
    build_lease(row, groups, &scenarios, recipes, ranges)
}

/// Converts a lease whose scenarios are in memory.
///
/// # Errors
/// Returns a problem if the cache lacks a scenario.
pub(super) fn lease_from_cache(
    row: LeaseRow,
    groups: Vec<GroupRow>,
    scenarios: &ScenarioCache,
) -> Result<Lease, Problem> {
    build_lease(row, groups, scenarios, RecipeTable::default(), None)
}

fn build_lease(
    row: LeaseRow,
    rows: Vec<GroupRow>,
    scenarios: &ScenarioCache,
    mut recipes: RecipeTable,
    ranges: Option<Vec<SeedRange>>,
) -> Result<Lease, Problem> {
    let lease = row.lease_id();
    let (mut groups, mut undisclosed) = (Vec::new(), Vec::new());
    for group in rows {
        if !group.is_disclosed {
            if group.state == GroupState::Open {
                undisclosed.push(UndisclosedGroup { group: group.number, task: group.task });
            }
            continue;
        }
        let (scenario, bracket) = scenarios.get(&group.scenario, row.is_columns())?;
        let recipe = recipes.insert(scenario.recipe());
        groups.push(leased_group(&lease, &row, group, recipe, scenario, bracket));
    }
    Ok(Lease {
        lease: lease.to_string(),
        run: row.run,
        purpose: row.purpose.convert(),
        form: row.form.convert(),
        status: row.status.convert(),
        group_size: row.group_size,
        policy_version: row.policy_version,
        expires_at: rfc3339(row.expires_at),
        recipes: recipes.bodies,
        disclosure: row.disclosure.convert(),
        groups,
        undisclosed,
        ranges,
    })
}

/// Distinct recipes of a lease, in order of their first use.
#[derive(Default)]
struct RecipeTable {
    ids: Vec<RecipeId>,
    bodies: Vec<Value>,
}

impl RecipeTable {
    /// Returns the index of a recipe, which is added if it is new.
    fn insert(&mut self, recipe: &Recipe) -> usize {
        let id = recipe.id();
        self.ids.iter().position(|known| *known == id).unwrap_or_else(|| {
            self.ids.push(id);
            self.bodies.push(recipe.to_json());
            self.bodies.len() - 1
        })
    }
}

async fn load_ranges(
    conn: &mut SqliteConnection,
    recipes: &mut RecipeTable,
    lease: i64,
) -> Result<Vec<SeedRange>, Problem> {
    let (mut loader, mut ranges) = (ScenarioLoader::default(), Vec::new());
    for row in columns::ranges(conn, lease).await? {
        let recipe = recipes.insert(&*loader.recipe(conn, &row.recipe).await?);
        let SeedRangeRow { task, level, role, first_group, groups, first_seed: seed, .. } = row;
        ranges.push(SeedRange {
            recipe,
            task,
            level,
            role: role.convert(),
            first_group,
            groups,
            seed: to_u64(seed),
        });
    }
    Ok(ranges)
}

fn leased_group(
    lease: &LeaseId,
    row: &LeaseRow,
    group: GroupRow,
    recipe: usize,
    scenario: &env_core::Scenario,
    bracket: Option<&env_core::Bracket>,
) -> LeasedGroup {
    let first = group.number * row.group_size;
    let name = |index| EpisodeId { lease: lease.clone(), index }.to_string();
    LeasedGroup {
        group: group.number,
        recipe,
        seed: scenario.seed().get(),
        scenario: scenario.id().to_string(),
        contested: group.is_contested,
        episodes: (first..first + row.group_size).map(name).collect(),
        bracket: bracket.map(|bracket| scenario_bracket(scenario, bracket)),
        task: group.task,
        level: group.level,
        role: group.role.convert(),
        train: group.is_for_training,
        layout: group.layout.map(|id| LayoutId::of_run(&row.run, id).to_string()),
        state: group.state.convert(),
    }
}
