//! Folded leases: what is left of those past a run's retention. Some leases a row, packed.

use serde::{Deserialize, Serialize};
use sqlx::{SqliteConnection, query};

use super::StoreError;
use super::leases::LeaseRow;
use super::pack::{pack, unpack};
use crate::clock::Millis;

/// A lease that was folded.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FoldedLease {
    /// The lease as it was.
    pub row: LeaseRow,
    /// Its groups, but for those that something rests on.
    pub groups: Vec<FoldedGroup>,
    /// What became of what was claimed of it in columns.
    pub claim: Option<FoldedClaim>,
}

/// A group of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FoldedGroup {
    /// Its number in the lease.
    pub number: i64,
    /// The task.
    pub task: String,
    /// The level.
    pub level: Option<i64>,
    /// The proposal's role, or `designed`.
    pub role: String,
    /// Its layout, where it was designed.
    pub layout: Option<i64>,
    /// Whether the scenario was contested.
    pub contested: bool,
    /// Its reported episodes, in order.
    pub episodes: Vec<FoldedEpisode>,
}

/// What an episode came to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FoldedEpisode {
    /// Its index in the lease.
    pub number: i64,
    /// How it ended.
    pub state: FoldedState,
    /// The world's score.
    pub score: Option<f64>,
    /// Skill, where the scenario defines one.
    pub skill: Option<f64>,
    /// Whether it counts as a success.
    pub success: Option<bool>,
    /// The policy that flew it.
    pub policy_version: i64,
    /// When it was reported, milliseconds after its lease was granted.
    pub after_ms: i64,
}

/// See [`super::episodes::EpisodeRow::state`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum FoldedState {
    /// It was flown.
    Finished,
    /// The infrastructure lost it.
    Failed,
    /// It came after its lease was over.
    Late,
}

impl FoldedState {
    /// As it is stored otherwise.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Finished => "finished",
            Self::Failed => "failed",
            Self::Late => "late",
        }
    }

    /// From the word it is stored by.
    #[must_use]
    pub fn of(word: &str) -> Self {
        match word {
            "finished" => Self::Finished,
            "failed" => Self::Failed,
            _ => Self::Late,
        }
    }
}

/// A claim in columns, without them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FoldedClaim {
    /// `accepted`, `refused` or `unproven`.
    pub state: String,
    /// How many episodes.
    pub episodes: i64,
    /// Of these, lost to infrastructure.
    pub failed: i64,
}

impl FoldedLease {
    /// An episode by its index in the lease, with its group.
    #[must_use]
    pub fn episode(&self, number: i64) -> Option<(&FoldedGroup, &FoldedEpisode)> {
        let group = self.group(number / self.row.group_size.max(1))?;
        Some((group, group.episodes.iter().find(|episode| episode.number == number)?))
    }

    /// A group by its number.
    #[must_use]
    pub fn group(&self, number: i64) -> Option<&FoldedGroup> {
        self.groups.iter().find(|group| group.number == number)
    }

    /// Its reported episodes, in order.
    pub fn episodes(&self) -> impl Iterator<Item = (&FoldedGroup, &FoldedEpisode)> {
        self.groups.iter().flat_map(|group| group.episodes.iter().map(move |episode| (group, episode)))
    }
}

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
    let body = rmp_serde::to_vec(leases).map_err(|error| StoreError::unreadable("a fold", error))?;
    let body = pack(body);
    query!(
        "INSERT INTO folds (run, first, last, episodes, at, body) VALUES (?, ?, ?, ?, ?, ?)",
        run,
        first,
        last,
        episodes,
        at,
        body
    )
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
    let bodies = sqlx::query_scalar!(
        "SELECT body FROM folds WHERE run = ?1 AND first <= ?2 AND last >= ?2 ORDER BY first DESC",
        run,
        lease
    )
    .fetch_all(conn)
    .await?;
    let mut found = Vec::new();
    for body in bodies {
        found.extend(read(run, &body)?.into_iter().filter(|folded| folded.row.id == lease));
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
                last.groups.extend(lease.groups);
                last.groups.sort_by_key(|group| group.number);
                last.claim = last.claim.take().or(lease.claim);
            }
            None => joined.push(lease),
        }
    }
    joined
}

/// Folds that are read at a time.
const FOLDS: i64 = 2;

/// Folded leases of a run from a number on, in order, until they come to enough by this count.
///
/// # Errors
/// The database's, or a fold that cannot be read.
pub async fn from(
    conn: &mut SqliteConnection,
    run: &str,
    lease: i64,
    (enough, count): (i64, impl Fn(&FoldedLease) -> i64),
) -> Result<Vec<FoldedLease>, StoreError> {
    let (mut found, mut begin, mut after) = (Vec::<FoldedLease>::new(), i64::MIN, i64::MIN);
    loop {
        // Several may begin with the same lease: something of it was folded later.
        let rows = query!(
            "SELECT id, first, body FROM folds WHERE run = ? AND (first, id) > (?, ?) AND last >= ? ORDER BY first, id LIMIT ?",
            run,
            begin,
            after,
            lease,
            FOLDS
        )
        .fetch_all(&mut *conn)
        .await?;
        let Some(last) = rows.last() else { break };
        (begin, after) = (last.first, last.id);
        // Those of later rows come after what is before the first of them: a lease that ended late is in a row of its own.
        let settled = |folded: &&FoldedLease| folded.row.id < begin;
        for row in &rows {
            found.extend(read(run, &row.body)?.into_iter().filter(|folded| folded.row.id >= lease));
        }
        found = joined(found);
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
            "SELECT id, first, body FROM folds WHERE run = ? AND (first, id) > (?, ?) ORDER BY first, id LIMIT ?",
            run,
            after.0,
            after.1,
            FOLDS
        )
        .fetch_all(&mut *conn)
        .await?;
        let Some(last) = rows.last() else { return Ok(()) };
        after = (last.first, last.id);
        for row in &rows {
            read(run, &row.body)?.into_iter().for_each(&mut see);
        }
    }
}

