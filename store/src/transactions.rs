//! Statements that begin and end transactions.
//!
//! The writer applies a batch of changes in one transaction, and each change in a savepoint. A statement that begins or ends a
//! savepoint also carries its neighbour, because each statement costs a switch between two threads.

use sqlx::{Connection, Sqlite, SqliteConnection, Transaction, query};

use super::StoreError;

/// Begins a transaction that may write from the start. It is rolled back if it is dropped without a commit.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails, for example because another connection writes.
pub async fn begin_write(conn: &mut SqliteConnection) -> Result<Transaction<'_, Sqlite>, StoreError> {
    Ok(conn.begin_with("BEGIN IMMEDIATE").await?)
}

/// Lets statements of this connection fail after 20 ms if another process holds the lock that they need.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn wait_briefly_for_locks(conn: &mut SqliteConnection) -> Result<(), StoreError> {
    execute(conn, "PRAGMA busy_timeout = 20").await
}

/// Begins a batch, and its first change.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn begin_batch(conn: &mut SqliteConnection) -> Result<(), StoreError> {
    execute(conn, "BEGIN IMMEDIATE; SAVEPOINT change").await
}

/// Ends the change before, and begins the next one.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn begin_next_change(conn: &mut SqliteConnection) -> Result<(), StoreError> {
    execute(conn, "RELEASE change; SAVEPOINT change").await
}

/// Undoes what the current change has written.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails: on a full disk SQLite may have rolled back the whole transaction.
pub async fn undo_change(conn: &mut SqliteConnection) -> Result<(), StoreError> {
    execute(conn, "ROLLBACK TO change").await
}

/// Ends the last change, and commits the batch.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn commit_batch(conn: &mut SqliteConnection) -> Result<(), StoreError> {
    execute(conn, "RELEASE change; COMMIT").await
}

/// Rolls the whole batch back.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails, for example because SQLite has rolled back by itself.
pub async fn roll_back_batch(conn: &mut SqliteConnection) -> Result<(), StoreError> {
    execute(conn, "ROLLBACK").await
}

async fn execute(conn: &mut SqliteConnection, statement: &'static str) -> Result<(), StoreError> {
    query(statement).execute(conn).await?;
    Ok(())
}
