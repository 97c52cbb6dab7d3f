//! Groups above 512 KiB, and deleted runs.

use system_tests::wait_until;
use tokio::io::AsyncReadExt;

use super::*;
use crate::trajectories::{read, wait_for_full_feed, wait_for_rollouts};

#[tokio::test(flavor = "multi_thread")]
async fn large_groups_are_in_the_object_store() {
    let Some(cluster) = start_feed(3, 16).await else { return };
    let (api, context) = (cluster.api(), connect(&cluster).await);
    let objects = format!("OBJ_{STREAM}");
    wait_for_full_feed(&api, "run").await;
    let consumer = open_consumer(&context, "trainer").await;
    let messages = receive(&consumer, 3).await;
    let bucket = context.get_object_store(STREAM).await.unwrap();
    let mut groups = Vec::new();
    for message in &messages {
        assert!(message.payload.is_empty(), "the group is an object");
        let name = message.headers.as_ref().unwrap().get("Sparring-Object").unwrap().as_str();
        let mut bytes = Vec::new();
        let _ = bucket.get(name).await.unwrap().read_to_end(&mut bytes).await.unwrap();
        assert!(bytes.len() > 512 * 1024);
        groups.push(serde_json::from_slice::<Value>(&bytes).unwrap());
    }
    assert_eq!(groups, read(&api, "run", "limit=64").await);
    set_policy(&cluster, "off", 3).await;
    wait_for_rollouts(&api).await;
    acknowledge(&messages).await;
    wait_for_acknowledged(&cluster, 3).await;
    wait_until("the objects are deleted", async || messages_of(&context, &objects).await == Some(0)).await;
    assert_eq!(messages_of(&context, STREAM).await, Some(0));

    // A run that is deleted takes its stream and its objects with it.
    set_policy(&cluster, "random", 1).await;
    wait_until("a group is published", async || messages_of(&context, STREAM).await == Some(1)).await;
    assert!(messages_of(&context, &objects).await > Some(0));
    let _ = api.post("/v1/runs/run/archive", json!({})).await.expect(200);
    let deleted = api.request("DELETE", "/v1/runs/run?name=run", "application/json", String::new()).await;
    assert!(deleted.status < 300, "{deleted:?}");
    wait_until("the stream is deleted", async || {
        messages_of(&context, STREAM).await.is_none() && messages_of(&context, &objects).await.is_none()
    })
    .await;
}
