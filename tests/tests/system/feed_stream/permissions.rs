//! A key for trainers, by the configuration that deployments use.

use std::sync::{Arc, Mutex};

use system_tests::{ServerProcess, wait_until};
use tokio::io::AsyncReadExt;

use super::*;
use crate::remote_workers::secure_nats::{SecureNats, as_strs};

#[tokio::test(flavor = "multi_thread")]
async fn a_key_for_trainers_consumes_the_feed_of_its_run_only() {
    let Some(nats) = SecureNats::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let options = nats.options("SERVER");
    let server = ServerProcess::start_with_options(&folder.path().join("db.sqlite3"), &as_strs(&options));
    let api = server.api();
    for run in ["my-run", "other"] {
        create_run(&api, run, json!({"group_size": 16})).await;
        let settings = json!({"policy": "random", "max_unacknowledged_groups": 2, "delivery": "nats"});
        let _ = put_policy(&api, run, settings).await.expect(200);
    }
    let errors = Arc::new(Mutex::new(Vec::new()));
    let client = nats.connect("TRAINER", &errors).await;
    let mut context = jetstream::new(client.clone());
    context.set_timeout(Duration::from_secs(2));
    let config = |name: &str| pull::Config { durable_name: Some(name.to_owned()), ..pull::Config::default() };
    let consumer = wait_for("the consumer is created", async || {
        context.create_consumer_on_stream(config("trainer"), "SPARRING_default_FEED_my-run").await.ok()
    })
    .await;
    let messages = receive(&consumer, 2).await;
    let name = messages[0].headers.as_ref().unwrap().get("Sparring-Object").unwrap().as_str();
    let objects = context.get_object_store("SPARRING_default_FEED_my-run").await.unwrap();
    let mut bytes = Vec::new();
    let _ = objects.get(name).await.unwrap().read_to_end(&mut bytes).await.unwrap();
    assert_eq!(serde_json::from_slice::<Value>(&bytes).unwrap()["run"], "my-run");
    acknowledge(&messages).await;
    wait_until("the feed has room again", async || {
        policy(&api, "my-run").await["feed"]["acknowledged"].as_i64() >= Some(2)
    })
    .await;
    let bucket = context.get_key_value("SPARRING_default_RUNS").await.unwrap();
    assert!(bucket.get("runs.my-run").await.unwrap().is_some());
    assert!(errors.lock().unwrap().is_empty(), "{:?}", errors.lock().unwrap());

    let subjects = [
        "sparring.default.feed.my-run",
        "sparring.default.jobs.audit.server",
        "sparring.default.workers.me",
        "$KV.SPARRING_default_RUNS.runs.my-run",
        "$JS.API.CONSUMER.CREATE.SPARRING_default_FEED_other.me",
        "$JS.API.CONSUMER.CREATE.SPARRING_default_JOBS.me",
        "$JS.API.STREAM.PURGE.SPARRING_default_FEED_my-run",
        "$JS.API.STREAM.DELETE.SPARRING_default_FEED_my-run",
        "$JS.API.CONSUMER.DELETE.SPARRING_default_FEED_my-run.trainer",
    ];
    for subject in subjects {
        client.publish(subject, "{}".into()).await.unwrap();
    }
    let _feeds = client.subscribe("sparring.default.>").await.unwrap();
    let _replies = client.subscribe("_INBOX.>").await.unwrap();
    client.flush().await.unwrap();
    let expected = subjects.len() + 2;
    wait_until("NATS has denied all", async || errors.lock().unwrap().len() >= expected).await;
    let denied = errors.lock().unwrap().clone();
    assert!(denied.iter().all(|error| error.to_lowercase().contains("permissions violation")), "{denied:?}");
    assert_eq!(denied.len(), expected, "{denied:?}");
}
