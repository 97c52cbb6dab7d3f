//! Episodes with their groups, as lists show them. Reads `episodes`, `groups` and `leases`.

use sqlx::{FromRow, SqliteConnection, query_as};

use super::StoreError;
use super::episodes::{EpisodeRow, EpisodeState};
use super::groups::GroupRole;
use super::keys::EpisodeKey;

/// A reported episode in a list.
#[derive(Debug, Clone)]
pub struct ListedEpisode {
    /// Suffix of the lease id.
    pub id_suffix: String,
    /// The group of the episode.
    pub group: EpisodeGroup,
    /// Row of the episode.
    pub row: EpisodeRow,
}

/// The group of an episode, as lists show it.
#[derive(Debug, Clone, PartialEq)]
pub struct EpisodeGroup {
    /// Task of the group.
    pub task: String,
    /// Level of the group; none for strategies without levels.
    pub level: Option<i64>,
    /// Role of the group.
    pub role: GroupRole,
    /// Number of the designed layout, if the group has one.
    pub layout: Option<i64>,
}

/// A [`ListedEpisode`] as statements return it.
#[derive(FromRow)]
pub(super) struct ListedEpisodeRow {
    id_suffix: String,
    task: String,
    level: Option<i64>,
    role: GroupRole,
    layout: Option<i64>,
    lease: i64,
    number: i64,
    state: EpisodeState,
    digest: Vec<u8>,
    score: Option<f64>,
    success: Option<bool>,
    skill: Option<f64>,
    floor: Option<f64>,
    reference: Option<f64>,
    planner_version: Option<i64>,
    outcome: Option<String>,
    policy_version: i64,
    reason: Option<String>,
    metrics: Option<String>,
    at: i64,
}

impl From<ListedEpisodeRow> for ListedEpisode {
    fn from(r: ListedEpisodeRow) -> Self {
        Self {
            id_suffix: r.id_suffix,
            group: EpisodeGroup { task: r.task, level: r.level, role: r.role, layout: r.layout },
            row: EpisodeRow {
                lease: r.lease,
                number: r.number,
                state: r.state,
                digest: r.digest,
                score: r.score,
                success: r.success,
                skill: r.skill,
                floor: r.floor,
                reference: r.reference,
                planner_version: r.planner_version,
                outcome: r.outcome,
                policy_version: r.policy_version,
                reason: r.reason,
                metrics: r.metrics,
                at: r.at,
            },
        }
    }
}

/// Reads reported episodes of a run after a key, in order of their keys.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn page(
    conn: &mut SqliteConnection,
    run: &str,
    after: EpisodeKey,
    limit: i64,
) -> Result<Vec<ListedEpisode>, StoreError> {
    let rows = query_as!(
        ListedEpisodeRow,
        r#"SELECT l.id_suffix, g.task, g.level, g.role AS "role: GroupRole", g.layout, e.lease AS "lease!", e.number AS "number!",
                  e.state AS "state: EpisodeState", e.digest, e.score, e.success AS "success: bool", e.skill, e.floor,
                  e.reference, e.planner_version, e.outcome, e.policy_version, e.reason, e.metrics, e.at
           FROM leases l JOIN episodes e ON e.lease = l.id
           JOIN groups g ON g.lease = e.lease AND g.number = e.number / l.group_size
           WHERE l.run = ?1 AND l.id >= ?2 AND (e.lease, e.number) > (?2, ?3)
           ORDER BY l.id, e.number LIMIT ?4"#,
        run,
        after.lease,
        after.number,
        limit
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(ListedEpisode::from).collect())
}
