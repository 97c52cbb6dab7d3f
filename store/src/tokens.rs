//! Access tokens. Table `tokens`.

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::Millis;
use crate::principals::PrincipalId;
use crate::role::Role;

/// Row of the `tokens` table.
#[derive(Debug, Clone)]
pub struct TokenRow {
    /// Number of the token, from 1.
    pub id: i64,
    /// Name that is displayed.
    pub name: String,
    /// Number of the principal that the token acts for.
    pub principal: PrincipalId,
    /// Name of the principal.
    pub principal_name: String,
    /// Role that limits what the token may do.
    pub role: Role,
    /// Hash of the token; empty before it is set.
    pub hash: Vec<u8>,
    /// When the token was created.
    pub created_at: Millis,
    /// When the token expires; none for never.
    pub expires_at: Option<Millis>,
    /// When the token was revoked.
    pub revoked_at: Option<Millis>,
    /// When the token was used last, to about ten minutes.
    pub used_at: Option<Millis>,
}

/// State of a token: only valid tokens are accepted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TokenState {
    /// The token is accepted.
    Valid,
    /// The token has expired.
    Expired,
    /// The token was revoked.
    Revoked,
}

impl TokenState {
    /// The word that lists and logs show.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Valid => "valid",
            Self::Expired => "expired",
            Self::Revoked => "revoked",
        }
    }
}

impl TokenRow {
    /// State of the token at the time `now`.
    #[must_use]
    pub const fn state(&self, now: Millis) -> TokenState {
        match self {
            Self { revoked_at: Some(_), .. } => TokenState::Revoked,
            Self { expires_at: Some(at), .. } if *at <= now => TokenState::Expired,
            _ => TokenState::Valid,
        }
    }
}

/// A token to be stored.
#[derive(Debug, Clone, Copy)]
pub struct NewToken<'a> {
    /// Name that is displayed.
    pub name: &'a str,
    /// Principal that the token acts for.
    pub principal: PrincipalId,
    /// Role that limits what the token may do.
    pub role: Role,
    /// When the token expires; none for never.
    pub expires_at: Option<Millis>,
}

/// Stores a token without its hash, which depends on its number. Returns the number.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn insert(conn: &mut SqliteConnection, new: &NewToken<'_>, now: Millis) -> Result<i64, StoreError> {
    let done = query!(
        "INSERT INTO tokens (name, principal, role, hash, created_at, expires_at) VALUES (?, ?, ?, x'', ?, ?)",
        new.name,
        new.principal,
        new.role,
        now,
        new.expires_at
    )
    .execute(conn)
    .await?;
    Ok(done.last_insert_rowid())
}

/// Stores a token that the database of another shard created, with its number and its hash. Returns false if the number is taken.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn insert_known(
    conn: &mut SqliteConnection,
    id: i64,
    new: &NewToken<'_>,
    hash: &[u8],
    now: Millis,
) -> Result<bool, StoreError> {
    let done = query!(
        "INSERT INTO tokens (id, name, principal, role, hash, created_at, expires_at) VALUES (?, ?, ?, ?, ?, ?, ?)
         ON CONFLICT (id) DO NOTHING",
        id,
        new.name,
        new.principal,
        new.role,
        hash,
        now,
        new.expires_at
    )
    .execute(conn)
    .await?;
    Ok(done.rows_affected() > 0)
}

/// Sets the hash of a token.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn set_hash(conn: &mut SqliteConnection, id: i64, hash: &[u8]) -> Result<(), StoreError> {
    query!("UPDATE tokens SET hash = ? WHERE id = ?", hash, id).execute(conn).await?;
    Ok(())
}

/// Selects [`TokenRow`]s: takes what follows `FROM tokens t` and the arguments of the statement.
macro_rules! query_tokens {
    ($rest:literal $(, $argument:expr)* $(,)?) => {
        sqlx::query_as!(
            TokenRow,
            r#"SELECT t.id, t.name, t.principal AS "principal!: PrincipalId", p.name AS "principal_name!",
                      t.role AS "role: Role", t.hash, t.created_at, t.expires_at, t.revoked_at, t.used_at
               FROM tokens t CROSS JOIN principals p ON p.id = t.principal "# + $rest
            $(, $argument)*
        )
    };
}

/// Reads a token by its number.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn get(conn: &mut SqliteConnection, id: i64) -> Result<Option<TokenRow>, StoreError> {
    Ok(query_tokens!("WHERE t.id = ?", id).fetch_optional(conn).await?)
}

/// Reads all tokens, oldest first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn all(conn: &mut SqliteConnection) -> Result<Vec<TokenRow>, StoreError> {
    Ok(query_tokens!("ORDER BY t.id").fetch_all(conn).await?)
}

/// Answer to the question whether a database has tokens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TokenPresence {
    /// True if there is a token, valid or not.
    pub any: bool,
    /// True if there is a valid token.
    pub valid: bool,
}

/// Reads whether there are tokens, and whether one is valid at `now`.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn presence(conn: &mut SqliteConnection, now: Millis) -> Result<TokenPresence, StoreError> {
    Ok(sqlx::query_as!(
        TokenPresence,
        r#"SELECT EXISTS (SELECT 1 FROM tokens) AS "any!: bool",
                  EXISTS (SELECT 1 FROM tokens WHERE revoked_at IS NULL AND (expires_at IS NULL OR expires_at > ?))
                      AS "valid!: bool""#,
        now
    )
    .fetch_one(conn)
    .await?)
}

/// Revokes a token. Returns true if it existed and was not revoked yet.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn revoke(conn: &mut SqliteConnection, id: i64, now: Millis) -> Result<bool, StoreError> {
    let done = query!("UPDATE tokens SET revoked_at = ? WHERE id = ? AND revoked_at IS NULL", now, id)
        .execute(conn)
        .await?;
    Ok(done.rows_affected() == 1)
}

/// Sets when a token was used last.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn set_used(conn: &mut SqliteConnection, id: i64, now: Millis) -> Result<(), StoreError> {
    query!("UPDATE tokens SET used_at = ? WHERE id = ?", now, id).execute(conn).await?;
    Ok(())
}
