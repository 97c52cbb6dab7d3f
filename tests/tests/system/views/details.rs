//! Flights, scenarios of evaluations, earlier settings, archived runs and recent events.

use serde_json::{Value, json};
use system_tests::{Server, wait_for};

use super::{create_run, report_groups};

#[tokio::test]
async fn flight_frames_are_the_same_for_any_range() {
    let server = Server::start().await;
    let api = server.api();
    let scenario = json!({"task": "kessler/survival", "params": {"debris": 40}, "seed": 7});
    let fly = |options: Value| {
        let mut request = json!({"scenario": scenario});
        for (key, value) in options.as_object().unwrap() {
            request[key] = value.clone();
        }
        api.post("/v1/rollouts", request)
    };
    let steps = json!([[[0, 0.1, 0.0]], [], [[0, 0.0, -0.05]]]);
    let whole = fly(json!({"steps": steps, "until": 50})).await.expect(200);
    let frames = whole["frames"].as_array().unwrap();
    assert_eq!(frames.len() as u64, frames.last().unwrap()["step"].as_u64().unwrap() + 1);
    // A range of steps equals that range of the whole flight.
    for (from, until) in [(0, 0), (2, 3), (3, 10), (50, 50)] {
        let part = fly(json!({"steps": steps, "from": from, "until": until})).await.expect(200);
        let part = part["frames"].as_array().unwrap();
        let (first, last) = (&part[0], part.last().unwrap());
        let step = |frame: &Value| frame["step"].as_u64().unwrap() as usize;
        assert_eq!(step(first), from.min(frames.len() - 1));
        assert_eq!(step(last), until.max(3).min(frames.len() - 1));
        assert_eq!(part[..], frames[step(first)..=step(last)]);
    }
    // Fuel decreases in steps with a burn only.
    let fuel = |frame: &Value| frame["state"]["satellites"][0]["fuel"].as_f64().unwrap();
    assert!(fuel(&frames[1]) < fuel(&frames[0]) && fuel(&frames[2]) == fuel(&frames[1]));
    let late = fly(json!({"steps": steps, "from": 9})).await.expect(422);
    assert_eq!(late["field"], "from", "{late}");
    let wrong = fly(json!({"steps": [[["a", 1]]]})).await.expect(422);
    assert!(wrong["detail"].is_string(), "{wrong}");
}

#[tokio::test]
async fn evaluation_lists_every_scenario() {
    let server = Server::start().await;
    let api = server.api();
    let suites = api.get("/v1/suites").await.expect(200);
    let usual = suites["default"].as_str().unwrap();
    let suite = suites["suites"].as_array().unwrap().iter().find(|suite| suite["name"] == usual).unwrap();
    assert!(suite["policies"].as_array().unwrap().contains(&json!("hold")));
    let created = api.post("/v1/evaluations", json!({"policy": "hold"})).await.expect(201);
    let path = format!("/v1/evaluations/{}", created["id"].as_str().unwrap());
    let whole = wait_for("the evaluation is complete", async || {
        let evaluation = api.get(&path).await.expect(200);
        (evaluation["state"] == "complete").then_some(evaluation)
    });
    let whole = whole.await;
    let (mut all, mut cursor) = (Vec::<Value>::new(), String::new());
    loop {
        let page = api.get(&format!("{path}/scenarios?limit=100{cursor}")).await.expect(200);
        all.extend(page["scenarios"].as_array().unwrap().iter().cloned());
        let Some(next) = page["next"].as_str() else { break };
        cursor = format!("&cursor={next}");
    }
    assert_eq!(all.len() as u64, suite["scenarios"].as_u64().unwrap());
    assert!(all.iter().enumerate().all(|(i, row)| row["index"] == i && row["episodes"].as_u64() > Some(0)));
    // The floor is the score of holding, except for tasks whose floor is a blind plan.
    let blind = ["kessler/survival", "kessler/eco_station"].map(Value::from);
    let held: Vec<&Value> = all.iter().filter(|row| !blind.contains(&row["task"])).collect();
    assert!(!held.is_empty());
    for row in held {
        assert!((row["score"].as_f64().unwrap() - row["floor"].as_f64().unwrap()).abs() < 1e-9, "{row}");
    }
    let mean = all.iter().map(|row| row["score"].as_f64().unwrap()).sum::<f64>() / all.len() as f64;
    let rows = whole["rows"].as_array().unwrap();
    let row = rows.iter().find(|row| row["task"] == "all" && row["part"] == "all" && row["policy"] == "hold");
    let reported_mean = row.unwrap_or(&rows[0])["score"]["mean"].as_f64().unwrap();
    assert!((mean - reported_mean).abs() < 1e-9, "{mean} and {reported_mean}");
}

