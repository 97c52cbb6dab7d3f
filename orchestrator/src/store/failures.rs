//! The failure profile: cells of (mode, bearing sector, speed band), and the newest failures of each.

use std::collections::BTreeMap;

use sqlx::{QueryBuilder, Sqlite, SqliteConnection, query};

use super::{ROWS, StoreError};
use crate::clock::Millis;

/// Newest failures that are kept of each cell.
pub const RING: i64 = 64;

/// Sector and band of a failure in which nothing was met.
const NOWHERE: i64 = -1;

/// Which cell of a task's profile.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct CellKey {
    /// The failure mode.
    pub mode: String,
    /// (bearing sector, speed band); none where nothing was met.
    pub met: Option<(u32, u32)>,
}

impl CellKey {
    fn columns(&self) -> (i64, i64) {
        self.met.map_or((NOWHERE, NOWHERE), |(sector, band)| (i64::from(sector), i64::from(band)))
    }

    fn of(mode: String, sector: i64, band: i64) -> Self {
        Self { mode, met: u32::try_from(sector).ok().zip(u32::try_from(band).ok()) }
    }
}

/// A cell's sums.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CellSums {
    /// Failures.
    pub count: i64,
    /// Of these, could have been avoided.
    pub avoidable: i64,
    /// Of these, were seen and could not.
    pub unavoidable: i64,
    /// The sum of the steps that were left to act.
    pub steps_left: i64,
    /// The count, halving every half-life, as it stood at `as_of`.
    pub weight: f64,
    /// The last one's place among the task's criticised episodes, from 1.
    pub as_of: i64,
    /// When the last one was entered.
    pub last_at: Millis,
}

/// A failure that is kept as an example.
#[derive(Debug, Clone, PartialEq)]
pub struct Example {
    /// Which of its cell's it is, from 1.
    pub nth: i64,
    /// The episode's place among the task's criticised ones, from 1.
    pub place: i64,
    /// The episode's lease.
    pub lease: i64,
    /// Its index in the lease.
    pub number: i64,
    /// Whose.
    pub agent: i64,
    /// When, from 1.
    pub step: i64,
    /// From where, degrees.
    pub bearing_deg: Option<f64>,
    /// How fast, in the world's unit.
    pub relative_speed: Option<f64>,
    /// Steps that were left to act.
    pub steps_left: Option<i64>,
    /// Whether it could have been avoided; none if nothing was met, or seen.
    pub avoidable: Option<bool>,
}

/// Writes cells.
///
/// # Errors
/// The database's.
pub async fn put_cells(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    cells: &[(&CellKey, &CellSums)],
) -> Result<(), StoreError> {
    for rows in cells.chunks(ROWS) {
        write_cells((run, task), rows).build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// Writes cells that were never written before; their numbers.
///
/// # Errors
/// The database's.
pub async fn insert_cells(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    cells: &[(&CellKey, &CellSums)],
) -> Result<BTreeMap<CellKey, i64>, StoreError> {
    let mut numbers = BTreeMap::new();
    for rows in cells.chunks(ROWS) {
        let mut statement = write_cells((run, task), rows);
        statement.push(" RETURNING mode, sector, band, cell");
        for (mode, sector, band, cell) in statement.build_query_as().fetch_all(&mut *conn).await? {
            numbers.insert(CellKey::of(mode, sector, band), cell);
        }
    }
    Ok(numbers)
}

fn write_cells((run, task): (&str, &str), rows: &[(&CellKey, &CellSums)]) -> QueryBuilder<Sqlite> {
    let mut statement = QueryBuilder::new(
        "INSERT INTO failure_profile (run, task, mode, sector, band, count, avoidable, unavoidable, steps_left,
                                      weight, as_of, last_at) ",
    );
    statement.push_values(rows, |mut values, (key, sums)| {
        let (sector, band) = key.columns();
        values.push_bind(run.to_owned()).push_bind(task.to_owned()).push_bind(key.mode.clone());
        values.push_bind(sector).push_bind(band).push_bind(sums.count).push_bind(sums.avoidable);
        values.push_bind(sums.unavoidable).push_bind(sums.steps_left).push_bind(sums.weight);
        values.push_bind(sums.as_of).push_bind(sums.last_at);
    });
    statement.push(
        " ON CONFLICT (run, task, mode, sector, band) DO UPDATE SET
             count = excluded.count, avoidable = excluded.avoidable, unavoidable = excluded.unavoidable,
             steps_left = excluded.steps_left, weight = excluded.weight, as_of = excluded.as_of,
             last_at = excluded.last_at",
    );
    statement
}

/// Writes examples of cells, each over the one of its cell that is a ring older.
///
/// # Errors
/// The database's.
pub async fn put_examples(
    conn: &mut SqliteConnection,
    examples: &[(i64, &Example)],
) -> Result<(), StoreError> {
    for rows in examples.chunks(ROWS) {
        let mut statement = QueryBuilder::new(
            "INSERT OR REPLACE INTO failure_examples (cell, slot, nth, place, lease, number, agent, step, bearing_deg,
                 relative_speed, steps_left, avoidable) ",
        );
        statement.push_values(rows, |mut values, (cell, x)| {
            values.push_bind(cell).push_bind(x.nth % RING).push_bind(x.nth).push_bind(x.place);
            values.push_bind(x.lease).push_bind(x.number).push_bind(x.agent).push_bind(x.step);
            values.push_bind(x.bearing_deg).push_bind(x.relative_speed).push_bind(x.steps_left);
            values.push_bind(x.avoidable.map(i64::from));
        });
        statement.build().execute(&mut *conn).await?;
    }
    Ok(())
}

