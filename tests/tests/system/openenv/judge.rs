//! Judges of single steps: what clients receive, which verdicts are stored, and faults of the judge's endpoint.

use std::sync::Arc;
use std::time::{Duration, Instant};

use api_types::Judge;
use env_core::log::Precision;
use env_core::{ActionLog, Recipe, Scenario, Seed};
use llm::{LlmClient, LlmConfig, WallClock};
use llm_policy::judging::{Judges, ModelJudge};
use orchestrator::service::Config;
use serde_json::{Value, json};
use system_tests::mock_llm::{
    API_KEY, ClosedPort, GatedEndpoint, chat_completion, chat_response, contains_api_key, received_bodies,
    start_endpoint,
};
use system_tests::{Received, Server, sparring_binary};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;
use wiremock::ResponseTemplate;

use super::socket::OpenEnvSocket;

const VERDICT: &str = r#"{"reasoning": "Nothing came near.", "score": 0.5}"#;

/// Configuration of a client for the endpoint at `base`, with a timeout that no response on a busy machine exceeds.
fn model_config(base: &str) -> LlmConfig {
    let mut config = LlmConfig::new(format!("{base}/v1"), "mock", WallClock::new(|| 0));
    config.key = Some(API_KEY.to_owned().into());
    config.retries = 1;
    config.backoff = Duration::from_millis(20);
    config.timeout = Duration::from_secs(60);
    config
}

/// Creates the judges of a server whose model is at `base`.
fn judges(default_judge: Judge, base: &str) -> Arc<Judges> {
    judges_with_model(default_judge, model_config(base))
}

fn judges_with_model(default_judge: Judge, model: LlmConfig) -> Arc<Judges> {
    Arc::new(Judges::new(default_judge, Some(ModelJudge::new(LlmClient::new(model).unwrap()))))
}

async fn start_server(judges: Arc<Judges>) -> Server {
    Server::with_config(move |config| Config { judges: Arc::clone(&judges), ..config }).await
}

fn burn() -> Value {
    json!({"burns": [{"satellite_id": 0, "delta_vx": 0.3, "delta_vy": 0.0}]})
}

fn hold() -> Value {
    json!({"burns": []})
}

/// Runs these actions over `/ws` on a fixed scenario and returns all observations, that of the reset first.
async fn run_steps(server: &Server, actions: &[Value]) -> Vec<Value> {
    let mut socket = OpenEnvSocket::connect(&server.api(), "/ws").await;
    let mut observations =
        vec![socket.reset(json!({"seed": 3, "task": "survival", "episode_id": "e"})).await];
    for action in actions {
        observations.push(socket.step(action.clone()).await);
    }
    observations
}

fn judge_alert(observation: &Value) -> Option<&str> {
    let alerts = observation["observation"]["critical_alerts"].as_array().unwrap();
    alerts.iter().filter_map(Value::as_str).find(|alert| alert.starts_with("[JUDGE]"))
}

fn number_at(observation: &Value, path: &str) -> f64 {
    observation.pointer(path).and_then(Value::as_f64).unwrap()
}

/// The rules' verdict changes each reward and the total score as documented, and nothing else.
#[tokio::test]
async fn rules_verdict_changes_rewards_as_documented() {
    let judged = start_server(Arc::new(Judges::new(Judge::Deterministic, None))).await;
    let plain = Server::start().await;
    let actions = [hold(), burn(), hold(), hold()];
    let (judged, plain) = (run_steps(&judged, &actions).await, run_steps(&plain, &actions).await);
    assert_eq!(judged[0], plain[0], "a reset is not judged");
    let task = env_core::task("kessler/survival").unwrap();
    let scenario = Scenario::new(Recipe::new(task).unwrap(), Seed::user(3).unwrap());
    let (mut log, mut total) = (ActionLog::new(2, Precision::F64), 0.0);
    for (at, action) in actions.iter().enumerate() {
        openenv_wire::wire_format(task).read_action(action, &mut log).unwrap();
        let verdict = task.judge_step(&scenario, &log).unwrap().unwrap();
        let (mut ours, mut theirs) = (judged[at + 1].clone(), plain[at + 1].clone());
        let wanted = number_at(&theirs, "/reward") / 1.2 * (1.0 + 0.2 * verdict.value);
        total += wanted;
        assert!((number_at(&ours, "/reward") - wanted).abs() < 1e-15, "{verdict:?}");
        assert!((number_at(&ours, "/observation/total_score") - total).abs() < 1e-12);
        assert_eq!(
            judge_alert(&ours),
            Some(format!("[JUDGE]: {} (Score: {:.2})", verdict.explanation, verdict.value).as_str())
        );
        for observation in [&mut ours, &mut theirs] {
            observation["reward"] = Value::Null;
            observation["observation"]["total_score"] = Value::Null;
            let alerts = observation["observation"]["critical_alerts"].as_array_mut().unwrap();
            alerts.retain(|alert| !alert.as_str().unwrap().starts_with("[JUDGE]"));
        }
        assert_eq!(ours, theirs);
    }
    assert!(judge_alert(&judged[2]).unwrap().contains("fuel"), "{:?}", judge_alert(&judged[2]));
}

