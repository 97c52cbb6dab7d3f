//! Tokens, and what was done with them.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::clock::Millis;

/// A token as stored.
#[derive(Debug, Clone)]
pub struct TokenRow {
    /// Its number.
    pub id: i64,
    /// Its name, for people.
    pub name: String,
    /// `viewer`, `trainer` or `admin`.
    pub role: String,
    /// Of the token.
    pub hash: Vec<u8>,
    /// When it was made.
    pub created_at: Millis,
    /// From when on it is worth nothing; none: never.
    pub expires_at: Option<Millis>,
    /// When it was revoked.
    pub revoked_at: Option<Millis>,
    /// When it was used last, to some minutes.
    pub used_at: Option<Millis>,
}

impl TokenRow {
    /// `valid`, `expired` or `revoked`.
    #[must_use]
    pub fn state(&self, now: Millis) -> &'static str {
        match self {
            Self { revoked_at: Some(_), .. } => "revoked",
            Self { expires_at: Some(at), .. } if *at <= now => "expired",
            _ => "valid",
        }
    }
}

/// Stores a new token without its hash, which needs its number; the number.
///
/// # Errors
/// The database's.
pub async fn insert(
    conn: &mut SqliteConnection,
    (name, role): (&str, &str),
    now: Millis,
    expires_at: Option<Millis>,
) -> Result<i64, StoreError> {
    let done = query!(
        "INSERT INTO tokens (name, role, hash, created_at, expires_at) VALUES (?, ?, x'', ?, ?)",
        name,
        role,
        now,
        expires_at
    )
    .execute(conn)
    .await?;
    Ok(done.last_insert_rowid())
}

/// Sets the hash of a token.
///
/// # Errors
/// The database's.
pub async fn set_hash(conn: &mut SqliteConnection, id: i64, hash: &[u8]) -> Result<(), StoreError> {
    query!("UPDATE tokens SET hash = ? WHERE id = ?", hash, id).execute(conn).await?;
    Ok(())
}

/// A token by its number.
///
/// # Errors
/// The database's.
pub async fn get(conn: &mut SqliteConnection, id: i64) -> Result<Option<TokenRow>, StoreError> {
    Ok(sqlx::query_as!(
        TokenRow,
        "SELECT id, name, role, hash, created_at, expires_at, revoked_at, used_at FROM tokens WHERE id = ?",
        id
    )
    .fetch_optional(conn)
    .await?)
}

/// All tokens, the oldest first.
///
/// # Errors
/// The database's.
pub async fn all(conn: &mut SqliteConnection) -> Result<Vec<TokenRow>, StoreError> {
    Ok(sqlx::query_as!(
        TokenRow,
        "SELECT id, name, role, hash, created_at, expires_at, revoked_at, used_at FROM tokens ORDER BY id"
    )
    .fetch_all(conn)
    .await?)
}

/// Whether there are tokens, whatever became of them, and whether one is valid.
///
/// # Errors
/// The database's.
pub async fn any(conn: &mut SqliteConnection, now: Millis) -> Result<(bool, bool), StoreError> {
    let row = query!(
        r#"SELECT EXISTS (SELECT 1 FROM tokens) AS "any!: bool",
                  EXISTS (SELECT 1 FROM tokens WHERE revoked_at IS NULL AND (expires_at IS NULL OR expires_at > ?))
                      AS "valid!: bool""#,
        now
    )
    .fetch_one(conn)
    .await?;
    Ok((row.any, row.valid))
}

/// Revokes a token; whether there is such a one that was not revoked yet.
///
/// # Errors
/// The database's.
pub async fn revoke(conn: &mut SqliteConnection, id: i64, now: Millis) -> Result<bool, StoreError> {
    let done = query!("UPDATE tokens SET revoked_at = ? WHERE id = ? AND revoked_at IS NULL", now, id)
        .execute(conn)
        .await?;
    Ok(done.rows_affected() == 1)
}

/// Notes that a token was used.
///
/// # Errors
/// The database's.
pub async fn used(conn: &mut SqliteConnection, id: i64, now: Millis) -> Result<(), StoreError> {
    query!("UPDATE tokens SET used_at = ? WHERE id = ?", now, id).execute(conn).await?;
    Ok(())
}

