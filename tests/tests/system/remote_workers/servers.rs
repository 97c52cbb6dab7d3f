//! A server with options of its own, and what it says about its workers.

use serde_json::{Value, json};
use system_tests::{ApiClient, ServerProcess, wait_until};

use super::secure_nats::as_strs;
use crate::trajectories::number;

/// A server and the folder of its database.
pub(super) struct OptionServer {
    pub(super) process: ServerProcess,
    pub(super) folder: tempfile::TempDir,
}

impl OptionServer {
    pub(super) fn start(options: &[String]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let process = ServerProcess::start_with_options(&folder.path().join("db.sqlite3"), &as_strs(options));
        Self { process, folder }
    }

    pub(super) fn api(&self) -> ApiClient {
        self.process.api()
    }
}

pub(super) async fn workers(api: &ApiClient) -> Value {
    api.get("/v1/workers").await.expect(200)
}

pub(super) async fn done_remotely(api: &ApiClient) -> i64 {
    number(&workers(api).await["counters"]["done_remotely"])
}

/// Waits until workers of this kind are active.
pub(super) async fn wait_for_kind(api: &ApiClient, kind: &str) {
    wait_until(kind, async || {
        let list = workers(api).await;
        let is_active = |worker: &Value| {
            worker["state"] == "active" && worker["kinds"].as_array().unwrap().contains(&json!(kind))
        };
        list["workers"].as_array().unwrap().iter().any(is_active)
    })
    .await;
}
