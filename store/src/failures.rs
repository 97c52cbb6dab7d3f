//! The failure profile of a run's task: cells by failure mode, sector and speed band, and the newest failures of each
//! cell. Tables `failure_cells` and `failure_examples`.

use std::collections::BTreeMap;

use sqlx::{QueryBuilder, Sqlite, SqliteConnection, query};

use super::{MAX_ROWS, StoreError};
use crate::Millis;

/// Newest failures that are kept of each cell.
pub const EXAMPLES_PER_CELL: i64 = 64;

/// Stored sector of a failure without an angle, and stored band of one without an encounter.
const NONE: i64 = -1;

/// Key of a cell in the profile of a task.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct CellKey {
    /// Name of the failure mode.
    pub mode: String,
    /// Sector of the failure's angle, from 0; none if it has no angle.
    pub sector: Option<u32>,
    /// Speed band of the encounter, from 0; none if nothing was met.
    pub band: Option<u32>,
}

impl CellKey {
    fn from_columns(mode: String, sector: i64, band: i64) -> Self {
        Self { mode, sector: u32::try_from(sector).ok(), band: u32::try_from(band).ok() }
    }

    fn sector_column(&self) -> i64 {
        self.sector.map_or(NONE, i64::from)
    }

    fn band_column(&self) -> i64 {
        self.band.map_or(NONE, i64::from)
    }
}

/// Counters of a cell.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CellCounters {
    /// Number of failures so far.
    pub count: i64,
    /// Failures that could have been avoided.
    pub avoidable: i64,
    /// Failures that were visible and could not be avoided.
    pub unavoidable: i64,
    /// Sum of the steps that were left to act.
    pub steps_left: i64,
    /// Count that halves with every half-life, at the moment `as_of`.
    pub weight: f64,
    /// Position of the last failure among the task's criticised episodes, from 1.
    pub as_of: i64,
    /// When the last failure was added.
    pub last_at: Millis,
}

/// A cell of the profile.
#[derive(Debug, Clone, PartialEq)]
pub struct FailureCell {
    /// Number of the cell.
    pub id: i64,
    /// Key of the cell.
    pub key: CellKey,
    /// Counters of the cell.
    pub counters: CellCounters,
}

/// A failure that is kept as an example of its cell.
#[derive(Debug, Clone, PartialEq)]
pub struct FailureExample {
    /// Position of the failure in its cell, from 1.
    pub ordinal: i64,
    /// Position of the episode among the task's criticised episodes, from 1.
    pub episode_ordinal: i64,
    /// Number of the episode's lease.
    pub lease: i64,
    /// Index of the episode in the lease.
    pub number: i64,
    /// Index of the agent that failed.
    pub agent: i64,
    /// Step of the failure, from 1.
    pub step: i64,
    /// Angle of the failure, whose sector is that of its cell, degrees.
    pub sector_deg: Option<f64>,
    /// Relative speed of the encounter, in the world's unit.
    pub relative_speed: Option<f64>,
    /// Steps that were left to act.
    pub steps_left: Option<i64>,
    /// True if the failure could have been avoided; none if nothing was met or seen.
    pub avoidable: Option<bool>,
}

