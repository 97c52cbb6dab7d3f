//! Messages without jobs: heartbeats of workers, the answers of servers, and the states of runs in the key-value bucket.

use job_queue::fuzzing::{list_workers, rewrite_control_message, rewrite_heartbeat, rewrite_run_state};
use job_queue::status::WorkerState;
use serde_json::{Value, json};

/// World version of the server that receives heartbeats.
const WORLD: &str = "0.1.0-1-0123456789ab";

/// A message that was read is the same after it is written and read again.
fn is_stable(bytes: &[u8], rewrite: fn(&[u8]) -> Option<Vec<u8>>) -> bool {
    let Some(written) = rewrite(bytes) else { return false };
    assert!(rewrite(&written).is_some_and(|twice| twice == written), "the written form differs");
    true
}

fn packed(messages: impl IntoIterator<Item = Value>) -> Vec<Vec<u8>> {
    messages.into_iter().map(|message| rmp_serde::to_vec(&message).expect("it has no other values")).collect()
}

/// A server lists the worker of a heartbeat once, unless it leaves. It works only if it computes the same worlds.
pub(super) fn heartbeat(bytes: &[u8]) -> bool {
    let Some(workers) = list_workers(bytes, WORLD) else { return false };
    assert!(workers.len() <= 1, "one heartbeat has {} workers", workers.len());
    for worker in &workers {
        assert_eq!(worker.state == WorkerState::Active, worker.world == WORLD, "{worker:?}");
        assert!(worker.active as usize <= bytes.len() && worker.kinds.len() <= bytes.len());
    }
    is_stable(bytes, rewrite_heartbeat)
}

pub(super) fn heartbeat_seeds() -> Vec<Vec<u8>> {
    let beat = json!({
        "id": "host-0a1b2c", "host": "host", "version": "0.1.0", "world": WORLD,
        "kinds": ["prepare", "audit", "design_llm", "rollout_chat", "later"], "concurrency": 4, "chat_calls": 32,
        "chat_model": "my-model", "llm_designs": 2, "active": [[1_700_000_000_000_u64, 7], [1_700_000_000_000_u64, 8]],
        "is_waiting": true, "is_leaving": false
    });
    let (mut leaving, mut foreign) = (beat.clone(), beat.clone());
    leaving["is_leaving"] = json!(true);
    foreign["world"] = json!("0.0.1-1-abc");
    // The oldest form has no fields for language models.
    let oldest =
        json!({"id": "a", "host": "a", "version": "0", "world": WORLD, "kinds": [], "concurrency": 1});
    packed([beat, leaving, foreign, oldest])
}

pub(super) fn control_message(bytes: &[u8]) -> bool {
    is_stable(bytes, rewrite_control_message)
}

pub(super) fn control_message_seeds() -> Vec<Vec<u8>> {
    let reason = "its result of an audit job of kessler/survival differs from the server's";
    packed([
        json!({"welcome": {"server": "host"}}),
        json!({"refused": {"reason": "install the same version"}}),
        json!({"expelled": {"reason": reason}}),
    ])
}

pub(super) fn run_state(bytes: &[u8]) -> bool {
    is_stable(bytes, rewrite_run_state)
}

pub(super) fn run_state_seeds() -> Vec<Vec<u8>> {
    let state = json!({
        "state": "active", "policy_version": 3, "policy": "chat", "version": 2, "created_at": 1_700_000_000_000_i64,
        "server": "host"
    });
    let off =
        json!({"state": "archived", "policy_version": 0, "policy": "off", "version": 0, "created_at": 0});
    crate::target::json_seeds([state, off])
}
