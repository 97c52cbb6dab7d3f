//! Folded leases: what is left of those past a run's retention. Some leases a row, packed.

mod form;
#[cfg(test)]
mod tests;

use sqlx::{SqliteConnection, query};

pub use self::form::{FoldedClaim, FoldedEpisode, FoldedGroup, FoldedLease, FoldedState};
use super::StoreError;
use super::leases::LeaseRow;
use crate::clock::Millis;

/// Stores leases of a run, in order of their numbers.
///
/// # Errors
/// The database's.
pub async fn insert(
    conn: &mut SqliteConnection,
    run: &str,
    leases: &[FoldedLease],
    at: Millis,
) -> Result<(), StoreError> {
    let numbers = || leases.iter().map(|lease| lease.row.id);
    let (Some(first), Some(last)) = (numbers().min(), numbers().max()) else { return Ok(()) };
    let episodes = leases.iter().map(|lease| lease.episodes().count()).sum::<usize>() as i64;
    let (heads, body) = form::packed(leases)?;
    query!(
        "INSERT INTO folds (run, first, last, episodes, at, heads, body) VALUES (?, ?, ?, ?, ?, ?, ?)",
        run,
        first,
        last,
        episodes,
        at,
        heads,
        body
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Adds to leases that were folded before what more of them was, where they are: many small rows about the same leases would make
/// every list of them slow.
///
/// # Errors
/// The database's, or a fold that cannot be read.
pub async fn extend(
    conn: &mut SqliteConnection,
    run: &str,
    leases: &[FoldedLease],
    at: Millis,
) -> Result<(), StoreError> {
    let mut open: Option<(i64, Vec<FoldedLease>)> = None;
    for lease in leases {
        let holds = |(_, all): &(i64, Vec<FoldedLease>)| all.iter().any(|known| known.row.id == lease.row.id);
        if !open.as_ref().is_some_and(holds) {
            if let Some((id, all)) = open.take() {
                rewrite(conn, id, &all).await?;
            }
            open = holding(conn, run, lease.row.id).await?;
        }
        match &mut open {
            Some((_, all)) => {
                all.push(lease.clone());
                *all = joined(std::mem::take(all));
            }
            None => insert(conn, run, std::slice::from_ref(lease), at).await?,
        }
    }
    match open {
        Some((id, all)) => rewrite(conn, id, &all).await,
        None => Ok(()),
    }
}

/// A row that a lease is in, with all its leases.
async fn holding(
    conn: &mut SqliteConnection,
    run: &str,
    lease: i64,
) -> Result<Option<(i64, Vec<FoldedLease>)>, StoreError> {
    let mut before = (lease, i64::MAX);
    // As a rule the first that is looked at: leases are folded in order.
    loop {
        let row = query!(
            "SELECT id, first, heads, body FROM folds
             WHERE run = ? AND (first, id) <= (?, ?) AND last >= ? ORDER BY first DESC, id DESC LIMIT 1",
            run,
            before.0,
            before.1,
            lease
        )
        .fetch_optional(&mut *conn)
        .await?;
        let Some(row) = row else { return Ok(None) };
        let all = form::whole(run, row.heads.as_deref(), Some(&row.body))?;
        if all.iter().any(|known| known.row.id == lease) {
            return Ok(Some((row.id, all)));
        }
        before = (row.first, row.id - 1);
    }
}

async fn rewrite(conn: &mut SqliteConnection, id: i64, leases: &[FoldedLease]) -> Result<(), StoreError> {
    let episodes = leases.iter().map(|lease| lease.episodes().count()).sum::<usize>() as i64;
    let (heads, body) = form::packed(leases)?;
    query!("UPDATE folds SET episodes = ?, heads = ?, body = ? WHERE id = ?", episodes, heads, body, id)
        .execute(conn)
        .await?;
    Ok(())
}

/// A folded lease by its number.
///
/// # Errors
/// The database's, or a fold that cannot be read.
pub async fn get(
    conn: &mut SqliteConnection,
    run: &str,
    lease: i64,
) -> Result<Option<FoldedLease>, StoreError> {
    let rows = query!(
        "SELECT heads, body FROM folds WHERE run = ?1 AND first <= ?2 AND last >= ?2 ORDER BY first DESC",
        run,
        lease
    )
    .fetch_all(conn)
    .await?;
    let mut found = Vec::new();
    for row in rows {
        let all = form::whole(run, row.heads.as_deref(), Some(&row.body))?;
        found.extend(all.into_iter().filter(|folded| folded.row.id == lease));
    }
    Ok(joined(found).pop())
}

/// In order of their numbers, each once: something of a lease may have been folded later than the rest.
fn joined(mut leases: Vec<FoldedLease>) -> Vec<FoldedLease> {
    leases.sort_by_key(|folded| folded.row.id);
    let mut joined = Vec::<FoldedLease>::with_capacity(leases.len());
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

/// What is read of folds: leases alone, or with what they came to.
trait Part: Sized {
    /// Whether bodies are read.
    const WHOLE: bool;
    /// Folds that are read at a time.
    const FOLDS: i64;

    fn read(run: &str, heads: Option<&[u8]>, body: Option<&[u8]>) -> Result<Vec<Self>, StoreError>;

    fn lease(&self) -> i64;

    /// In order of their numbers, each once: something of a lease may have been folded later than the rest.
    fn joined(parts: Vec<Self>) -> Vec<Self>;
}

impl Part for FoldedLease {
    const WHOLE: bool = true;
    const FOLDS: i64 = 2;

    fn read(run: &str, heads: Option<&[u8]>, body: Option<&[u8]>) -> Result<Vec<Self>, StoreError> {
        form::whole(run, heads, body)
    }

    fn lease(&self) -> i64 {
        self.row.id
    }

    fn joined(parts: Vec<Self>) -> Vec<Self> {
        joined(parts)
    }
}

impl Part for LeaseRow {
    const WHOLE: bool = false;
    const FOLDS: i64 = 128;

    fn read(run: &str, heads: Option<&[u8]>, body: Option<&[u8]>) -> Result<Vec<Self>, StoreError> {
        form::heads(run, heads, body)
    }

    fn lease(&self) -> i64 {
        self.id
    }

    fn joined(mut parts: Vec<Self>) -> Vec<Self> {
        parts.sort_by_key(|row| row.id);
        parts.dedup_by_key(|row| row.id);
        parts
    }
}

/// Folded leases of a run from a number on, in order, until they come to enough by this count.
///
/// # Errors
/// The database's, or a fold that cannot be read.
pub async fn from(
    conn: &mut SqliteConnection,
    run: &str,
    lease: i64,
    enough: (i64, impl Fn(&FoldedLease) -> i64),
) -> Result<Vec<FoldedLease>, StoreError> {
    walk(conn, run, lease, enough).await
}

/// So many folded leases of a run from a number on, in order, by themselves; some more may come with them.
///
/// # Errors
/// The database's, or a fold that cannot be read.
pub async fn heads(
    conn: &mut SqliteConnection,
    run: &str,
    lease: i64,
    limit: i64,
) -> Result<Vec<LeaseRow>, StoreError> {
    walk(conn, run, lease, (limit, |_: &LeaseRow| 1)).await
}

async fn walk<P: Part>(
    conn: &mut SqliteConnection,
    run: &str,
    lease: i64,
    (enough, count): (i64, impl Fn(&P) -> i64),
) -> Result<Vec<P>, StoreError> {
    let (mut found, mut begin, mut after) = (Vec::<P>::new(), i64::MIN, i64::MIN);
    loop {
        let (whole, folds) = (P::WHOLE, P::FOLDS);
        // Several may begin with the same lease: something of it was folded later.
        let rows = query!(
            r#"SELECT id, first, heads, CASE WHEN ? OR heads IS NULL THEN body END AS "body: Vec<u8>" FROM folds
               WHERE run = ? AND (first, id) > (?, ?) AND last >= ? ORDER BY first, id LIMIT ?"#,
            whole,
            run,
            begin,
            after,
            lease,
            folds
        )
        .fetch_all(&mut *conn)
        .await?;
        let Some(last) = rows.last() else { break };
        (begin, after) = (last.first, last.id);
        // Those of later rows come after what is before the first of them: a lease that ended late is in a row of its own.
        let settled = |part: &&P| part.lease() < begin;
        for row in &rows {
            let parts = P::read(run, row.heads.as_deref(), row.body.as_deref())?;
            found.extend(parts.into_iter().filter(|part| part.lease() >= lease));
        }
        found = P::joined(found);
        if found.iter().filter(settled).map(&count).sum::<i64>() >= enough {
            break;
        }
    }
    Ok(found)
}

/// Every folded lease of a run, in order; one of which something was folded later comes again with that.
///
/// # Errors
/// The database's, or a fold that cannot be read.
pub async fn each(
    conn: &mut SqliteConnection,
    run: &str,
    mut see: impl FnMut(FoldedLease),
) -> Result<(), StoreError> {
    let mut after = (i64::MIN, i64::MIN);
    loop {
        let rows = query!(
            "SELECT id, first, heads, body FROM folds WHERE run = ? AND (first, id) > (?, ?) ORDER BY first, id LIMIT 2",
            run,
            after.0,
            after.1
        )
        .fetch_all(&mut *conn)
        .await?;
        let Some(last) = rows.last() else { return Ok(()) };
        after = (last.first, last.id);
        for row in &rows {
            form::whole(run, row.heads.as_deref(), Some(&row.body))?.into_iter().for_each(&mut see);
        }
    }
}
