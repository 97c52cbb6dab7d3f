//! Designed layouts, with the sums of their outcomes. Table `layouts`.

use sqlx::SqliteConnection;

use super::{StoreError, text_enum};
use crate::Millis;

text_enum! {
    /// State of a layout.
    pub enum LayoutState: "a layout's state" {
        /// The layout is served.
        Active = "active",
        /// The layout is no longer served, except for an occasional probe.
        Retired = "retired",
        /// The gate refused the layout.
        Refused = "refused",
    }
}

text_enum! {
    /// Why a layout is retired.
    pub enum RetirementReason: "why a layout is retired" {
        /// The agent nearly always succeeds.
        Mastered = "mastered",
        /// The agent never succeeds.
        Hopeless = "hopeless",
        /// A user retired the layout.
        User = "user",
        /// The server judges the layout otherwise than the worker that designed it.
        Wrong = "wrong",
    }
}

text_enum! {
    /// Kind of a layout.
    pub enum LayoutKind: "a layout's kind" {
        /// An agent that does nothing loses.
        Threat = "threat",
        /// An agent that does nothing succeeds, and acting is a waste.
        Decoy = "decoy",
    }
}

/// Row of the `layouts` table. Refused layouts have no scenario.
#[derive(Debug, Clone)]
pub struct LayoutRow {
    /// Number of the layout, from 1.
    pub id: i64,
    /// Number of the design request.
    pub request: i64,
    /// Id of the run.
    pub run: String,
    /// Task of the layout.
    pub task: String,
    /// Level that the layout was designed for; none for strategies without levels.
    pub level: Option<i64>,
    /// Start rung that the layout was designed for, if the rungs of the task are starts.
    pub start_rung: Option<i64>,
    /// Name of the designer that made the layout.
    pub designer: String,
    /// Name that is displayed.
    pub name: String,
    /// Design as JSON, in the language of its world.
    pub design: Option<String>,
    /// Failure mode that the layout aims at.
    pub mode: Option<String>,
    /// Bearing that the layout aims at, degrees in `frame`.
    pub bearing_deg: Option<i64>,
    /// Reference frame of bearings.
    pub frame: Option<String>,
    /// Round of the designer, from 1.
    pub round: i64,
    /// State of the layout.
    pub state: LayoutState,
    /// Why the layout is retired.
    pub retirement_reason: Option<RetirementReason>,
    /// Check of the gate that refused the layout.
    pub gate_check: Option<String>,
    /// Why the gate refused the layout, in a sentence.
    pub refusal_reason: Option<String>,
    /// Claim of the layout about its scenario.
    pub kind: Option<LayoutKind>,
    /// Distance to the nearest design that was known then, 0 to 1.
    pub novelty: Option<f64>,
    /// Id of the scenario.
    pub scenario: Option<Vec<u8>>,
    /// Training groups that the run had leased when the layout was made.
    pub training_groups_at_creation: i64,
    /// Number of leased groups.
    pub groups: i64,
    /// Groups with an outcome.
    pub outcomes: i64,
    /// Number of finished episodes.
    pub episodes: i64,
    /// Finished episodes that succeeded.
    pub successes: i64,
    /// Sum of the scores.
    pub score_sum: f64,
    /// Sum of the regrets.
    pub regret_sum: f64,
    /// Criticised episodes with a failure.
    pub failure_episodes: i64,
    /// Criticised episodes with the failure mode that the layout aims at.
    pub aimed_failure_episodes: i64,
    /// Results of the last groups, oldest first, as JSON.
    pub recent_results: String,
    /// When a group of the layout was leased last.
    pub served_at: Option<Millis>,
    /// When the layout was made.
    pub created_at: Millis,
    /// When the layout retired.
    pub retired_at: Option<Millis>,
}

impl LayoutRow {
    /// Share of the criticised episodes with a failure in which the aimed failure mode occurred.
    #[must_use]
    pub fn aimed_failure_share(&self) -> Option<f64> {
        (self.failure_episodes > 0).then(|| self.aimed_failure_episodes as f64 / self.failure_episodes as f64)
    }
}

/// A layout to be stored. Fields as in [`LayoutRow`].
#[derive(Debug, Clone)]
pub struct NewLayout {
    /// Number of the design request.
    pub request: i64,
    /// Id of the run.
    pub run: String,
    /// Task of the layout.
    pub task: String,
    /// Level that the layout was designed for.
    pub level: Option<i64>,
    /// Start rung that the layout was designed for, if the rungs of the task are starts.
    pub start_rung: Option<i64>,
    /// Name of the designer that made the layout.
    pub designer: String,
    /// Name that is displayed.
    pub name: String,
    /// The design as JSON.
    pub design: Option<String>,
    /// Failure mode that the layout aims at.
    pub mode: Option<String>,
    /// Bearing that the layout aims at, degrees in `frame`.
    pub bearing_deg: Option<i64>,
    /// Reference frame of bearings.
    pub frame: Option<String>,
    /// Round of the designer, from 1.
    pub round: i64,
    /// Either `Active` or `Refused`.
    pub state: LayoutState,
    /// Check of the gate that refused the layout.
    pub gate_check: Option<String>,
    /// Why the gate refused the layout, in a sentence.
    pub refusal_reason: Option<String>,
    /// Claim of the layout about its scenario.
    pub kind: Option<LayoutKind>,
    /// Distance to the nearest known design, 0 to 1.
    pub novelty: Option<f64>,
    /// Id of the scenario.
    pub scenario: Option<Vec<u8>>,
    /// Training groups that the run has leased so far.
    pub training_groups_at_creation: i64,
}

