//! Contents of a row of compacted leases, and their packing: lease rows (the leases themselves), and apart from them a body (their
//! groups and episodes).

use serde::{Deserialize, Serialize};

use super::super::StoreError;
use super::super::columns::ClaimState;
use super::super::episodes::EpisodeState;
use super::super::groups::GroupRole;
use super::super::leases::LeaseRow;
use super::super::pack::{pack, unpack};

/// A lease that was compacted.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CompactedLease {
    /// The lease as it was.
    pub row: LeaseRow,
    /// Groups that were compacted. Groups that something still refers to are missing.
    pub groups: Vec<CompactedGroup>,
    /// Claim of the lease's columns, if there was one.
    pub claim: Option<CompactedClaim>,
}

/// A group of a compacted lease.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CompactedGroup {
    /// Number of the group in the lease.
    pub number: i64,
    /// Task of the group.
    pub task: String,
    /// Level of the group; none for strategies without levels.
    pub level: Option<i64>,
    /// Role of the group.
    pub role: GroupRole,
    /// Number of the designed layout, if the group has one.
    pub layout: Option<i64>,
    /// True if the scenario was contested.
    pub contested: bool,
    /// Reported episodes, in order.
    pub episodes: Vec<CompactedEpisode>,
}

/// Result of an episode of a compacted lease.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CompactedEpisode {
    /// Index of the episode in the lease.
    pub number: i64,
    /// State of the episode.
    pub state: EpisodeState,
    /// Score that the world computed.
    pub score: Option<f64>,
    /// Skill, if the scenario defines one.
    pub skill: Option<f64>,
    /// True if the episode is a success.
    pub success: Option<bool>,
    /// Version of the policy that ran the episode.
    pub policy_version: i64,
    /// When the result was reported, milliseconds after the lease was granted.
    pub after_ms: i64,
}

/// A claim of columns, without the columns.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CompactedClaim {
    /// State of the claim, never `Claimed`.
    pub state: ClaimState,
    /// Number of claimed episodes.
    pub episodes: i64,
    /// Claimed episodes that the infrastructure lost.
    pub failed: i64,
}

impl CompactedLease {
    /// Finds an episode by its index in the lease, with its group.
    #[must_use]
    pub fn episode(&self, number: i64) -> Option<(&CompactedGroup, &CompactedEpisode)> {
        let group = self.group(number / self.row.group_size.max(1))?;
        Some((group, group.episodes.iter().find(|episode| episode.number == number)?))
    }

    /// Finds a group by its number in the lease.
    #[must_use]
    pub fn group(&self, number: i64) -> Option<&CompactedGroup> {
        self.groups.iter().find(|group| group.number == number)
    }

    /// Reported episodes with their groups, in order.
    pub fn episodes(&self) -> impl Iterator<Item = (&CompactedGroup, &CompactedEpisode)> {
        self.groups.iter().flat_map(|group| group.episodes.iter().map(move |episode| (group, episode)))
    }
}

/// A lease in the body of a row: all but its head.
#[derive(Serialize, Deserialize)]
struct LeaseBody {
    groups: Vec<CompactedGroup>,
    claim: Option<CompactedClaim>,
}

/// Borrowed form of [`LeaseBody`].
#[derive(Serialize)]
struct LeaseBodyRef<'a> {
    groups: &'a [CompactedGroup],
    claim: &'a Option<CompactedClaim>,
}

/// Heads and body of a row, packed.
pub struct PackedLeases {
    /// Content of the `lease_rows` column.
    pub lease_rows: Vec<u8>,
    /// Content of the `body` column.
    pub body: Vec<u8>,
}

/// Packs leases into the columns of a row.
pub fn pack_leases(leases: &[CompactedLease]) -> Result<PackedLeases, StoreError> {
    let rows: Vec<&LeaseRow> = leases.iter().map(|lease| &lease.row).collect();
    let bodies = leases.iter().map(|lease| LeaseBodyRef { groups: &lease.groups, claim: &lease.claim });
    let bodies: Vec<LeaseBodyRef<'_>> = bodies.collect();
    let packed = |encoded: Result<Vec<u8>, rmp_serde::encode::Error>| {
        encoded.map(pack).map_err(|error| StoreError::corrupt(ITEM, error))
    };
    Ok(PackedLeases {
        lease_rows: packed(rmp_serde::to_vec(&rows))?,
        body: packed(rmp_serde::to_vec(&bodies))?,
    })
}

/// Name of a row in error messages.
const ITEM: &str = "a row of compacted leases";

/// Unpacks the lease rows.
pub(super) fn unpack_lease_rows(run: &str, lease_rows: &[u8]) -> Result<Vec<LeaseRow>, StoreError> {
    let mut rows: Vec<LeaseRow> = decode(lease_rows)?;
    rows.iter_mut().for_each(|row| complete(run, row));
    Ok(rows)
}

/// Unpacks the leases of a row.
pub fn unpack_leases(run: &str, lease_rows: &[u8], body: &[u8]) -> Result<Vec<CompactedLease>, StoreError> {
    let rows = unpack_lease_rows(run, lease_rows)?;
    let bodies: Vec<LeaseBody> = decode(body)?;
    if rows.len() != bodies.len() {
        return Err(StoreError::corrupt(ITEM, "its lease_rows do not match its body"));
    }
    let leases = rows.into_iter().zip(bodies);
    Ok(leases.map(|(row, LeaseBody { groups, claim })| CompactedLease { row, groups, claim }).collect())
}

fn decode<T: for<'a> Deserialize<'a>>(blob: &[u8]) -> Result<T, StoreError> {
    let blob = unpack(ITEM, blob)?;
    rmp_serde::from_slice(&blob).map_err(|error| StoreError::corrupt(ITEM, error))
}

/// Sets the fields that are not packed, since they are the same for all leases of a row.
fn complete(run: &str, row: &mut LeaseRow) {
    run.clone_into(&mut row.run);
    row.is_compacted = true;
}
