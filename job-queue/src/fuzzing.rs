//! Private parsers of messages, for fuzz tests only. They are not behind a feature, because a feature would compile the crate twice:
//! for the program and for the tests.

use crate::nats::feed::PublishedRunState;
use crate::nats::membership::{self, ControlMessage, Heartbeat};
use crate::nats::server::fuzzing;
use crate::status::WorkerStatus;

/// Lists the workers of a server of the worlds `world` that receives a heartbeat twice; `None` if it is malformed.
#[must_use]
pub fn list_workers(bytes: &[u8], world: &'static str) -> Option<Vec<WorkerStatus>> {
    fuzzing::list_workers(bytes, world)
}

/// Reads the heartbeat of a worker, and writes it again.
#[must_use]
pub fn rewrite_heartbeat(bytes: &[u8]) -> Option<Vec<u8>> {
    membership::read::<Heartbeat>(bytes).map(|heartbeat| membership::write(&heartbeat))
}

/// Reads the answer of a server to a heartbeat, and writes it again.
#[must_use]
pub fn rewrite_control_message(bytes: &[u8]) -> Option<Vec<u8>> {
    membership::read::<ControlMessage>(bytes).map(|message| membership::write(&message))
}

/// Reads the state of a run in the key-value bucket, and writes it again.
#[must_use]
pub fn rewrite_run_state(bytes: &[u8]) -> Option<Vec<u8>> {
    let state: PublishedRunState = serde_json::from_slice(bytes).ok()?;
    serde_json::to_vec(&state).ok()
}
