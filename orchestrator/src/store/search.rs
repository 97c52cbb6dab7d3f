//! Reported episodes that are kept whole, by what they are of and how they came out, in any order.

use sqlx::{FromRow, QueryBuilder, Sqlite, SqliteConnection};

use super::StoreError;
use super::episodes::{EpisodeRow, Listed, OfGroup};

/// Which episodes.
#[derive(Debug, Clone, Default)]
pub struct Wanted {
    /// Of this task.
    pub task: Option<String>,
    /// Of this level.
    pub level: Option<i64>,
    /// In this state.
    pub state: Option<String>,
    /// Successes, or what are none.
    pub success: Option<bool>,
    /// In which this failure mode was found, of those that are kept as examples of it.
    pub mode: Option<String>,
    /// Of groups of this role.
    pub role: Option<String>,
    /// On this layout.
    pub layout: Option<i64>,
    /// Flown by this version of the policy.
    pub version: Option<i64>,
}

/// In which order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// The last that was leased first.
    Newest,
    /// The first that was leased first.
    Oldest,
    /// By score or skill, the least first or the most; those without one are left out.
    By {
        /// Which: `e.score` or `e.skill`.
        column: Column,
        /// The most first.
        most: bool,
    },
}

/// What episodes are ordered by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Column {
    /// The score.
    Score,
    /// The skill.
    Skill,
}

/// Where a page ended: what it is ordered by, and the lease and index that it came to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// The score or skill; none where the order is of neither.
    pub value: Option<f64>,
    /// The lease's number.
    pub lease: i64,
    /// The index in it.
    pub number: i64,
}

#[derive(FromRow)]
struct Row {
    token: String,
    task: String,
    level: Option<i64>,
    role: String,
    layout: Option<i64>,
    lease: i64,
    number: i64,
    state: String,
    digest: Vec<u8>,
    score: Option<f64>,
    success: Option<i64>,
    skill: Option<f64>,
    floor: Option<f64>,
    reference: Option<f64>,
    planner: Option<i64>,
    flown: Option<String>,
    policy_version: i64,
    reason: Option<String>,
    metrics: Option<String>,
    at: i64,
}

/// A page of episodes behind a place.
///
/// # Errors
/// The database's.
pub async fn page(
    conn: &mut SqliteConnection,
    run: &str,
    wanted: &Wanted,
    order: Order,
    (after, limit): (Option<Place>, i64),
) -> Result<Vec<Listed>, StoreError> {
    let mut statement = QueryBuilder::new(
        "SELECT l.token, g.task, g.level, g.role, g.layout, e.lease, e.number, e.state, e.digest, e.score, e.success, e.skill,
                e.floor, e.reference, e.planner, e.flown, e.policy_version, e.reason, e.metrics, e.at
         FROM leases l JOIN episodes e ON e.lease = l.id
         JOIN groups g ON g.lease = e.lease AND g.number = e.number / l.group_size
         WHERE l.run = ",
    );
    statement.push_bind(run.to_owned());
    narrow(&mut statement, run, wanted);
    go_on(&mut statement, order, after);
    statement.push(match order {
        Order::Newest => " ORDER BY l.id DESC, e.number DESC",
        Order::Oldest => " ORDER BY l.id, e.number",
        Order::By { column: Column::Score, most: false } => " ORDER BY e.score, l.id, e.number",
        Order::By { column: Column::Score, most: true } => " ORDER BY e.score DESC, l.id, e.number",
        Order::By { column: Column::Skill, most: false } => " ORDER BY e.skill, l.id, e.number",
        Order::By { column: Column::Skill, most: true } => " ORDER BY e.skill DESC, l.id, e.number",
    });
    statement.push(" LIMIT ").push_bind(limit);
    let rows: Vec<Row> = statement.build_query_as().fetch_all(conn).await?;
    Ok(rows.into_iter().map(Row::listed).collect())
}

fn narrow(statement: &mut QueryBuilder<Sqlite>, run: &str, wanted: &Wanted) {
    let Wanted { task, level, state, success, mode, role, layout, version } = wanted.clone();
    if let Some(task) = task {
        statement.push(" AND g.task = ").push_bind(task);
    }
    if let Some(level) = level {
        statement.push(" AND g.level = ").push_bind(level);
    }
    if let Some(state) = state {
        statement.push(" AND e.state = ").push_bind(state);
    }
    if let Some(success) = success {
        statement.push(" AND e.success = ").push_bind(i64::from(success));
    }
    if let Some(role) = role {
        statement.push(" AND g.role = ").push_bind(role);
    }
    if let Some(layout) = layout {
        statement.push(" AND g.layout = ").push_bind(layout);
    }
    if let Some(version) = version {
        statement.push(" AND e.policy_version = ").push_bind(version);
    }
    if let Some(mode) = mode {
        statement.push(
            " AND (e.lease, e.number) IN (SELECT x.lease, x.number FROM failure_profile p
               JOIN failure_examples x ON x.cell = p.cell WHERE p.run = ",
        );
        statement.push_bind(run.to_owned()).push(" AND p.mode = ").push_bind(mode).push(")");
    }
}

/// Only what stands behind a place.
fn go_on(statement: &mut QueryBuilder<Sqlite>, order: Order, after: Option<Place>) {
    if let Order::By { column, .. } = order {
        statement.push(match column {
            Column::Score => " AND e.score IS NOT NULL",
            Column::Skill => " AND e.skill IS NOT NULL",
        });
    }
    let Some(Place { value, lease, number }) = after else { return };
    let behind = match order {
        Order::Newest => " AND (l.id, e.number) < (",
        Order::Oldest => " AND (l.id, e.number) > (",
        Order::By { column, most } => {
            let (name, sign) = match (column, most) {
                (Column::Score, false) => ("e.score", ">"),
                (Column::Score, true) => ("e.score", "<"),
                (Column::Skill, false) => ("e.skill", ">"),
                (Column::Skill, true) => ("e.skill", "<"),
            };
            let value = value.unwrap_or_default();
            statement.push(" AND (").push(name).push(" ").push(sign).push(" ").push_bind(value);
            statement.push(" OR (").push(name).push(" = ").push_bind(value);
            statement
                .push(" AND (l.id, e.number) > (")
                .push_bind(lease)
                .push(", ")
                .push_bind(number)
                .push(")))");
            return;
        }
    };
    // The lease by itself, too: so that the index of leases is walked from there.
    statement.push(behind).push_bind(lease).push(", ").push_bind(number).push(")");
    statement.push(if order == Order::Newest { " AND l.id <= " } else { " AND l.id >= " }).push_bind(lease);
}

impl Row {
    fn listed(self) -> Listed {
        let row = EpisodeRow {
            lease: self.lease,
            number: self.number,
            state: self.state,
            digest: self.digest,
            score: self.score,
            success: self.success,
            skill: self.skill,
            floor: self.floor,
            reference: self.reference,
            planner: self.planner,
            flown: self.flown,
            policy_version: self.policy_version,
            reason: self.reason,
            metrics: self.metrics,
            at: self.at,
        };
        let of = OfGroup { task: self.task, level: self.level, role: self.role, layout: self.layout };
        Listed { token: self.token, of, row }
    }
}
