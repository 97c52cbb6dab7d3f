//! Retention: a run keeps its newest leases in full. Older leases are compacted to their outcomes, except for what level
//! moves, failure examples and evaluations depend on.

use std::collections::BTreeMap;

use serde_json::{Value, json};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Row};
use system_tests::{ApiClient, Server, episode_result, wait_until};

const SURVIVAL: &str = "kessler/survival";
const ECO: &str = "kessler/eco_station";
/// Number of episodes that the run of these tests keeps in full.
const KEPT_EPISODES: i64 = 64;
const ROUNDS: usize = 44;
/// Number of groups of each lease of a round.
const GROUPS_PER_LEASE: [u32; 3] = [6, 1, 1];

async fn create(api: &ApiClient, placement: bool, retention: Value) {
    let settings = json!({"strategy": "ladder", "id": "run", "seed": 77, "group_size": 2, "target": "mastery", "tasks": [SURVIVAL, ECO],
                      "design": {"designer": "off"}, "placement": placement, "retention": retention});
    let _ = api.post("/v1/runs", settings).await.expect(201);
}

/// Leased groups and reported results of one round of a trainer.
struct Round {
    groups: Vec<Value>,
    reports: Vec<ReportedResult>,
}

/// Result that a trainer sent, and its receipt.
struct ReportedResult {
    result: Value,
    receipt: Value,
}

/// Leases groups and reports their results. The policy improves after four rounds.
async fn train_round(api: &ApiClient, number: usize) -> Round {
    let policy = if number < 4 { "hold" } else { "heuristic" };
    let mut round = Round { groups: Vec::new(), reports: Vec::new() };
    for groups in GROUPS_PER_LEASE {
        let lease = api.lease("run", json!({"groups": groups})).await;
        let results = lease.results(policy);
        let receipts = api.report("run", results.clone()).await["results"].as_array().unwrap().clone();
        for group in lease.0["groups"].as_array().unwrap() {
            round
                .groups
                .push(json!(["scenario", "seed", "task", "level", "role"].map(|field| &group[field])));
        }
        let reports = results.into_iter().zip(receipts);
        round.reports.extend(reports.map(|(result, receipt)| ReportedResult { result, receipt }));
    }
    round
}

async fn list_all(api: &ApiClient, resource: &str, limit: u32) -> Vec<Value> {
    let (mut items, mut cursor) = (Vec::new(), String::new());
    loop {
        let page = api.get(&format!("/v1/runs/run/{resource}?limit={limit}{cursor}")).await.expect(200);
        items.extend(page[resource].as_array().unwrap().clone());
        match page["next"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => return items,
        }
    }
}

pub(crate) async fn query_numbers(server: &Server, sql: &'static str) -> Vec<i64> {
    let mut conn = SqliteConnectOptions::new().filename(server.db_path()).connect().await.unwrap();
    sqlx::query_scalar(sql).fetch_all(&mut conn).await.unwrap()
}

async fn query_number(server: &Server, sql: &'static str) -> i64 {
    query_numbers(server, sql).await[0]
}

