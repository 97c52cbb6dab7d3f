//! What a run keeps whole is a ring: what is older stays as how it came out, and what something rests on stays whole.

use std::collections::BTreeMap;
use std::time::Duration;

use serde_json::{Value, json};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Row};
use system_tests::{Api, Server, result};

const SURVIVAL: &str = "kessler/survival";
const ECO: &str = "kessler/eco_station";
/// Episodes that the run keeps whole, in these tests.
const KEPT: i64 = 64;
const ROUNDS: usize = 44;
/// Groups of the leases of a round.
const LEASES: [u32; 3] = [6, 1, 1];

async fn create(api: &Api, placement: bool, retention: Value) {
    let wish = json!({"id": "run", "seed": 77, "group_size": 2, "target": "mastery", "tasks": [SURVIVAL, ECO],
                      "design": {"designer": "off"}, "placement": placement, "retention": retention});
    let _ = api.post("/v1/runs", wish).await.expect(201);
}

/// One round of a trainer: what it was given, and what it sent and was told, episode by episode.
async fn round(api: &Api, number: usize) -> (Vec<Value>, Vec<(Value, Value)>) {
    let policy = if number < 4 { "hold" } else { "heuristic" };
    let (mut given, mut sent) = (Vec::new(), Vec::new());
    for groups in LEASES {
        let lease = api.lease("run", json!({"groups": groups})).await;
        let results: Vec<Value> = lease.episodes().iter().map(|(id, s)| result(id, s, policy)).collect();
        let told = api.report("run", results.clone()).await["results"].as_array().unwrap().clone();
        for group in lease.0["groups"].as_array().unwrap() {
            given.push(["scenario", "seed", "task", "level", "role"].map(|field| group[field].clone()));
        }
        sent.extend(results.into_iter().zip(told));
    }
    (given.into_iter().map(|group| json!(group)).collect(), sent)
}

async fn all(api: &Api, what: &str, limit: u32) -> Vec<Value> {
    let (mut found, mut cursor) = (Vec::new(), String::new());
    loop {
        let page = api.get(&format!("/v1/runs/run/{what}?limit={limit}{cursor}")).await.expect(200);
        found.extend(page[what].as_array().unwrap().clone());
        match page["next"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => return found,
        }
    }
}

async fn numbers(server: &Server, sql: &'static str) -> Vec<i64> {
    let mut conn = SqliteConnectOptions::new().filename(server.db()).connect().await.unwrap();
    sqlx::query_scalar(sql).fetch_all(&mut conn).await.unwrap()
}

async fn number(server: &Server, sql: &'static str) -> i64 {
    numbers(server, sql).await[0]
}

