//! Pulling and acknowledging: at least once, in order, woken in time, within bounds.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use orchestrator::clock::Clock;
use serde_json::{Value, json};
use system_tests::Server;

use super::{ack, ids, number, policy, pull, put, run, until};

/// A manual clock's start: any day.
const DAY: i64 = 1_790_000_000_000;

#[tokio::test]
async fn what_is_not_acknowledged_comes_again_and_what_is_does_not() {
    let (clock, hand) = Clock::manual(DAY);
    let server = Server::with_clock(clock).await;
    let api = server.api();
    run(&api, "run", json!({})).await;
    run(&api, "other", json!({})).await;
    let _ = put(&api, "run", json!({"policy": "hold", "ahead": 4})).await.expect(200);
    until(&api, "run", "full", |told| told["feed"]["full"] == true).await;
    let _ = put(&api, "run", json!({"policy": "off", "ahead": 4})).await.expect(200);
    let first = pull(&api, "run", "limit=3&ttl_s=60").await;
    assert_eq!(first.len(), 3);
    assert!(first.iter().all(|group| group["deliveries"] == 1));
    let second = pull(&api, "run", "limit=3&ttl_s=120").await;
    assert_eq!(second.len(), 1, "what is claimed is nobody else's");
    let [a, b, c] = <[i64; 3]>::try_from(ids(&first)).unwrap();
    assert!(a < b && b < c && c < ids(&second)[0]);
    assert!(pull(&api, "run", "").await.is_empty());
    assert_eq!(ack(&api, "run", &[a]).await, json!({"acked": [a], "unknown": []}));
    hand.fetch_add(61_000, Ordering::SeqCst);
    let again = pull(&api, "run", "ttl_s=60").await;
    assert_eq!(ids(&again), [b, c]);
    assert!(again.iter().all(|group| group["deliveries"] == 2));
    let same = |one: &Value| {
        let mut one = one.clone();
        one["deliveries"] = Value::Null;
        one
    };
    assert_eq!(again.iter().map(same).collect::<Vec<_>>(), first[1..].iter().map(same).collect::<Vec<_>>());
    // Twice is once; what another run has, or nobody, is unknown.
    assert_eq!(ack(&api, "run", &[a, b, 999]).await, json!({"acked": [a, b], "unknown": [999]}));
    assert_eq!(ack(&api, "other", &[c]).await, json!({"acked": [], "unknown": [c]}));
    hand.fetch_add(200_000, Ordering::SeqCst);
    assert_eq!(ids(&pull(&api, "run", "").await), [c, ids(&second)[0]]);
    // Acknowledged once its time is over it is done with all the same.
    hand.fetch_add(1_000_000, Ordering::SeqCst);
    ack(&api, "run", &[c]).await;
    assert_eq!(ids(&pull(&api, "run", "").await), ids(&second));
    // All can be read again, which claims nothing.
    let all = pull(&api, "run", "after=0").await;
    assert_eq!(ids(&all), [a, b, c, ids(&second)[0]]);
    assert_eq!(all.iter().map(|group| number(&group["deliveries"])).collect::<Vec<_>>(), [1, 2, 3, 3]);
    let told = api.get(&format!("/v1/runs/run/trajectories?after={a}&limit=2")).await.expect(200);
    assert_eq!((ids(told["groups"].as_array().unwrap()), &told["next"]), (vec![b, c], &json!(c)));
    let told = api.get("/v1/runs/run/trajectories?after=9999").await.expect(200);
    assert_eq!(told, json!({"groups": [], "next": 9999}));
}

/// Of what is acknowledged the newest 256 groups are kept.
#[tokio::test]
async fn what_is_acknowledged_is_kept_for_a_while() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run", json!({"group_size": 1})).await;
    let _ =
        put(&api, "run", json!({"policy": "hold", "ahead": 300, "observations": "none"})).await.expect(200);
    until(&api, "run", "full", |told| told["feed"]["full"] == true).await;
    let _ = put(&api, "run", json!({"policy": "off"})).await.expect(200);
    let mut all = ids(&pull(&api, "run", "limit=256").await);
    all.extend(ids(&pull(&api, "run", "limit=256").await));
    assert_eq!(all.len(), 300);
    ack(&api, "run", &all).await;
    assert_eq!(number(&policy(&api, "run").await["feed"]["acked"]), 256);
    assert_eq!(ids(&pull(&api, "run", "after=0&limit=256").await), all[44..]);
    assert_eq!(ack(&api, "run", &all[43..45]).await, json!({"acked": [all[44]], "unknown": [all[43]]}));
}

#[tokio::test]
async fn who_waits_is_woken_by_a_push_and_by_a_time_that_is_over() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run", json!({})).await;
    let waiting = tokio::spawn({
        let api = api.clone();
        async move { (pull(&api, "run", "wait_s=50&ttl_s=2").await, Instant::now()) }
    });
    tokio::time::sleep(Duration::from_millis(300)).await;
    let _ = put(&api, "run", json!({"policy": "hold", "ahead": 1})).await.expect(200);
    until(&api, "run", "pushed", |told| number(&told["groups"]) == 1).await;
    let pushed = Instant::now();
    let (groups, woken) = waiting.await.unwrap();
    assert_eq!(groups.len(), 1);
    assert!(woken.saturating_duration_since(pushed) < Duration::from_secs(1));
    // Nothing is pushed any more, but the time of this one will be over.
    let begun = Instant::now();
    let again = pull(&api, "run", "wait_s=50").await;
    assert_eq!((ids(&again), &again[0]["deliveries"]), (ids(&groups), &json!(2)));
    assert!(begun.elapsed() < Duration::from_secs(4), "{:?}", begun.elapsed());
    // Nothing comes: the answer does.
    let begun = Instant::now();
    assert!(pull(&api, "run", "wait_s=1").await.is_empty());
    assert!((Duration::from_millis(900)..Duration::from_secs(4)).contains(&begun.elapsed()));
    // Who follows by a cursor is woken too.
    let after = ids(&groups)[0];
    let following = tokio::spawn({
        let api = api.clone();
        async move { pull(&api, "run", &format!("after={after}&wait_s=50")).await }
    });
    ack(&api, "run", &ids(&groups)).await;
    assert!(number(&following.await.unwrap()[0]["id"]) > after);
}

/// Sixty-four wait; one more is told to come again, and those that do not wait are answered. A server that stops lets them
/// all go.
#[tokio::test]
async fn only_so_many_wait_at_a_time() {
    let mut server = Server::start().await;
    let api = server.api();
    run(&api, "run", json!({})).await;
    let mut waiting = tokio::task::JoinSet::new();
    for _ in 0..65 {
        let api = api.clone();
        waiting.spawn(async move { api.get("/v1/runs/run/trajectories?wait_s=60").await });
    }
    // Whoever comes last is answered first.
    let refused = waiting.join_next().await.unwrap().unwrap();
    assert_eq!((refused.status, refused.retry_after.as_deref()), (429, Some("5")));
    assert_eq!(refused.body["type"], "urn:sparring:problem:too_many_polls");
    assert_eq!(api.get("/v1/runs/run/trajectories").await.expect(200)["groups"], json!([]));
    assert_eq!(waiting.len(), 64);
    let begun = Instant::now();
    server.stop().await;
    assert!(begun.elapsed() < Duration::from_secs(8), "{:?}", begun.elapsed());
    while let Some(waited) = waiting.join_next().await {
        assert_eq!(waited.unwrap().expect(200)["groups"], json!([]));
    }
}
