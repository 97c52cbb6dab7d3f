//! Series of a run over time and over episodes: every result is in exactly one point.

use std::collections::BTreeMap;
use std::sync::atomic::Ordering;

use clock::{Clock, ManualClock};
use serde_json::{Value, json};
use system_tests::{ApiClient, Server, wait_until};

use super::{create_run, report_groups};

const MINUTE: i64 = 60_000;
const HOUR: i64 = 60 * MINUTE;
const DAY: i64 = 24 * HOUR;
/// Start of an hour, in milliseconds.
const START: i64 = 1_800_000_000_000;

fn sum(series: &Value, column: &str) -> i64 {
    let values = series["tasks"][0][column].as_array().expect("a column");
    values.iter().map(|value| value.as_i64().expect("a count")).sum()
}

async fn series(api: &ApiClient, from: i64, to: i64, points: u32) -> Value {
    let timestamp = |at: i64| jiff::Timestamp::from_millisecond(at).expect("a moment").to_string();
    let path = format!("/v1/runs/run/series?from={}&to={}&points={points}", timestamp(from), timestamp(to));
    api.get(&path).await.expect(200)
}

/// Mastery is sampled at intervals, but the last point always has the current value.
#[tokio::test]
async fn last_point_has_the_current_mastery() {
    let ManualClock { clock, time: clock_ms } = Clock::manual(START);
    let server = Server::with_clock(clock).await;
    let api = server.api();
    create_run(&api, json!({})).await;
    for after in [0, 0, 3 * MINUTE, 0, 0] {
        clock_ms.fetch_add(after, Ordering::SeqCst);
        report_groups(&api, 9, "heuristic").await;
        let now = clock_ms.load(Ordering::SeqCst) + 1;
        let mastery = api.get("/v1/runs/run/mastery").await.expect(200)["tasks"][0]["mastery"].clone();
        let task_series = series(&api, START, now, 2000).await["tasks"][0].clone();
        for (column, key) in [("mastery", "mean"), ("mastery_low", "q10"), ("mastery_high", "q90")] {
            assert_eq!(
                task_series[column].as_array().and_then(|values| values.last()),
                Some(&mastery[key]),
                "{mastery}"
            );
        }
    }
}

/// Mean duration of a task's episodes in a series of one point.
async fn mean_duration(settings: Value) -> Value {
    let ManualClock { clock, .. } = Clock::manual(START);
    let server = Server::with_clock(clock).await;
    let api = server.api();
    create_run(&api, settings).await;
    report_groups(&api, 4, "random").await;
    report_groups(&api, 3, "random").await;
    let durations = &series(&api, START, START + 1, 2000).await["tasks"][0]["duration_s"];
    assert_eq!(durations.as_array().map(Vec::len), Some(1));
    durations[0].clone()
}

#[tokio::test]
async fn durations_of_episodes_are_averaged() {
    let levels = json!({"columns": ["time_limit_s"], "rows": [[1800]]});
    let task_settings = json!({"tasking/scanning": {"levels": levels}});
    let scanning = json!({"tasks": ["tasking/scanning"], "task_settings": task_settings});
    // The episodes are too short for a death.
    assert_eq!(mean_duration(scanning).await, json!(1800.0));
    assert_eq!(mean_duration(json!({})).await, Value::Null, "steps of kessler have one duration");
}

