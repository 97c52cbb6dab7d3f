//! Heartbeats as a server receives them, for fuzz tests only.

use super::registry::WorkerRegistry;
use crate::nats::membership::{self, Heartbeat};
use crate::status::WorkerStatus;

/// Lists the workers of a server of the worlds `world` that receives a heartbeat twice; `None` if it is malformed.
pub(crate) fn list_workers(bytes: &[u8], world: &'static str) -> Option<Vec<WorkerStatus>> {
    let heartbeat = membership::read::<Heartbeat>(bytes)?;
    let mut registry = WorkerRegistry::new("server".to_owned(), world);
    registry.note_heartbeat(heartbeat.clone());
    registry.note_heartbeat(heartbeat);
    registry.tick(std::time::Duration::from_millis(500));
    Some(registry.list())
}
