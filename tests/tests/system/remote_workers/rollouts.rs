//! Policies that workers roll out: the same groups as the server, without its language model, and with kills.

use std::path::Path;

use serde_json::Value;
use system_tests::mock_llm::{
    API_KEY, GatedEndpoint, HOLD_ACTION, chat_response, contains_api_key, start_endpoint,
};
use system_tests::worker_cluster::{WorkerProcess, nats_options};
use system_tests::{ApiClient, wait_until};

use super::secure_nats::{SecureNats, as_strs};
use super::servers::{OptionServer, done_remotely, wait_for_kind, workers};
use super::*;
use crate::trajectories::{
    ack, all_leases, assert_group_replays, claim, counted_episodes, create_run, ids, number, policy,
    put_policy, wait_for_policy,
};

const ONNX: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/onnx");
/// Environment variable with the key of the language model, which only workers have.
const KEY_VARIABLE: &str = "ROLLOUT_TEST_KEY";

/// Starts a worker that rolls out policies.
fn rollout_worker(nats: &NatsServer, options: &[&str]) -> WorkerProcess {
    let url = nats.url();
    let options = [&["--nats", &url, "--jobs", "rollout"], options].concat();
    WorkerProcess::start_with_variables(&options, &[(KEY_VARIABLE, API_KEY)])
}

/// Options of a worker with a language model.
fn model_options(url: &str) -> [String; 6] {
    let url = format!("{url}/v1");
    ["--policy-url", &url, "--policy-model", "mock", "--policy-key-env", KEY_VARIABLE].map(str::to_owned)
}

/// Removes the names that differ between two servers.
fn without_names(mut group: Value) -> Value {
    for name in ["id", "lease", "deliveries"] {
        group.as_object_mut().unwrap().remove(name);
    }
    for episode in group["episodes"].as_array_mut().unwrap() {
        episode.as_object_mut().unwrap().remove("id");
    }
    group
}