#[tokio::test]
async fn buckets_sum_to_all_results() {
    let ManualClock { clock, time: clock_ms } = Clock::manual(START);
    let server = Server::with_clock(clock).await;
    let api = server.api();
    create_run(&api, json!({"group_size": 2})).await;
    let mut reported = 0;
    for (after, groups) in [(0, 6), (10_000, 3), (MINUTE, 9), (3 * MINUTE, 3), (50 * MINUTE, 6)] {
        clock_ms.fetch_add(after, Ordering::SeqCst);
        report_groups(&api, groups, if groups == 9 { "hold" } else { "heuristic" }).await;
        reported += 2 * i64::from(groups);
    }
    // Two groups are never reported: they are lost when their lease expires.
    let lost = api.lease("run", json!({"groups": 2, "ttl_s": 60})).await;
    clock_ms.fetch_add(2 * MINUTE, Ordering::SeqCst);
    wait_until("the lease expires", async || {
        api.get(&format!("/v1/runs/run/leases/{}", lost.id())).await.expect(200)["status"] == "expired"
    })
    .await;
    let mastery = api.get("/v1/runs/run/mastery").await.expect(200)["tasks"][0].clone();
    let plain = &mastery["results"];
    let count = |key: &str| plain[key].as_i64().expect("a count");
    assert_eq!(count("episodes") + count("failed"), reported);
    assert_eq!(count("expired"), 4);

    let now = clock_ms.load(Ordering::SeqCst);
    let all = series(&api, START, now, 2000).await;
    let task = &all["tasks"][0];
    assert_eq!(all["resolution"], "episodes", "some minutes would be too coarse");
    assert_eq!((sum(&all, "episodes"), sum(&all, "lost")), (count("episodes"), count("failed") + 4));
    // Results are in the minute of their report; the minutes between have none.
    let until = task["until"].as_array().unwrap();
    let mut by_minute: BTreeMap<i64, i64> = BTreeMap::new();
    for (until, n) in until.iter().zip(task["episodes"].as_array().unwrap()) {
        let minute = (until.as_f64().unwrap() as i64 - START / 1000) / 60;
        *by_minute.entry(minute).or_default() += n.as_i64().unwrap();
    }
    by_minute.retain(|_, n| *n > 0);
    assert_eq!(by_minute, BTreeMap::from([(0, 12), (1, 12), (4, 4), (54, 8)]));
    let is_empty = |n: &&Value| **n == json!(0);
    let gaps = task["episodes"].as_array().unwrap().iter().filter(is_empty).count();
    assert!(gaps >= 4, "empty points separate times with results");
    // Shares and means agree with the sums of the run.
    let weighed = |column: &str| {
        let values = task[column].as_array().unwrap().iter().zip(task["episodes"].as_array().unwrap());
        values.map(|(value, n)| value.as_f64().unwrap_or(0.0) * n.as_f64().unwrap()).sum::<f64>()
    };
    let close = |left: f64, right: &Value| (left - right.as_f64().unwrap()).abs() < 1e-9;
    // A missing episode counts as a failure.
    let ended = |at: usize| task["episodes"][at].as_i64().unwrap() + task["lost"][at].as_i64().unwrap();
    let success = task["success"].as_array().unwrap().iter().enumerate();
    let successes: f64 = success.map(|(at, value)| value.as_f64().unwrap_or(0.0) * ended(at) as f64).sum();
    assert!((successes - count("successes") as f64).abs() < 1e-9, "{successes}");
    assert!(close(weighed("score") / count("episodes") as f64, &plain["score"]), "{plain}");
    // Fewer points have the same sums.
    for points in [1, 7, 60] {
        let fewer = series(&api, START, now, points).await;
        assert_eq!(sum(&fewer, "episodes"), count("episodes"), "in {points}");
        assert!(fewer["tasks"][0]["at"].as_array().unwrap().len() <= 3 * points as usize + 3);
    }
    // A range has the results of that range only.
    let part = series(&api, START + MINUTE, START + 5 * MINUTE, 2000).await;
    assert_eq!(sum(&part, "episodes"), 16);
    let nothing = series(&api, START + 10 * MINUTE, START + 20 * MINUTE, 2000).await;
    assert_eq!(nothing["tasks"], json!([]));
    assert_task_state(task, &mastery);
    let overview = api.get("/v1/runs/run/overview").await.expect(200);
    assert_eq!((&overview["episodes"], &overview["leases"]), (&plain["episodes"], &json!(0)));
    assert_eq!(overview["tasks"][0]["level"], mastery["level"]);
}

