//! A database looked at as a whole: how large what is, and whether what it says of itself agrees.

use serde::Serialize;
use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::clock::Millis;

/// How large a database is.
#[derive(Debug, Clone, Serialize)]
pub struct Size {
    /// Its schema.
    pub schema: i64,
    /// Bytes of the file as its pages say.
    pub bytes: i64,
    /// Of these, bytes of pages that are free: `sparring db vacuum` gives them back.
    pub free_bytes: i64,
    /// Tables with their indexes, the largest first, bytes.
    pub tables: Vec<(String, i64)>,
}

/// Bytes of the file as its pages say, and how many of them are free.
///
/// # Errors
/// The database's.
pub async fn bytes(conn: &mut SqliteConnection) -> Result<(i64, i64), StoreError> {
    let page: i64 = sqlx::query_scalar("PRAGMA page_size").fetch_one(&mut *conn).await?;
    let pages: i64 = sqlx::query_scalar("PRAGMA page_count").fetch_one(&mut *conn).await?;
    let free: i64 = sqlx::query_scalar("PRAGMA freelist_count").fetch_one(conn).await?;
    Ok((page * pages, page * free))
}

/// How large it is. It goes through every page.
///
/// # Errors
/// The database's.
pub async fn size(conn: &mut SqliteConnection) -> Result<Size, StoreError> {
    let (bytes, free_bytes) = bytes(conn).await?;
    let schema =
        sqlx::query_scalar("SELECT max(version) FROM _sqlx_migrations").fetch_one(&mut *conn).await?;
    let tables = sqlx::query_as(
        "SELECT s.tbl_name, sum(d.pgsize) FROM dbstat d JOIN sqlite_schema s ON s.name = d.name
         WHERE d.aggregate = TRUE GROUP BY s.tbl_name ORDER BY 2 DESC, 1",
    );
    let tables = tables.fetch_all(conn).await?;
    Ok(Size { schema, bytes, free_bytes, tables })
}

/// What a run has.
#[derive(Debug, Clone, Serialize)]
pub struct RunCount {
    /// Its id.
    pub run: String,
    /// `active` or `paused`.
    pub status: String,
    /// Leases that are active.
    pub active: i64,
    /// Reported episodes that are kept whole.
    pub whole: i64,
    /// Reported episodes of which only is kept how they came out.
    pub folded: i64,
    /// Episodes claimed in columns and accepted.
    pub claimed: i64,
    /// Level moves.
    pub moves: i64,
    /// Layouts that the gate let through.
    pub layouts: i64,
    /// When it was made.
    pub created_at: Millis,
}

/// What each run has, the oldest first. It goes through all that they have.
///
/// # Errors
/// The database's.
pub async fn runs(conn: &mut SqliteConnection) -> Result<Vec<RunCount>, StoreError> {
    Ok(sqlx::query_as!(
        RunCount,
        r#"SELECT r.id AS run, r.status, r.created_at,
                  (SELECT count(*) FROM leases l WHERE l.run = r.id AND l.status = 'active') AS "active!: i64",
                  (SELECT count(*) FROM leases l JOIN episodes e ON e.lease = l.id WHERE l.run = r.id) AS "whole!: i64",
                  (SELECT coalesce(sum(episodes), 0) FROM folds f WHERE f.run = r.id) AS "folded!: i64",
                  (SELECT coalesce(sum(episodes), 0) FROM claimed_sums c WHERE c.run = r.id) AS "claimed!: i64",
                  (SELECT count(*) FROM level_moves m WHERE m.run = r.id) AS "moves!: i64",
                  (SELECT count(*) FROM layouts y WHERE y.run = r.id AND y.state <> 'refused') AS "layouts!: i64"
           FROM runs r ORDER BY r.created_at, r.id"#
    )
    .fetch_all(conn)
    .await?)
}

/// What SQLite finds wrong with the file, in its words.
///
/// # Errors
/// The database's.
pub async fn broken(conn: &mut SqliteConnection) -> Result<Vec<String>, StoreError> {
    let mut found: Vec<String> =
        sqlx::query_scalar("PRAGMA integrity_check(20)").fetch_all(&mut *conn).await?;
    found.retain(|line| line != "ok");
    let dangling: Vec<(String, Option<i64>, String)> =
        sqlx::query_as("SELECT \"table\", rowid, parent FROM pragma_foreign_key_check LIMIT 20")
            .fetch_all(conn)
            .await?;
    found.extend(dangling.into_iter().map(|(table, row, parent)| {
        let row = row.map_or_else(String::new, |row| format!(" {row}"));
        format!("row{row} of {table} refers to a row of {parent} that is not there")
    }));
    Ok(found)
}

