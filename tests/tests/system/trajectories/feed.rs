//! Pulling and acknowledging groups: at least once, in order, with long polls and limits.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use clock::{Clock, ManualClock};
use serde_json::{Value, json};
use system_tests::Server;

use super::{
    ack, claim, create_run, ids, number, policy, put_policy, read, wait_for_full_feed, wait_for_policy,
};

/// Start of the manual clock: an arbitrary time, in milliseconds.
const START_MS: i64 = 1_790_000_000_000;
/// Time within which a long poll must be woken: far below the 50 s that it would wait otherwise.
const WAKE_LIMIT: Duration = Duration::from_secs(25);

#[tokio::test]
async fn unacknowledged_groups_are_delivered_again() {
    let ManualClock { clock, time: clock_ms } = Clock::manual(START_MS);
    let server = Server::with_clock(clock).await;
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    create_run(&api, "other", json!({})).await;
    let _ =
        put_policy(&api, "run", json!({"policy": "hold", "max_unacknowledged_groups": 4})).await.expect(200);
    wait_for_full_feed(&api, "run").await;
    let _ =
        put_policy(&api, "run", json!({"policy": "off", "max_unacknowledged_groups": 4})).await.expect(200);
    let first = claim(&api, "run", json!({"limit": 3, "ttl_s": 60})).await;
    assert_eq!(first.len(), 3);
    assert!(first.iter().all(|group| group["deliveries"] == 1));
    let second = claim(&api, "run", json!({"limit": 3, "ttl_s": 120})).await;
    assert_eq!(second.len(), 1, "a delivered group is not delivered to others");
    let [a, b, c] = <[i64; 3]>::try_from(ids(&first)).unwrap();
    assert!(a < b && b < c && c < ids(&second)[0]);
    assert!(claim(&api, "run", json!({})).await.is_empty());
    assert_eq!(ack(&api, "run", &[a]).await, json!({"acknowledged": [a], "unknown": []}));
    clock_ms.fetch_add(61_000, Ordering::SeqCst);
    let redelivered = claim(&api, "run", json!({"ttl_s": 60})).await;
    assert_eq!(ids(&redelivered), [b, c]);
    assert!(redelivered.iter().all(|group| group["deliveries"] == 2));
    let same = |one: &Value| {
        let mut one = one.clone();
        one["deliveries"] = Value::Null;
        one
    };
    assert_eq!(
        redelivered.iter().map(same).collect::<Vec<_>>(),
        first[1..].iter().map(same).collect::<Vec<_>>()
    );
    // Acknowledging twice is allowed; ids of other runs and unused ids are unknown.
    assert_eq!(ack(&api, "run", &[a, b, 999]).await, json!({"acknowledged": [a, b], "unknown": [999]}));
    assert_eq!(ack(&api, "other", &[c]).await, json!({"acknowledged": [], "unknown": [c]}));
    clock_ms.fetch_add(200_000, Ordering::SeqCst);
    assert_eq!(ids(&claim(&api, "run", json!({})).await), [c, ids(&second)[0]]);
    // A group can also be acknowledged after its delivery timed out.
    clock_ms.fetch_add(1_000_000, Ordering::SeqCst);
    ack(&api, "run", &[c]).await;
    assert_eq!(ids(&claim(&api, "run", json!({})).await), ids(&second));
    // Reads with a cursor return every group and do not count as deliveries.
    let all = read(&api, "run", "after=0").await;
    assert_eq!(ids(&all), [a, b, c, ids(&second)[0]]);
    assert_eq!(all.iter().map(|group| number(&group["deliveries"])).collect::<Vec<_>>(), [1, 2, 3, 3]);
    let page = api.get(&format!("/v1/runs/run/trajectories?after={a}&limit=2")).await.expect(200);
    assert_eq!((ids(page["groups"].as_array().unwrap()), &page["next"]), (vec![b, c], &json!(c)));
    let page = api.get("/v1/runs/run/trajectories?after=9999").await.expect(200);
    assert_eq!(page, json!({"groups": [], "next": 9999}));
}

