//! What a fold holds, and how it is packed: heads, which are leases as they were, and apart from them a body, which is what their
//! groups and episodes came to.

use serde::{Deserialize, Serialize};

use super::super::StoreError;
use super::super::leases::LeaseRow;
use super::super::pack::{pack, unpack};

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

/// What a body has of a lease: all but its row.
#[derive(Serialize, Deserialize)]
struct Rest {
    groups: Vec<FoldedGroup>,
    claim: Option<FoldedClaim>,
}

/// The same, borrowed.
#[derive(Serialize)]
struct RestOf<'a> {
    groups: &'a [FoldedGroup],
    claim: &'a Option<FoldedClaim>,
}

/// Packs leases: heads, and body.
pub(super) fn packed(leases: &[FoldedLease]) -> Result<(Vec<u8>, Vec<u8>), StoreError> {
    let rows: Vec<&LeaseRow> = leases.iter().map(|lease| &lease.row).collect();
    let rests = leases.iter().map(|lease| RestOf { groups: &lease.groups, claim: &lease.claim });
    let rests: Vec<RestOf<'_>> = rests.collect();
    let written = |what: Result<Vec<u8>, rmp_serde::encode::Error>| {
        what.map(pack).map_err(|error| StoreError::unreadable("a fold", error))
    };
    Ok((written(rmp_serde::to_vec(&rows))?, written(rmp_serde::to_vec(&rests))?))
}

fn unpacked<T: for<'a> Deserialize<'a>>(blob: &[u8]) -> Result<T, StoreError> {
    let blob = unpack("a fold", blob)?;
    rmp_serde::from_slice(&blob).map_err(|error| StoreError::unreadable("a fold", error))
}

/// A fold's leases. Of one that was folded before there were heads the body has them.
pub(super) fn heads(
    run: &str,
    heads: Option<&[u8]>,
    body: Option<&[u8]>,
) -> Result<Vec<LeaseRow>, StoreError> {
    let rows = match heads {
        Some(heads) => unpacked(heads)?,
        None => whole(run, None, body)?.into_iter().map(|lease| lease.row).collect(),
    };
    Ok(of_run(run, rows))
}

/// A fold's leases, with what they came to.
pub(super) fn whole(
    run: &str,
    heads: Option<&[u8]>,
    body: Option<&[u8]>,
) -> Result<Vec<FoldedLease>, StoreError> {
    let body = body.ok_or_else(|| StoreError::unreadable("a fold", "it has no body"))?;
    let Some(heads) = heads else {
        let mut leases: Vec<FoldedLease> = unpacked(body)?;
        for lease in &mut leases {
            mark(run, &mut lease.row);
        }
        return Ok(leases);
    };
    let (rows, rests): (Vec<LeaseRow>, Vec<Rest>) = (unpacked(heads)?, unpacked(body)?);
    if rows.len() != rests.len() {
        return Err(StoreError::unreadable("a fold", "its heads are not those of its body"));
    }
    let leases = of_run(run, rows).into_iter().zip(rests);
    Ok(leases.map(|(row, Rest { groups, claim })| FoldedLease { row, groups, claim }).collect())
}

fn of_run(run: &str, mut rows: Vec<LeaseRow>) -> Vec<LeaseRow> {
    rows.iter_mut().for_each(|row| mark(run, row));
    rows
}

/// What is not packed with a lease, since all of a fold have it.
fn mark(run: &str, row: &mut LeaseRow) {
    run.clone_into(&mut row.run);
    row.folded = 1;
}
