//! Looks whether the tokens by which connections came in are still worth something: a request shows its token each time, a
//! connection that lasts only once.

use std::sync::Arc;
use std::time::Duration;

use sqlx::SqlitePool;

use crate::clock::Clock;
use crate::sessions::{Credential, SessionManager};
use crate::store::tokens::{self, TokenState};
use crate::store::StoreError;

/// How often it looks.
const EVERY: Duration = Duration::from_secs(1);

/// Works until it is cut off.
pub async fn run(readers: SqlitePool, clock: Clock, sessions: Arc<SessionManager>) {
    loop {
        if let Err(error) = look(&readers, &clock, &sessions).await {
            tracing::warn!(error = %error, "Tokens of open connections could not be looked at; trying again soon.");
        }
        tokio::time::sleep(EVERY).await;
    }
}

async fn look(readers: &SqlitePool, clock: &Clock, sessions: &SessionManager) -> Result<(), StoreError> {
    let connections = sessions.connections();
    for credential in connections.active_credentials() {
        let mut conn = readers.acquire().await?;
        let Credential::Token(token) = credential else {
            if tokens::presence(&mut conn, clock.now()).await?.any {
                tracing::info!("There are tokens now: connections that came in without one are closed.");
                connections.close_connections(credential);
            }
            continue;
        };
        let state = tokens::get(&mut conn, token).await?.map(|row| row.state(clock.now()));
        if state != Some(TokenState::Valid) {
            let state = state.map_or("gone", TokenState::as_str);
            tracing::info!(token, state, "The connections that this token opened are closed.");
            connections.close_connections(credential);
        }
    }
    Ok(())
}
