//! The failure profile: every finished training episode gets one critique, also after kills, and the profile equals the
//! critiques of the episodes.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::Ordering;

use clock::{Clock, ManualClock};
use env_core::critique::{Critique, profile_sector};
use env_core::{ActionLog, Scenario};
use serde_json::{Value, json};
use sqlx::Connection;
use sqlx::sqlite::SqliteConnectOptions;
use system_tests::{ApiClient, Lease, Server, ServerProcess, log_to_json, run_policy};

use crate::design::{wait_for_critiques, wait_for_response};

const TASK: &str = "kessler/survival";

async fn create(api: &ApiClient, group_size: u32) {
    let settings = json!({
        "id": "run", "seed": 11, "group_size": group_size, "placement": false, "contested_share": 1.0, "tasks": [TASK],
        "design": {"designer": "off"}
    });
    let _ = api.post("/v1/runs", settings).await.expect(201);
}

/// Waits until every episode has its critique, and returns the failure profile of the task.
async fn wait_for_profile(api: &ApiClient) -> Value {
    wait_for_critiques(api).await["tasks"][0].clone()
}

async fn finished_episodes(api: &ApiClient) -> u64 {
    let mastery = api.get("/v1/runs/run/mastery").await.expect(200);
    mastery["tasks"][0]["results"]["episodes"].as_u64().unwrap()
}

fn number(profile: &Value, name: &str) -> u64 {
    profile[name].as_u64().unwrap()
}

/// Number of failures by mode, and by sector and band if there was an encounter.
type Cells = BTreeMap<(String, Option<(u64, u64)>), u64>;

fn profile_cells(profile: &Value) -> Cells {
    let mut cells = Cells::new();
    for mode in profile["modes"].as_array().unwrap() {
        for cell in mode["cells"].as_array().unwrap() {
            let encounter = cell["sector"].as_u64().zip(cell["band"].as_u64());
            cells.insert(
                (mode["mode"].as_str().unwrap().to_owned(), encounter),
                cell["count"].as_u64().unwrap(),
            );
        }
    }
    cells
}

fn compute_critique(scenario: &Scenario, log: &ActionLog) -> Critique {
    scenario.task().critique(scenario, log).unwrap()
}

fn count_failures(cells: &mut Cells, scenario: &Scenario, critique: &Critique) {
    let bands = scenario.task().speed_bands();
    for failure in &critique.failures {
        let encounter = failure.encounter.as_ref();
        let encounter = encounter
            .map(|e| (u64::from(profile_sector(e.bearing_deg)), u64::from(bands.band(e.relative_speed))));
        *cells.entry((failure.mode.to_owned(), encounter)).or_default() += 1;
    }
}

/// Returns a critique of the API without the fields that the server adds.
fn without_server_fields(mut body: Value) -> Value {
    for failure in body["failures"].as_array_mut().unwrap() {
        let fields = failure.as_object_mut().unwrap();
        fields.remove("sector").unwrap();
        fields.remove("sector_deg").unwrap();
        fields.insert("orbit_angle_deg".to_owned(), Value::Null);
        if let Some(encounter) = failure["encounter"].as_object_mut() {
            encounter.remove("band").unwrap();
        }
    }
    json!({"failures": body["failures"], "actions": body["actions"], "assessment": body["assessment"]})
}

/// Reports a lease, its first episode as failed. Returns the failures of the others and the sum of their judged values.
async fn report_lease(api: &ApiClient, lease: &Lease) -> (Cells, f64) {
    let (mut cells, mut judged, mut results) = (Cells::new(), 0.0, Vec::new());
    for (i, (episode, scenario)) in lease.episodes().into_iter().enumerate() {
        if i == 0 {
            results.push(json!({"episode": episode, "status": "failed", "reason": "the machine was lost"}));
            continue;
        }
        let log = run_policy(&scenario, if i % 3 == 0 { "random" } else { "hold" }).log;
        let critique = compute_critique(&scenario, &log);
        count_failures(&mut cells, &scenario, &critique);
        judged += critique.assessment.value;
        results.push(json!({"episode": episode, "actions": log_to_json(&log)}));
    }
    api.report("run", results).await;
    (cells, judged)
}