/// How many runs a token created.
///
/// # Errors
/// The database's.
pub async fn runs(conn: &mut SqliteConnection, id: i64) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(r#"SELECT count(*) AS "n!: i64" FROM runs WHERE owner = ?"#, id)
        .fetch_one(conn)
        .await?)
}

/// How many active leases a token has.
///
/// # Errors
/// The database's.
pub async fn leases(conn: &mut SqliteConnection, id: i64) -> Result<i64, StoreError> {
    Ok(sqlx::query_scalar!(
        r#"SELECT count(*) AS "n!: i64" FROM leases INDEXED BY leases_of_owner WHERE owner = ? AND status = 'active'"#,
        id
    )
    .fetch_one(conn)
    .await?)
}

/// Something that was changed by hand, or refused.
#[derive(Debug, Clone)]
pub struct AuditRow {
    /// Its number.
    pub id: i64,
    /// When.
    pub at: Millis,
    /// Whose token; none: anonymous.
    pub token: Option<i64>,
    /// The name of that.
    pub name: Option<String>,
    /// Where it came from.
    pub address: Option<String>,
    /// The operation, as the API's document names it.
    pub operation: String,
    /// The path that was asked for.
    pub path: String,
    /// The HTTP status it was answered with.
    pub status: i64,
    /// The request's id.
    pub request_id: String,
}

/// Lines of the audit log that are kept.
const AUDITED: i64 = 100_000;
/// Lines about who was kept out that are.
const DENIED: i64 = 20_000;

/// Writes a line of the audit log, and forgets those past its ring.
///
/// # Errors
/// The database's.
pub async fn audit(conn: &mut SqliteConnection, row: &AuditRow) -> Result<(), StoreError> {
    query!(
        "INSERT INTO audit_log (at, token, address, operation, path, status, request_id) VALUES (?, ?, ?, ?, ?, ?, ?)",
        row.at,
        row.token,
        row.address,
        row.operation,
        row.path,
        row.status,
        row.request_id
    )
    .execute(&mut *conn)
    .await?;
    query!("DELETE FROM audit_log WHERE id <= (SELECT max(id) FROM audit_log) - ?", AUDITED)
        .execute(conn)
        .await?;
    Ok(())
}

/// Writes a line about somebody who was kept out, and forgets those past its ring.
///
/// # Errors
/// The database's.
pub async fn deny(conn: &mut SqliteConnection, row: &AuditRow) -> Result<(), StoreError> {
    query!(
        "INSERT INTO denials (at, token, address, operation, path, status, request_id) VALUES (?, ?, ?, ?, ?, ?, ?)",
        row.at,
        row.token,
        row.address,
        row.operation,
        row.path,
        row.status,
        row.request_id
    )
    .execute(&mut *conn)
    .await?;
    query!("DELETE FROM denials WHERE id <= (SELECT max(id) FROM denials) - ?", DENIED).execute(conn).await?;
    Ok(())
}

/// The audit log, the newest first, before a number.
///
/// # Errors
/// The database's.
pub async fn audited(
    conn: &mut SqliteConnection,
    before: i64,
    limit: i64,
) -> Result<Vec<AuditRow>, StoreError> {
    Ok(sqlx::query_as!(
        AuditRow,
        r#"SELECT a.id, a.at, a.token, t.name AS "name?", a.address, a.operation, a.path, a.status, a.request_id
           FROM audit_log a LEFT JOIN tokens t ON t.id = a.token WHERE a.id < ? ORDER BY a.id DESC LIMIT ?"#,
        before,
        limit
    )
    .fetch_all(conn)
    .await?)
}

/// Who was kept out, the newest first, before a number.
///
/// # Errors
/// The database's.
pub async fn denied(
    conn: &mut SqliteConnection,
    before: i64,
    limit: i64,
) -> Result<Vec<AuditRow>, StoreError> {
    Ok(sqlx::query_as!(
        AuditRow,
        r#"SELECT a.id, a.at, a.token, t.name AS "name?", a.address, a.operation, a.path, a.status, a.request_id
           FROM denials a LEFT JOIN tokens t ON t.id = a.token WHERE a.id < ? ORDER BY a.id DESC LIMIT ?"#,
        before,
        limit
    )
    .fetch_all(conn)
    .await?)
}
