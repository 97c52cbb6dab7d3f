//! Planning for a request: a few at a time, off the threads that answer others, and no longer than somebody waits for it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use tokio::sync::Semaphore;

use super::problem::Problem;

/// Longest wait for a turn.
const PATIENCE: Duration = Duration::from_secs(10);

/// Turns at planning.
#[derive(Debug, Clone)]
pub struct Planning {
    turns: Arc<Semaphore>,
    patience: Duration,
}

impl Default for Planning {
    /// All cores but one: planning takes whole cores, and trainers wait for answers.
    fn default() -> Self {
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        Self { turns: Arc::new(Semaphore::new(cores.saturating_sub(1).max(1))), patience: PATIENCE }
    }
}

/// Says that nobody waits any more once it is dropped: the request was answered, cut off, or its client has gone.
struct Waiting(Arc<AtomicBool>);

impl Drop for Waiting {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Relaxed);
    }
}

impl Planning {
    /// Does `work` when there is a turn, and answers with what it gives; `work` is told how to ask whether it is still
    /// wanted. The turn is kept until the work has really ended.
    ///
    /// # Errors
    /// No turn for too long; or the work panicked.
    pub(super) async fn plan<T: Send + 'static>(
        &self,
        work: impl FnOnce(&dyn Fn() -> bool) -> T + Send + 'static,
    ) -> Result<T, Problem> {
        let turn = tokio::time::timeout(self.patience, Arc::clone(&self.turns).acquire_owned()).await;
        let Ok(Ok(turn)) = turn else { return Err(Problem::busy_planning()) };
        let wanted = Arc::new(AtomicBool::new(true));
        let waiting = Waiting(Arc::clone(&wanted));
        let done = tokio::task::spawn_blocking(move || {
            let _turn = turn;
            work(&|| wanted.load(Ordering::Relaxed))
        })
        .await;
        drop(waiting);
        done.map_err(|_| Problem::internal())
    }
}

#[cfg(test)]
mod tests {
    use axum::http::StatusCode;
    use axum::response::IntoResponse;

    use super::*;

    fn one_turn() -> Planning {
        Planning { turns: Arc::new(Semaphore::new(1)), patience: Duration::from_millis(50) }
    }

    /// Works until it is not wanted any more.
    fn for_ever(wanted: &dyn Fn() -> bool) {
        while wanted() {
            std::thread::yield_now();
        }
    }

    #[tokio::test]
    async fn who_waits_too_long_for_a_turn_is_asked_to_come_again() {
        let planning = one_turn();
        let first = tokio::spawn({
            let planning = planning.clone();
            async move { planning.plan(for_ever).await }
        });
        while planning.turns.available_permits() > 0 {
            tokio::task::yield_now().await;
        }
        let refused = planning.plan(|_| ()).await.unwrap_err().into_response();
        assert_eq!(refused.status(), StatusCode::SERVICE_UNAVAILABLE);
        assert!(refused.headers().contains_key("retry-after"));
        first.abort();
    }

    /// A request that is cut off is dropped: its work ends by itself, and its turn is free again.
    #[tokio::test]
    async fn work_ends_when_nobody_waits_for_it() {
        let planning = one_turn();
        let cut_off = tokio::time::timeout(Duration::from_millis(20), planning.plan(for_ever)).await;
        assert!(cut_off.is_err());
        let planning = Planning { patience: PATIENCE, ..planning };
        assert!(planning.plan(|wanted| wanted()).await.unwrap());
    }
}