/// Reads all pages of the list of failures, finds each failure in the critique of its episode, and returns their number.
async fn count_listed_failures(api: &ApiClient) -> u64 {
    let (mut cursor, mut listed) = (String::new(), 0);
    loop {
        let page = api.get(&format!("/v1/runs/run/failures?task={TASK}&limit=7{cursor}")).await.expect(200);
        for failure in page["failures"].as_array().unwrap() {
            listed += 1;
            let path = format!("/v1/runs/run/episodes/{}/critique", failure["episode"].as_str().unwrap());
            let critique = api.get(&path).await.expect(200);
            let mut found = critique["failures"].as_array().unwrap().iter().map(|f| {
                let encounter = &f["encounter"];
                json!([
                    f["mode"],
                    f["agent"],
                    f["step"],
                    f["sector"],
                    encounter["band"],
                    encounter["steps_left"],
                    encounter["avoidable"]
                ])
            });
            let wanted =
                ["mode", "agent", "step", "sector", "band", "steps_left", "avoidable"].map(|n| &failure[n]);
            assert!(found.any(|f| f == json!(wanted)), "{failure} is not in {critique}");
        }
        match page["next"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => return listed,
        }
    }
}

/// Checks that a cell names as many different episodes as requested, if it has so many.
async fn assert_examples_are_distinct(api: &ApiClient) {
    let cells = |profile: &Value| -> Vec<(Vec<String>, u64)> {
        let modes = profile["tasks"][0]["modes"].as_array().unwrap().iter();
        let cells = modes.flat_map(|mode| mode["cells"].as_array().unwrap());
        let names = |cell: &Value| serde_json::from_value(cell["episodes"].clone()).unwrap();
        cells.map(|cell| (names(cell), cell["count"].as_u64().unwrap())).collect()
    };
    let request =
        async |n: usize| api.get(&format!("/v1/runs/run/failure_profiles?task={TASK}&examples={n}")).await;
    let whole = cells(&request(64).await.expect(200));
    let twice = |(names, count): &&(Vec<String>, u64)| names.len() > 3 && *count > names.len() as u64;
    assert!(
        whole.iter().any(|cell| twice(&cell)),
        "the test needs an episode with two failures in one cell: {whole:?}"
    );
    for n in [0, 1, 2, 3, 5, 8] {
        for ((some, _), (all, _)) in cells(&request(n).await.expect(200)).iter().zip(&whole) {
            assert_eq!(some[..], all[..n.min(all.len())], "{n} examples");
        }
    }
}

#[tokio::test]
async fn profile_equals_the_critiques_of_the_episodes() {
    let ManualClock { clock, time: clock_ms } = Clock::manual(1_700_000_000_000);
    let server = Server::with_clock(clock).await;
    let api = server.api();
    create(&api, 2).await;
    let lease = api.lease("run", json!({"groups": 24, "ttl_s": 60})).await;
    let late = api.lease("run", json!({"groups": 2, "ttl_s": 1})).await;
    let eval = api.lease("run", json!({"groups": 2, "purpose": "eval"})).await;
    let (cells, judged) = report_lease(&api, &lease).await;
    assert!(cells.values().sum::<u64>() > 20, "the test needs lost satellites: {cells:?}");
    for other in [&eval, &late] {
        clock_ms.fetch_add(2_000, Ordering::SeqCst);
        api.report("run", other.results("hold")).await;
    }

    let profile = wait_for_profile(&api).await;
    assert_eq!(number(&profile, "criticised"), 47, "failed, evaluation and late episodes have no critique");
    assert_eq!((number(&profile, "skipped"), number(&profile, "failed")), (0, 0));
    assert_eq!(finished_episodes(&api).await, 47);
    assert_eq!(profile_cells(&profile), cells);
    let mean = profile["judge"]["overall"].as_f64().unwrap();
    assert!((mean - judged / 47.0).abs() < 1e-12, "the mean of 47 judged values is {mean}");

    assert_examples_are_distinct(&api).await;
    // A cell has at most 64 examples, and no cell has more failures here: all are listed.
    assert_eq!(count_listed_failures(&api).await, cells.values().sum::<u64>());
    let ((mode, encounter), of_cell) = cells.iter().find(|((_, encounter), _)| encounter.is_some()).unwrap();
    let (sector, band) = encounter.unwrap();
    let path = format!("/v1/runs/run/failures?task={TASK}&mode={mode}&sector={sector}&band={band}&limit=500");
    assert_eq!(api.get(&path).await.expect(200)["failures"].as_array().unwrap().len() as u64, *of_cell);

    // The critique of an evaluation episode is available, and does not change the profile.
    let (episode, scenario) = eval.episodes().into_iter().next().unwrap();
    let critique = api.get(&format!("/v1/runs/run/episodes/{episode}/critique")).await.expect(200);
    assert_eq!(
        without_server_fields(critique),
        serde_json::to_value(compute_critique(&scenario, &run_policy(&scenario, "hold").log)).unwrap()
    );
    assert_eq!(wait_for_profile(&api).await, profile);
}

