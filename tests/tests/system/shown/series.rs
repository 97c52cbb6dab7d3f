//! A run over time: what came back is in one bucket, and in no other; all buckets together are what came back.

use std::sync::atomic::Ordering;

use orchestrator::clock::Clock;
use serde_json::{Value, json};
use system_tests::{Api, Server};

use super::{fly, run};

const MINUTE: i64 = 60_000;
const HOUR: i64 = 60 * MINUTE;
const DAY: i64 = 24 * HOUR;
/// The beginning of an hour.
const START: i64 = 1_800_000_000_000;

fn sum(series: &Value, column: &str) -> i64 {
    let values = series["tasks"][0][column].as_array().expect("a column");
    values.iter().map(|value| value.as_i64().expect("a count")).sum()
}

async fn series(api: &Api, from: i64, to: i64, points: u32) -> Value {
    let moment = |at: i64| jiff::Timestamp::from_millisecond(at).expect("a moment").to_string();
    let path = format!("/v1/runs/run/series?from={}&to={}&points={points}", moment(from), moment(to));
    api.get(&path).await.expect(200)
}

/// Where a task stands is looked at now and then; what came in between is in the last point nevertheless.
#[tokio::test]
async fn the_last_point_says_where_a_task_stands_now() {
    let (clock, hand) = Clock::manual(START);
    let server = Server::with_clock(clock).await;
    let api = server.api();
    run(&api, json!({})).await;
    for after in [0, 0, 3 * MINUTE, 0, 0] {
        hand.fetch_add(after, Ordering::SeqCst);
        fly(&api, 9, "heuristic").await;
        let now = hand.load(Ordering::SeqCst) + 1;
        let standing = api.get("/v1/runs/run/mastery").await.expect(200)["tasks"][0]["mastery"].clone();
        let told = series(&api, START, now, 2000).await["tasks"][0].clone();
        for (column, key) in [("mastery", "mean"), ("mastery_low", "q10"), ("mastery_high", "q90")] {
            assert_eq!(
                told[column].as_array().and_then(|values| values.last()),
                Some(&standing[key]),
                "{standing}"
            );
        }
    }
}

#[tokio::test]
async fn all_buckets_together_are_what_came_back() {
    let (clock, hand) = Clock::manual(START);
    let server = Server::with_clock(clock).await;
    let api = server.api();
    run(&api, json!({"group_size": 2})).await;
    let mut flown = 0;
    for (after, groups) in [(0, 6), (10_000, 3), (MINUTE, 9), (3 * MINUTE, 3), (50 * MINUTE, 6)] {
        hand.fetch_add(after, Ordering::SeqCst);
        fly(&api, groups, if groups == 9 { "hold" } else { "heuristic" }).await;
        flown += 2 * i64::from(groups);
    }
    // Two groups are never reported: they are lost when their lease runs out.
    let lost = api.lease("run", json!({"groups": 2, "ttl_s": 60})).await;
    hand.fetch_add(2 * MINUTE, Ordering::SeqCst);
    loop {
        let standing = api.get(&format!("/v1/runs/run/leases/{}", lost.id())).await.expect(200);
        if standing["status"] == "expired" {
            break;
        }
        tokio::time::sleep(std::time::Duration::from_millis(50)).await;
    }
    let mastery = api.get("/v1/runs/run/mastery").await.expect(200)["tasks"][0].clone();
    let plain = &mastery["plain"];
    let count = |key: &str| plain[key].as_i64().expect("a count");
    assert_eq!(count("episodes") + count("failed"), flown);
    assert_eq!(count("expired"), 4);

    let now = hand.load(Ordering::SeqCst);
    let all = series(&api, START, now, 2000).await;
    let task = &all["tasks"][0];
    assert_eq!(all["width_s"], 60);
    assert_eq!((sum(&all, "episodes"), sum(&all, "lost")), (count("episodes"), count("failed") + 4));
    // Minutes in which something came back, each with its own; what was quiet between them has nothing.
    let at = task["at"].as_array().unwrap();
    let came: Vec<(i64, i64)> = at
        .iter()
        .zip(task["episodes"].as_array().unwrap())
        .map(|(at, n)| ((at.as_i64().unwrap() - START / 1000) / 60, n.as_i64().unwrap()))
        .filter(|(_, n)| *n > 0)
        .collect();
    assert_eq!(came, [(0, 12), (1, 12), (4, 4), (54, 8)]);
    assert!(at.len() > came.len(), "a line between them would claim what was not");
    // Shares and means are of the same sums.
    let weighed = |column: &str| {
        let values = task[column].as_array().unwrap().iter().zip(task["episodes"].as_array().unwrap());
        values.map(|(value, n)| value.as_f64().unwrap_or(0.0) * n.as_f64().unwrap()).sum::<f64>()
    };
    let close = |left: f64, right: &Value| (left - right.as_f64().unwrap()).abs() < 1e-9;
    assert!(
        (weighed("success") - plain["success"].as_f64().unwrap() * count("episodes") as f64).abs() < 1e-9
    );
    assert!(close(weighed("score") / count("episodes") as f64, &plain["score"]), "{plain}");
    // Fewer points are sums of them, and an hour is as much.
    for points in [1, 7, 60] {
        let fewer = series(&api, START, now, points).await;
        assert_eq!(sum(&fewer, "episodes"), count("episodes"), "in {points}");
        assert!(fewer["tasks"][0]["at"].as_array().unwrap().len() <= 3 * points as usize + 1);
    }
    // A stretch is what came in it.
    let part = series(&api, START + MINUTE, START + 5 * MINUTE, 2000).await;
    assert_eq!(sum(&part, "episodes"), 16);
    let nothing = series(&api, START + 10 * MINUTE, START + 20 * MINUTE, 2000).await;
    assert_eq!(nothing["tasks"], json!([]));
    stands(task, &mastery);
    let glance = api.get("/v1/runs/run/overview").await.expect(200);
    assert_eq!((&glance["episodes"], &glance["leases"]), (&plain["episodes"], &json!(0)));
    assert_eq!(glance["tasks"][0]["level"], mastery["level"]);
}