/// Waits until the server keeps no more episodes in full than the settings say.
async fn wait_for_compaction(server: &Server) {
    let full = "SELECT coalesce(sum(groups * group_size), 0) FROM leases
                WHERE is_compacted = 0 AND status <> 'active' AND purpose <> 'eval'";
    wait_until("old leases are compacted", async || query_number(server, full).await <= KEPT_EPISODES).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn compacted_leases_keep_their_outcomes() {
    let everything = Server::start().await;
    create(&everything.api(), true, json!({"episodes": "all"})).await;
    let mut server = Server::start().await;
    create(&server.api(), true, json!({"episodes": KEPT_EPISODES})).await;
    let evaluation = server.api().lease("run", json!({"groups": 2, "purpose": "eval"})).await;
    let (id, scenario) = &evaluation.episodes()[0];
    let _ = server.api().report("run", vec![episode_result(id, scenario, "hold")]).await;
    let _ = server
        .api()
        .post(&format!("/v1/runs/run/leases/{}/release", evaluation.id()), json!({}))
        .await
        .expect(200);

    let mut reports = Vec::new();
    for round in 0..ROUNDS {
        if round == ROUNDS / 2 {
            wait_for_compaction(&server).await;
            server.restart().await;
        }
        let uncompacted = train_round(&everything.api(), round).await;
        let compacted = train_round(&server.api(), round).await;
        assert_eq!(uncompacted.groups, compacted.groups, "compaction does not change the proposals");
        reports.extend(compacted.reports);
    }
    wait_for_compaction(&server).await;
    let api = server.api();

    let listed = assert_lists_are_complete(&api, &reports).await;
    let history = |api: ApiClient| async move {
        let history = api.get("/v1/runs/run/level_moves").await.expect(200);
        let points = history["points"].as_array().unwrap();
        let mut n = BTreeMap::<String, (u64, f64)>::new();
        for point in points {
            let of_task = n.entry(point["task"].as_str().unwrap().to_owned()).or_default();
            let count = point["n"].as_u64().unwrap();
            of_task.0 += count;
            of_task.1 += count as f64 * point["success"].as_f64().unwrap();
        }
        let moves: Vec<Value> = history["moves"]
            .as_array()
            .unwrap()
            .iter()
            .map(|m| json!([m["seq"], m["task"], m["to"], m["evidence"]]))
            .collect();
        (n, moves)
    };
    let (expected, moves) = history(everything.api()).await;
    let (points, same_moves) = history(api.clone()).await;
    assert_eq!(moves, same_moves);
    assert!(moves.len() > 2, "the test needs level moves");
    for (task, (n, sum)) in &expected {
        assert_eq!(points[task].0, *n);
        assert!((points[task].1 - sum).abs() < 1e-9);
    }

    assert_compacted_episodes(&api, &listed, &reports).await;
    assert_dependencies_are_kept(&server).await;
}

/// Checks that all lists have every entry with its outcome; returns the list of episodes.
async fn assert_lists_are_complete(api: &ApiClient, reports: &[ReportedResult]) -> Vec<Value> {
    for limit in [500, 7] {
        let heads = list_all(api, "episodes", limit).await;
        assert_eq!(heads.len(), reports.len() + 1, "each episode is listed once");
        let listed: BTreeMap<String, Value> =
            heads.into_iter().map(|head| (head["episode"].as_str().unwrap().to_owned(), head)).collect();
        assert_eq!(listed.len(), reports.len() + 1);
        for ReportedResult { receipt, .. } in reports {
            let head = &listed[receipt["episode"].as_str().unwrap()];
            for field in ["score", "skill", "success"] {
                assert_eq!(
                    head.get(field).unwrap_or(&Value::Null),
                    receipt.get(field).unwrap_or(&Value::Null),
                    "{field} {head} {receipt}"
                );
            }
        }
        assert_eq!(list_all(api, "leases", limit).await.len(), ROUNDS * GROUPS_PER_LEASE.len() + 1);
    }
    // A made-up cursor within the first lease returns the entries that follow.
    let far = api.get("/v1/runs/run/episodes?limit=3&cursor=1.9223372036854775807").await.expect(200);
    assert_eq!(far["episodes"].as_array().unwrap().len(), 3);
    let listed = list_all(api, "episodes", 500).await;
    let expired = listed.iter().filter(|head| head["replay"] == "expired").count();
    assert!(expired > 100, "{expired} of {}", listed.len());
    listed
}

/// Checks episodes and leases that are compacted: details, duplicates of results, and requests for the lease.
async fn assert_compacted_episodes(api: &ApiClient, listed: &[Value], reports: &[ReportedResult]) {
    let old = listed.iter().find(|head| head["replay"] == "expired").unwrap();
    let id = old["episode"].as_str().unwrap();
    let shown = api.get(&format!("/v1/runs/run/episodes/{id}")).await.expect(200);
    assert_eq!(
        (&shown["replay"], &shown["scenario"], &shown["actions"]),
        (&json!("expired"), &Value::Null, &Value::Null)
    );
    assert_eq!((&shown["score"], &shown["state"]), (&old["score"], &json!("finished")));
    for resource in ["replay", "critique"] {
        let gone = api.get(&format!("/v1/runs/run/episodes/{id}/{resource}")).await;
        assert_eq!((gone.status, gone.body["type"].as_str()), (410, Some("urn:sparring:problem:expired")));
    }
    // A repeated result gets the same score.
    let first = reports.iter().find(|report| report.receipt["episode"] == id).unwrap();
    let repeated = api.report("run", vec![first.result.clone()]).await;
    assert_eq!(repeated["results"][0]["status"], "duplicate");
    assert_eq!(repeated["results"][0]["score"], first.receipt["score"]);
    // The same holds for every episode: kept in full, compacted next to a kept one, and removed.
    for batch in reports.chunks(50) {
        let results: Vec<Value> = batch.iter().map(|report| report.result.clone()).collect();
        let repeated = api.report("run", results).await;
        for (repeated, first) in repeated["results"].as_array().unwrap().iter().zip(batch) {
            assert_eq!(
                (&repeated["status"], &repeated["score"]),
                (&json!("duplicate"), &first.receipt["score"]),
                "{repeated}"
            );
        }
    }
    // Leases whose rows are removed.
    let lease = list_all(api, "leases", 500).await;
    let mut gone = 0;
    for lease in lease.iter().map(|lease| lease["lease"].as_str().unwrap()) {
        let response = api.get(&format!("/v1/runs/run/leases/{lease}")).await;
        if response.status == 410 {
            gone += 1;
            let renewed = api.post(&format!("/v1/runs/run/leases/{lease}/renew"), json!({})).await;
            assert_eq!(
                (renewed.status, renewed.body["type"].as_str()),
                (409, Some("urn:sparring:problem:lease_closed"))
            );
            let released =
                api.post(&format!("/v1/runs/run/leases/{lease}/release"), json!({})).await.expect(200);
            assert_eq!(released["status"], "done");
        } else {
            assert_eq!(response.status, 200);
        }
    }
    assert!(gone > 0, "the test needs leases without rows");
}

/// Checks that the data of level moves, failure examples and evaluations is kept, and nothing else.
async fn assert_dependencies_are_kept(server: &Server) {
    let mut conn = SqliteConnectOptions::new().filename(server.db_path()).connect().await.unwrap();
    let moves =
        sqlx::query("SELECT seq, task, evidence FROM level_moves").fetch_all(&mut conn).await.unwrap();
    for row in moves {
        let (seq, task, evidence): (i64, String, String) = (row.get(0), row.get(1), row.get(2));
        let evidence: Value = serde_json::from_str(&evidence).unwrap();
        let parts =
            evidence["blocks"].as_array().unwrap().iter().chain(evidence["probes"].as_array().unwrap());
        let parts: Vec<&Value> = parts.collect();
        let first = parts.iter().map(|part| part["first"].as_i64().unwrap()).min().unwrap();
        let n: i64 = parts.iter().map(|part| part["n"].as_i64().unwrap()).sum();
        let kept: i64 = sqlx::query_scalar(
            "SELECT count(*) FROM groups g WHERE task = ? AND proposal >= ? AND proposal < ? AND is_contested AND is_evidence
             AND role IN ('placement', 'frontier')
             AND (SELECT count(*) FROM action_logs a WHERE a.lease = g.lease AND a.number / 2 = g.number) = 2
             AND EXISTS (SELECT 1 FROM scenarios s WHERE s.id = g.scenario)",
        )
        .bind(&task).bind(first).bind(seq).fetch_one(&mut conn).await.unwrap();
        assert!(kept >= n, "{task} {seq}: {kept} of {n} scenarios of the evidence are kept");
    }
    drop(conn);
    wait_for_removal_of_the_rest(server).await;
    let lost = "SELECT count(*) FROM failure_examples x
                WHERE NOT EXISTS (SELECT 1 FROM action_logs a WHERE a.lease = x.lease AND a.number = x.number)";
    assert_eq!(query_number(server, lost).await, 0);
    assert_eq!(query_number(server, "SELECT count(*) FROM leases WHERE purpose = 'eval'").await, 1);
    let orphans = [
        "SELECT count(*) FROM action_logs a WHERE NOT EXISTS (SELECT 1 FROM episodes e WHERE e.lease = a.lease AND e.number = a.number)",
        "SELECT count(*) FROM scenarios s WHERE NOT EXISTS (SELECT 1 FROM groups g WHERE g.scenario = s.id)
             AND NOT EXISTS (SELECT 1 FROM proposals p WHERE p.scenario = s.id)",
        "SELECT count(*) FROM brackets b WHERE NOT EXISTS (SELECT 1 FROM scenarios s WHERE s.id = b.scenario)",
    ];
    for sql in orphans {
        // Orphans of the last compaction are removed after it.
        wait_until(sql, async || query_number(server, sql).await == 0).await;
    }
    assert_eq!(query_numbers(server, "SELECT 1 FROM pragma_foreign_key_check").await, Vec::<i64>::new());
}

/// Waits until compacted leases have no episodes but failure examples and evidence of past or possible level moves.
async fn wait_for_removal_of_the_rest(server: &Server) {
    let sql = "SELECT count(*) FROM leases l JOIN episodes e ON e.lease = l.id
        JOIN groups g ON g.lease = l.id AND g.number = e.number / l.group_size
        WHERE l.is_compacted = 1 AND NOT EXISTS (SELECT 1 FROM failure_examples x WHERE x.lease = e.lease AND x.number = e.number)
          AND NOT EXISTS (
            SELECT 1 FROM level_moves m WHERE m.task = g.task AND m.seq > g.proposal AND g.proposal >= (
                SELECT min(part.value ->> 'first') FROM (
                    SELECT value FROM json_each(m.evidence, '$.blocks') UNION ALL SELECT value FROM json_each(m.evidence, '$.probes')
                ) AS part))
          AND EXISTS (SELECT 1 FROM level_moves m WHERE m.task = g.task AND m.seq > g.proposal)";
    // The server checks after the compaction what must be kept.
    wait_until("episodes without dependents are removed", async || query_number(server, sql).await == 0)
        .await;
}

#[tokio::test]
async fn retention_settings_can_be_changed() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, false, json!({})).await;
    let shown = api.get("/v1/runs/run").await.expect(200);
    assert_eq!(shown["settings"]["retention"], json!({"episodes": 50_000, "claimed": 10_000_000}));
    let put = |body: Value| {
        let api = api.clone();
        async move { api.request("PUT", "/v1/runs/run/retention", "application/json", body.to_string()).await }
    };
    let set = put(json!({"episodes": "all"})).await.expect(200);
    assert_eq!(set["settings"]["retention"], json!({"episodes": "all", "claimed": 10_000_000}));
    for _ in 0..3 {
        let _ = train_round(&api, 0).await;
    }
    for invalid in
        [json!({"episodes": -1}), json!({"episodes": "some"}), json!({"groups": 5}), json!({"episodes": 1.5})]
    {
        let rejected = put(invalid).await;
        assert_eq!(rejected.status, 422, "{}", rejected.body);
    }
    let _ = put(json!({"episodes": 0})).await.expect(200);
    wait_until("episodes are compacted", async || {
        let heads = list_all(&api, "episodes", 500).await;
        assert_eq!(heads.len(), 48);
        // Half of the episodes are possible evidence. The newest lease is kept, because it determines the next number.
        heads.iter().filter(|head| head["replay"] == "expired").count() >= 8
    })
    .await;
    let next = api.lease("run", json!({"groups": 1})).await;
    assert!(next.id().starts_with("10-"), "{}", next.id());
}
