//! Principals: the named owners of tokens, runs, leases and evaluations. Tables `principals` and `run_members`.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};
use sqlx::{SqliteConnection, query};

use super::StoreError;

/// Number of a principal. A token that replaces another one has the same principal, and so keeps its access.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, sqlx::Type)]
#[serde(transparent)]
#[sqlx(transparent)]
pub struct PrincipalId(pub i64);

impl PrincipalId {
    /// The server itself, which owns the leases of its workers and sessions. No token has this principal.
    pub const SERVER: Self = Self(0);
}

/// Relation of a principal to a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunRelation {
    /// Owner of the run; `None` if it was created without authentication.
    pub owner: Option<PrincipalId>,
    /// Name of the owner.
    pub owner_name: Option<String>,
    /// True if the principal is in the list of the run's members.
    pub is_listed: bool,
}

/// Returns the number of the principal with this name, and creates the principal if there is none.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn get_or_insert(conn: &mut SqliteConnection, name: &str) -> Result<PrincipalId, StoreError> {
    query!("INSERT INTO principals (name) VALUES (?) ON CONFLICT (name) DO NOTHING", name)
        .execute(&mut *conn)
        .await?;
    let id = sqlx::query_scalar!(r#"SELECT id AS "id: PrincipalId" FROM principals WHERE name = ?"#, name);
    Ok(id.fetch_one(conn).await?)
}

/// Finds a principal by its name.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn find(conn: &mut SqliteConnection, name: &str) -> Result<Option<PrincipalId>, StoreError> {
    let id = sqlx::query_scalar!(r#"SELECT id AS "id: PrincipalId" FROM principals WHERE name = ?"#, name);
    Ok(id.fetch_optional(conn).await?)
}

/// Reads the relation of a principal to a run; `None` if the run does not exist.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn relation(
    conn: &mut SqliteConnection,
    run: &str,
    principal: PrincipalId,
) -> Result<Option<RunRelation>, StoreError> {
    Ok(sqlx::query_as!(
        RunRelation,
        r#"SELECT owner AS "owner: PrincipalId", (SELECT name FROM principals WHERE id = r.owner) AS "owner_name: String",
                  EXISTS (SELECT 1 FROM run_members WHERE run = r.id AND principal = ?) AS "is_listed!: bool"
           FROM runs r WHERE r.id = ? AND r.deleted_at IS NULL"#,
        principal,
        run
    )
    .fetch_optional(conn)
    .await?)
}

/// Replaces the members of a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn replace_members(
    conn: &mut SqliteConnection,
    run: &str,
    members: &BTreeSet<PrincipalId>,
) -> Result<(), StoreError> {
    query!("DELETE FROM run_members WHERE run = ?", run).execute(&mut *conn).await?;
    for member in members {
        query!("INSERT INTO run_members (run, principal) VALUES (?, ?)", run, member)
            .execute(&mut *conn)
            .await?;
    }
    Ok(())
}

/// Sets the owner of a run.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn set_owner(conn: &mut SqliteConnection, run: &str, owner: PrincipalId) -> Result<(), StoreError> {
    query!("UPDATE runs SET owner = ? WHERE id = ?", owner, run).execute(conn).await?;
    Ok(())
}

/// Counts the runs that a principal owns.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn count_runs(conn: &mut SqliteConnection, owner: PrincipalId) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT count(*) AS "n!: i64" FROM runs WHERE owner = ? AND deleted_at IS NULL"#,
        owner
    )
    .fetch_one(conn)
    .await?)
}

/// Counts the active leases of a principal.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn count_leases(conn: &mut SqliteConnection, owner: PrincipalId) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT count(*) AS "n!: i64" FROM leases INDEXED BY leases_of_owner WHERE owner = ? AND status = 'active'"#,
        owner
    )
    .fetch_one(conn)
    .await?)
}
