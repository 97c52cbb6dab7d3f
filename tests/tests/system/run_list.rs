//! List of runs: search, filters, order, pages, groups and notes.

use std::collections::BTreeSet;
use std::path::Path;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection};
use system_tests::{ApiClient, Server, ServerProcess};

const TASK: &str = "kessler/survival";
const SORTS: [&str; 5] = ["created", "name", "episodes", "last_results", "skill"];

async fn create(api: &ApiClient, id: &str, settings: Value) {
    let mut request = json!({"id": id, "tasks": [TASK], "strategy": "ladder", "design": {"designer": "off"}});
    request.as_object_mut().unwrap().extend(settings.as_object().unwrap().clone());
    let _ = api.post("/v1/runs", request).await.expect(201);
}

/// Returns the ids of a list of runs.
fn ids(page: &Value) -> Vec<String> {
    page["runs"].as_array().unwrap().iter().map(|run| run["id"].as_str().unwrap().to_owned()).collect()
}

async fn listed(api: &ApiClient, query: &str) -> Vec<String> {
    ids(&api.get(&format!("/v1/runs?{query}")).await.expect(200))
}

/// Runs a statement in the database of a server that is running.
async fn execute(db: &Path, statement: &str) {
    let options = SqliteConnectOptions::new().filename(db).busy_timeout(Duration::from_secs(60));
    let mut conn = options.connect().await.unwrap();
    sqlx::query(sqlx::AssertSqlSafe(statement)).execute(&mut conn).await.unwrap();
    conn.close().await.unwrap();
}

/// Inserts `count` copies of the run `seed`, without its queues: a list does not read them. A third has no results, many values are
/// equal, and some names differ by their case only.
async fn copy_runs(db: &Path, count: u32) {
    execute(
        db,
        &format!(
            "WITH RECURSIVE n (n) AS (SELECT 0 UNION ALL SELECT n + 1 FROM n WHERE n < {count} - 1)
             INSERT INTO runs (id, name, seed, status, settings, created_at, note, strategy, tasks)
             SELECT printf('copy-%d', n), iif(n % 2, 'Name ', 'name ') || n % 7, n, 'active', settings, created_at + n / 3,
                    'note ' || n % 5, strategy, tasks
             FROM n CROSS JOIN runs WHERE id = 'seed'"
        ),
    )
    .await;
    execute(
        db,
        "INSERT INTO run_totals (run, episodes, first_results_at, last_results_at, skill, skill_weight)
         SELECT id, seed % 11, created_at, created_at + seed % 13, iif(seed % 4, seed % 9 / 9.0 - 0.3, NULL), 1
         FROM runs WHERE id LIKE 'copy-%' AND seed % 3 > 0",
    )
    .await;
    execute(
        db,
        "INSERT INTO run_tags (run, tag, run_created_at)
         SELECT id, 't' || seed % 6, created_at FROM runs WHERE id LIKE 'copy-%' AND seed % 2",
    )
    .await;
}

/// Reads all pages of a list. Creates a run after each page if `creates` is true.
async fn all_pages(api: &ApiClient, query: &str, limit: u32, creates: bool) -> Vec<Value> {
    let (mut all, mut cursor, mut total) = (Vec::new(), String::new(), None);
    for page_number in 0.. {
        let page = api.get(&format!("/v1/runs?limit={limit}&{query}{cursor}")).await.expect(200);
        assert_eq!(page["total"].is_null(), page_number > 0, "only the first page has the number of runs");
        total = total.or(page["total"].as_u64());
        all.extend(page["runs"].as_array().unwrap().iter().cloned());
        if creates {
            create(api, &format!("late-{}-{page_number}", query.len()), json!({"name": "name 3"})).await;
        }
        match page["next"].as_str() {
            Some(next) => cursor = format!("&cursor={}", next.replace(' ', "+")),
            None => break,
        }
    }
    if !creates {
        assert_eq!(Some(all.len() as u64), total, "{query}");
    }
    all
}