/// Waits until the server keeps whole no more than it should.
async fn folded(server: &Server) {
    let whole = "SELECT coalesce(sum(groups * group_size), 0) FROM leases
                 WHERE folded = 0 AND status <> 'active' AND purpose <> 'eval'";
    for _ in 0..300 {
        if number(server, whole).await <= KEPT {
            return;
        }
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    panic!("what is old is not folded: {} episodes are whole", number(server, whole).await);
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_old_stays_as_how_it_came_out() {
    let everything = Server::start().await;
    create(&everything.api(), true, json!({"episodes": "all"})).await;
    let mut server = Server::start().await;
    create(&server.api(), true, json!({"episodes": KEPT})).await;
    let evaluation = server.api().lease("run", json!({"groups": 2, "purpose": "eval"})).await;
    let (id, scenario) = &evaluation.episodes()[0];
    let _ = server.api().report("run", vec![result(id, scenario, "hold")]).await;
    let _ = server
        .api()
        .post(&format!("/v1/runs/run/leases/{}/release", evaluation.id()), json!({}))
        .await
        .expect(200);

    let mut told = Vec::new();
    for number in 0..ROUNDS {
        if number == ROUNDS / 2 {
            folded(&server).await;
            server.restart().await;
        }
        let (steady, _) = round(&everything.api(), number).await;
        let (groups, sent) = round(&server.api(), number).await;
        assert_eq!(steady, groups, "what is forgotten changes nothing of what is proposed");
        told.extend(sent);
    }
    folded(&server).await;
    let api = server.api();

    let listed = lists(&api, &told).await;
    let history = |api: Api| async move {
        let history = api.get("/v1/runs/run/mastery/history").await.expect(200);
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
    let (steady, moves) = history(everything.api()).await;
    let (points, same_moves) = history(api.clone()).await;
    assert_eq!(moves, same_moves);
    assert!(moves.len() > 2, "levels moved, or this proves little");
    for (task, (n, sum)) in &steady {
        assert_eq!(points[task].0, *n);
        assert!((points[task].1 - sum).abs() < 1e-9);
    }

    one_that_is_old(&api, &listed, &told).await;
    what_stays(&server).await;
}

/// Every list is as long as ever, and says what each came to; the episodes.
async fn lists(api: &Api, told: &[(Value, Value)]) -> Vec<Value> {
    for limit in [500, 7] {
        let heads = all(api, "episodes", limit).await;
        assert_eq!(heads.len(), told.len() + 1, "each once");
        let listed: BTreeMap<String, Value> =
            heads.into_iter().map(|head| (head["episode"].as_str().unwrap().to_owned(), head)).collect();
        assert_eq!(listed.len(), told.len() + 1);
        for (_, told) in told {
            let head = &listed[told["episode"].as_str().unwrap()];
            for field in ["score", "skill", "success"] {
                assert_eq!(
                    head.get(field).unwrap_or(&Value::Null),
                    told.get(field).unwrap_or(&Value::Null),
                    "{field} {head} {told}"
                );
            }
        }
        assert_eq!(all(api, "leases", limit).await.len(), ROUNDS * LEASES.len() + 1);
    }
    // Whatever somebody makes up of a cursor: it is of the first lease, and what follows that is there.
    let far = api.get("/v1/runs/run/episodes?limit=3&cursor=1.9223372036854775807").await.expect(200);
    assert_eq!(far["episodes"].as_array().unwrap().len(), 3);
    let listed = all(api, "episodes", 500).await;
    let expired = listed.iter().filter(|head| head["replay"] == "expired").count();
    assert!(expired > 100, "{expired} of {}", listed.len());
    listed
}

/// What is said of an episode past the ring.
async fn one_that_is_old(api: &Api, listed: &[Value], told: &[(Value, Value)]) {
    let old = listed.iter().find(|head| head["replay"] == "expired").unwrap();
    let id = old["episode"].as_str().unwrap();
    let shown = api.get(&format!("/v1/runs/run/episodes/{id}")).await.expect(200);
    assert_eq!(
        (&shown["replay"], &shown["scenario"], &shown["actions"]),
        (&json!("expired"), &Value::Null, &Value::Null)
    );
    assert_eq!((&shown["score"], &shown["state"]), (&old["score"], &json!("finished")));
    for what in ["replay", "critique"] {
        let gone = api.get(&format!("/v1/runs/run/episodes/{id}/{what}")).await;
        assert_eq!((gone.status, gone.body["type"].as_str()), (410, Some("urn:sparring:problem:expired")));
    }
    // A trainer that comes again is told what it was told.
    let (sent, first) = told.iter().find(|(_, told)| told["episode"] == id).unwrap();
    let again = api.report("run", vec![sent.clone()]).await;
    assert_eq!(again["results"][0]["status"], "duplicate");
    assert_eq!(again["results"][0]["score"], first["score"]);
    // And so of every episode: those that stay, those that are folded around one that does, those that are gone.
    for sent in told.chunks(50) {
        let results: Vec<Value> = sent.iter().map(|(sent, _)| sent.clone()).collect();
        let again = api.report("run", results).await;
        for (again, (_, first)) in again["results"].as_array().unwrap().iter().zip(sent) {
            assert_eq!(
                (&again["status"], &again["score"]),
                (&json!("duplicate"), &first["score"]),
                "{again}"
            );
        }
    }
    // A lease of which nothing is left.
    let lease = all(api, "leases", 500).await;
    let mut gone = 0;
    for lease in lease.iter().map(|lease| lease["lease"].as_str().unwrap()) {
        let answer = api.get(&format!("/v1/runs/run/leases/{lease}")).await;
        if answer.status == 410 {
            gone += 1;
            let renewed = api.post(&format!("/v1/runs/run/leases/{lease}/renew"), json!({})).await;
            assert_eq!(
                (renewed.status, renewed.body["type"].as_str()),
                (409, Some("urn:sparring:problem:lease_over"))
            );
            let released =
                api.post(&format!("/v1/runs/run/leases/{lease}/release"), json!({})).await.expect(200);
            assert_eq!(released["status"], "done");
        } else {
            assert_eq!(answer.status, 200);
        }
    }
    assert!(gone > 0, "something must be left of no lease");
}

/// What a level move, an example of a failure or an evaluation rests on, and nothing else.
async fn what_stays(server: &Server) {
    let mut conn = SqliteConnectOptions::new().filename(server.db()).connect().await.unwrap();
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
        let there: i64 = sqlx::query_scalar(
            "SELECT count(*) FROM groups g WHERE task = ? AND proposal >= ? AND proposal < ? AND contested AND evidence
             AND role IN ('placement', 'frontier')
             AND (SELECT count(*) FROM action_logs a WHERE a.lease = g.lease AND a.number / 2 = g.number) = 2
             AND EXISTS (SELECT 1 FROM scenarios s WHERE s.id = g.scenario)",
        )
        .bind(&task).bind(first).bind(seq).fetch_one(&mut conn).await.unwrap();
        assert!(there >= n, "{task} {seq}: of {n} scenarios that it rests on {there} are there");
    }
    drop(conn);
    nothing_else_stays(server).await;
    let lost = "SELECT count(*) FROM failure_examples x
                WHERE NOT EXISTS (SELECT 1 FROM action_logs a WHERE a.lease = x.lease AND a.number = x.number)";
    assert_eq!(number(server, lost).await, 0);
    assert_eq!(number(server, "SELECT count(*) FROM leases WHERE purpose = 'eval'").await, 1);
    let orphans = [
        "SELECT count(*) FROM action_logs a WHERE NOT EXISTS (SELECT 1 FROM episodes e WHERE e.lease = a.lease AND e.number = a.number)",
        "SELECT count(*) FROM scenarios s WHERE NOT EXISTS (SELECT 1 FROM groups g WHERE g.scenario = s.id)
             AND NOT EXISTS (SELECT 1 FROM proposals p WHERE p.scenario = s.id)",
        "SELECT count(*) FROM brackets b WHERE NOT EXISTS (SELECT 1 FROM scenarios s WHERE s.id = b.scenario)",
    ];
    for sql in orphans {
        for tries in 0.. {
            let left = number(server, sql).await;
            if left == 0 {
                break;
            }
            // What was folded last is swept after it.
            assert!(tries < 100, "{left}: {sql}");
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    }
    assert_eq!(numbers(server, "SELECT 1 FROM pragma_foreign_key_check").await, Vec::<i64>::new());
}

/// Of leases that are folded: no episode but examples, what a move rests on, and what one that is yet to come may.
async fn nothing_else_stays(server: &Server) {
    let needless = "SELECT count(*) FROM leases l JOIN episodes e ON e.lease = l.id
        JOIN groups g ON g.lease = l.id AND g.number = e.number / l.group_size
        WHERE l.folded = 1 AND NOT EXISTS (SELECT 1 FROM failure_examples x WHERE x.lease = e.lease AND x.number = e.number)
          AND NOT EXISTS (
            SELECT 1 FROM level_moves m WHERE m.task = g.task AND m.seq > g.proposal AND g.proposal >= (
                SELECT min(part.value ->> 'first') FROM (
                    SELECT value FROM json_each(m.evidence, '$.blocks') UNION ALL SELECT value FROM json_each(m.evidence, '$.probes')
                ) AS part))
          AND EXISTS (SELECT 1 FROM level_moves m WHERE m.task = g.task AND m.seq > g.proposal)";
    for tries in 0.. {
        let left = number(server, needless).await;
        if left == 0 {
            return;
        }
        // Whether it must still stay is looked at behind the folding.
        assert!(tries < 100, "{left} episodes stay that nothing rests on");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
}

#[tokio::test]
async fn what_is_kept_can_be_changed() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, false, json!({})).await;
    let shown = api.get("/v1/runs/run").await.expect(200);
    assert_eq!(shown["settings"]["retention"], json!({"episodes": 50_000, "claimed": 10_000_000}));
    let put = |body: Value| {
        let api = api.clone();
        async move { api.raw("PUT", "/v1/runs/run/retention", "application/json", body.to_string()).await }
    };
    let set = put(json!({"episodes": "all"})).await.expect(200);
    assert_eq!(set["settings"]["retention"], json!({"episodes": "all", "claimed": 10_000_000}));
    for _ in 0..3 {
        let _ = round(&api, 0).await;
    }
    for wrong in
        [json!({"episodes": -1}), json!({"episodes": "some"}), json!({"groups": 5}), json!({"episodes": 1.5})]
    {
        let refused = put(wrong).await;
        assert_eq!(refused.status, 422, "{}", refused.body);
    }
    let _ = put(json!({"episodes": 0})).await.expect(200);
    for _ in 0..300 {
        let heads = all(&api, "episodes", 500).await;
        assert_eq!(heads.len(), 48);
        // Half of it is evidence for a move to come; and the newest lease stays: numbers are given after it.
        if heads.iter().filter(|head| head["replay"] == "expired").count() >= 8 {
            let next = api.lease("run", json!({"groups": 1})).await;
            assert!(next.id().starts_with("10-"), "{}", next.id());
            return;
        }
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    panic!("nothing was folded");
}
