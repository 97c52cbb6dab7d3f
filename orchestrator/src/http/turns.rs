//! Turns at what takes a while: planning, flying by hand, searching. A few at a time, off the threads that answer others, and no longer than
//! somebody waits for it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::problem::Problem;

/// Longest wait for a turn.
const PATIENCE: Duration = Duration::from_secs(10);

/// Turns at one kind of work: all cores but one at once, for it takes whole cores, and trainers wait for answers.
#[derive(Debug, Clone)]
pub struct Turns {
    /// What waits for a turn, to say that there are too many.
    what: &'static str,
    turns: Arc<Semaphore>,
    patience: Duration,
}

/// Who waits for whom: each kind of work has turns of its own, so that a quick one does not wait for a slow one.
#[derive(Debug, Clone)]
pub struct AllTurns {
    /// Scenarios by hand that are planned on.
    pub planning: Turns,
    /// Scenarios that are flown by hand.
    pub flights: Turns,
    /// Searches through all episodes of a run.
    pub searches: Turns,
}

impl Default for AllTurns {
    fn default() -> Self {
        Self {
            planning: Turns::at("scenarios are being planned on"),
            flights: Turns::at("scenarios are being flown by hand"),
            searches: Turns::at("searches are under way"),
        }
    }
}

/// Says that nobody waits any more once it is dropped: the request was answered, cut off, or its client has gone.
struct Waiting(Arc<AtomicBool>);

impl Drop for Waiting {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Relaxed);
    }
}

impl Turns {
    fn at(what: &'static str) -> Self {
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        Self { what, turns: Arc::new(Semaphore::new(cores.saturating_sub(1).max(1))), patience: PATIENCE }
    }

    /// Does `work` when there is a turn, and answers with what it gives; `work` is told how to ask whether it is still
    /// wanted. The turn is kept until the work has really ended.
    ///
    /// # Errors
    /// No turn for too long; or the work panicked.
    pub(super) async fn work<T: Send + 'static>(
        &self,
        work: impl FnOnce(&dyn Fn() -> bool) -> T + Send + 'static,
    ) -> Result<T, Problem> {
        let turn = self.turn().await?;
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

    /// Waits for a turn, which lasts until it is dropped.
    ///
    /// # Errors
    /// None for too long.
    pub(super) async fn turn(&self) -> Result<OwnedSemaphorePermit, Problem> {
        let turn = tokio::time::timeout(self.patience, Arc::clone(&self.turns).acquire_owned()).await;
        turn.ok().and_then(Result::ok).ok_or_else(|| Problem::busy(self.what))
    }
}

#[cfg(test)]
mod tests {
    use axum::http::StatusCode;
    use axum::response::IntoResponse;

    use super::*;

    fn one_turn() -> Turns {
        Turns {
            what: "tests are under way",
            turns: Arc::new(Semaphore::new(1)),
            patience: Duration::from_millis(50),
        }
    }

    /// Works until it is not wanted any more.
    fn for_ever(wanted: &dyn Fn() -> bool) {
        while wanted() {
            std::thread::yield_now();
        }
    }

    #[tokio::test]
    async fn who_waits_too_long_for_a_turn_is_asked_to_come_again() {
        let turns = one_turn();
        let first = tokio::spawn({
            let turns = turns.clone();
            async move { turns.work(for_ever).await }
        });
        while turns.turns.available_permits() > 0 {
            tokio::task::yield_now().await;
        }
        let refused = turns.work(|_| ()).await.unwrap_err().into_response();
        assert_eq!(refused.status(), StatusCode::SERVICE_UNAVAILABLE);
        assert!(refused.headers().contains_key("retry-after"));
        first.abort();
    }

    /// A request that is cut off is dropped: its work ends by itself, and its turn is free again.
    #[tokio::test]
    async fn work_ends_when_nobody_waits_for_it() {
        let turns = one_turn();
        let cut_off = tokio::time::timeout(Duration::from_millis(20), turns.work(for_ever)).await;
        assert!(cut_off.is_err());
        let turns = Turns { patience: PATIENCE, ..turns };
        assert!(turns.work(|wanted| wanted()).await.unwrap());
    }
}