#[tokio::test]
async fn scenario_endpoint_returns_a_critique() {
    let server = Server::start().await;
    let settings = json!({"task": TASK, "params": {"debris": 150, "fuel": 5}, "seed": 3});
    let scenario = Scenario::from_json(&settings).unwrap();
    let log = run_policy(&scenario, "random").log;
    let body = json!({"scenario": settings, "actions": log_to_json(&log)});
    let response = server.api().post("/v1/scenarios", body).await.expect(200);
    let expected = compute_critique(&scenario, &log);
    assert!(!expected.actions.is_empty(), "the policy acts");
    assert_eq!(without_server_fields(response["critique"].clone()), serde_json::to_value(expected).unwrap());
    let without_actions = server.api().post("/v1/scenarios", json!({"scenario": settings})).await.expect(200);
    assert_eq!(without_actions["critique"], Value::Null);
}

async fn execute_sql(db: &Path, statement: &'static str) -> i64 {
    let options = SqliteConnectOptions::new().filename(db);
    let mut conn = sqlx::SqliteConnection::connect_with(&options).await.unwrap();
    let rows = sqlx::query_scalar::<_, i64>(statement).fetch_optional(&mut conn).await.unwrap();
    conn.close().await.unwrap();
    rows.unwrap_or(0)
}

/// Kills the server before, during and after critiques: each episode gets exactly one.
#[tokio::test]
async fn kills_lose_no_critique_and_count_none_twice() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("killed.sqlite3");
    let mut process = ServerProcess::start(&db);
    create(&process.api(), 2).await;
    let (mut cells, mut max_waiting) = (Cells::new(), 0);
    for round in 0..8 {
        let api = process.api();
        let lease = api.lease("run", json!({"groups": 32})).await;
        let mut results = Vec::new();
        for (episode, scenario) in lease.episodes() {
            let log = run_policy(&scenario, "hold").log;
            count_failures(&mut cells, &scenario, &compute_critique(&scenario, &log));
            results.push(json!({"episode": episode, "actions": log_to_json(&log)}));
        }
        api.report("run", results).await;
        // Each round kills the server later: from all 64 episodes waiting for their critique to none.
        let max_left = 64 - 64 * round / 7;
        wait_for_response(&api, "/v1/runs/run", |run| {
            run["critique_backlog"]["waiting"].as_u64().is_some_and(|waiting| waiting <= max_left)
        })
        .await;
        process.kill();
        max_waiting = max_waiting.max(execute_sql(&db, "SELECT sum(episodes) FROM critique_queue").await);
        process = ServerProcess::start(&db);
    }
    assert!(max_waiting > 0, "no kill happened before a critique");
    let profile = wait_for_profile(&process.api()).await;
    assert_eq!(number(&profile, "criticised"), 8 * 64);
    assert_eq!((number(&profile, "skipped"), number(&profile, "failed")), (0, 0));
    assert_eq!(finished_episodes(&process.api()).await, 8 * 64);
    assert_eq!(profile_cells(&profile), cells, "{max_waiting} critiques waited at a kill");
}

