//! Queues of the writer, and the order in which their work is served.

use tokio::sync::mpsc;

use super::job::{Job, WaitingQuery};

/// Capacity of each queue of waiting work.
pub const QUEUE_CAPACITY: usize = 1024;

pub(super) type JobSender = mpsc::Sender<Box<dyn Job>>;
pub(super) type QuerySender = mpsc::Sender<Box<dyn WaitingQuery>>;

/// Sending ends of the queues.
#[derive(Debug, Clone)]
pub(super) struct Queues {
    pub(super) urgent: JobSender,
    pub(super) bulk: JobSender,
    pub(super) queries: QuerySender,
}

/// Receiving ends of the queues.
pub(super) struct Inbox {
    urgent: mpsc::Receiver<Box<dyn Job>>,
    bulk: mpsc::Receiver<Box<dyn Job>>,
    queries: mpsc::Receiver<Box<dyn WaitingQuery>>,
    /// True if bulk jobs had to wait: the next batch starts with one.
    is_bulk_next: bool,
}

/// Work that the writer takes from its queues.
pub(super) enum Work {
    /// First job of a batch.
    Batch(Box<dyn Job>),
    /// Query, which needs no transaction.
    Query(Box<dyn WaitingQuery>),
}

/// Creates the queues of a writer.
pub(super) fn create() -> (Queues, Inbox) {
    let (urgent, urgent_inbox) = mpsc::channel(QUEUE_CAPACITY);
    let (bulk, bulk_inbox) = mpsc::channel(QUEUE_CAPACITY);
    let (queries, query_inbox) = mpsc::channel(QUEUE_CAPACITY);
    let inbox = Inbox { urgent: urgent_inbox, bulk: bulk_inbox, queries: query_inbox, is_bulk_next: false };
    (Queues { urgent, bulk, queries }, inbox)
}

/// Returns how many jobs wait in a queue.
pub(super) fn waiting(queue: &JobSender) -> usize {
    QUEUE_CAPACITY - queue.capacity()
}

impl Inbox {
    /// Waits for work; `None` once every handle is dropped.
    pub(super) async fn next(&mut self) -> Option<Work> {
        if std::mem::take(&mut self.is_bulk_next)
            && let Ok(job) = self.bulk.try_recv()
        {
            return Some(Work::Batch(job));
        }
        tokio::select! {
            biased;
            Some(job) = self.urgent.recv() => {
                self.is_bulk_next = true;
                Some(Work::Batch(job))
            }
            Some(query) = self.queries.recv() => {
                self.is_bulk_next = true;
                Some(Work::Query(query))
            }
            Some(job) = self.bulk.recv() => Some(Work::Batch(job)),
            else => None,
        }
    }

    /// Returns another job for a batch: an urgent one, and a bulk one only while the batch has no urgent job.
    pub(super) fn more(&mut self, has_urgent: &mut bool) -> Option<Box<dyn Job>> {
        if let Ok(job) = self.urgent.try_recv() {
            *has_urgent = true;
            return Some(job);
        }
        if *has_urgent { None } else { self.bulk.try_recv().ok() }
    }

    /// Takes all jobs that wait.
    pub(super) fn take_jobs(&mut self) -> Vec<Box<dyn Job>> {
        let (urgent, bulk) = (&mut self.urgent, &mut self.bulk);
        let urgent = std::iter::from_fn(|| urgent.try_recv().ok());
        let bulk = std::iter::from_fn(|| bulk.try_recv().ok());
        urgent.chain(bulk).take(2 * QUEUE_CAPACITY).collect()
    }

    /// Takes the queries that wait.
    pub(super) fn take_queries(&mut self) -> Vec<Box<dyn WaitingQuery>> {
        let queries = &mut self.queries;
        std::iter::from_fn(|| queries.try_recv().ok()).take(QUEUE_CAPACITY).collect()
    }
}