/// Key of a run in an order; the first part is true for runs without the value.
fn key(run: &Value, sort: &str) -> (bool, f64, String) {
    let number = |value: &Value| (value.is_null(), value.as_f64().unwrap_or_default(), String::new());
    match sort {
        "created" => (false, 0.0, run["created_at"].as_str().unwrap().to_owned()),
        "name" => (false, 0.0, run["name"].as_str().unwrap().to_ascii_lowercase()),
        "last_results" => {
            let at = &run["last_results_at"];
            (at.is_null(), 0.0, at.as_str().unwrap_or_default().to_owned())
        }
        _ => number(&run[sort]),
    }
}

fn assert_sorted(runs: &[Value], sort: &str, descending: bool) {
    for pair in runs.windows(2) {
        let [(none_a, number_a, text_a), (none_b, number_b, text_b)] =
            [key(&pair[0], sort), key(&pair[1], sort)];
        let id = |run: &Value| run["id"].as_str().unwrap().to_owned();
        let order =
            number_a.total_cmp(&number_b).then(text_a.cmp(&text_b)).then(id(&pair[0]).cmp(&id(&pair[1])));
        let order = if descending { order.reverse() } else { order };
        let is_sorted = (!none_a && none_b) || (none_a == none_b && order.is_lt());
        assert!(is_sorted, "{sort} {descending}: {} before {}", pair[0], pair[1]);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn pages_together_are_the_list_in_every_order_while_runs_are_created() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("db.sqlite3");
    let server = ServerProcess::start(&db);
    let api = server.api();
    create(&api, "seed", json!({})).await;
    copy_runs(&db, 120).await;
    let everything: BTreeSet<String> = listed(&api, "limit=500").await.into_iter().collect();
    assert_eq!(everything.len(), 121);
    for (at, sort) in SORTS.into_iter().enumerate() {
        for order in ["asc", "desc"] {
            let query = format!("sort={sort}&order={order}");
            let all = all_pages(&api, &query, [7, 1, 50, 13, 120][at], false).await;
            assert_sorted(&all, sort, order == "desc");
            let found: BTreeSet<String> = ids(&json!({ "runs": all })).into_iter().collect();
            assert_eq!((found.len(), &found), (all.len(), &everything), "{query}");
        }
        let query = format!("sort={sort}&search=note");
        assert_sorted(&all_pages(&api, &query, 9, false).await, sort, false);
    }
    for (sort, order) in [("name", "asc"), ("skill", "desc"), ("created", "desc")] {
        let all = all_pages(&api, &format!("sort={sort}&order={order}"), 31, true).await;
        assert_sorted(&all, sort, order == "desc");
        let all = ids(&json!({ "runs": all }));
        let found: BTreeSet<&String> = all.iter().collect();
        assert_eq!(found.len(), all.len(), "no run is on two pages");
        assert!(everything.iter().all(|id| found.contains(id)), "{sort}: every earlier run is on a page");
    }
}

#[tokio::test]
async fn search_finds_all_words_in_id_name_note_and_tags() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, "alpha", json!({"name": "Erste Reihe", "tags": ["lr:3e-4"], "note": "with 100% dropout"}))
        .await;
    create(&api, "beta", json!({"tags": ["paper"], "strategy": "uniform"})).await;
    create(&api, "gamma_1", json!({"note": "alpha again"})).await;
    for (search, found) in [
        ("alpha", vec!["alpha", "gamma_1"]),
        ("reihe", vec!["alpha"]),
        ("ALPHA+dropout", vec!["alpha"]),
        ("lr:3E", vec!["alpha"]),
        ("100%25", vec!["alpha"]),
        ("a_1", vec!["gamma_1"]),
        ("%25", vec!["alpha"]),
        ("%5C", vec![]),
        ("paper+alpha", vec![]),
        ("+", vec!["alpha", "beta", "gamma_1"]),
    ] {
        assert_eq!(listed(&api, &format!("search={search}")).await, found, "{search}");
    }
    assert_eq!(api.get("/v1/runs?search=%00").await.expect(422)["field"], "search");
    assert_eq!(listed(&api, "strategy=uniform").await, ["beta"]);
    assert_eq!(listed(&api, "tag=").await, ["gamma_1"]);
    assert_eq!(listed(&api, "tasks=kessler/survival&search=a").await.len(), 3);
    assert_eq!(listed(&api, "tasks=kessler/rendezvous").await, [""; 0]);
    let changed = json!({"strategy": "plr", "tasks": ["kessler/survival", "kessler/rendezvous"]});
    let _ = api.send_json("PATCH", "/v1/runs/beta", changed).await.expect(200);
    assert_eq!(listed(&api, "strategy=plr&tasks=kessler/survival,kessler/rendezvous").await, ["beta"]);
    assert_eq!(listed(&api, "strategy=uniform").await, [""; 0]);
}