/// Writes cells, over those with the same keys.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn put_cells(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    cells: &[(&CellKey, &CellCounters)],
) -> Result<(), StoreError> {
    for rows in cells.chunks(MAX_ROWS) {
        put_cells_statement(run, task, rows).build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// Writes cells that are not stored yet. Returns their numbers.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn insert_cells(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    cells: &[(&CellKey, &CellCounters)],
) -> Result<BTreeMap<CellKey, i64>, StoreError> {
    let mut ids = BTreeMap::new();
    for rows in cells.chunks(MAX_ROWS) {
        let mut statement = put_cells_statement(run, task, rows);
        statement.push(" RETURNING mode, sector, band, id");
        for (mode, sector, band, id) in statement.build_query_as().fetch_all(&mut *conn).await? {
            ids.insert(CellKey::from_columns(mode, sector, band), id);
        }
    }
    Ok(ids)
}

fn put_cells_statement(run: &str, task: &str, rows: &[(&CellKey, &CellCounters)]) -> QueryBuilder<Sqlite> {
    let mut statement = QueryBuilder::new(
        "INSERT INTO failure_cells (run, task, mode, sector, band, count, avoidable, unavoidable, steps_left,
                                    weight, as_of, last_at) ",
    );
    statement.push_values(rows, |mut values, (key, counters)| {
        values.push_bind(run.to_owned()).push_bind(task.to_owned()).push_bind(key.mode.clone());
        values.push_bind(key.sector_column()).push_bind(key.band_column()).push_bind(counters.count);
        values.push_bind(counters.avoidable).push_bind(counters.unavoidable).push_bind(counters.steps_left);
        values.push_bind(counters.weight).push_bind(counters.as_of).push_bind(counters.last_at);
    });
    statement.push(
        " ON CONFLICT (run, task, mode, sector, band) DO UPDATE SET
             count = excluded.count, avoidable = excluded.avoidable, unavoidable = excluded.unavoidable,
             steps_left = excluded.steps_left, weight = excluded.weight, as_of = excluded.as_of,
             last_at = excluded.last_at",
    );
    statement
}

/// Writes examples by the numbers of their cells. Each one replaces the oldest example of its cell.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn put_examples(
    conn: &mut SqliteConnection,
    examples: &[(i64, &FailureExample)],
) -> Result<(), StoreError> {
    for rows in examples.chunks(MAX_ROWS) {
        let mut statement = QueryBuilder::new(
            "INSERT OR REPLACE INTO failure_examples (cell, slot, ordinal, episode_ordinal, lease, number, agent, step,
                 sector_deg, relative_speed, steps_left, avoidable) ",
        );
        statement.push_values(rows, |mut values, (cell, example)| {
            values.push_bind(cell).push_bind(example.ordinal % EXAMPLES_PER_CELL).push_bind(example.ordinal);
            values.push_bind(example.episode_ordinal).push_bind(example.lease).push_bind(example.number);
            values.push_bind(example.agent).push_bind(example.step).push_bind(example.sector_deg);
            values.push_bind(example.relative_speed).push_bind(example.steps_left);
            values.push_bind(example.avoidable);
        });
        statement.build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// Reads the whole profile of a run's task, by mode, sector and band.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn profile(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
) -> Result<Vec<FailureCell>, StoreError> {
    let rows = query!(
        "SELECT id, mode, sector, band, count, avoidable, unavoidable, steps_left, weight, as_of, last_at
         FROM failure_cells WHERE run = ? AND task = ? ORDER BY mode, sector, band",
        run,
        task
    )
    .fetch_all(conn)
    .await?;
    let cells = rows.into_iter().map(|r| FailureCell {
        id: r.id,
        key: CellKey::from_columns(r.mode, r.sector, r.band),
        counters: CellCounters {
            count: r.count,
            avoidable: r.avoidable,
            unavoidable: r.unavoidable,
            steps_left: r.steps_left,
            weight: r.weight,
            as_of: r.as_of,
            last_at: r.last_at,
        },
    });
    Ok(cells.collect())
}

/// An episode behind a cell.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CellEpisode {
    /// Number of the cell.
    pub cell: i64,
    /// Number of the episode's lease.
    pub lease: i64,
    /// Suffix of the lease id.
    pub id_suffix: String,
    /// Index of the episode in the lease.
    pub number: i64,
}

