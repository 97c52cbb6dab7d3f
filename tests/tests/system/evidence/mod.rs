//! Evidence of mastery against trainers that hide, delay or select results, over HTTP against the binary. Each attack is one that moved a
//! level or the shown mastery before slots existed.

mod audits;
mod deadlines;
mod disclosure;
mod hidden_failures;
mod sessions;
mod settings;
mod twins;
mod withholding;

use serde_json::{Value, json};
use system_tests::{ApiClient, Lease, ServerProcess, episode_result};

const SURVIVAL: &str = "kessler/survival";

/// Server process with a database in a temporary folder.
struct EvidenceServer {
    server: ServerProcess,
    _folder: tempfile::TempDir,
}

impl EvidenceServer {
    fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let server = ServerProcess::start(&folder.path().join("db.sqlite3"));
        Self { server, _folder: folder }
    }

    fn api(&self) -> ApiClient {
        self.server.api()
    }
}

/// Creates a run of survival that starts at level 0 and claims mastery.
async fn create_run(api: &ApiClient, run: &str, more: Value) {
    let mut settings = json!({"strategy": "ladder", "id": run, "seed": 1, "tasks": [SURVIVAL], "target": "mastery", "placement": false,
        "group_size": 1, "contested_share": 1.0, "design": {"designer": "off"}});
    settings.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    let _ = api.post("/v1/runs", settings).await.expect(201);
}

/// State of the run's task.
async fn task(api: &ApiClient, run: &str) -> Value {
    api.get(&format!("/v1/runs/{run}/mastery")).await.expect(200)["tasks"][0].clone()
}

/// Result of an episode: finished with `hold`, or failed.
fn failed(id: &str) -> Value {
    json!({"episode": id, "status": "failed", "reason": "a machine stopped"})
}

/// Results of a lease by the policy that never acts, with the success of each by its own replay.
fn hold_results(lease: &Lease) -> Vec<(Value, bool)> {
    let groups = lease.0["groups"].as_array().unwrap();
    let hold = |group: &Value| {
        let bracket = &group["bracket"];
        let scenario = lease.scenario(group);
        let succeeds = bracket["hold"].as_f64().unwrap() > 0.99;
        let id = group["episodes"][0].as_str().unwrap();
        (episode_result(id, &scenario, "hold"), succeeds)
    };
    groups.iter().map(hold).collect()
}

/// Posterior mean of `successes` in `n`.
fn posterior_mean(successes: f64, n: f64) -> f64 {
    (1.0 + successes) / (2.0 + n)
}