/// Where the task stands is known at the end, and the params of what came back are those of its level.
fn stands(task: &Value, mastery: &Value) {
    let last =
        |column: &str| task[column].as_array().expect("a column").iter().rfind(|v| !v.is_null()).cloned();
    assert_eq!(last("level"), Some(mastery["level"].clone()));
    assert!(last("mastery").is_some_and(|mean| (0.0..=1.0).contains(&mean.as_f64().expect("a share"))));
    let debris = task["params"]["debris"]["mean"].as_array().expect("a column");
    assert!(debris.iter().any(|value| value.as_f64().is_some_and(|n| n >= 1.0)), "{debris:?}");
}

/// Minutes are forgotten after a week, hours are not; a stretch of before a week is told in hours.
#[tokio::test]
async fn after_a_week_it_is_told_in_hours() {
    let (clock, hand) = Clock::manual(START);
    let mut server = Server::with_clock(clock).await;
    let api = server.api();
    run(&api, json!({})).await;
    fly(&api, 6, "heuristic").await;
    hand.fetch_add(10 * MINUTE, Ordering::SeqCst);
    fly(&api, 3, "heuristic").await;
    hand.fetch_add(8 * DAY, Ordering::SeqCst);
    let now = hand.load(Ordering::SeqCst);
    let told = series(&api, START, now, 2000).await;
    assert_eq!((&told["width_s"], sum(&told, "episodes")), (&json!(3600), 6));
    // The service sees to it when it starts, and every hour.
    server.restart().await;
    let api = server.api();
    let db = server.db();
    let rows = || async {
        use sqlx::{Connection, Row};
        let options = sqlx::sqlite::SqliteConnectOptions::new().filename(&db).read_only(true);
        let mut conn = sqlx::SqliteConnection::connect_with(&options).await.unwrap();
        let row = sqlx::query("SELECT count(*) FILTER (WHERE width = 60000), count(*) FILTER (WHERE width = 3600000) FROM history")
            .fetch_one(&mut conn)
            .await
            .unwrap();
        (row.get::<i64, _>(0), row.get::<i64, _>(1))
    };
    while rows().await.0 > 0 {
        tokio::time::sleep(std::time::Duration::from_millis(50)).await;
    }
    assert_eq!(rows().await.1, 1);
    assert_eq!(sum(&series(&api, START, now, 2000).await, "episodes"), 6);
    fly(&api, 3, "heuristic").await;
    assert_eq!(rows().await, (1, 2), "what comes now is a minute again");
}
