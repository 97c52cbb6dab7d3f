//! Closes connections whose token expired or was revoked. A request shows its token each time; a long-lived connection shows it
//! only once.

use std::sync::Arc;
use std::time::Duration;

use sqlx::SqlitePool;
use store::StoreError;
use store::tokens::{self, TokenState};

use crate::sessions::{Credential, SessionManager};
use clock::Clock;

/// Interval between two checks.
const POLL_INTERVAL: Duration = Duration::from_secs(1);

/// Runs until the task is aborted.
pub(super) async fn run(readers: SqlitePool, clock: Clock, sessions: Arc<SessionManager>) {
    loop {
        if let Err(error) = close_revoked(&readers, &clock, &sessions).await {
            tracing::warn!(error = %error, "Tokens of open connections could not be checked; the server retries.");
        }
        tokio::time::sleep(POLL_INTERVAL).await;
    }
}

/// Closes the connections of each credential that is no longer valid.
async fn close_revoked(
    readers: &SqlitePool,
    clock: &Clock,
    sessions: &SessionManager,
) -> Result<(), StoreError> {
    let connections = sessions.connections();
    for credential in connections.active_credentials() {
        let mut conn = readers.acquire().await?;
        let Credential::Token(token) = credential else {
            if tokens::presence(&mut conn, clock.now()).await?.any {
                tracing::info!("A token was created; connections without a token are closed.");
                connections.close_connections(credential);
            }
            continue;
        };
        let state = tokens::get(&mut conn, token).await?.map(|row| row.state(clock.now()));
        if state != Some(TokenState::Valid) {
            let state = state.map_or("gone", TokenState::as_str);
            tracing::info!(token, state, "A token is no longer valid; its connections are closed.");
            connections.close_connections(credential);
        }
    }
    Ok(())
}