/// The newest 256 acknowledged groups are kept.
#[tokio::test]
async fn newest_acknowledged_groups_are_kept() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({"group_size": 1})).await;
    let _ = put_policy(
        &api,
        "run",
        json!({"policy": "hold", "max_unacknowledged_groups": 300, "observations": "none"}),
    )
    .await
    .expect(200);
    wait_for_full_feed(&api, "run").await;
    let _ = put_policy(&api, "run", json!({"policy": "off"})).await.expect(200);
    let mut all = ids(&claim(&api, "run", json!({"limit": 256})).await);
    all.extend(ids(&claim(&api, "run", json!({"limit": 256})).await));
    assert_eq!(all.len(), 300);
    ack(&api, "run", &all).await;
    assert_eq!(number(&policy(&api, "run").await["feed"]["acknowledged"]), 256);
    assert_eq!(ids(&read(&api, "run", "after=0&limit=256").await), all[44..]);
    assert_eq!(
        ack(&api, "run", &all[43..45]).await,
        json!({"acknowledged": [all[44]], "unknown": [all[43]]})
    );
}

#[tokio::test]
async fn long_polls_wake_for_pushes_and_redeliveries() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let waiting = tokio::spawn({
        let api = api.clone();
        async move { (claim(&api, "run", json!({"wait_s": 50, "ttl_s": 2})).await, Instant::now()) }
    });
    // The spawned task sends its request before this one: both run on one thread. The rollout takes longer still.
    tokio::task::yield_now().await;
    let _ =
        put_policy(&api, "run", json!({"policy": "hold", "max_unacknowledged_groups": 1})).await.expect(200);
    wait_for_policy(&api, "run", "a group is pushed", |policy| number(&policy["groups"]) == 1).await;
    let pushed = Instant::now();
    let (groups, woken) = waiting.await.unwrap();
    assert_eq!(groups.len(), 1);
    assert!(woken.saturating_duration_since(pushed) < WAKE_LIMIT);
    // No further group is pushed, but the delivery of this one times out after 2 s.
    let start = Instant::now();
    let redelivered = claim(&api, "run", json!({"wait_s": 50})).await;
    assert_eq!((ids(&redelivered), &redelivered[0]["deliveries"]), (ids(&groups), &json!(2)));
    assert!(start.elapsed() < WAKE_LIMIT, "{:?}", start.elapsed());
    // Without a group, the poll returns after `wait_s`.
    let start = Instant::now();
    assert!(claim(&api, "run", json!({"wait_s": 1})).await.is_empty());
    assert!((Duration::from_millis(900)..WAKE_LIMIT).contains(&start.elapsed()));
    // A poll with a cursor is woken, too.
    let after = ids(&groups)[0];
    let following = tokio::spawn({
        let api = api.clone();
        async move { read(&api, "run", &format!("after={after}&wait_s=50")).await }
    });
    ack(&api, "run", &ids(&groups)).await;
    assert!(number(&following.await.unwrap()[0]["id"]) > after);
}

/// At most 64 requests wait at a time: one more is rejected, and requests without `wait_s` are served. A server that stops
/// ends all of them.
#[tokio::test]
async fn number_of_long_polls_is_bounded() {
    let mut server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let mut waiting = tokio::task::JoinSet::new();
    for _ in 0..65 {
        let api = api.clone();
        waiting
            .spawn(async move { api.post("/v1/runs/run/trajectories/claim", json!({"wait_s": 60})).await });
    }
    // Only the rejected request returns at once.
    let rejected = waiting.join_next().await.unwrap().unwrap();
    assert_eq!((rejected.status, rejected.retry_after.as_deref()), (429, Some("5")));
    assert_eq!(rejected.body["type"], "urn:sparring:problem:too_many_polls");
    assert_eq!(api.get("/v1/runs/run/trajectories").await.expect(200)["groups"], json!([]));
    assert_eq!(waiting.len(), 64);
    let start = Instant::now();
    server.stop().await;
    assert!(start.elapsed() < WAKE_LIMIT, "{:?}", start.elapsed());
    while let Some(poll) = waiting.join_next().await {
        assert_eq!(poll.unwrap().expect(200)["groups"], json!([]));
    }
}