/// More episodes than the queue takes wait when the server starts: some are skipped, and counted as such.
#[tokio::test]
async fn long_critique_queue_is_sampled() {
    let mut server = Server::start().await;
    create(&server.api(), 64).await;
    let lease = server.api().lease("run", json!({"groups": 48})).await;
    let hold = |(episode, _): (String, Scenario)| json!({"episode": episode, "actions": {"steps": [], "stopped": "too_late"}});
    server.api().report("run", lease.episodes().into_iter().map(hold).collect()).await;
    server.stop().await;
    for statement in [
        "DELETE FROM failure_examples",
        "DELETE FROM failure_cells",
        "DELETE FROM failure_inertial_sectors",
        "DELETE FROM critique_counters",
        "DELETE FROM critique_queue",
        "INSERT INTO critique_queue (run, task, lease, numbers, episodes)
         SELECT l.run, g.task, e.lease, json_group_array(e.number), count(*)
         FROM leases l JOIN groups g ON g.lease = l.id
         JOIN episodes e ON e.lease = l.id AND e.number / l.group_size = g.number
         WHERE e.state = 'finished' GROUP BY e.lease, g.task, e.number / 64",
    ] {
        execute_sql(&server.db_path(), statement).await;
    }
    server.restart().await;
    let profile = wait_for_profile(&server.api()).await;
    let [criticised, skipped, failed] =
        ["criticised", "skipped", "failed"].map(|name| number(&profile, name));
    assert_eq!(criticised + skipped + failed, 48 * 64);
    assert_eq!((finished_episodes(&server.api()).await, failed), (48 * 64, 0));
    // Half of the queue above 2 000 is skipped: of 1 072 about 536 ± 16, and up to one batch more.
    assert!((400..1000).contains(&skipped), "{skipped} were skipped");
    assert!(profile["weight"].as_f64().unwrap() < criticised as f64, "weights fade");
}

#[tokio::test]
async fn responses() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, 1).await;
    // The world defines the modes; the snapshot has the first one only.
    let modes = env_core::task(TASK).unwrap().failure_modes();
    let mut nothing_yet = api.get("/v1/runs/run/failure_profiles").await.expect(200);
    let modes_shown = nothing_yet["tasks"][0]["modes"].as_array_mut().unwrap();
    assert!(modes_shown.iter().map(|mode| &mode["mode"]).eq(modes.iter().map(|mode| mode.name)));
    modes_shown.truncate(1);
    insta::assert_json_snapshot!("nothing_yet", nothing_yet);
    let lease = api.lease("run", json!({"groups": 1})).await;
    let (pending_episode, _) = lease.episodes().into_iter().next().unwrap();
    let mut problems = Vec::new();
    for path in [
        "unknown/failure_profiles",
        "NOBODY/failure_profiles",
        "run/failure_profiles?task=kessler/nothing",
        "run/failure_profiles?task=kessler/rendezvous",
        "run/failure_profiles?examples=65",
        "run/failure_profiles?examples=many",
        "run/failure_profiles?page=2",
        "run/failures",
        "run/failures?task=kessler/nothing",
        "run/failures?task=kessler/survival&mode=boredom",
        "run/failures?task=kessler/survival&sector=12",
        "run/failures?task=kessler/survival&band=9",
        "run/failures?task=kessler/survival&limit=0",
        "run/failures?task=kessler/survival&cursor=4.zz",
        "unknown/failures?task=kessler/survival",
        "run/episodes/nonsense/critique",
        &format!("run/episodes/{pending_episode}/critique"),
    ] {
        let response = api.get(&format!("/v1/runs/{path}")).await;
        assert_eq!(response.content_type, "application/problem+json", "{path}");
        let text = format!("{path}\n{:#}", response.body);
        let names = modes.iter().map(|mode| mode.name).collect::<Vec<_>>().join(", ");
        problems.push(text.replace(&pending_episode, "ep_UNFLOWN").replace(&names, "MODES"));
    }
    insta::assert_snapshot!("problems", problems.join("\n\n"));
}
