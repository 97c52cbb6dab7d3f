//! Looks whether the tokens by which connections came in are still worth something: a request shows its token each time, a
//! connection that lasts only once.

use std::sync::Arc;
use std::time::Duration;

use sqlx::SqlitePool;

use crate::clock::Clock;
use crate::sessions::Sessions;
use crate::store::{StoreError, tokens};

/// How often it looks.
const EVERY: Duration = Duration::from_secs(1);

/// Works until it is cut off.
pub async fn run(readers: SqlitePool, clock: Clock, sessions: Arc<Sessions>) {
    loop {
        if let Err(error) = look(&readers, &clock, &sessions).await {
            tracing::warn!(error = %error, "Tokens of open connections could not be looked at; trying again soon.");
        }
        tokio::time::sleep(EVERY).await;
    }
}

async fn look(readers: &SqlitePool, clock: &Clock, sessions: &Sessions) -> Result<(), StoreError> {
    let passes = sessions.passes();
    for pass in passes.held() {
        let mut conn = readers.acquire().await?;
        let Some(token) = pass else {
            if tokens::any(&mut conn, clock.now()).await?.0 {
                tracing::info!("There are tokens now: connections that came in without one are closed.");
                passes.end(None);
            }
            continue;
        };
        let state = tokens::get(&mut conn, token).await?.map_or("gone", |row| row.state(clock.now()));
        if state != "valid" {
            tracing::info!(token, state, "The connections that this token opened are closed.");
            passes.end(pass);
        }
    }
    Ok(())
}
