//! Leases: take, list, show, renew, release.

use axum::Extension;
use axum::extract::State;
use axum::http::StatusCode;
use env_core::{Recipe, RecipeId};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sqlx::SqliteConnection;
use utoipa::ToSchema;

use super::super::access::Caller;
use super::super::extract::{Json, NoQuery, Path, Query};
use super::super::problem::Problem;
use super::{Page, id, next, reader_of, run_id};
use crate::clock::rfc3339;
use crate::ids::{EpisodeId, EvaluationId, LayoutId, LeaseId};
use crate::service::App;
use crate::store::columns::RangeRow;
use crate::store::groups::{self, GroupRow};
use crate::store::leases::LeaseRow;
use crate::store::scenarios::Loader;
use crate::store::{columns, folds, leases, unsigned};
use crate::training::columns::TakeColumns;
use crate::training::lease::{Granted, Purpose, Release, Renew, TakeLease, find};
use crate::training::sets::Sets;
use crate::training::{BracketView, TrainingError};

/// A lease as it is asked for.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct LeaseWish {
    /// How many groups: 1 to 1 024; with `form: columns` 1 to 100 000.
    groups: u32,
    /// Episodes of one scenario in each (the run's group_size).
    group_size: Option<u32>,
    /// The policy that will fly it (0).
    #[serde(default)]
    policy_version: u32,
    /// How long it holds, seconds: 1 to 86 400 (600).
    #[serde(default = "ten_minutes")]
    ttl_s: u32,
    /// `train` (default), `probe` or `eval`.
    #[serde(default = "train")]
    purpose: Purpose,
    /// `groups` (default): every group with its scenario and bracket, every log replayed. `columns`: for 10⁵ episodes and more a
    /// second: ranges of seeds, as they come, without brackets; results are columns, of which some groups are audited.
    #[serde(default)]
    form: Form,
    /// Whether groups whose episodes all have the same score are replaced, up to as many as were asked for (false). The answer to
    /// their results names the groups that came in their place.
    #[serde(default)]
    refill: bool,
    /// With `purpose: eval`: the evaluation whose scenarios are wanted, of those that nobody flies. As many groups are answered as there
    /// are, at most as many as were asked for.
    evaluation: Option<String>,
}

/// How a lease's episodes are named and reported.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
enum Form {
    #[default]
    Groups,
    Columns,
}

const fn ten_minutes() -> u32 {
    600
}

const fn train() -> Purpose {
    Purpose::Train
}

/// A lease: recipes once each, and groups that name a recipe and a seed.
#[derive(Serialize, ToSchema)]
pub(super) struct Lease {
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
pub(super) struct LeaseHead {
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
    fn of(row: LeaseRow) -> Self {
        Self {
            lease: LeaseId { number: row.id, token: row.token }.to_string(),
            purpose: row.purpose,
            form: row.form,
            status: row.status,
            groups: row.groups,
            group_size: row.group_size,
            created_at: rfc3339(row.created_at),
            expires_at: rfc3339(row.expires_at),
        }
    }
}

/// A page of leases.
#[derive(Serialize, ToSchema)]
pub(super) struct Leases {
    /// Oldest first.
    leases: Vec<LeaseHead>,
    /// Cursor of the next page, if there may be one.
    next: Option<String>,
}

/// Lease groups of scenarios. Where scenarios are still being prepared it waits a while, then answers 503.
#[utoipa::path(
    post, path = "/runs/{run}/leases", tag = "leases", request_body = LeaseWish,
    params(("run" = String, Path, description = "The run's id.")),
    responses(
        (status = 201, body = Lease),
        (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 409, body = Problem, description = "The run is paused."), (status = 408, body = Problem), (status = 413, body = Problem),
        (status = 415, body = Problem), (status = 422, body = Problem), (status = 429, body = Problem),
        (status = 503, body = Problem, description = "Scenarios are still being prepared; see Retry-After.")
    )
)]
pub(super) async fn take(
    _: NoQuery,
    State(app): State<App>,
    Extension(caller): Extension<Caller>,
    Path(run): Path<String>,
    Json(wish): Json<LeaseWish>,
) -> Result<(StatusCode, axum::Json<Lease>), Problem> {
    let LeaseWish { groups, group_size, policy_version, ttl_s, purpose, form, refill, evaluation } = wish;
    let (run, owner) = (run_id(&run)?, caller.owns(app.each.leases));
    let evaluation = evaluation.map(|text| text.parse::<EvaluationId>()).transpose();
    let evaluation =
        evaluation.map_err(|error| Problem::invalid("evaluation", error.to_string()))?.map(|id| id.0);
    let wish = TakeLease {
        run: run.clone(),
        groups,
        group_size,
        policy_version,
        ttl_s,
        purpose,
        owner,
        refill,
        evaluation,
    };
    let Granted { row, groups, sets } = match form {
        Form::Groups => app.desk.lease(wish).await?,
        Form::Columns => app.writer.change(TakeColumns(wish)).await?,
    };
    let lease = match sets {
        Some(sets) => view_of(row, groups, &sets, (Recipes::default(), None))?,
        None => describe(&mut *app.readers.acquire().await?, row, groups).await?,
    };
    Ok((StatusCode::CREATED, axum::Json(lease)))
}