#[tokio::test]
async fn note_is_set_searched_kept_and_removed() {
    let mut server = Server::start().await;
    let api = server.api();
    create(&api, "a", json!({})).await;
    assert_eq!(api.get("/v1/runs/a").await.expect(200)["note"], "");
    let put = async |api: &ApiClient, note: Value| {
        api.send_json("PUT", "/v1/runs/a/note", json!({ "note": note })).await
    };
    let set = put(&api, json!("new encoder\nsecond line")).await.expect(200);
    assert_eq!(set["note"], "new encoder\nsecond line");
    server.restart().await;
    let api = server.api();
    assert_eq!(api.get("/v1/runs/a").await.expect(200)["note"], set["note"]);
    assert_eq!(listed(&api, "search=encoder").await, ["a"]);
    let too_long = put(&api, json!("ä".repeat(2001))).await.expect(422);
    assert_eq!(too_long["field"], "note");
    assert_eq!(api.post("/v1/runs", json!({"note": "x".repeat(2001)})).await.expect(422)["field"], "note");
    let _ = put(&api, json!("ä".repeat(2000))).await.expect(200);
    assert_eq!(put(&api, json!("")).await.expect(200)["note"], "");
    let unknown = api.send_json("PUT", "/v1/runs/b/note", json!({"note": ""})).await.expect(404);
    assert_eq!(unknown["type"], "urn:sparring:problem:unknown_run");
}

#[tokio::test]
async fn totals_and_activity_follow_the_results() {
    let server = Server::start().await;
    let api = server.api();
    for id in ["busy", "new", "old"] {
        create(&api, id, json!({})).await;
    }
    let lease = api.lease("busy", json!({"groups": 4})).await;
    let _ = api.report("busy", lease.results("hold")).await;
    let run = api.get("/v1/runs/busy").await.expect(200);
    let overview = api.get("/v1/runs/busy/overview").await.expect(200);
    assert_eq!((&run["episodes"], &run["episodes"]), (&overview["episodes"], &json!(4)));
    assert_eq!(run["last_results_at"], overview["last_results_at"]);
    assert_eq!(run["first_results_at"], overview["first_results_at"]);
    assert_eq!(run["activity"], "running");
    let _ = api.post("/v1/runs/old/archive", Value::Null).await.expect(200);
    let _ = api.post("/v1/runs/new/pause", Value::Null).await.expect(200);
    for (activity, found) in [
        ("running", vec!["busy"]),
        ("waiting", vec![]),
        ("idle", vec![]),
        ("paused", vec!["new"]),
        ("archived", vec!["old"]),
    ] {
        assert_eq!(listed(&api, &format!("activity={activity}")).await, found, "{activity}");
    }
    assert_eq!(listed(&api, "archived=true&activity=archived").await, ["old"]);
    assert_eq!(listed(&api, "sort=episodes&order=desc").await, ["busy", "new"]);
    let groups = api.get("/v1/run_groups?by=activity").await.expect(200);
    let groups: Vec<_> = groups["groups"]
        .as_array()
        .unwrap()
        .iter()
        .map(|group| (group["value"].clone(), group["runs"].clone(), group["episodes"].clone()))
        .collect();
    assert_eq!(groups, [(json!("paused"), json!(1), json!(0)), (json!("running"), json!(1), json!(4))]);
}

