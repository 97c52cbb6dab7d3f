//! Jobs of the writer: changes and queries, each with the channel of its answer.

use std::future::Future;
use std::pin::Pin;

use store::{Outage, StoreError};
use tokio::sync::oneshot;

use crate::engine::change::{Change, ReadTx, StateQuery};
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;

/// Sends an answer once it is known whether the transaction was committed.
pub(super) type Delivery = Box<dyn FnOnce(Result<(), &StoreError>) + Send>;
type Running<'a, T> = Pin<Box<dyn Future<Output = T> + Send + 'a>>;
/// Channel of an answer.
pub(super) type AnswerSender<T> = oneshot::Sender<Result<T, ServiceError>>;

/// Outcome of a job before the commit of its batch.
pub(super) struct JobOutcome {
    pub(super) is_ok: bool,
    /// Outage of the database that prevented the change from being stored.
    pub(super) outage: Option<Outage>,
    pub(super) delivery: Delivery,
}

impl JobOutcome {
    fn new<T: Send + 'static>(answer: Result<T, ServiceError>, reply: AnswerSender<T>) -> Self {
        let is_ok = answer.is_ok();
        let outage = answer.as_ref().err().and_then(ServiceError::outage);
        let delivery: Delivery = Box::new(move |committed| {
            let answer = committed.map_err(ServiceError::not_committed).and(answer);
            // The caller may have dropped its end; the answer is then of no use.
            drop(reply.send(answer));
        });
        Self { is_ok, outage, delivery }
    }
}

/// A change with the channel of its answer.
pub(super) trait Job: Send {
    fn run<'a>(self: Box<Self>, tx: &'a mut WriteTx) -> Running<'a, JobOutcome>;
    /// Answers with an error because no transaction could be started.
    fn refuse(self: Box<Self>, error: &StoreError);
    /// True if other jobs are served first.
    fn is_bulk(&self) -> bool;
}

pub(super) struct ChangeJob<C: Change> {
    pub(super) change: C,
    pub(super) reply: AnswerSender<C::Output>,
}

impl<C: Change> Job for ChangeJob<C> {
    fn run<'a>(self: Box<Self>, tx: &'a mut WriteTx) -> Running<'a, JobOutcome> {
        Box::pin(async move {
            let answer = self.change.apply(tx).await;
            let outcome = JobOutcome::new(answer, self.reply);
            tx.has_outage |= outcome.outage.is_some();
            outcome
        })
    }

    fn refuse(self: Box<Self>, error: &StoreError) {
        drop(self.reply.send(Err(ServiceError::not_committed(error))));
    }

    fn is_bulk(&self) -> bool {
        C::IS_BULK
    }
}

/// A query with the channel of its answer. It runs between transactions, so that a transaction that fails does not affect it.
pub(super) trait WaitingQuery: Send {
    /// Sends the answer. Returns the outage of the database that prevented it, if there was one.
    fn answer<'a>(self: Box<Self>, tx: &'a mut WriteTx) -> Running<'a, Option<Outage>>;
}

pub(super) struct QueryJob<Q: StateQuery> {
    pub(super) query: Q,
    pub(super) reply: AnswerSender<Q::Output>,
}

impl<Q: StateQuery> WaitingQuery for QueryJob<Q> {
    fn answer<'a>(self: Box<Self>, tx: &'a mut WriteTx) -> Running<'a, Option<Outage>> {
        Box::pin(async move {
            let answer = self.query.read(&mut ReadTx::new(tx)).await;
            let outage = answer.as_ref().err().and_then(ServiceError::outage);
            drop(self.reply.send(answer));
            outage
        })
    }
}