#[tokio::test]
async fn earlier_settings_are_kept_and_archived_runs_are_hidden() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, json!({"group_size": 2})).await;
    report_groups(&api, 2, "hold").await;
    let _ = api.send_json("PATCH", "/v1/runs/run", json!({"max_staleness": 3})).await.expect(200);
    let history = api.get("/v1/runs/run/settings").await.expect(200);
    let settings = history["settings"].as_array().unwrap();
    assert_eq!(settings.len(), 2);
    assert_eq!((&settings[0]["revision"], &settings[0]["settings"]["max_staleness"]), (&json!(1), &json!(3)));
    assert_eq!(
        (&settings[1]["revision"], &settings[1]["settings"]["max_staleness"]),
        (&json!(0), &Value::Null)
    );

    let listed = |all: Value| -> Vec<Value> {
        all["runs"].as_array().unwrap().iter().map(|run| run["id"].clone()).collect()
    };
    let archived = api.post("/v1/runs/run/archive", json!({})).await.expect(200);
    assert!(archived["archived_at"].is_string() && archived["status"] == "paused", "{archived}");
    assert_eq!(listed(api.get("/v1/runs").await.expect(200)), [] as [Value; 0]);
    assert_eq!(listed(api.get("/v1/runs?archived=true").await.expect(200)), ["run"]);
    assert_eq!(api.get("/v1/runs/run/overview").await.expect(200)["episodes"], json!(2));
    let _ = api.post("/v1/runs/run/leases", json!({"groups": 1})).await.expect(409);
    let back = api.post("/v1/runs/run/resume", json!({})).await.expect(200);
    assert!(back["archived_at"].is_null() && back["status"] == "active", "{back}");
    assert_eq!(listed(api.get("/v1/runs").await.expect(200)), ["run"]);
    let lease = api.lease("run", json!({"groups": 1})).await;
    let results = lease.results("hold");
    assert_eq!(api.report("run", results).await["results"][0]["status"], "counted");
}

/// An event stream can start with the last events before the connection.
#[tokio::test]
async fn event_stream_starts_with_the_requested_last_events() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, json!({})).await;
    report_groups(&api, 4, "hold").await;
    let event_ids = |path: &'static str, until: String| {
        let url = format!("{}{path}", api.base());
        async move {
            let mut answer = system_tests::http_client().get(url).send().await.unwrap();
            assert_eq!(answer.status(), 200);
            let mut text = String::new();
            while !(text.ends_with("\n\n") && text.contains(&until)) {
                text.push_str(&String::from_utf8_lossy(&answer.chunk().await.unwrap().unwrap()));
            }
            let (heads, events): (Vec<_>, Vec<_>) =
                text.split_terminator("\n\n").partition(|block| !block.contains("data: "));
            let id =
                |block: &str| block.lines().find_map(|line| line.strip_prefix("id: ")?.parse::<i64>().ok());
            let ids: Vec<_> = events.into_iter().filter_map(id).collect();
            // Without `after`, the stream starts with an id from which the client can resume.
            let from = heads.first().map(|head| id(head).unwrap());
            assert_eq!(from, (!path.contains("after=")).then(|| ids[0] - 1), "{text}");
            ids
        }
    };
    // Wait for the event of the critique, which follows the end of the lease: the archiving is then the last event.
    let _ = event_ids("/v1/runs/run/events?after=0", r#""criticised":"#.to_owned()).await;
    let _ = api.post("/v1/runs/run/archive", json!({})).await.expect(200);
    let all = event_ids("/v1/runs/run/events?after=0", r#""state":"archived""#.to_owned()).await;
    assert!(all.len() > 5, "{all:?}");
    let last = format!("id: {}\n", all[all.len() - 1]);
    assert_eq!(
        event_ids("/v1/runs/run/events?last=1000", last.clone()).await,
        all,
        "at most as many events as there are"
    );
    assert_eq!(event_ids("/v1/runs/run/events?last=3", last).await, all[all.len() - 3..]);
    let _ = api.get("/v1/runs/run/events?last=1001").await.expect(422);
}
