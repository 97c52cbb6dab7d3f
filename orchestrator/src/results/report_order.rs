//! Order in which the reports of a run are stored.
//!
//! Audits on other machines end in any order. Where they do, the reports of a run wait for each other, so that outcomes reach the
//! curriculum in the order of the reports, however many workers there are. Without workers a report is stored as soon as it is audited.

use std::collections::HashMap;
use std::sync::Arc;

use parking_lot::Mutex;
use store::ids::RunId;
use tokio::sync::oneshot;

/// Number of runs from which ended turns are removed.
const MAX_RUNS: usize = 256;

/// Order in which the reports of runs are stored. Clones share it.
#[derive(Debug, Clone, Default)]
pub struct ReportOrder(Option<Arc<Mutex<LastTurns>>>);

/// The last turn of each run.
type LastTurns = HashMap<RunId, oneshot::Receiver<PreviousTurn>>;

/// The turn before one that was given up; `None` if there is none, or if it has ended.
#[derive(Debug)]
struct PreviousTurn(Option<oneshot::Receiver<PreviousTurn>>);

/// Turn of a report. It ends when it is dropped.
#[derive(Debug)]
pub struct ReportTurn {
    previous: Option<oneshot::Receiver<PreviousTurn>>,
    ended: Option<oneshot::Sender<PreviousTurn>>,
}

impl ReportOrder {
    /// Reports are stored in the order of [`Self::enter`].
    #[must_use]
    pub fn of_arrival() -> Self {
        Self(Some(Arc::default()))
    }

    /// Takes the next turn of a run.
    #[must_use]
    pub fn enter(&self, run: &RunId) -> ReportTurn {
        let Some(turns) = &self.0 else { return ReportTurn { previous: None, ended: None } };
        let (sender, receiver) = oneshot::channel();
        let mut turns = turns.lock();
        if turns.len() >= MAX_RUNS {
            turns.retain(|_, last| match last.try_recv() {
                Err(oneshot::error::TryRecvError::Empty) => true,
                Ok(PreviousTurn(Some(earlier))) => {
                    *last = earlier;
                    true
                }
                Ok(PreviousTurn(None)) | Err(_) => false,
            });
        }
        let previous = turns.insert(run.clone(), receiver);
        ReportTurn { previous, ended: Some(sender) }
    }
}

impl ReportTurn {
    /// Waits until all earlier turns of the run have ended.
    pub async fn wait(&mut self) {
        while let Some(previous) = &mut self.previous {
            self.previous = previous.await.ok().and_then(|PreviousTurn(earlier)| earlier);
        }
    }
}

impl Drop for ReportTurn {
    fn drop(&mut self) {
        // A turn that is given up before it came leaves the earlier ones to the next.
        if let Some(ended) = self.ended.take() {
            drop(ended.send(PreviousTurn(self.previous.take())));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex as StdMutex;

    use super::*;

    fn run(name: &str) -> RunId {
        name.parse().unwrap()
    }

    #[tokio::test]
    async fn turns_come_in_order_also_past_one_that_was_given_up() {
        let order = ReportOrder::of_arrival();
        let passed: Arc<StdMutex<Vec<u32>>> = Arc::default();
        let mut turns: Vec<_> = (0..4).map(|_| order.enter(&run("a"))).collect();
        let mut other = order.enter(&run("b"));
        other.wait().await; // another run does not wait
        drop(turns.remove(1));
        let mut tasks = Vec::new();
        for (number, mut turn) in turns.into_iter().enumerate().rev() {
            let passed = Arc::clone(&passed);
            tasks.push(tokio::spawn(async move {
                turn.wait().await;
                tokio::task::yield_now().await;
                passed.lock().unwrap().push(number as u32);
            }));
        }
        for task in tasks {
            task.await.unwrap();
        }
        assert_eq!(*passed.lock().unwrap(), [0, 1, 2]);
    }

    #[tokio::test]
    async fn without_an_order_no_turn_waits() {
        let order = ReportOrder::default();
        let _first = order.enter(&run("a"));
        order.enter(&run("a")).wait().await;
    }
}