/// Stores a layout and returns its number.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn insert(conn: &mut SqliteConnection, new: &NewLayout, now: Millis) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"INSERT INTO layouts (request, run, task, level, start_rung, designer, name, design, mode, bearing_deg, frame, round, state,
                                gate_check, refusal_reason, kind, novelty, scenario, training_groups_at_creation,
                                created_at)
           VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) RETURNING id AS "id!""#,
        new.request,
        new.run,
        new.task,
        new.level,
        new.start_rung,
        new.designer,
        new.name,
        new.design,
        new.mode,
        new.bearing_deg,
        new.frame,
        new.round,
        new.state,
        new.gate_check,
        new.refusal_reason,
        new.kind,
        new.novelty,
        new.scenario,
        new.training_groups_at_creation,
        now
    )
    .fetch_one(conn)
    .await?)
}

/// Selects [`LayoutRow`]s: takes what follows `FROM layouts` and the arguments of the statement.
macro_rules! query_layouts {
    ($rest:literal, $($argument:expr),+ $(,)?) => {
        sqlx::query_as!(
            LayoutRow,
            r#"SELECT id, request, run, task, level, start_rung, designer, name, design, mode, bearing_deg, frame, round,
                      state AS "state: LayoutState", retirement_reason AS "retirement_reason: RetirementReason", gate_check,
                      refusal_reason, kind AS "kind: LayoutKind", novelty, scenario, training_groups_at_creation, groups,
                      outcomes, episodes, successes, score_sum, regret_sum, failure_episodes, aimed_failure_episodes,
                      recent_results, served_at, created_at, retired_at
               FROM layouts "# + $rest,
            $($argument),+
        )
    };
}

/// Reads a layout.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn get(conn: &mut SqliteConnection, id: i64) -> Result<Option<LayoutRow>, StoreError> {
    Ok(query_layouts!(
        "WHERE id = ? AND NOT EXISTS (SELECT 1 FROM runs r WHERE r.id = layouts.run AND r.deleted_at IS NOT NULL)",
        id
    )
    .fetch_optional(conn).await?)
}

/// Filter of lists of layouts; a field that is none filters nothing.
#[derive(Debug, Clone, Default)]
pub struct LayoutFilter {
    /// Task of the layout.
    pub task: Option<String>,
    /// State of the layout.
    pub state: Option<LayoutState>,
    /// Failure mode that the layout aims at.
    pub mode: Option<String>,
    /// Number of the design request.
    pub request: Option<i64>,
    /// True if refused layouts are listed, too.
    pub with_refused: bool,
}

/// Reads layouts of a run with numbers below `before`, newest first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn of_run(
    conn: &mut SqliteConnection,
    run: &str,
    filter: &LayoutFilter,
    before: i64,
    limit: i64,
) -> Result<Vec<LayoutRow>, StoreError> {
    Ok(query_layouts!(
        "WHERE run = ?1 AND id < ?2 AND (?3 IS NULL OR task = ?3) AND (?4 IS NULL OR state = ?4)
               AND (?5 IS NULL OR mode = ?5) AND (?6 IS NULL OR request = ?6) AND (?7 OR state != 'refused')
         ORDER BY id DESC LIMIT ?8",
        run,
        before,
        filter.task,
        filter.state,
        filter.mode,
        filter.request,
        filter.with_refused,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Reads admitted layouts of all runs with numbers below `before`, newest first. The filter's request is ignored.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn of_all_runs(
    conn: &mut SqliteConnection,
    filter: &LayoutFilter,
    before: i64,
    limit: i64,
) -> Result<Vec<LayoutRow>, StoreError> {
    Ok(query_layouts!(
        "WHERE state != 'refused' AND id < ?1 AND (?2 IS NULL OR task = ?2) AND (?3 IS NULL OR state = ?3)
               AND (?4 IS NULL OR mode = ?4)
               AND NOT EXISTS (SELECT 1 FROM runs r WHERE r.id = layouts.run AND r.deleted_at IS NOT NULL)
         ORDER BY id DESC LIMIT ?5",
        before,
        filter.task,
        filter.state,
        filter.mode,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Reads the newest admitted designs of a run's task, as JSON.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn archive(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    limit: i64,
) -> Result<Vec<String>, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT design AS "design!" FROM layouts
           WHERE run = ? AND task = ? AND state != 'refused' AND design IS NOT NULL ORDER BY id DESC LIMIT ?"#,
        run,
        task,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// A finished episode on a layout.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LayoutEpisode {
    /// Number of the lease.
    pub lease: i64,
    /// Suffix of the lease id.
    pub id_suffix: String,
    /// Index of the episode in the lease.
    pub number: i64,
}

/// Reads the newest finished episodes on a layout.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn episodes(
    conn: &mut SqliteConnection,
    id: i64,
    limit: i64,
) -> Result<Vec<LayoutEpisode>, StoreError> {
    Ok(sqlx::query_as!(
        LayoutEpisode,
        r#"SELECT l.id AS "lease!", l.id_suffix AS "id_suffix!", e.number AS "number!"
           FROM groups g JOIN leases l ON l.id = g.lease
           JOIN episodes e ON e.lease = g.lease AND e.number >= g.number * l.group_size
                AND e.number < (g.number + 1) * l.group_size AND e.state = 'finished'
           WHERE g.layout = ? ORDER BY g.lease DESC, g.number DESC, e.number DESC LIMIT ?"#,
        id,
        limit
    )
    .fetch_all(conn)
    .await?)
}
