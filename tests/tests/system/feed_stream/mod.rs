//! Trajectory feeds on NATS JetStream: content, sharing, crashes, large groups, permissions. This file has the helpers of these tests.

mod content;
mod crashes;
mod example;
mod objects;
mod owners;
mod permissions;
mod run_states;
mod sharing;

use std::time::Duration;

use async_nats::jetstream::consumer::{AckPolicy, Consumer, pull};
use async_nats::jetstream::{self, Context, Message};
use futures_util::StreamExt;
use serde_json::{Value, json};
use system_tests::nats_server::NatsServer;
use system_tests::wait_for;
use system_tests::worker_cluster::WorkerCluster;

use crate::trajectories::{create_run, policy, put_policy};

/// Stream of the run of these tests.
const STREAM: &str = "SPARRING_default_FEED_run";

/// Starts a server without workers whose run `run` is delivered by NATS. `None` without NATS.
async fn start_feed(max_groups: u32, group_size: u32) -> Option<WorkerCluster> {
    let cluster = WorkerCluster::start(Some(NatsServer::start()?), 0).await;
    create_run(&cluster.api(), "run", json!({"group_size": group_size})).await;
    set_policy(&cluster, "random", max_groups).await;
    Some(cluster)
}

/// Sets the policy of the run, delivered by NATS.
async fn set_policy(cluster: &WorkerCluster, name: &str, max_groups: u32) {
    let settings = json!({"policy": name, "max_unacknowledged_groups": max_groups, "delivery": "nats"});
    let state = put_policy(&cluster.api(), "run", settings).await.expect(200);
    assert_eq!(state["delivery"], "nats");
}

/// Connects to the NATS server of a cluster.
async fn connect(cluster: &WorkerCluster) -> Context {
    let url = cluster.nats.as_ref().unwrap().url();
    let options = async_nats::ConnectOptions::new().retry_on_initial_connect();
    jetstream::new(options.connect(url).await.unwrap())
}

/// Creates a durable consumer of the run's stream, or opens the one that exists.
async fn open_consumer(context: &Context, name: &str) -> Consumer<pull::Config> {
    let config = pull::Config {
        durable_name: Some(name.to_owned()),
        ack_policy: AckPolicy::Explicit,
        ack_wait: Duration::from_secs(15),
        ..pull::Config::default()
    };
    wait_for("the consumer is created", async || {
        context.create_consumer_on_stream(config.clone(), STREAM).await.ok()
    })
    .await
}

/// Waits for a number of groups, at most a minute.
async fn receive(consumer: &Consumer<pull::Config>, count: usize) -> Vec<Message> {
    let mut messages = Vec::new();
    for _ in 0..60 {
        let limit = count - messages.len();
        if let Ok(mut batch) =
            consumer.batch().max_messages(limit).expires(Duration::from_secs(1)).messages().await
        {
            while let Some(Ok(message)) = batch.next().await {
                messages.push(message);
            }
        }
        if messages.len() >= count {
            return messages;
        }
    }
    panic!("{} of {count} groups arrived", messages.len());
}

/// Acknowledges messages, with the confirmation of NATS.
async fn acknowledge(messages: &[Message]) {
    for message in messages {
        message.double_ack().await.unwrap();
    }
}

/// Group of a message that is no object.
fn group(message: &Message) -> Value {
    serde_json::from_slice(&message.payload).unwrap()
}

/// Id of the group of a message.
fn id_of(message: &Message) -> i64 {
    message.headers.as_ref().unwrap().get("Nats-Msg-Id").unwrap().as_str().parse().unwrap()
}

/// Number of messages of a stream; `None` if it does not exist.
async fn messages_of(context: &Context, stream: &str) -> Option<u64> {
    Some(context.get_stream(stream).await.ok()?.cached_info().state.messages)
}

/// Waits until the server has acknowledged exactly this many groups of the run.
async fn wait_for_acknowledged(cluster: &WorkerCluster, count: i64) {
    system_tests::wait_until("the groups are acknowledged", async || {
        policy(&cluster.api(), "run").await["feed"]["acknowledged"] == count
    })
    .await;
}
