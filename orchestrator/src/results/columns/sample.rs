//! The audit sample of a lease, as groups of the lease.

use sqlx::SqliteConnection;
use store::audit_samples::{self, SampledGroupRow};
use store::columns::{self, SeedRangeRow};
use store::groups::GroupRow;
use store::leases::LeaseRow;

use crate::engine::error::ServiceError;
use crate::results::columns::table::Columns;

/// Score that a client claims for an episode.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ClaimedScore {
    /// Index of the episode in the lease.
    pub(crate) episode: i64,
    pub(crate) score: f32,
}

/// Returns the claimed scores of the episodes of a group that are claimed to have finished.
pub(crate) fn claimed_scores(
    columns: &Columns,
    group: i64,
    group_size: usize,
) -> impl Iterator<Item = ClaimedScore> {
    let first = usize::try_from(group).unwrap_or_default() * group_size;
    let entries = (first..first + group_size).filter(|at| !columns.has_failed(*at));
    entries.map(|at| ClaimedScore { episode: at as i64, score: columns.scores[at] })
}

/// Builds the row of a sampled group, without results.
pub(super) fn sampled_row(range: &SeedRangeRow, sampled: SampledGroupRow, is_evidence: bool) -> GroupRow {
    GroupRow {
        proposal: Some(range.proposal),
        level: range.level,
        is_contested: sampled.is_contested,
        is_evidence,
        is_slot: sampled.is_slot,
        is_for_training: true,
        ..GroupRow::open(sampled.number, range.role, range.task.clone(), sampled.scenario)
    }
}

/// Takes the audit sample of a lease out of the secret table, as rows of groups without results.
pub(crate) async fn take_sample(
    conn: &mut SqliteConnection,
    lease: &LeaseRow,
    is_evidence: bool,
) -> Result<Vec<GroupRow>, ServiceError> {
    let sample = audit_samples::of_lease(conn, lease.id).await?;
    audit_samples::delete(conn, lease.id).await?;
    let ranges = columns::ranges(conn, lease.id).await?;
    let row = |sampled: SampledGroupRow| {
        let range = ranges.iter().find(|range| range.holds(sampled.number))?;
        Some(sampled_row(range, sampled, is_evidence))
    };
    Ok(sample.into_iter().filter_map(row).collect())
}
