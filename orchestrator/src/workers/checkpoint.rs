//! Folds the write-ahead log into the database, so that the writer, and whoever waits for it, need not.

use std::time::Duration;

use sqlx::{Connection, SqliteConnection};
use tokio::sync::watch;

use crate::store;

/// How often.
const EVERY: Duration = Duration::from_millis(500);

/// Works until the server stops; then closes its connection, so that whoever closes the last one folds the rest.
pub async fn run(mut connection: SqliteConnection, mut stopped: watch::Receiver<bool>) {
    let mut failing = false;
    while tokio::time::timeout(EVERY, stopped.wait_for(|stop| *stop)).await.is_err() {
        match store::checkpoint(&mut connection).await {
            Err(error) if !failing => {
                failing = true; // told of once: it is tried twice a second
                tracing::warn!(error = %error, "The write-ahead log could not be folded in; trying again until it can.");
            }
            Err(_) => {}
            Ok(()) if failing => {
                failing = false;
                tracing::info!("The write-ahead log is folded in again.");
            }
            Ok(()) => {}
        }
    }
    if let Err(error) = connection.close().await {
        tracing::warn!(error = %error, "A connection to the database did not close cleanly.");
    }
}