/// The whole profile of a run's task, by mode, sector and band.
///
/// # Errors
/// The database's.
pub async fn profile(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
) -> Result<Vec<(i64, CellKey, CellSums)>, StoreError> {
    let rows = query!(
        "SELECT cell, mode, sector, band, count, avoidable, unavoidable, steps_left, weight, as_of, last_at
         FROM failure_profile WHERE run = ? AND task = ? ORDER BY mode, sector, band",
        run,
        task
    )
    .fetch_all(conn)
    .await?;
    let cells = rows.into_iter().map(|r| {
        let sums = CellSums {
            count: r.count,
            avoidable: r.avoidable,
            unavoidable: r.unavoidable,
            steps_left: r.steps_left,
            weight: r.weight,
            as_of: r.as_of,
            last_at: r.last_at,
        };
        (r.cell, CellKey::of(r.mode, r.sector, r.band), sums)
    });
    Ok(cells.collect())
}

/// The newest `most` episodes behind every cell of a run's task: (cell, lease, token, index), newest first in each. An
/// episode can fail more than once in one cell, and is one episode all the same.
///
/// # Errors
/// The database's.
pub async fn newest(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    most: i64,
) -> Result<Vec<(i64, i64, String, i64)>, StoreError> {
    let rows = query!(
        r#"SELECT p.cell AS "cell!", l.id AS "lease!", l.token AS "token!", x.number AS "number!"
           FROM failure_profile p
           JOIN (SELECT cell, lease, number, max(nth) AS nth,
                        row_number() OVER (PARTITION BY cell ORDER BY max(nth) DESC) AS place
                 FROM failure_examples
                 WHERE cell IN (SELECT cell FROM failure_profile WHERE run = ?1 AND task = ?2)
                 GROUP BY cell, lease, number) x ON x.cell = p.cell AND x.place <= ?3
           JOIN leases l ON l.id = x.lease
           WHERE p.run = ?1 AND p.task = ?2 ORDER BY p.cell, x.place"#,
        run,
        task,
        most
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|r| (r.cell, r.lease, r.token, r.number)).collect())
}

/// Which failures are asked for.
#[derive(Debug, Clone, Default)]
pub struct Wanted {
    /// Of this mode.
    pub mode: Option<String>,
    /// Of this sector.
    pub sector: Option<u32>,
    /// Of this band.
    pub band: Option<u32>,
    /// Older than (place, cell, nth).
    pub before: Option<(i64, i64, i64)>,
}

/// A failure with the cell it is in.
#[derive(Debug, Clone, PartialEq)]
pub struct Kept {
    /// The cell's number.
    pub cell: i64,
    /// Its key.
    pub key: CellKey,
    /// The token of the episode's lease.
    pub token: String,
    /// The failure.
    pub example: Example,
}

/// Failures that are kept of a run's task, the newest first.
///
/// # Errors
/// The database's.
pub async fn kept(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    wanted: &Wanted,
    limit: i64,
) -> Result<Vec<Kept>, StoreError> {
    let (place, cell, nth) = wanted.before.unwrap_or((i64::MAX, i64::MAX, i64::MAX));
    let rows = query!(
        r#"SELECT p.cell AS "cell!", p.mode AS "mode!", p.sector AS "sector!", p.band AS "band!", l.token AS "token!",
                  x.nth AS "nth!", x.place AS "place!", x.lease AS "lease!", x.number AS "number!", x.agent AS "agent!",
                  x.step AS "step!", x.bearing_deg, x.relative_speed, x.steps_left, x.avoidable
           FROM failure_profile p JOIN failure_examples x ON x.cell = p.cell JOIN leases l ON l.id = x.lease
           WHERE p.run = ?1 AND p.task = ?2 AND (?3 IS NULL OR p.mode = ?3) AND (?4 IS NULL OR p.sector = ?4)
                 AND (?5 IS NULL OR p.band = ?5) AND (x.place, x.cell, x.nth) < (?6, ?7, ?8)
           ORDER BY x.place DESC, x.cell DESC, x.nth DESC LIMIT ?9"#,
        run,
        task,
        wanted.mode,
        wanted.sector,
        wanted.band,
        place,
        cell,
        nth,
        limit
    )
    .fetch_all(conn)
    .await?;
    let kept = rows.into_iter().map(|r| Kept {
        cell: r.cell,
        key: CellKey::of(r.mode, r.sector, r.band),
        token: r.token,
        example: Example {
            nth: r.nth,
            place: r.place,
            lease: r.lease,
            number: r.number,
            agent: r.agent,
            step: r.step,
            bearing_deg: r.bearing_deg,
            relative_speed: r.relative_speed,
            steps_left: r.steps_left,
            avoidable: r.avoidable.map(|a| a != 0),
        },
    });
    Ok(kept.collect())
}
