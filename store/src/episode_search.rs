//! Search among the reported episodes that are stored whole, in any order.

use sqlx::{QueryBuilder, Sqlite, SqliteConnection};

use super::StoreError;
use super::episodes::EpisodeState;
use super::groups::GroupRole;
use super::listed_episodes::{ListedEpisode, ListedEpisodeRow};

/// Filter of a search; a field that is none filters nothing.
#[derive(Debug, Clone, Default)]
pub struct EpisodeFilter {
    /// Task of the episode.
    pub task: Option<String>,
    /// Level of the episode.
    pub level: Option<i64>,
    /// State of the episode.
    pub state: Option<EpisodeState>,
    /// True for successes, false for all others.
    pub success: Option<bool>,
    /// Failure mode, among the episodes that are kept as examples of it.
    pub mode: Option<String>,
    /// Role of the group.
    pub role: Option<GroupRole>,
    /// Number of the designed layout.
    pub layout: Option<i64>,
    /// Version of the policy.
    pub version: Option<i64>,
}

/// Order of a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EpisodeOrder {
    /// The newest lease comes first.
    Newest,
    /// The oldest lease comes first.
    Oldest,
    /// By a value. Episodes without the value are left out.
    ByValue {
        /// The value to order by.
        value: OrderValue,
        /// True if the highest value comes first.
        descending: bool,
    },
}

/// Value that episodes can be ordered by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OrderValue {
    /// Score that the world computed.
    Score,
    /// Skill, normalised by the scenario's bracket.
    Skill,
}

impl OrderValue {
    const fn column(self) -> &'static str {
        match self {
            Self::Score => "e.score",
            Self::Skill => "e.skill",
        }
    }
}

/// Position of an episode in the results of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EpisodeCursor {
    /// Score or skill; none if the order is by lease.
    pub value: Option<f64>,
    /// Number of the lease.
    pub lease: i64,
    /// Index of the episode in the lease.
    pub number: i64,
}

/// Reads a page of a run's episodes after a cursor, or from the begin.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn page(
    conn: &mut SqliteConnection,
    run: &str,
    filter: &EpisodeFilter,
    order: EpisodeOrder,
    after: Option<EpisodeCursor>,
    limit: i64,
) -> Result<Vec<ListedEpisode>, StoreError> {
    let mut statement = QueryBuilder::new(
        "SELECT l.id_suffix, g.task, g.level, g.role, g.layout, e.lease, e.number, e.state, e.digest, e.score, e.success, e.skill,
                e.floor, e.reference, e.planner_version, e.outcome, e.policy_version, e.reason, e.metrics, e.at
         FROM leases l JOIN episodes e ON e.lease = l.id
         JOIN groups g ON g.lease = e.lease AND g.number = e.number / l.group_size
         WHERE l.run = ",
    );
    statement.push_bind(run.to_owned());
    push_filter(&mut statement, run, filter);
    push_cursor(&mut statement, order, after);
    match order {
        EpisodeOrder::Newest => statement.push(" ORDER BY l.id DESC, e.number DESC"),
        EpisodeOrder::Oldest => statement.push(" ORDER BY l.id, e.number"),
        EpisodeOrder::ByValue { value, descending } => {
            statement.push(" ORDER BY ").push(value.column()).push(if descending { " DESC" } else { "" });
            statement.push(", l.id, e.number")
        }
    };
    statement.push(" LIMIT ").push_bind(limit);
    let rows: Vec<ListedEpisodeRow> = statement.build_query_as().fetch_all(conn).await?;
    Ok(rows.into_iter().map(ListedEpisode::from).collect())
}

/// Appends the conditions of the filter.
fn push_filter(statement: &mut QueryBuilder<Sqlite>, run: &str, filter: &EpisodeFilter) {
    let EpisodeFilter { task, level, state, success, mode, role, layout, version } = filter.clone();
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
        statement.push(" AND e.success = ").push_bind(success);
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
            " AND (e.lease, e.number) IN (SELECT x.lease, x.number FROM failure_cells c
               JOIN failure_examples x ON x.cell = c.id WHERE c.run = ",
        );
        statement.push_bind(run.to_owned()).push(" AND c.mode = ").push_bind(mode).push(")");
    }
}

/// Appends the condition that only episodes after the cursor are read.
fn push_cursor(statement: &mut QueryBuilder<Sqlite>, order: EpisodeOrder, after: Option<EpisodeCursor>) {
    if let EpisodeOrder::ByValue { value, .. } = order {
        statement.push(" AND ").push(value.column()).push(" IS NOT NULL");
    }
    let Some(EpisodeCursor { value: at, lease, number }) = after else { return };
    // Orders by lease also compare the lease alone, so that SQLite walks its index from there.
    let (comparison, lease_comparison) = match order {
        EpisodeOrder::Newest => (" < (", " AND l.id <= "),
        EpisodeOrder::Oldest => (" > (", " AND l.id >= "),
        EpisodeOrder::ByValue { value, descending } => {
            let (column, sign) = (value.column(), if descending { "<" } else { ">" });
            let at = at.unwrap_or_default();
            statement.push(" AND (").push(column).push(" ").push(sign).push(" ").push_bind(at);
            statement.push(" OR (").push(column).push(" = ").push_bind(at);
            statement.push(" AND (l.id, e.number) > (").push_bind(lease).push(", ").push_bind(number);
            statement.push(")))");
            return;
        }
    };
    statement.push(" AND (l.id, e.number)").push(comparison).push_bind(lease).push(", ").push_bind(number);
    statement.push(")").push(lease_comparison).push_bind(lease);
}
