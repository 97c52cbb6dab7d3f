//! Content and order of a stream, flow control, and the switch of a run.

use system_tests::{Server, wait_until};

use super::*;
use crate::trajectories::{ack, claim, ids, number, read, wait_for_full_feed, wait_for_rollouts};

#[tokio::test(flavor = "multi_thread")]
async fn stream_has_the_groups_of_the_http_feed() {
    let Some(cluster) = start_feed(8, 2).await else { return };
    let (api, context) = (cluster.api(), connect(&cluster).await);
    wait_for_full_feed(&api, "run").await;
    let consumer = open_consumer(&context, "trainer").await;
    let messages = receive(&consumer, 8).await;
    let groups: Vec<Value> = messages.iter().map(group).collect();
    assert_eq!(groups, read(&api, "run", "limit=64").await);
    let published: Vec<i64> = messages.iter().map(id_of).collect();
    assert_eq!((published.clone(), ids(&groups)), ((1..=8).collect(), published));

    // Acknowledgements of a consumer make room. The first is missing, so those after it do not count yet.
    acknowledge(&messages[1..4]).await;
    tokio::time::sleep(Duration::from_secs(1)).await; // tests that nothing happens
    assert_eq!(policy(&api, "run").await["feed"]["acknowledged"], 0);
    acknowledge(&messages[..1]).await;
    wait_for_acknowledged(&cluster, 4).await;
    let more = receive(&consumer, 4).await;
    assert_eq!(more.iter().map(id_of).collect::<Vec<_>>(), [9, 10, 11, 12]);
    acknowledge(&messages[4..]).await;
    acknowledge(&more).await;

    set_policy(&cluster, "off", 8).await;
    wait_for_rollouts(&api).await;
    let left = number(&policy(&api, "run").await["groups"]) - 12;
    acknowledge(&receive(&consumer, usize::try_from(left).unwrap()).await).await;
    wait_for_acknowledged(&cluster, 12 + left).await;
    wait_until("the stream is empty", async || messages_of(&context, STREAM).await == Some(0)).await;
    assert!(cluster.metrics().await.contains("sparring_feed_unpublished 0\n"));
}

#[tokio::test(flavor = "multi_thread")]
async fn http_goes_on_without_nats() {
    let Some(mut cluster) = start_feed(8, 2).await else { return };
    let api = cluster.api();
    wait_for_full_feed(&api, "run").await;
    wait_until("all groups are published", async || {
        cluster.metrics().await.contains("sparring_feed_unpublished 0\n")
            && messages_of(&connect(&cluster).await, STREAM).await == Some(8)
    })
    .await;
    cluster.nats.as_mut().unwrap().kill();
    let claimed = claim(&api, "run", json!({"limit": 3, "wait_s": 30})).await;
    assert_eq!(ack(&api, "run", &ids(&claimed)).await["acknowledged"], json!([1, 2, 3]));
    wait_until("new groups wait", async || cluster.metrics().await.contains("sparring_feed_unpublished 3\n"))
        .await;
    cluster.nats.as_mut().unwrap().resume();
    // Groups that were acknowledged over HTTP are not delivered, and nothing is missing.
    let context = connect(&cluster).await;
    wait_until("the stream follows the database", async || {
        let stream = context.get_stream(STREAM).await.unwrap();
        let state = &stream.cached_info().state;
        (state.messages, state.first_sequence) == (8, 4)
    })
    .await;
    let messages = receive(&open_consumer(&context, "late").await, 8).await;
    assert_eq!(messages.iter().map(id_of).collect::<Vec<_>>(), (4..=11).collect::<Vec<_>>());
    // Acknowledging over HTTP removes a group in the middle, too.
    let _ = ack(&api, "run", &[6]).await;
    wait_until("the message is gone", async || {
        context.get_stream(STREAM).await.unwrap().get_raw_message(6).await.is_err()
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn switch_of_a_run_needs_nats_and_can_be_undone() {
    let server = Server::start().await;
    create_run(&server.api(), "run", json!({})).await;
    let refused =
        put_policy(&server.api(), "run", json!({"policy": "off", "delivery": "nats"})).await.expect(422);
    assert_eq!(refused["field"], "delivery");
    assert_eq!(policy(&server.api(), "run").await["delivery"], "http");

    let Some(cluster) = start_feed(4, 2).await else { return };
    let (api, context) = (cluster.api(), connect(&cluster).await);
    wait_until("the groups are published", async || messages_of(&context, STREAM).await == Some(4)).await;
    let _ = put_policy(&api, "run", json!({"policy": "off"})).await.expect(200);
    wait_until("the stream is deleted", async || messages_of(&context, STREAM).await.is_none()).await;
    assert!(claim(&api, "run", json!({"limit": 4})).await.len() >= 4, "the groups wait for HTTP");
}

#[tokio::test(flavor = "multi_thread")]
async fn runs_of_two_servers_with_one_id_do_not_mix() {
    let Some(cluster) = start_feed(2, 2).await else { return };
    let context = connect(&cluster).await;
    wait_until("the groups are published", async || messages_of(&context, STREAM).await == Some(2)).await;
    let folder = tempfile::tempdir().unwrap();
    let url = cluster.nats.as_ref().unwrap().url();
    let other =
        system_tests::ServerProcess::start_with_options(&folder.path().join("other.db"), &["--nats", &url]);
    create_run(&other.api(), "run", json!({})).await;
    let settings = json!({"policy": "random", "max_unacknowledged_groups": 2, "delivery": "nats"});
    let _ = put_policy(&other.api(), "run", settings).await.expect(200);
    wait_until("the second server says why it does not publish", async || {
        let error = policy(&other.api(), "run").await["last_error"]["message"].to_string();
        error.contains("belongs to the run of another server")
    })
    .await;
    assert_eq!(messages_of(&context, STREAM).await, Some(2));
}