/// Rolls out a policy group by group, and returns the groups without names.
async fn groups_of(api: &ApiClient, name: &str, count: usize) -> Vec<Value> {
    create_run(api, "run", json!({})).await;
    let settings = json!({"policy": name, "version": 1, "max_unacknowledged_groups": 1});
    let _ = put_policy(api, "run", settings).await.expect(200);
    let mut groups = Vec::new();
    while groups.len() < count {
        let claimed = claim(api, "run", json!({"wait_s": 50})).await;
        groups.extend(claimed.iter().cloned().map(without_names));
        let _ = ack(api, "run", &ids(&claimed)).await;
    }
    groups
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_rolls_out_the_same_groups_as_the_server() {
    let Some(nats) = NatsServer::start() else { return };
    let alone = OptionServer::start(&[]);
    let server = OptionServer::start(&nats_options(&nats.url()));
    let _worker = rollout_worker(&nats, &[]);
    wait_for_kind(&server.api(), "rollout_built_in").await;
    assert_eq!(workers(&server.api()).await["workers"][0]["kinds"], json!(["rollout_built_in"]));
    let remote = groups_of(&server.api(), "random", 3).await;
    assert!(done_remotely(&server.api()).await >= 3);
    assert_eq!(remote, groups_of(&alone.api(), "random", 3).await);
}

/// Creates a folder with a fixture under the name `model.onnx`.
fn policy_folder(fixture: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(Path::new(ONNX).join(fixture), folder.path().join("model.onnx")).unwrap();
    folder
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_without_the_same_file_refuses_the_group() {
    let Some(nats) = NatsServer::start() else { return };
    let (same, other) = (policy_folder("tracks_continuous.onnx"), policy_folder("state_docking.onnx"));
    let path = |folder: &tempfile::TempDir| folder.path().display().to_string();
    let mut options = nats_options(&nats.url());
    options.extend(["--policy-folder".to_owned(), path(&same)]);
    let server = OptionServer::start(&options);
    let api = server.api();
    let worker = rollout_worker(&nats, &["--policy-folder", &path(&other)]);
    wait_for_kind(&api, "rollout_file").await;
    let groups = groups_of(&api, "onnx:model.onnx", 1).await;
    assert_group_replays(&groups[0]);
    let list = workers(&api).await;
    assert!(number(&list["workers"][0]["errors"]) >= 1, "{list}");
    assert_eq!(number(&list["counters"]["done_remotely"]), 0);
    drop(worker);
    let _worker = rollout_worker(&nats, &["--policy-folder", &path(&same)]);
    wait_until("the other worker rolls out the file", async || {
        let claimed = claim(&api, "run", json!({"wait_s": 1})).await;
        let _ = ack(&api, "run", &ids(&claimed)).await;
        done_remotely(&api).await >= 1
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_server_without_a_language_model_uses_that_of_a_worker() {
    let Some(nats) = NatsServer::start() else { return };
    let mock = start_endpoint([chat_response(HOLD_ACTION)]).await;
    let server = OptionServer::start(&nats_options(&nats.url()));
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let settings = json!({"policy": "chat", "version": 2, "max_unacknowledged_groups": 1, "temperature": 0.25, "history": 1});
    let _ = put_policy(&api, "run", settings).await.expect(200);
    wait_for_policy(&api, "run", "the lack of a model is an error", |policy| {
        let message = policy["last_error"]["message"].as_str().unwrap_or_default();
        message.contains("neither the server nor a connected worker")
    })
    .await;
    let state = policy(&api, "run").await;
    assert_eq!((&state["model"], &state["worker_models"]), (&Value::Null, &json!([])));
    let prices = ["--llm-price-in", "1", "--llm-price-out", "1"].map(str::to_owned);
    let options = [model_options(&mock.uri()).as_slice(), &prices].concat();
    let _worker = rollout_worker(&nats, &as_strs(&options));
    let group = claim(&api, "run", json!({"wait_s": 50})).await.remove(0);
    assert_group_replays(&group);
    assert_eq!(
        (&group["messages"], &group["policy_version"], &group["failed"]),
        (&json!("kept"), &json!(2), &json!(0))
    );
    let metrics = &group["episodes"][0]["metrics"];
    assert_eq!((&metrics["temperature"], &metrics["tokens_in"]), (&json!(0.25), &json!(900 * 50)));
    let messages = &group["episodes"][0]["steps"][1]["completions"][0]["messages"];
    assert_eq!(messages.as_array().unwrap().len(), 4, "the history travels");
    assert_eq!(done_remotely(&api).await, 1);
    let state = policy(&api, "run").await;
    assert_eq!(number(&state["tokens_in"]), 900 * 100);
    assert_eq!((&state["model"], &state["worker_models"]), (&Value::Null, &json!(["mock"])));
    assert_eq!(counted_episodes(&api, "run").await, 2);
    for entry in std::fs::read_dir(server.folder.path()).unwrap() {
        assert!(!contains_api_key(&std::fs::read(entry.unwrap().path()).unwrap()));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_group_of_a_killed_worker_is_rolled_out_again() {
    let Some(nats) = NatsServer::start() else { return };
    let gate = GatedEndpoint::start(HOLD_ACTION).await;
    let mock = start_endpoint([chat_response(HOLD_ACTION)]).await;
    let server = OptionServer::start(&nats_options(&nats.url()));
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let killed = rollout_worker(&nats, &as_strs(&model_options(gate.url())));
    wait_for_kind(&api, "rollout_chat").await;
    let settings = json!({"policy": "chat", "max_unacknowledged_groups": 1});
    let _ = put_policy(&api, "run", settings).await.expect(200);
    gate.wait_for_requests(1).await;
    drop(killed);
    let _worker = rollout_worker(&nats, &as_strs(&model_options(&mock.uri())));
    let group = claim(&api, "run", json!({"wait_s": 50})).await.remove(0);
    assert_group_replays(&group);
    let state = policy(&api, "run").await;
    assert_eq!((number(&state["groups"]), number(&state["episodes"]), number(&state["failed"])), (1, 2, 0));
    assert_eq!(counted_episodes(&api, "run").await, 2);
}

/// The NATS server has the keys and permissions of deployments.
#[tokio::test(flavor = "multi_thread")]
async fn a_new_version_ends_rollouts_of_the_old_one() {
    let Some(nats) = SecureNats::start() else { return };
    let gate = GatedEndpoint::start(HOLD_ACTION).await;
    let server = OptionServer::start(&nats.options("SERVER"));
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let model = model_options(gate.url());
    let rollout = ["--jobs", "rollout"].map(str::to_owned);
    let options = [&nats.options("WORKER"), rollout.as_slice(), &model].concat();
    let _worker = WorkerProcess::start_with_variables(&as_strs(&options), &[(KEY_VARIABLE, API_KEY)]);
    wait_for_kind(&api, "rollout_chat").await;
    let settings =
        |version: u32| json!({"policy": "chat", "version": version, "max_unacknowledged_groups": 1});
    let _ = put_policy(&api, "run", settings(1)).await.expect(200);
    gate.wait_for_requests(2).await;
    let _ = put_policy(&api, "run", settings(2)).await.expect(200);
    // No response was released: the old conversations have ended, and new ones begun.
    gate.wait_for_requests(4).await;
    gate.release(1000);
    let group = claim(&api, "run", json!({"wait_s": 50})).await.remove(0);
    assert_eq!(number(&group["policy_version"]), 2);
    let leases = all_leases(&api).await;
    assert_eq!(leases.iter().map(|lease| &lease["status"]).collect::<Vec<_>>(), ["released", "done"]);
    assert_eq!(counted_episodes(&api, "run").await, 2);
    let list = workers(&api).await;
    assert_eq!(number(&list["workers"][0]["errors"]), 0, "{list}");
}

/// A message has 512 KiB; larger results go through the object store, for which a worker's key needs permissions.
#[tokio::test(flavor = "multi_thread")]
async fn a_worker_with_a_key_sends_results_larger_than_a_message() {
    let Some(nats) = SecureNats::start() else { return };
    let server = OptionServer::start(&nats.options("SERVER"));
    let api = server.api();
    let options = [&nats.options("WORKER")[..], &["--jobs", "rollout"].map(str::to_owned)].concat();
    let _worker = WorkerProcess::start_with_options(&as_strs(&options));
    wait_for_kind(&api, "rollout_built_in").await;
    create_run(&api, "run", json!({"group_size": 16})).await;
    let _ = put_policy(&api, "run", json!({"policy": "random", "max_unacknowledged_groups": 1}))
        .await
        .expect(200);
    let group = claim(&api, "run", json!({"wait_s": 50})).await.remove(0);
    let bytes = group.to_string().len();
    assert!(bytes > 1 << 20, "{bytes} bytes");
    assert_group_replays(&group);
    assert!(done_remotely(&api).await >= 1);
    let list = workers(&api).await;
    assert_eq!(number(&list["workers"][0]["errors"]), 0, "{list}");
}