/// A run of some seconds has a point for each few episodes, with what came before it.
#[tokio::test]
async fn fast_run_shows_its_course_over_episodes() {
    let ManualClock { clock, time: clock_ms } = Clock::manual(START);
    let server = Server::with_clock(clock).await;
    let api = server.api();
    create_run(&api, json!({"group_size": 2})).await;
    for version in 0..8 {
        clock_ms.fetch_add(1_500, Ordering::SeqCst);
        let lease = api.lease("run", json!({"groups": 3, "policy_version": version})).await;
        api.report("run", lease.results("hold")).await;
    }
    let numbers = |series: &Value, column: &str| -> Vec<i64> {
        let values = series["tasks"][0][column].as_array().expect("a column");
        values.iter().map(|value| value.as_i64().expect("a number")).collect()
    };
    let get = async |query: &str| api.get(&format!("/v1/runs/run/series?{query}")).await.expect(200);
    let all = get("by=episodes").await;
    assert_eq!(numbers(&all, "first_episode"), (0..8).map(|lease| 6 * lease).collect::<Vec<_>>());
    assert_eq!(numbers(&all, "episodes"), [6; 8]);
    assert_eq!(
        (numbers(&all, "version_low"), numbers(&all, "version_high")),
        ((0..8).collect(), (0..8).collect())
    );
    // An episode of survival has at most 50 steps, and all of holding satellites that survive.
    let steps = numbers(&all, "first_step");
    assert!(steps.windows(2).all(|pair| (6..=300).contains(&(pair[1] - pair[0]))), "{steps:?}");
    // The same points over time, each from the end of the one before it.
    let over_time = series(&api, START, START + MINUTE, 2000).await;
    assert_eq!(over_time["resolution"], "episodes");
    let seconds = |column: &str| -> Vec<f64> {
        let values = over_time["tasks"][0][column].as_array().expect("a column");
        values.iter().map(|value| value.as_f64().expect("a time") - START as f64 / 1000.0).collect()
    };
    assert_eq!(seconds("until"), [1.5, 3.0, 4.5, 6.0, 7.5, 9.0, 10.5, 12.0]);
    assert_eq!(seconds("at"), [1.5, 1.5, 3.0, 4.5, 6.0, 7.5, 9.0, 10.5]);
    // A range, and fewer points.
    let part = get("by=episodes&from_episode=13&to_episode=20").await;
    assert_eq!(numbers(&part, "first_episode"), [12, 18]);
    let fewer = get("by=episodes&points=2").await;
    assert_eq!((numbers(&fewer, "first_episode"), numbers(&fewer, "episodes")), (vec![0, 24], vec![24, 24]));
    for (query, field) in [
        ("by=episodes&from=2027-01-15T08:00:00Z", "from"),
        ("by=episodes&to=2027-01-15T08:00:00Z", "to"),
        ("from_episode=1", "by"),
        ("by=time&to_episode=1", "by"),
        ("by=episodes&from_episode=9&to_episode=8", "to_episode"),
    ] {
        let refused = api.get(&format!("/v1/runs/run/series?{query}")).await.expect(422);
        assert_eq!(refused["field"], field, "{query}");
    }
}

/// Checks that the last values are those of the task, and that params are those of its level.
fn assert_task_state(task: &Value, mastery: &Value) {
    let last =
        |column: &str| task[column].as_array().expect("a column").iter().rfind(|v| !v.is_null()).cloned();
    assert_eq!(last("level"), Some(mastery["level"].clone()));
    assert!(last("mastery").is_some_and(|mean| (0.0..=1.0).contains(&mean.as_f64().expect("a share"))));
    let debris = task["params"]["debris"]["mean"].as_array().expect("a column");
    assert!(debris.iter().any(|value| value.as_f64().is_some_and(|n| n >= 1.0)), "{debris:?}");
}

/// Buckets of a minute are removed after a week, those of an hour are kept; older ranges have buckets of an hour.
#[tokio::test]
async fn series_is_hourly_after_a_week() {
    let ManualClock { clock, time: clock_ms } = Clock::manual(START);
    let mut server = Server::with_clock(clock).await;
    let api = server.api();
    create_run(&api, json!({})).await;
    report_groups(&api, 6, "heuristic").await;
    clock_ms.fetch_add(10 * MINUTE, Ordering::SeqCst);
    report_groups(&api, 3, "heuristic").await;
    clock_ms.fetch_add(8 * DAY, Ordering::SeqCst);
    let now = clock_ms.load(Ordering::SeqCst);
    let task_series = series(&api, START, now, 4).await;
    assert_eq!((&task_series["resolution"], sum(&task_series, "episodes")), (&json!("hours"), 6));
    let fine = series(&api, START, now, 2000).await;
    assert_eq!(
        (&fine["resolution"], sum(&fine, "episodes")),
        (&json!("episodes"), 6),
        "the curve keeps more"
    );
    // The server removes old buckets when it starts, and every hour.
    server.restart().await;
    let api = server.api();
    let db = server.db_path();
    let bucket_counts = || async {
        use sqlx::{Connection, Row};
        let options = sqlx::sqlite::SqliteConnectOptions::new().filename(&db).read_only(true);
        let mut conn = sqlx::SqliteConnection::connect_with(&options).await.unwrap();
        let row = sqlx::query(
            "SELECT count(*) FILTER (WHERE width = 60000), count(*) FILTER (WHERE width = 3600000)
             FROM (SELECT width FROM task_history UNION ALL SELECT DISTINCT width FROM task_history_rungs)",
        )
        .fetch_one(&mut conn)
        .await
        .unwrap();
        (row.get::<i64, _>(0), row.get::<i64, _>(1))
    };
    wait_until("buckets of a minute are removed", async || bucket_counts().await.0 == 0).await;
    assert_eq!(bucket_counts().await.1, 2, "results of the task, and those by rung");
    assert_eq!(sum(&series(&api, START, now, 2000).await, "episodes"), 6);
    report_groups(&api, 3, "heuristic").await;
    assert_eq!(bucket_counts().await, (2, 3), "new results are in buckets of a minute");
}