/// What contradicts itself among what is kept whole, in sentences.
///
/// # Errors
/// The database's.
pub async fn contradictions(conn: &mut SqliteConnection) -> Result<Vec<String>, StoreError> {
    let mut found = Vec::new();
    let logs = query!(
        r#"SELECT e.lease AS "lease!", e.number AS "number!" FROM episodes e
           WHERE e.flown IS NOT NULL
                 AND NOT EXISTS (SELECT 1 FROM action_logs a WHERE a.lease = e.lease AND a.number = e.number)
           LIMIT 20"#
    );
    for row in logs.fetch_all(&mut *conn).await? {
        found.push(format!("episode {} of lease {} was flown and has no actions", row.number, row.lease));
    }
    let groups = query!(
        r#"SELECT g.lease AS "lease!", g.number AS "number!", g.finished AS "finished!",
                  (SELECT count(*) FROM episodes e WHERE e.lease = g.lease AND e.state = 'finished'
                       AND e.number >= g.number * l.group_size AND e.number < (g.number + 1) * l.group_size)
                      AS "there!: i64"
           FROM groups g JOIN leases l ON l.id = g.lease
           WHERE l.form = 'groups' AND l.folded = 0 AND g.finished <> (
               SELECT count(*) FROM episodes e WHERE e.lease = g.lease AND e.state = 'finished'
                   AND e.number >= g.number * l.group_size AND e.number < (g.number + 1) * l.group_size)
           LIMIT 20"#
    );
    for row in groups.fetch_all(conn).await? {
        found.push(format!(
            "group {} of lease {} counts {} finished episodes, and has {}",
            row.number, row.lease, row.finished, row.there
        ));
    }
    Ok(found)
}

/// Finished episodes that plain sums count, and those that are there to be counted, of one run, those folded left out.
///
/// # Errors
/// The database's.
pub async fn counted(conn: &mut SqliteConnection, run: &str) -> Result<(i64, i64), StoreError> {
    let row = query!(
        r#"SELECT (SELECT coalesce(sum(episodes), 0) FROM task_sums WHERE run = ?1) AS "summed!: i64",
                  (SELECT count(*) FROM leases l JOIN episodes e ON e.lease = l.id
                   JOIN groups g ON g.lease = l.id AND g.number = e.number / l.group_size
                   WHERE l.run = ?1 AND e.state = 'finished' AND (g.proposal IS NOT NULL OR g.layout IS NOT NULL)
                         AND (l.form = 'groups' OR l.folded = 1 OR EXISTS (
                             SELECT 1 FROM column_claims c WHERE c.lease = l.id AND c.state = 'accepted')))
                      AS "there!: i64""#,
        run
    )
    .fetch_one(conn)
    .await?;
    Ok((row.summed, row.there))
}

/// Episodes claimed in columns by what became of their claims: accepted and finished, lost of accepted ones, refused, unproven.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Claimed {
    /// Of accepted claims, those that finished.
    pub finished: i64,
    /// Of accepted claims, those lost to infrastructure.
    pub failed: i64,
    /// Of refused claims.
    pub refused: i64,
    /// Of claims whose audited logs never came.
    pub unproven: i64,
}

impl Claimed {
    /// Adds a claim; one that waits for its logs counts nowhere yet.
    pub fn add(&mut self, state: &str, episodes: i64, failed: i64) {
        match state {
            "accepted" => {
                self.finished += episodes - failed;
                self.failed += failed;
            }
            "refused" => self.refused += episodes,
            "unproven" => self.unproven += episodes,
            _ => {}
        }
    }
}

/// Episodes claimed in columns of a run as plain sums count them, and as its claims say that are not folded.
///
/// # Errors
/// The database's.
pub async fn claimed(conn: &mut SqliteConnection, run: &str) -> Result<(Claimed, Claimed), StoreError> {
    let summed = query!(
        r#"SELECT coalesce(sum(episodes), 0) AS "finished!: i64", coalesce(sum(failed), 0) AS "failed!: i64",
                  coalesce(sum(refused), 0) AS "refused!: i64", coalesce(sum(unproven), 0) AS "unproven!: i64"
           FROM claimed_sums WHERE run = ?"#,
        run
    );
    let row = summed.fetch_one(&mut *conn).await?;
    let summed =
        Claimed { finished: row.finished, failed: row.failed, refused: row.refused, unproven: row.unproven };
    let whole = query!(
        r#"SELECT c.state, sum(c.episodes) AS "episodes!: i64", sum(c.failed) AS "failed!: i64"
           FROM leases l JOIN column_claims c ON c.lease = l.id WHERE l.run = ? GROUP BY c.state"#,
        run
    );
    let mut there = Claimed::default();
    for row in whole.fetch_all(conn).await? {
        there.add(&row.state, row.episodes, row.failed);
    }
    Ok((summed, there))
}

/// Numbers of episodes that are kept whole and were flown, some of them.
///
/// # Errors
/// The database's.
pub async fn sample(conn: &mut SqliteConnection, count: i64) -> Result<Vec<(i64, i64, f64)>, StoreError> {
    let rows = query!(
        r#"SELECT lease AS "lease!", number AS "number!", score AS "score!: f64" FROM episodes
           WHERE flown IS NOT NULL ORDER BY random() LIMIT ?"#,
        count
    )
    .fetch_all(conn)
    .await?;
    Ok(rows.into_iter().map(|row| (row.lease, row.number, row.score)).collect())
}
