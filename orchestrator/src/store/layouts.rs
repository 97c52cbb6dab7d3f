//! What designers thought of: layouts, their outcomes, and every change of their state.

use std::collections::BTreeSet;

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::clock::Millis;

/// A layout as stored; those that the gate refused have no scenario.
#[derive(Debug, Clone, Default)]
pub struct LayoutRow {
    /// Its number.
    pub id: i64,
    /// The ask it came of.
    pub ask: i64,
    /// The run.
    pub run: String,
    /// The task.
    pub task: String,
    /// The level it was designed at.
    pub level: Option<i64>,
    /// Who thought of it.
    pub designer: String,
    /// Its name, for people.
    pub name: String,
    /// JSON, in the language of its world.
    pub design: Option<String>,
    /// The failure mode it aims at.
    pub mode: Option<String>,
    /// From where, in the frame.
    pub bearing_deg: Option<i64>,
    /// What bearings are measured in.
    pub frame: Option<String>,
    /// In which round it was given.
    pub round: i64,
    /// `active`, `retired` or `refused`.
    pub state: String,
    /// Where retired: `mastered`, `hopeless` or `hand`.
    pub why: Option<String>,
    /// Where refused: which check.
    pub gate_check: Option<String>,
    /// Where refused: the sentence.
    pub reason: Option<String>,
    /// `threat` or `decoy`.
    pub claim: Option<String>,
    /// How far the nearest design that was known then is.
    pub novelty: Option<f64>,
    /// Its scenario.
    pub scenario: Option<Vec<u8>>,
    /// Training groups that the run had leased when it was made.
    pub train_groups_at: i64,
    /// Groups leased.
    pub groups: i64,
    /// Groups that came back.
    pub outcomes: i64,
    /// Episodes that finished.
    pub episodes: i64,
    /// Of these, successes.
    pub successes: i64,
    /// Sum of their scores.
    pub score: f64,
    /// Sum of their regrets.
    pub regret: f64,
    /// Criticised episodes in which something went wrong.
    pub faults: i64,
    /// Of these, by the failure mode it aims at.
    pub as_aimed: i64,
    /// JSON: the last outcomes.
    pub recent: String,
    /// Outcomes in a row without any success.
    pub barren: i64,
    /// When it was leased last.
    pub served_at: Option<Millis>,
    /// When it was made.
    pub created_at: Millis,
    /// When it was retired.
    pub retired_at: Option<Millis>,
}

impl LayoutRow {
    /// Of the criticised episodes in which something went wrong, the share in which the aimed failure mode did.
    #[must_use]
    pub fn as_aimed_share(&self) -> Option<f64> {
        (self.faults > 0).then(|| self.as_aimed as f64 / self.faults as f64)
    }
}

/// Stores a layout that has just been made: its number. What can only have happened since is not looked at.
///
/// # Errors
/// The database's.
pub async fn insert(conn: &mut SqliteConnection, new: &LayoutRow, now: Millis) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"INSERT INTO layouts (ask, run, task, level, designer, name, design, mode, bearing_deg, frame, round, state,
                                gate_check, reason, claim, novelty, scenario, train_groups_at, created_at)
           VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) RETURNING id AS "id!""#,
        new.ask,
        new.run,
        new.task,
        new.level,
        new.designer,
        new.name,
        new.design,
        new.mode,
        new.bearing_deg,
        new.frame,
        new.round,
        new.state,
        new.gate_check,
        new.reason,
        new.claim,
        new.novelty,
        new.scenario,
        new.train_groups_at,
        now
    )
    .fetch_one(conn)
    .await?)
}

/// One layout.
///
/// # Errors
/// The database's.
pub async fn get(conn: &mut SqliteConnection, id: i64) -> Result<Option<LayoutRow>, StoreError> {
    Ok(sqlx::query_as!(
        LayoutRow,
        "SELECT id, ask, run, task, level, designer, name, design, mode, bearing_deg, frame, round, state, why,
                gate_check, reason, claim, novelty, scenario, train_groups_at, groups, outcomes, episodes, successes,
                score, regret, faults, as_aimed, recent, barren, served_at, created_at, retired_at
         FROM layouts WHERE id = ?",
        id
    )
    .fetch_optional(conn)
    .await?)
}

/// Which layouts are asked for.
#[derive(Debug, Clone, Default)]
pub struct Wanted {
    /// Of this task.
    pub task: Option<String>,
    /// In this state.
    pub state: Option<String>,
    /// That aim at this failure mode.
    pub mode: Option<String>,
    /// Of this ask.
    pub ask: Option<i64>,
    /// Those refused too.
    pub refused: bool,
}