fn read(run: &str, body: &[u8]) -> Result<Vec<FoldedLease>, StoreError> {
    let body = unpack("a fold", body)?;
    let mut leases: Vec<FoldedLease> =
        rmp_serde::from_slice(&body).map_err(|error| StoreError::unreadable("a fold", error))?;
    for lease in &mut leases {
        run.clone_into(&mut lease.row.run);
        lease.row.folded = 1;
    }
    Ok(leases)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lease(id: i64, numbers: &[i64]) -> FoldedLease {
        let row = LeaseRow {
            id,
            token: "aaaaaa".to_owned(),
            run: "run".to_owned(),
            purpose: "train".to_owned(),
            form: "groups".to_owned(),
            status: "done".to_owned(),
            groups: 8,
            group_size: 1,
            policy_version: 0,
            ttl_ms: 1000,
            created_at: 5,
            expires_at: 6,
            folded: 1,
            owner: None,
        };
        let group = |number: &i64| FoldedGroup {
            number: *number,
            task: "kessler/survival".to_owned(),
            level: Some(3),
            role: "frontier".to_owned(),
            layout: None,
            contested: true,
            episodes: vec![FoldedEpisode {
                number: *number,
                state: FoldedState::Finished,
                score: Some(0.5),
                skill: None,
                success: Some(true),
                policy_version: 1,
                after_ms: 7,
            }],
        };
        FoldedLease { row, groups: numbers.iter().map(group).collect(), claim: None }
    }

    async fn database() -> (tempfile::TempDir, SqliteConnection) {
        let folder = tempfile::tempdir().expect("a folder");
        let mut conn = crate::store::writer(&folder.path().join("db")).await.expect("a database");
        sqlx::query("INSERT INTO runs (id, name, seed, status, settings, created_at) VALUES ('run', '', 1, 'active', '{}', 0)")
            .execute(&mut conn)
            .await
            .expect("a run");
        (folder, conn)
    }

    /// Whatever was folded when: every episode is found once and in order, from wherever it is asked for, however few at a time.
    #[tokio::test]
    async fn folds_that_overlap_lose_nothing() {
        let (_folder, mut conn) = database().await;
        let folds: [&[FoldedLease]; 6] = [
            &[lease(1, &[0, 1, 2]), lease(2, &[0, 7]), lease(5, &[3])],
            &[lease(5, &[4, 5]), lease(6, &[0])],
            &[lease(5, &[6]), lease(9, &[1])],
            &[lease(3, &[0, 1, 2, 3])],
            &[lease(5, &[0]), lease(8, &[0, 1])],
            &[lease(9, &[0, 2]), lease(10, &[5])],
        ];
        for leases in folds {
            insert(&mut conn, "run", leases, 9).await.expect("it is stored");
        }
        let all = from(&mut conn, "run", 0, (i64::MAX, |_| 1)).await.expect("they are read");
        let numbers: Vec<(i64, Vec<i64>)> = all
            .iter()
            .map(|lease| (lease.row.id, lease.episodes().map(|(_, episode)| episode.number).collect()))
            .collect();
        assert_eq!(
            numbers,
            [
                (1, vec![0, 1, 2]),
                (2, vec![0, 7]),
                (3, vec![0, 1, 2, 3]),
                (5, vec![0, 3, 4, 5, 6]),
                (6, vec![0]),
                (8, vec![0, 1]),
                (9, vec![0, 1, 2]),
                (10, vec![5]),
            ]
        );
        for begin in 0..12 {
            for enough in 1..30 {
                let count = |lease: &FoldedLease| lease.episodes().count() as i64;
                let found = from(&mut conn, "run", begin, (enough, count)).await.expect("they are read");
                let wanted: Vec<&FoldedLease> = all.iter().filter(|lease| lease.row.id >= begin).collect();
                // As many as were asked for are as they should be; what follows them may not be there yet.
                let mut reached = 0;
                for (found, wanted) in found.iter().zip(&wanted) {
                    if reached >= enough {
                        break;
                    }
                    assert_eq!(found, *wanted, "from {begin}, {enough}");
                    reached += count(found);
                }
                assert!(
                    reached >= enough || found.len() == wanted.len(),
                    "from {begin}, {enough}: {reached}"
                );
            }
        }
        for wanted in &all {
            assert_eq!(
                get(&mut conn, "run", wanted.row.id).await.expect("it is read").as_ref(),
                Some(wanted)
            );
        }
        assert_eq!(get(&mut conn, "run", 4).await.expect("it is read"), None);
    }
}
