//! Compacted leases: the results of leases that a run does not keep whole any more. Table `compacted_leases`, several leases a row.
//!
//! [`packing`] has the contents of a row. A lease may be in several rows, since some of its groups may be compacted later; all
//! reads of this module join its parts.

pub(crate) mod packing;
#[cfg(test)]
mod tests;

use sqlx::{SqliteConnection, query};

pub use self::packing::{CompactedClaim, CompactedEpisode, CompactedGroup, CompactedLease};
use self::packing::{PackedLeases, pack_leases, unpack_lease_rows, unpack_leases};
use super::StoreError;
use super::leases::LeaseRow;
use crate::Millis;

/// Stores leases of a run in one row.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn insert(
    conn: &mut SqliteConnection,
    run: &str,
    leases: &[CompactedLease],
    at: Millis,
) -> Result<(), StoreError> {
    let numbers = || leases.iter().map(|lease| lease.row.id);
    let (Some(first), Some(last)) = (numbers().min(), numbers().max()) else { return Ok(()) };
    let episodes = count_episodes(leases);
    let PackedLeases { lease_rows, body } = pack_leases(leases)?;
    query!(
        "INSERT INTO compacted_leases (run, first_lease, last_lease, episodes, at, lease_rows, body)
         VALUES (?, ?, ?, ?, ?, ?, ?)",
        run,
        first,
        last,
        episodes,
        at,
        lease_rows,
        body
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Adds more groups of leases that were compacted before, to the rows that hold them. A new row for each would make every list
/// slow.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails, and [`StoreError::Corrupt`] if a row cannot be decoded.
pub async fn extend(
    conn: &mut SqliteConnection,
    run: &str,
    leases: &[CompactedLease],
    at: Millis,
) -> Result<(), StoreError> {
    let mut open: Option<CompactedRow> = None;
    for lease in leases {
        if !open.as_ref().is_some_and(|row| row.holds(lease.row.id)) {
            if let Some(row) = open.take() {
                row.rewrite(conn).await?;
            }
            open = row_of_lease(conn, run, lease.row.id).await?;
        }
        match &mut open {
            Some(row) => {
                row.leases.push(lease.clone());
                row.leases = join_leases(std::mem::take(&mut row.leases));
            }
            None => insert(conn, run, std::slice::from_ref(lease), at).await?,
        }
    }
    match open {
        Some(row) => row.rewrite(conn).await,
        None => Ok(()),
    }
}

/// A row with all of its leases.
struct CompactedRow {
    id: i64,
    leases: Vec<CompactedLease>,
}

impl CompactedRow {
    fn holds(&self, lease: i64) -> bool {
        self.leases.iter().any(|known| known.row.id == lease)
    }

    async fn rewrite(self, conn: &mut SqliteConnection) -> Result<(), StoreError> {
        let episodes = count_episodes(&self.leases);
        let PackedLeases { lease_rows, body } = pack_leases(&self.leases)?;
        query!(
            "UPDATE compacted_leases SET episodes = ?, lease_rows = ?, body = ? WHERE id = ?",
            episodes,
            lease_rows,
            body,
            self.id
        )
        .execute(conn)
        .await?;
        Ok(())
    }
}

fn count_episodes(leases: &[CompactedLease]) -> i64 {
    leases.iter().map(|lease| lease.episodes().count()).sum::<usize>() as i64
}

/// Reads a row that holds a lease.
async fn row_of_lease(
    conn: &mut SqliteConnection,
    run: &str,
    lease: i64,
) -> Result<Option<CompactedRow>, StoreError> {
    let (mut first_lease, mut id) = (lease, i64::MAX);
    // Usually the first row holds it: leases are compacted in order.
    loop {
        let row = query!(
            "SELECT id, first_lease, lease_rows, body FROM compacted_leases
             WHERE run = ? AND (first_lease, id) <= (?, ?) AND last_lease >= ?
             ORDER BY first_lease DESC, id DESC LIMIT 1",
            run,
            first_lease,
            id,
            lease
        )
        .fetch_optional(&mut *conn)
        .await?;
        let Some(row) = row else { return Ok(None) };
        let leases = unpack_leases(run, &row.lease_rows, &row.body)?;
        let found = CompactedRow { id: row.id, leases };
        if found.holds(lease) {
            return Ok(Some(found));
        }
        (first_lease, id) = (row.first_lease, row.id - 1);
    }
}

/// Reads a compacted lease by its number.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails, and [`StoreError::Corrupt`] if a row cannot be decoded.
pub async fn get(
    conn: &mut SqliteConnection,
    run: &str,
    lease: i64,
) -> Result<Option<CompactedLease>, StoreError> {
    let rows = query!(
        "SELECT lease_rows, body FROM compacted_leases
         WHERE run = ?1 AND first_lease <= ?2 AND last_lease >= ?2 ORDER BY first_lease DESC",
        run,
        lease
    )
    .fetch_all(conn)
    .await?;
    let mut found = Vec::new();
    for row in rows {
        let leases = unpack_leases(run, &row.lease_rows, &row.body)?;
        found.extend(leases.into_iter().filter(|compacted| compacted.row.id == lease));
    }
    Ok(join_leases(found).pop())
}

/// Sorts leases by number and joins the parts of each.
fn join_leases(mut leases: Vec<CompactedLease>) -> Vec<CompactedLease> {
    leases.sort_by_key(|lease| lease.row.id);
    let mut joined = Vec::<CompactedLease>::with_capacity(leases.len());
    for lease in leases {
        match joined.last_mut().filter(|last| last.row.id == lease.row.id) {
            Some(last) => {
                for group in lease.groups {
                    match last.groups.iter_mut().find(|known| known.number == group.number) {
                        Some(known) => {
                            known.episodes.extend(group.episodes);
                            known.episodes.sort_by_key(|episode| episode.number);
                        }
                        None => last.groups.push(group),
                    }
                }
                last.groups.sort_by_key(|group| group.number);
                last.claim = last.claim.take().or(lease.claim);
            }
            None => joined.push(lease),
        }
    }
    joined
}

/// Part of a row that a walk reads: leases alone, or with their results.
trait RowPart: Sized {
    /// True if bodies are read.
    const READS_BODY: bool;
    /// Rows that are read at a time.
    const ROWS: i64;

    /// Unpacks a row. `body` is none if bodies are not read.
    fn unpack(run: &str, lease_rows: &[u8], body: Option<&[u8]>) -> Result<Vec<Self>, StoreError>;

    /// Number of the lease.
    fn lease(&self) -> i64;

    /// Sorts parts by lease, each lease once.
    fn join(parts: Vec<Self>) -> Vec<Self>;
}

impl RowPart for CompactedLease {
    const READS_BODY: bool = true;
    const ROWS: i64 = 2;

    fn unpack(run: &str, lease_rows: &[u8], body: Option<&[u8]>) -> Result<Vec<Self>, StoreError> {
        unpack_leases(run, lease_rows, body.unwrap_or_default())
    }

    fn lease(&self) -> i64 {
        self.row.id
    }

    fn join(parts: Vec<Self>) -> Vec<Self> {
        join_leases(parts)
    }
}

impl RowPart for LeaseRow {
    const READS_BODY: bool = false;
    const ROWS: i64 = 128;

    fn unpack(run: &str, lease_rows: &[u8], _body: Option<&[u8]>) -> Result<Vec<Self>, StoreError> {
        unpack_lease_rows(run, lease_rows)
    }

    fn lease(&self) -> i64 {
        self.id
    }

    fn join(mut parts: Vec<Self>) -> Vec<Self> {
        parts.sort_by_key(|row| row.id);
        parts.dedup_by_key(|row| row.id);
        parts
    }
}

/// Reads compacted leases of a run from a number on, in order, until `weight` of them adds up to `enough`. A few more may follow.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails, and [`StoreError::Corrupt`] if a row cannot be decoded.
pub async fn from(
    conn: &mut SqliteConnection,
    run: &str,
    lease: i64,
    enough: i64,
    weight: impl Fn(&CompactedLease) -> i64,
) -> Result<Vec<CompactedLease>, StoreError> {
    walk(conn, run, lease, enough, weight).await
}

/// Reads `limit` compacted leases of a run from a number on, in order, without their results. A few more may follow.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails, and [`StoreError::Corrupt`] if a row cannot be decoded.
pub async fn lease_rows(
    conn: &mut SqliteConnection,
    run: &str,
    lease: i64,
    limit: i64,
) -> Result<Vec<LeaseRow>, StoreError> {
    walk(conn, run, lease, limit, |_: &LeaseRow| 1).await
}

async fn walk<P: RowPart>(
    conn: &mut SqliteConnection,
    run: &str,
    lease: i64,
    enough: i64,
    weight: impl Fn(&P) -> i64,
) -> Result<Vec<P>, StoreError> {
    let (mut found, mut first_lease, mut id) = (Vec::<P>::new(), i64::MIN, i64::MIN);
    loop {
        let (reads_body, limit) = (P::READS_BODY, P::ROWS);
        // Several rows may begin with the same lease.
        let rows = query!(
            r#"SELECT id, first_lease, lease_rows, CASE WHEN ? THEN body END AS "body: Vec<u8>" FROM compacted_leases
               WHERE run = ? AND (first_lease, id) > (?, ?) AND last_lease >= ? ORDER BY first_lease, id LIMIT ?"#,
            reads_body,
            run,
            first_lease,
            id,
            lease,
            limit
        )
        .fetch_all(&mut *conn)
        .await?;
        let Some(last) = rows.last() else { break };
        (first_lease, id) = (last.first_lease, last.id);
        // Leases below `first_lease` are complete: a lease that ended late is in a row of its own, which later rows may precede.
        let is_complete = |part: &&P| part.lease() < first_lease;
        for row in &rows {
            let parts = P::unpack(run, &row.lease_rows, row.body.as_deref())?;
            found.extend(parts.into_iter().filter(|part| part.lease() >= lease));
        }
        found = P::join(found);
        if found.iter().filter(is_complete).map(&weight).sum::<i64>() >= enough {
            break;
        }
    }
    Ok(found)
}

/// Calls `visit` for every compacted lease of a run, in order of the rows. A lease in several rows is visited several times.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails, and [`StoreError::Corrupt`] if a row cannot be decoded.
pub async fn each(
    conn: &mut SqliteConnection,
    run: &str,
    mut visit: impl FnMut(CompactedLease),
) -> Result<(), StoreError> {
    let (mut first_lease, mut id) = (i64::MIN, i64::MIN);
    loop {
        let rows = query!(
            "SELECT id, first_lease, lease_rows, body FROM compacted_leases
             WHERE run = ? AND (first_lease, id) > (?, ?) ORDER BY first_lease, id LIMIT 2",
            run,
            first_lease,
            id
        )
        .fetch_all(&mut *conn)
        .await?;
        let Some(last) = rows.last() else { return Ok(()) };
        (first_lease, id) = (last.first_lease, last.id);
        for row in &rows {
            unpack_leases(run, &row.lease_rows, &row.body)?.into_iter().for_each(&mut visit);
        }
    }
}