#[tokio::test]
async fn model_verdicts_are_cached_and_stored() {
    let model = start_endpoint([chat_response(VERDICT)]).await;
    let mut server = start_server(judges(Judge::Llm, &model.uri())).await;
    let actions = [hold(), burn(), hold()];
    let judged = run_steps(&server, &actions).await;
    for observation in &judged[1..] {
        assert_eq!(judge_alert(observation), Some("[JUDGE]: Nothing came near. (Score: 0.50)"));
        assert!((number_at(observation, "/reward") - 0.02 * 0.998 / 1.2 * 1.1).abs() < 1e-9, "{observation}");
    }
    // The same steps cause no request, and their verdicts are stored again.
    assert_eq!(run_steps(&server, &actions).await, judged);
    let requests = received_bodies(&model).await;
    assert_eq!(requests.len(), 3);
    let text = requests[1]["messages"][1]["content"].as_str().unwrap();
    assert!(
        text.starts_with("Before step 2:") && text.contains(r#"{"burns":[{"satellite_id":0,"delta_vx":0.3"#),
        "{text}"
    );
    assert_eq!(requests[1]["response_format"]["json_schema"]["name"], "verdict");
    server.stop().await;
    let stored = stored_verdicts(&server).await;
    let steps: Vec<(i64, bool)> = stored.iter().map(|row| (row.step, row.cached)).collect();
    assert_eq!(steps, [(1, false), (2, false), (3, false), (1, true), (2, true), (3, true)]);
    assert!(stored.iter().all(|row| row.score == Some(0.5) && row.error.is_none() && row.episode == "e"));
    assert_eq!(stored[0].tokens, 920);
    assert!(stored.iter().all(|row| row.rule_score.is_some()));
    assert_eq!(stored[1].rule_case.as_deref(), Some("unnecessary_burn"));
    // The agreement between rules and model.
    let command = |flags: &[&str]| {
        let mut command = std::process::Command::new(sparring_binary());
        command.env_remove("SPARRING_LOG").arg("judge-agreement").arg("--db").arg(server.db_path());
        command.args(flags).output().unwrap()
    };
    let agreement = |flags: &[&str]| {
        let output = command(flags);
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let report: Value = serde_json::from_str(&agreement(&["--json"])).unwrap();
    assert_eq!((&report["verdicts"], &report["unanswered"]), (&json!(6), &json!(0)));
    assert_eq!(report["agreement"][0]["bands"], json!([[0, 0, 0], [0, 0, 0], [2, 0, 4]]));
    assert!(agreement(&[]).contains("unnecessary burn"));
    let unknown = command(&["--run", "unknown"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&unknown.stderr).contains("there is no run \"unknown\""), "{unknown:?}");
}

/// A run may set its own judge. The reported score of its episodes is the world's, not the judged one.
#[tokio::test]
async fn run_judge_does_not_change_reported_scores() {
    let model = start_endpoint([chat_response(VERDICT)]).await;
    let server = start_server(judges(Judge::Off, &model.uri())).await;
    let api = server.api();
    for (run, judge) in [("plain", json!(null)), ("ruled", json!("deterministic")), ("asked", json!("llm"))] {
        let settings = json!({"id": run, "tasks": ["kessler/survival"], "seed": 1, "judge": judge, "design": {"designer": "off"}});
        let created = api.post("/v1/runs", settings).await.expect(201);
        assert_eq!(created["settings"]["judge"], judge);
        let mut socket = OpenEnvSocket::connect(&api, "/ws").await;
        socket.reset(json!({"run": run})).await;
        let mut last = Value::Null;
        for _ in 0..60 {
            last = socket.step(hold()).await;
            assert_eq!(judge_alert(&last).is_some(), run != "plain", "{last}");
            if last["done"] == true {
                break;
            }
        }
        let reported = socket.state().await["reported"].clone();
        let (score, total) = (number_at(&reported, "/score"), number_at(&last, "/observation/total_score"));
        assert_eq!((score - total).abs() < 1e-6, run == "plain", "{reported} {last}");
    }
    // A server without a model rejects runs that need one.
    let without = Server::start().await;
    let rejected = without.api().post("/v1/runs", json!({"judge": "llm"})).await.expect(422);
    assert_eq!(rejected["field"], "judge", "{rejected}");
    let rejected = without.api().post("/v1/runs", json!({"judge": "unknown"})).await;
    assert!(rejected.status == 422 || rejected.status == 400, "{rejected:?}");
}

/// Starts a server that sends `begin` on every connection, then `more` until the client leaves.
async fn start_raw_server(begin: &'static str, more: &'static str) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let base = format!("http://{}", listener.local_addr().unwrap());
    tokio::spawn(async move {
        while let Ok((mut connection, _)) = listener.accept().await {
            tokio::spawn(async move {
                let mut request = vec![0; 65536];
                let _ = connection.read(&mut request).await;
                let _ = connection.write_all(begin.as_bytes()).await;
                while !more.is_empty() && connection.write_all(more.as_bytes()).await.is_ok() {
                    // Tests the passing of time: the response is slow enough to reach the timeout before its size limit.
                    tokio::time::sleep(Duration::from_millis(1)).await;
                }
            });
        }
    });
    base
}

/// For every fault of the endpoint, each step returns in time with the world's reward, the reason is stored, and the API key
/// appears nowhere.
#[tokio::test]
async fn endpoint_faults_leave_steps_and_rewards_intact() {
    let error_response =
        |status: u16| ResponseTemplate::new(status).set_body_string(format!("go away with {API_KEY}"));
    let mut truncated = chat_completion(VERDICT).to_string();
    truncated.truncate(40);
    let faults = [
        ("slow", chat_response(VERDICT).set_delay(Duration::from_secs(300)), "within 1 s"),
        ("429", error_response(429).insert_header("retry-after", "3600"), "3600 s"),
        ("500", error_response(500), "500"),
        ("truncated", ResponseTemplate::new(200).set_body_string(truncated), "response is invalid"),
        ("html", ResponseTemplate::new(200).set_body_string("<html>no</html>"), "response is invalid"),
        ("prose", chat_response("I find it fine."), "no valid verdict"),
        ("beyond", chat_response(r#"{"reasoning": "x", "score": 7}"#), "must be from -1 to 1"),
        ("NaN", chat_response(r#"{"reasoning": "x", "score": NaN}"#), "no valid verdict"),
        ("401", error_response(401), "401"),
    ];
    let mut cases = Vec::new();
    for (name, answer, why) in faults {
        let model = start_endpoint([answer]).await;
        cases.push((name, model.uri(), why, Some(model)));
    }
    let closed = ClosedPort::reserve();
    cases.push(("unreachable", closed.url(), "cannot be reached", None));
    let stream =
        start_raw_server("HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\n", "5\r\nxxxxx\r\n").await;
    cases.push(("streaming", stream, "within 1 s", None));
    cases.push((
        "broken off",
        start_raw_server("HTTP/1.1 200 OK\r\ncontent-length: 99\r\n\r\n{", "").await,
        "",
        None,
    ));
    let plain = run_steps(&Server::start().await, &[hold(), burn(), hold(), hold(), hold()]).await;
    for (name, base, why, model) in cases {
        let timeout = Duration::from_secs(if why == "within 1 s" { 1 } else { 60 });
        let model_config = LlmConfig { timeout, ..model_config(&base) };
        let mut server = start_server(judges_with_model(Judge::Llm, model_config)).await;
        let start = Instant::now();
        let judged = run_steps(&server, &[hold(), burn(), hold(), hold(), hold()]).await;
        // Five steps wait for the timeout, 1 s, or for nothing. Without the timeout a single step takes 300 s.
        assert!(start.elapsed() < Duration::from_secs(120), "{name}: {:?}", start.elapsed());
        for (ours, theirs) in judged.iter().zip(&plain) {
            assert_eq!(ours["reward"], theirs["reward"], "{name}");
            assert_eq!(judge_alert(ours), None, "{name}");
        }
        server.stop().await;
        let stored = stored_verdicts(&server).await;
        assert_eq!(stored.len(), 5, "{name}");
        let error = stored[0].error.clone().unwrap();
        assert!(stored[0].score.is_none() && error.contains(why), "{name}: {error}");
        if let ("slow", Some(model)) = (name, &model) {
            assert!(
                received_bodies(model).await.len() <= 3,
                "an endpoint with several timeouts gets no more requests"
            );
        }
        assert!(
            !contains_api_key(&std::fs::read(server.db_path()).unwrap()),
            "{name}: the key is in the database"
        );
        assert!(!judged.iter().any(|observation| observation.to_string().contains(API_KEY)), "{name}");
    }
}

/// While one session waits for a verdict, other sessions step.
#[tokio::test]
async fn slow_judge_does_not_block_other_sessions() {
    let model = GatedEndpoint::start(VERDICT).await;
    let server = start_server(judges(Judge::Llm, model.url())).await;
    let settings = json!({"id": "run", "seed": 2, "tasks": ["kessler/survival"], "judge": "off", "design": {"designer": "off"}});
    let _ = server.api().post("/v1/runs", settings).await.expect(201);
    let mut waiting = OpenEnvSocket::connect(&server.api(), "/ws").await;
    let mut free = OpenEnvSocket::connect(&server.api(), "/ws").await;
    waiting.reset(json!({"seed": 1})).await;
    free.reset(json!({"run": "run"})).await;
    waiting.send_text(json!({"type": "step", "data": hold()}).to_string()).await;
    model.wait_for_requests(1).await;
    for _ in 0..10 {
        free.step(hold()).await;
    }
    // The waiting connection stays responsive: the pong comes before the reply to the step.
    waiting.ping().await;
    assert!(waiting.receive_pong().await);
    model.release(1);
    let Received::Text(reply) = waiting.receive().await else { panic!("no answer") };
    assert!(judge_alert(&reply["data"]).is_some(), "{reply}");
    // Messages that are sent before the reply are processed in order.
    waiting.send_text(json!({"type": "step", "data": burn()}).to_string()).await;
    waiting.send_text(json!({"type": "state"}).to_string()).await;
    model.wait_for_requests(2).await;
    model.release(1);
    let kinds = [waiting.receive().await, waiting.receive().await].map(|received| match received {
        Received::Text(frame) => frame["type"].as_str().unwrap().to_owned(),
        other => panic!("{other:?}"),
    });
    assert_eq!(kinds, ["observation", "state"]);
}

/// The spent budget of verdicts survives a restart.
#[tokio::test]
async fn spent_judge_budget_survives_a_restart() {
    let endpoint = start_endpoint([chat_response(VERDICT)]).await;
    let base = endpoint.uri();
    let mut server = Server::with_config(move |config| {
        let model = LlmConfig { tokens_per_run: Some(12_000), ..model_config(&base) };
        Config { judges: judges_with_model(Judge::Llm, model), ..config }
    })
    .await;
    let holds: Vec<Value> = (0..20).map(|_| hold()).collect();
    let judged = run_steps(&server, &holds).await;
    assert!(
        judge_alert(&judged[1]).is_some() && judge_alert(&judged[20]).is_none(),
        "{:?}",
        judge_alert(&judged[20])
    );
    let requests = received_bodies(&endpoint).await.len();
    server.restart().await;
    let judged = run_steps(&server, &[burn(), hold()]).await;
    assert!(judge_alert(&judged[1]).is_none() && number_at(&judged[1], "/reward") > 0.0);
    assert_eq!(received_bodies(&endpoint).await.len(), requests, "a spent budget allows no request");
    server.stop().await;
    let error = stored_verdicts(&server).await.pop().and_then(|row| row.error).unwrap();
    assert!(error.contains("budget"), "{error}");
}

/// `judge-agreement` rejects files that are no database, and leaves them unchanged.
#[test]
fn agreement_rejects_files_without_verdicts() {
    let folder = tempfile::tempdir().unwrap();
    let (empty, text) = (folder.path().join("empty.sqlite3"), folder.path().join("text.sqlite3"));
    std::fs::write(&empty, "").unwrap();
    std::fs::write(&text, "no database at all, but a text of some length").unwrap();
    for (file, why) in [(&empty, "is empty"), (&text, ""), (&folder.path().join("none"), "")] {
        let mut command = std::process::Command::new(sparring_binary());
        let output = command.env_remove("SPARRING_LOG").arg("judge-agreement").arg("--db").arg(file).output();
        let output = output.unwrap();
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert!(text.contains(why) && text.contains(&*file.to_string_lossy()), "{text}");
        assert!(output.stdout.is_empty() && text.lines().count() <= 3, "{text}");
    }
    assert_eq!(std::fs::metadata(&empty).unwrap().len(), 0);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "no file is created");
}

struct StoredVerdict {
    step: i64,
    episode: String,
    score: Option<f64>,
    error: Option<String>,
    rule_score: Option<f64>,
    rule_case: Option<String>,
    cached: bool,
    tokens: i64,
}

/// Reads the verdicts from the database of a stopped server.
async fn stored_verdicts(server: &Server) -> Vec<StoredVerdict> {
    use sqlx::{Connection, Row};
    let path = format!("sqlite://{}", server.db_path().display());
    let mut connection = sqlx::SqliteConnection::connect(&path).await.unwrap();
    let sql = "SELECT step, episode, score, error, rule_score, rule_case, is_cached, tokens_in + tokens_out FROM step_verdicts ORDER BY id";
    let rows = sqlx::query(sql).fetch_all(&mut connection).await.unwrap();
    rows.iter()
        .map(|row| StoredVerdict {
            step: row.get(0),
            episode: row.get(1),
            score: row.get(2),
            error: row.get(3),
            rule_score: row.get(4),
            rule_case: row.get(5),
            cached: row.get(6),
            tokens: row.get(7),
        })
        .collect()
}
