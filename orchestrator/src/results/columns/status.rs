//! State of the claim of a lease of columns.

use sqlx::SqliteConnection;
use store::columns::{self, ClaimState, ColumnClaimRow};
use store::leases::LeaseRow;

use crate::engine::error::ServiceError;
use crate::results::columns::table::{Columns, decode};

/// A claim and its audit.
#[derive(Debug, Clone, PartialEq)]
pub struct ClaimStatus {
    /// Row of the claim.
    pub claim: ColumnClaimRow,
    /// Row of the lease; logs are due until it expires.
    pub lease: LeaseRow,
    /// Audited episodes, by index in the lease.
    pub audited: Vec<i64>,
}

/// Stored columns and the state of their claim.
#[derive(Debug)]
pub struct ClaimedColumns {
    /// State of the claim.
    pub state: ClaimState,
    /// Columns of the claim.
    pub columns: Columns,
}

/// Returns the claim of a lease; `None` if no columns were sent.
///
/// # Errors
/// Returns an error of the store if a statement fails.
pub async fn claim_status(
    conn: &mut SqliteConnection,
    lease: LeaseRow,
) -> Result<Option<ClaimStatus>, ServiceError> {
    match columns::claim(conn, lease.id).await? {
        Some(claim) => claim_status_of(conn, lease, claim).await.map(Some),
        None => Ok(None),
    }
}

/// True if columns were sent for a lease.
pub(crate) async fn is_claimed(conn: &mut SqliteConnection, lease: i64) -> Result<bool, ServiceError> {
    Ok(columns::claim(conn, lease).await?.is_some())
}

/// Returns the columns of a lease with the state of their claim; `None` if no columns were sent.
///
/// # Errors
/// Returns an error of the store if a statement fails or the stored columns are unreadable.
pub async fn claimed_columns(
    conn: &mut SqliteConnection,
    lease: i64,
) -> Result<Option<ClaimedColumns>, ServiceError> {
    let Some(claim) = columns::claim(conn, lease).await? else { return Ok(None) };
    let body = columns::body(conn, lease).await?.unwrap_or_default();
    Ok(Some(ClaimedColumns { state: claim.state, columns: decode(&body)? }))
}

/// Adds the audited episodes to a claim.
pub(crate) async fn claim_status_of(
    conn: &mut SqliteConnection,
    lease: LeaseRow,
    claim: ColumnClaimRow,
) -> Result<ClaimStatus, ServiceError> {
    let audited = columns::audited(conn, lease.id).await?;
    Ok(ClaimStatus { claim, lease, audited })
}