/// Reads the newest `limit` episodes behind every cell of a run's task, by cell, newest first. An episode with several failures
/// in one cell is one episode.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn newest_episodes(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    limit: i64,
) -> Result<Vec<CellEpisode>, StoreError> {
    Ok(sqlx::query_as!(
        CellEpisode,
        r#"SELECT c.id AS "cell!", l.id AS "lease!", l.id_suffix AS "id_suffix!", x.number AS "number!"
           FROM failure_cells c
           JOIN (SELECT cell, lease, number, max(ordinal) AS ordinal,
                        row_number() OVER (PARTITION BY cell ORDER BY max(ordinal) DESC) AS rank
                 FROM failure_examples
                 WHERE cell IN (SELECT id FROM failure_cells WHERE run = ?1 AND task = ?2)
                 GROUP BY cell, lease, number) x ON x.cell = c.id AND x.rank <= ?3
           JOIN leases l ON l.id = x.lease
           WHERE c.run = ?1 AND c.task = ?2 ORDER BY c.id, x.rank"#,
        run,
        task,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Filter of [`examples`]; a field that is none filters nothing.
#[derive(Debug, Clone, Default)]
pub struct FailureFilter {
    /// Name of the failure mode.
    pub mode: Option<String>,
    /// Number of the sector.
    pub sector: Option<u32>,
    /// Number of the speed band.
    pub band: Option<u32>,
    /// Only failures that are older than this one.
    pub before: Option<FailureCursor>,
}

/// Position of a failure in the list of a task's failures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FailureCursor {
    /// Position of the episode among the task's criticised episodes.
    pub episode_ordinal: i64,
    /// Number of the cell.
    pub cell: i64,
    /// Position of the failure in its cell.
    pub ordinal: i64,
}

/// A failure with the cell that it is in.
#[derive(Debug, Clone, PartialEq)]
pub struct ListedFailure {
    /// Number of the cell.
    pub cell: i64,
    /// Key of the cell.
    pub key: CellKey,
    /// Suffix of the episode's lease id.
    pub id_suffix: String,
    /// The failure as stored.
    pub example: FailureExample,
}

/// Reads the failures that are kept of a run's task, newest first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn examples(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    filter: &FailureFilter,
    limit: i64,
) -> Result<Vec<ListedFailure>, StoreError> {
    let end = FailureCursor { episode_ordinal: i64::MAX, cell: i64::MAX, ordinal: i64::MAX };
    let FailureCursor { episode_ordinal, cell, ordinal } = filter.before.unwrap_or(end);
    let rows = query!(
        r#"SELECT c.id AS "cell!", c.mode AS "mode!", c.sector AS "sector!", c.band AS "band!", l.id_suffix AS "id_suffix!",
                  x.ordinal AS "ordinal!", x.episode_ordinal AS "episode_ordinal!", x.lease AS "lease!", x.number AS "number!",
                  x.agent AS "agent!", x.step AS "step!", x.sector_deg, x.relative_speed, x.steps_left,
                  x.avoidable AS "avoidable: bool"
           FROM failure_cells c JOIN failure_examples x ON x.cell = c.id JOIN leases l ON l.id = x.lease
           WHERE c.run = ?1 AND c.task = ?2 AND (?3 IS NULL OR c.mode = ?3) AND (?4 IS NULL OR c.sector = ?4)
                 AND (?5 IS NULL OR c.band = ?5) AND (x.episode_ordinal, x.cell, x.ordinal) < (?6, ?7, ?8)
           ORDER BY x.episode_ordinal DESC, x.cell DESC, x.ordinal DESC LIMIT ?9"#,
        run,
        task,
        filter.mode,
        filter.sector,
        filter.band,
        episode_ordinal,
        cell,
        ordinal,
        limit
    )
    .fetch_all(conn)
    .await?;
    let failures = rows.into_iter().map(|r| ListedFailure {
        cell: r.cell,
        key: CellKey::from_columns(r.mode, r.sector, r.band),
        id_suffix: r.id_suffix,
        example: FailureExample {
            ordinal: r.ordinal,
            episode_ordinal: r.episode_ordinal,
            lease: r.lease,
            number: r.number,
            agent: r.agent,
            step: r.step,
            sector_deg: r.sector_deg,
            relative_speed: r.relative_speed,
            steps_left: r.steps_left,
            avoidable: r.avoidable,
        },
    });
    Ok(failures.collect())
}