#[tokio::test]
async fn groups_have_the_runs_that_their_filter_lists() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, "a", json!({"tags": ["x", "y"]})).await;
    create(&api, "b", json!({"tags": ["x"], "strategy": "uniform"})).await;
    create(&api, "c", json!({"tasks": ["kessler/survival", "kessler/formation"]})).await;
    for (by, values) in [
        ("strategy", vec!["ladder", "uniform"]),
        ("tasks", vec!["kessler/formation,kessler/survival", "kessler/survival"]),
        ("tag", vec!["", "x", "y"]),
        ("activity", vec!["waiting"]),
    ] {
        let groups = api.get(&format!("/v1/run_groups?by={by}")).await.expect(200);
        let groups = groups["groups"].as_array().unwrap();
        assert_eq!(groups.iter().map(|group| group["value"].as_str().unwrap()).collect::<Vec<_>>(), values);
        for group in groups {
            let members = listed(&api, &format!("{by}={}", group["value"].as_str().unwrap())).await;
            assert_eq!(json!(members.len()), group["runs"], "{by}: {group}");
        }
    }
    let searched = api.get("/v1/run_groups?by=strategy&search=b").await.expect(200);
    assert_eq!(searched["groups"].as_array().unwrap().len(), 1);
}

#[tokio::test]
async fn invalid_parameters_are_named() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, "a", json!({})).await;
    create(&api, "b", json!({})).await;
    let next = api.get("/v1/runs?limit=1&sort=skill").await.expect(200)["next"].as_str().unwrap().to_owned();
    let mut problems = Vec::new();
    for path in [
        "/v1/runs?sort=size".to_owned(),
        "/v1/runs?order=up".to_owned(),
        "/v1/runs?activity=busy".to_owned(),
        "/v1/runs?archived=true&activity=idle".to_owned(),
        "/v1/runs?strategy=best".to_owned(),
        "/v1/runs?tasks=kessler/none".to_owned(),
        "/v1/runs?tag=No".to_owned(),
        format!("/v1/runs?search={}", "x".repeat(201)),
        "/v1/runs?search=1+2+3+4+5+6+7+8+9".to_owned(),
        "/v1/runs?cursor=1.a".to_owned(),
        format!("/v1/runs?cursor={next}"),
        format!("/v1/runs?sort=skill&order=desc&cursor={next}"),
        "/v1/runs?sort=skill&cursor=skill.asc.a.7ff0000000000000".to_owned(),
        "/v1/runs?cursor=created.asc.A.1".to_owned(),
        "/v1/runs?cursor=created.asc.a.x".to_owned(),
        "/v1/run_groups".to_owned(),
        "/v1/run_groups?by=seed".to_owned(),
        "/v1/run_groups?by=tag&limit=1".to_owned(),
    ] {
        let response = api.get(&path).await;
        assert!([400, 422].contains(&response.status), "{path}: {}", response.body);
        let problem = &response.body;
        problems.push(format!(
            "{} {}",
            problem["field"].as_str().unwrap(),
            problem["detail"].as_str().unwrap()
        ));
    }
    insta::assert_snapshot!(problems.join("\n"));
    assert_eq!(listed(&api, &format!("sort=skill&cursor={next}")).await, ["b"]);
}

/// A thousand runs: `make bench` measures the same with ten thousand and has a goal for it.
#[tokio::test(flavor = "multi_thread")]
async fn thousand_runs_are_listed_quickly_in_every_order() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("db.sqlite3");
    let server = ServerProcess::start(&db);
    let api = server.api();
    create(&api, "seed", json!({})).await;
    copy_runs(&db, 1000).await;
    let mut times = Vec::new();
    for sort in SORTS {
        for query in ["", "&search=note+name", "&tag=t3", "&order=desc&search=copy-77", "&activity=idle"] {
            for _ in 0..4 {
                let start = Instant::now();
                let _ = api.get(&format!("/v1/runs?limit=100&sort={sort}{query}")).await.expect(200);
                times.push(start.elapsed());
            }
        }
    }
    times.sort();
    let slowest = times[times.len() * 99 / 100];
    println!("median {:?}, 99 % {slowest:?} of {} requests", times[times.len() / 2], times.len());
    // The goal is 100 ms; machines that run tests are often busy, and their builds are not optimised.
    assert!(slowest < Duration::from_secs(2), "{slowest:?}");
}