/// List the leases of a run, oldest first.
#[utoipa::path(
    get, path = "/runs/{run}/leases", tag = "leases",
    params(("run" = String, Path, description = "The run's id."), Page),
    responses(
        (status = 200, body = Leases), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(super) async fn list(
    State(app): State<App>,
    Path(run): Path<String>,
    Query(page): Query<Page>,
) -> Result<axum::Json<Leases>, Problem> {
    let (run, limit) = (run_id(&run)?, page.limit()?);
    let mut conn = reader_of(&app, &run).await?;
    let after = page.cursor()?.0;
    let mut rows = leases::page(&mut conn, run.as_str(), after, limit).await?;
    rows.extend(folds::heads(&mut conn, run.as_str(), after.saturating_add(1), limit).await?);
    rows.sort_by_key(|row| row.id);
    rows.dedup_by_key(|row| row.id); // something of it stays
    rows.truncate(usize::try_from(limit).unwrap_or_default());
    let next = next(rows.len(), limit, rows.last().map(|row| (row.id, "")));
    Ok(axum::Json(Leases { leases: rows.into_iter().map(LeaseHead::of).collect(), next }))
}

/// Show a lease with its groups: what was answered when it was taken. Past what the run keeps whole only those groups are
/// left that a level move, a layout or an example of a failure rests on.
#[utoipa::path(
    get, path = "/runs/{run}/leases/{lease}", tag = "leases",
    params(("run" = String, Path, description = "The run's id."), ("lease" = String, Path, description = "The lease's id.")),
    responses(
        (status = 200, body = Lease), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 410, body = Problem, description = "The run keeps nothing of it any more but how its episodes came out.")
    )
)]
pub(super) async fn show(
    _: NoQuery,
    State(app): State<App>,
    Path((run, lease)): Path<(String, String)>,
) -> Result<axum::Json<Lease>, Problem> {
    let (run, lease) = (run_id(&run)?, id("lease", &lease)?);
    let mut conn = app.readers.acquire().await?;
    let row = find(&mut conn, &run, &lease).await?;
    let groups = groups::of_lease(&mut conn, row.id).await?;
    if row.folded != 0 && groups.is_empty() {
        return Err(TrainingError::Expired(lease.to_string()).into());
    }
    Ok(axum::Json(describe(&mut conn, row, groups).await?))
}

/// Renew a lease: it holds for its time again, from now.
#[utoipa::path(
    post, path = "/runs/{run}/leases/{lease}/renew", tag = "leases",
    params(("run" = String, Path, description = "The run's id."), ("lease" = String, Path, description = "The lease's id.")),
    responses(
        (status = 200, body = LeaseHead), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 409, body = Problem, description = "The lease is over."), (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(super) async fn renew(
    _: NoQuery,
    State(app): State<App>,
    Path((run, lease)): Path<(String, String)>,
) -> Result<axum::Json<LeaseHead>, Problem> {
    let change = Renew { run: run_id(&run)?, lease: id("lease", &lease)? };
    Ok(axum::Json(LeaseHead::of(app.writer.change(change).await?)))
}

/// Release a lease: what was not reported is offered again. Releasing what is over changes nothing.
#[utoipa::path(
    post, path = "/runs/{run}/leases/{lease}/release", tag = "leases",
    params(("run" = String, Path, description = "The run's id."), ("lease" = String, Path, description = "The lease's id.")),
    responses(
        (status = 200, body = LeaseHead), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 429, body = Problem),
        (status = 503, body = Problem)
    )
)]
pub(super) async fn release(
    _: NoQuery,
    State(app): State<App>,
    Path((run, lease)): Path<(String, String)>,
) -> Result<axum::Json<LeaseHead>, Problem> {
    let change = Release { run: run_id(&run)?, lease: id("lease", &lease)? };
    Ok(axum::Json(LeaseHead::of(app.writer.change(change).await?)))
}

async fn describe(
    conn: &mut SqliteConnection,
    row: LeaseRow,
    groups: Vec<GroupRow>,
) -> Result<Lease, Problem> {
    let mut recipes = Recipes::default();
    let ranges = if row.is_columns() { Some(ranges(conn, &mut recipes, row.id).await?) } else { None };
    let sets = Sets::of_groups(conn, &groups).await?;
    view_of(row, groups, &sets, (recipes, ranges))
}

fn view_of(
    row: LeaseRow,
    rows: Vec<GroupRow>,
    sets: &Sets,
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
        purpose: row.purpose,
        form: row.form,
        status: row.status,
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
    let (mut loader, mut ranges) = (Loader::default(), Vec::new());
    for row in columns::ranges(conn, lease).await? {
        let recipe = recipes.place(&*loader.recipe(conn, &row.recipe).await?);
        let RangeRow { task, level, role, first, groups, seed, .. } = row;
        ranges.push(Range { recipe, task, level, role, first, groups, seed: unsigned(seed) });
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
        contested: group.contested != 0,
        episodes: (first..first + row.group_size).map(name).collect(),
        bracket: bracket.map(|bracket| BracketView::of(scenario, bracket)),
        task: group.task,
        level: group.level,
        role: group.role,
        train: group.train != 0,
        layout: group.layout.map(|id| LayoutId(id).to_string()),
        state: group.state,
    }
}