/// Layouts of a run, the newest first, before a number.
///
/// # Errors
/// The database's.
pub async fn of_run(
    conn: &mut SqliteConnection,
    run: &str,
    wanted: &Wanted,
    before: i64,
    limit: i64,
) -> Result<Vec<LayoutRow>, StoreError> {
    Ok(sqlx::query_as!(
        LayoutRow,
        "SELECT id, ask, run, task, level, designer, name, design, mode, bearing_deg, frame, round, state, why,
                gate_check, reason, claim, novelty, scenario, train_groups_at, groups, outcomes, episodes, successes,
                score, regret, faults, as_aimed, recent, barren, served_at, created_at, retired_at
         FROM layouts
         WHERE run = ?1 AND id < ?2 AND (?3 IS NULL OR task = ?3) AND (?4 IS NULL OR state = ?4)
               AND (?5 IS NULL OR mode = ?5) AND (?6 IS NULL OR ask = ?6) AND (?7 OR state != 'refused')
         ORDER BY id DESC LIMIT ?8",
        run,
        before,
        wanted.task,
        wanted.state,
        wanted.mode,
        wanted.ask,
        wanted.refused,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Layouts of all runs that were let through, the newest first, before a number.
///
/// # Errors
/// The database's.
pub async fn of_all(
    conn: &mut SqliteConnection,
    wanted: &Wanted,
    before: i64,
    limit: i64,
) -> Result<Vec<LayoutRow>, StoreError> {
    Ok(sqlx::query_as!(
        LayoutRow,
        "SELECT id, ask, run, task, level, designer, name, design, mode, bearing_deg, frame, round, state, why,
                gate_check, reason, claim, novelty, scenario, train_groups_at, groups, outcomes, episodes, successes,
                score, regret, faults, as_aimed, recent, barren, served_at, created_at, retired_at
         FROM layouts
         WHERE state != 'refused' AND id < ?1 AND (?2 IS NULL OR task = ?2) AND (?3 IS NULL OR state = ?3)
               AND (?4 IS NULL OR mode = ?4)
         ORDER BY id DESC LIMIT ?5",
        before,
        wanted.task,
        wanted.state,
        wanted.mode,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// The newest designs of a run's task that were let through, as JSON.
///
/// # Errors
/// The database's.
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

/// What an outcome makes of a layout.
#[derive(Debug, Clone)]
pub struct Flown {
    /// Episodes that finished.
    pub episodes: i64,
    /// Of these, successes.
    pub successes: i64,
    /// Sum of their scores.
    pub score: f64,
    /// Sum of their regrets.
    pub regret: f64,
    /// JSON: the last outcomes now.
    pub recent: String,
    /// Outcomes in a row without any success now.
    pub barren: i64,
}

/// Adds an outcome to a layout.
///
/// # Errors
/// The database's.
pub async fn flown(conn: &mut SqliteConnection, id: i64, flown: &Flown) -> Result<(), StoreError> {
    query!(
        "UPDATE layouts SET outcomes = outcomes + 1, episodes = episodes + ?, successes = successes + ?, score = score + ?,
             regret = regret + ?, recent = ?, barren = ? WHERE id = ?",
        flown.episodes,
        flown.successes,
        flown.score,
        flown.regret,
        flown.recent,
        flown.barren,
        id
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Adds criticised episodes in which something went wrong to a layout: one for each, with the failure modes that it shows.
///
/// # Errors
/// The database's.
pub async fn blame(
    conn: &mut SqliteConnection,
    id: i64,
    episodes: &[BTreeSet<&str>],
) -> Result<(), StoreError> {
    let aim =
        sqlx::query_scalar!("SELECT mode FROM layouts WHERE id = ?", id).fetch_optional(&mut *conn).await?;
    let aimed = |modes: &&BTreeSet<&str>| aim.iter().flatten().any(|aim| modes.contains(aim.as_str()));
    let (faults, as_aimed) = (episodes.len() as i64, episodes.iter().filter(aimed).count() as i64);
    query!(
        "UPDATE layouts SET faults = faults + ?, as_aimed = as_aimed + ? WHERE id = ?",
        faults,
        as_aimed,
        id
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Forgets a layout's last outcomes.
///
/// # Errors
/// The database's.
pub async fn reset(conn: &mut SqliteConnection, id: i64, recent: &str) -> Result<(), StoreError> {
    query!("UPDATE layouts SET recent = ?, barren = 0 WHERE id = ?", recent, id).execute(conn).await?;
    Ok(())
}

/// A change of a layout's state.
#[derive(Debug, Clone)]
pub struct Turn {
    /// `active`, `retired` or `refused`.
    pub state: &'static str,
    /// Where retired: `mastered`, `hopeless` or `hand`.
    pub why: Option<&'static str>,
    /// For people.
    pub reason: String,
}

/// Changes a layout's state, and remembers it.
///
/// # Errors
/// The database's.
pub async fn turn(conn: &mut SqliteConnection, id: i64, turn: &Turn, now: Millis) -> Result<(), StoreError> {
    let retired_at = (turn.state == "retired").then_some(now);
    query!(
        "UPDATE layouts SET state = ?, why = ?, retired_at = ? WHERE id = ?",
        turn.state,
        turn.why,
        retired_at,
        id
    )
    .execute(&mut *conn)
    .await?;
    query!(
        "INSERT INTO layout_turns (layout, nth, state, reason, at)
         SELECT ?1, count(*), ?2, ?3, ?4 FROM layout_turns WHERE layout = ?1",
        id,
        turn.state,
        turn.reason,
        now
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Every change of a layout's state in order: (state, reason, when).
///
/// # Errors
/// The database's.
pub async fn turns(
    conn: &mut SqliteConnection,
    id: i64,
) -> Result<Vec<(String, String, Millis)>, StoreError> {
    let rows = query!("SELECT state, reason, at FROM layout_turns WHERE layout = ? ORDER BY nth", id)
        .fetch_all(conn)
        .await?;
    Ok(rows.into_iter().map(|r| (r.state, r.reason, r.at)).collect())
}

/// The newest finished episodes of a layout: (lease, token, index).
///
/// # Errors
/// The database's.
pub async fn episodes(
    conn: &mut SqliteConnection,
    id: i64,
    limit: i64,
) -> Result<Vec<(i64, String, i64)>, StoreError> {
    let rows = query!(
        r#"SELECT l.id AS "lease!", l.token AS "token!", e.number AS "number!"
           FROM groups g JOIN leases l ON l.id = g.lease
           JOIN episodes e ON e.lease = g.lease AND e.number >= g.number * l.group_size
                AND e.number < (g.number + 1) * l.group_size AND e.state = 'finished'
           WHERE g.layout = ? ORDER BY g.lease DESC, g.number DESC, e.number DESC LIMIT ?"#,
        id,
        limit
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|r| (r.lease, r.token, r.number)).collect())
}
