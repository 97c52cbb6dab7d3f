//! Judges of single steps: what a client is told of them, what is kept, and that no endpoint can do harm.

use std::sync::Arc;
use std::time::{Duration, Instant};

use designer::llm::{Llm, LlmConfig, WallClock};
use env_core::log::Precision;
use env_core::{ActionLog, Recipe, Scenario, Seed};
use orchestrator::judging::{Judge, Judges, ModelJudge};
use orchestrator::service::Config;
use serde_json::{Value, json};
use system_tests::model::{KEY, completion, endpoint, says, sent};
use system_tests::{Server, binary};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;
use wiremock::ResponseTemplate;

use super::socket::{Came, Socket};

const FINE: &str = r#"{"reasoning": "Nothing came near.", "score": 0.5}"#;

/// A model that is there, with little patience.
fn model(base: &str) -> LlmConfig {
    let mut config = LlmConfig::new(format!("{base}/v1"), "mock", WallClock::new(|| 0));
    config.key = Some(KEY.to_owned().into());
    config.retries = 1;
    config.backoff = Duration::from_millis(20);
    config.timeout = Duration::from_secs(1);
    config
}

/// The judges of a server with such a model.
fn judges(usual: Judge, base: &str) -> Arc<Judges> {
    let model = ModelJudge::new(Llm::new(model(base)).unwrap());
    Arc::new(Judges::new(usual, Some(model)))
}

async fn server(judges: Arc<Judges>) -> Server {
    Server::set_up(move |config| Config { judges: Arc::clone(&judges), ..config }).await
}

fn burn() -> Value {
    json!({"burns": [{"satellite_id": 0, "delta_vx": 0.3, "delta_vy": 0.0}]})
}

fn hold() -> Value {
    json!({"burns": []})
}

/// What `/ws` tells of these steps of a seed, the reset first.
async fn told(server: &Server, actions: &[Value]) -> Vec<Value> {
    let mut socket = Socket::to(&server.api(), "/ws").await;
    let mut told = vec![socket.reset(json!({"seed": 3, "task": "survival", "episode_id": "e"})).await];
    for action in actions {
        told.push(socket.step(action.clone()).await);
    }
    told
}

fn alert(told: &Value) -> Option<&str> {
    let alerts = told["observation"]["critical_alerts"].as_array().unwrap();
    alerts.iter().filter_map(Value::as_str).find(|alert| alert.starts_with("[JUDGE]"))
}

fn number(told: &Value, path: &str) -> f64 {
    told.pointer(path).and_then(Value::as_f64).unwrap()
}

/// Every reward and the score so far are the world's as the rules' word moves them, and nothing else is touched.
#[tokio::test]
async fn rules_judge_every_step() {
    let judged = server(Arc::new(Judges::new(Judge::Deterministic, None))).await;
    let plain = Server::start().await;
    let actions = [hold(), burn(), hold(), hold()];
    let (judged, plain) = (told(&judged, &actions).await, told(&plain, &actions).await);
    assert_eq!(judged[0], plain[0], "a reset is judged by nobody");
    let task = env_core::task("kessler/survival").unwrap();
    let scenario = Scenario::new(Recipe::new(task).unwrap(), Seed::user(3).unwrap());
    let (mut log, mut total) = (ActionLog::new(2, Precision::F64), 0.0);
    for (at, action) in actions.iter().enumerate() {
        task.wire().read_action(action, &mut log).unwrap();
        let word = task.judge_step(&scenario, &log).unwrap().unwrap();
        let (mut ours, mut theirs) = (judged[at + 1].clone(), plain[at + 1].clone());
        let wanted = number(&theirs, "/reward") / 1.2 * (1.0 + 0.2 * word.value);
        total += wanted;
        assert!((number(&ours, "/reward") - wanted).abs() < 1e-15, "{word:?}");
        assert!((number(&ours, "/observation/total_score") - total).abs() < 1e-12);
        assert_eq!(
            alert(&ours),
            Some(format!("[JUDGE]: {} (Score: {:.2})", word.words, word.value).as_str())
        );
        for told in [&mut ours, &mut theirs] {
            told["reward"] = Value::Null;
            told["observation"]["total_score"] = Value::Null;
            let alerts = told["observation"]["critical_alerts"].as_array_mut().unwrap();
            alerts.retain(|alert| !alert.as_str().unwrap().starts_with("[JUDGE]"));
        }
        assert_eq!(ours, theirs);
    }
    assert!(alert(&judged[2]).unwrap().contains("fuel"), "{:?}", alert(&judged[2]));
}

#[tokio::test]
async fn a_model_judges_and_every_verdict_is_kept() {
    let model = endpoint([says(FINE)]).await;
    let mut server = server(judges(Judge::Llm, &model.uri())).await;
    let actions = [hold(), burn(), hold()];
    let judged = told(&server, &actions).await;
    for told in &judged[1..] {
        assert_eq!(alert(told), Some("[JUDGE]: Nothing came near. (Score: 0.50)"));
        assert!((number(told, "/reward") - 0.02 * 0.998 / 1.2 * 1.1).abs() < 1e-9, "{told}");
    }
    // The same again costs nothing, and is kept again.
    assert_eq!(told(&server, &actions).await, judged);
    let asked = sent(&model).await;
    assert_eq!(asked.len(), 3);
    let words = asked[1]["messages"][1]["content"].as_str().unwrap();
    assert!(
        words.starts_with("Before step 2:")
            && words.contains(r#"{"burns":[{"satellite_id":0,"delta_vx":0.3"#),
        "{words}"
    );
    assert_eq!(asked[1]["response_format"]["json_schema"]["name"], "verdict");
    server.stop().await;
    let kept = kept(&server).await;
    let steps: Vec<(i64, bool)> = kept.iter().map(|row| (row.step, row.cached)).collect();
    assert_eq!(steps, [(1, false), (2, false), (3, false), (1, true), (2, true), (3, true)]);
    assert!(kept.iter().all(|row| row.score == Some(0.5) && row.error.is_none() && row.episode == "e"));
    assert_eq!(kept[0].tokens, 920);
    assert!(kept.iter().all(|row| row.rule_score.is_some()));
    assert_eq!(kept[1].rule_case.as_deref(), Some("unnecessary_burn"));
    // How far they agree.
    let agreement = |format: &str| {
        let mut command = std::process::Command::new(binary());
        command.env_remove("SPARRING_LOG").arg("judge-agreement").arg("--db").arg(server.db());
        let output = command.args(["--format", format]).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let report: Value = serde_json::from_str(&agreement("json")).unwrap();
    assert_eq!((&report["verdicts"], &report["unanswered"]), (&json!(6), &json!(0)));
    assert_eq!(report["agreement"][0]["bands"], json!([[0, 0, 0], [0, 0, 0], [2, 0, 4]]));
    assert!(agreement("table").contains("unnecessary burn"));
}

/// For a run the judge is the run's own, and what the run is told of the episode is what the world says.
#[tokio::test]
async fn a_run_may_have_its_own_judge_and_is_told_the_worlds_score() {
    let model = endpoint([says(FINE)]).await;
    let server = server(judges(Judge::Off, &model.uri())).await;
    let api = server.api();
    for (run, judge) in [("plain", json!(null)), ("ruled", json!("deterministic")), ("asked", json!("llm"))] {
        let wish = json!({"id": run, "tasks": ["kessler/survival"], "seed": 1, "judge": judge, "design": {"designer": "off"}});
        let created = api.post("/v1/runs", wish).await.expect(201);
        assert_eq!(created["settings"]["judge"], judge);
        let mut socket = Socket::to(&api, "/ws").await;
        socket.reset(json!({"run": run})).await;
        let mut last = Value::Null;
        for _ in 0..60 {
            last = socket.step(hold()).await;
            assert_eq!(alert(&last).is_some(), run != "plain", "{last}");
            if last["done"] == true {
                break;
            }
        }
        let reported = socket.state().await["reported"].clone();
        let (score, total) = (number(&reported, "/score"), number(&last, "/observation/total_score"));
        assert_eq!((score - total).abs() < 1e-6, run == "plain", "{reported} {last}");
    }
    // Nobody can ask for a model that is not there.
    let without = Server::start().await;
    let refused = without.api().post("/v1/runs", json!({"judge": "llm"})).await.expect(422);
    assert_eq!(refused["field"], "judge", "{refused}");
    let refused = without.api().post("/v1/runs", json!({"judge": "everybody"})).await;
    assert!(refused.status == 422 || refused.status == 400, "{refused:?}");
}

/// An address at which every connection gets this, for ever.
async fn raw(begin: &'static str, more: &'static str) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let base = format!("http://{}", listener.local_addr().unwrap());
    tokio::spawn(async move {
        while let Ok((mut connection, _)) = listener.accept().await {
            tokio::spawn(async move {
                let mut request = vec![0; 65536];
                let _ = connection.read(&mut request).await;
                let _ = connection.write_all(begin.as_bytes()).await;
                while !more.is_empty() && connection.write_all(more.as_bytes()).await.is_ok() {
                    tokio::time::sleep(Duration::from_millis(1)).await;
                }
            });
        }
    });
    base
}

/// Whatever an endpoint does, each step is answered in time with the world's own reward, the reason is kept, and nothing
/// tells the key.
#[tokio::test]
async fn no_endpoint_can_do_harm() {
    let text = |status: u16| ResponseTemplate::new(status).set_body_string(format!("go away with {KEY}"));
    let nobody = {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        format!("http://{}", listener.local_addr().unwrap())
    };
    let mut truncated = completion(FINE).to_string();
    truncated.truncate(40);
    let wire = [
        ("slow", says(FINE).set_delay(Duration::from_secs(30)), "within 1 s"),
        ("429", text(429).insert_header("retry-after", "60"), "60 s"),
        ("500", text(500), "500"),
        ("truncated", ResponseTemplate::new(200).set_body_string(truncated), "answer makes no sense"),
        ("html", ResponseTemplate::new(200).set_body_string("<html>no</html>"), "answer makes no sense"),
        ("prose", says("I find it fine."), "no verdict"),
        ("beyond", says(r#"{"reasoning": "x", "score": 7}"#), "outside -1 to 1"),
        ("NaN", says(r#"{"reasoning": "x", "score": NaN}"#), "no verdict"),
        ("401", text(401), "401"),
    ];
    let mut cases = Vec::new();
    for (name, answer, why) in wire {
        let model = endpoint([answer]).await;
        cases.push((name, model.uri(), why, Some(model)));
    }
    cases.push(("nobody", nobody, "cannot be reached", None));
    let stream = raw("HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\n", "5\r\nxxxxx\r\n").await;
    cases.push(("streaming", stream, "within 1 s", None));
    cases.push(("broken off", raw("HTTP/1.1 200 OK\r\ncontent-length: 99\r\n\r\n{", "").await, "", None));
    let plain = told(&Server::start().await, &[hold(), burn(), hold(), hold(), hold()]).await;
    for (name, base, why, model) in cases {
        let mut server = server(judges(Judge::Llm, &base)).await;
        let begun = Instant::now();
        let judged = told(&server, &[hold(), burn(), hold(), hold(), hold()]).await;
        // Five steps of a second's patience; the machine may be busy.
        assert!(begun.elapsed() < Duration::from_secs(15), "{name}: {:?}", begun.elapsed());
        for (ours, theirs) in judged.iter().zip(&plain) {
            assert_eq!(ours["reward"], theirs["reward"], "{name}");
            assert_eq!(alert(ours), None, "{name}");
        }
        server.stop().await;
        let kept = kept(&server).await;
        assert_eq!(kept.len(), 5, "{name}");
        let error = kept[0].error.clone().unwrap();
        assert!(kept[0].score.is_none() && error.contains(why), "{name}: {error}");
        if let ("slow", Some(model)) = (name, &model) {
            assert!(sent(model).await.len() <= 3, "what is late in a row is left alone");
        }
        let file = std::fs::read(server.db()).unwrap();
        assert!(
            !file.windows(KEY.len()).any(|bytes| bytes == KEY.as_bytes()),
            "{name}: the key is in the database"
        );
        assert!(!judged.iter().any(|told| told.to_string().contains(KEY)), "{name}");
    }
}

/// While one step waits for a verdict, others are taken.
#[tokio::test]
async fn a_slow_judge_keeps_nobody_else_waiting() {
    let model = endpoint([says(FINE).set_delay(Duration::from_millis(900))]).await;
    let server = server(judges(Judge::Llm, &model.uri())).await;
    let wish = json!({"id": "run", "seed": 2, "tasks": ["kessler/survival"], "judge": "off", "design": {"designer": "off"}});
    let _ = server.api().post("/v1/runs", wish).await.expect(201);
    let mut waiting = Socket::to(&server.api(), "/ws").await;
    let mut free = Socket::to(&server.api(), "/ws").await;
    waiting.reset(json!({"seed": 1})).await;
    free.reset(json!({"run": "run"})).await;
    let (mut steps, begun) = (0, Instant::now());
    let judged = {
        let judged = waiting.step(hold());
        tokio::pin!(judged);
        loop {
            tokio::select! {
                biased;
                told = &mut judged => break told,
                _ = free.step(hold()), if steps < 40 => steps += 1,
            }
        }
    };
    assert!(alert(&judged).is_some() && begun.elapsed() >= Duration::from_millis(900));
    assert!(steps > 5, "{steps} steps in {:?}", begun.elapsed());
    // Its own connection is not dead meanwhile: a ping is answered before the step is.
    waiting.text(&json!({"type": "step", "data": burn()}).to_string()).await;
    let begun = Instant::now();
    waiting.ping().await;
    assert!(waiting.ponged().await && begun.elapsed() < Duration::from_millis(700), "{:?}", begun.elapsed());
    let Came::Frame(told) = waiting.next().await else { panic!("no answer") };
    assert!(alert(&told["data"]).is_some(), "{told}");
    // What is sent before the answer waits its turn.
    waiting.text(&json!({"type": "step", "data": {"burns": []}}).to_string()).await;
    waiting.text(&json!({"type": "state"}).to_string()).await;
    let kinds = [waiting.next().await, waiting.next().await].map(|came| match came {
        Came::Frame(frame) => frame["type"].as_str().unwrap().to_owned(),
        other => panic!("{other:?}"),
    });
    assert_eq!(kinds, ["observation", "state"]);
}

/// What verdicts cost is remembered by a server that starts again.
#[tokio::test]
async fn a_budget_that_is_spent_stays_spent() {
    let endpoint = endpoint([says(FINE)]).await;
    let base = endpoint.uri();
    let mut server = Server::set_up(move |config| {
        let model = LlmConfig { tokens_per_run: Some(12_000), ..model(&base) };
        let judges = Judges::new(Judge::Llm, Some(ModelJudge::new(Llm::new(model).unwrap())));
        Config { judges: Arc::new(judges), ..config }
    })
    .await;
    let holds: Vec<Value> = (0..20).map(|_| hold()).collect();
    let judged = told(&server, &holds).await;
    assert!(alert(&judged[1]).is_some() && alert(&judged[20]).is_none(), "{:?}", alert(&judged[20]));
    let asked = sent(&endpoint).await.len();
    server.restart().await;
    let judged = told(&server, &[burn(), hold()]).await;
    assert!(alert(&judged[1]).is_none() && number(&judged[1], "/reward") > 0.0);
    assert_eq!(sent(&endpoint).await.len(), asked, "a spent budget pays for nothing");
    server.stop().await;
    let error = kept(&server).await.pop().and_then(|row| row.error).unwrap();
    assert!(error.contains("budget"), "{error}");
}

/// A file that is no database of verdicts is told apart, and left as it is.
#[test]
fn agreement_of_what_holds_no_verdicts() {
    let folder = tempfile::tempdir().unwrap();
    let (empty, text) = (folder.path().join("empty.sqlite3"), folder.path().join("text.sqlite3"));
    std::fs::write(&empty, "").unwrap();
    std::fs::write(&text, "no database at all, but a text of some length").unwrap();
    for (file, why) in [(&empty, "is empty"), (&text, ""), (&folder.path().join("none"), "")] {
        let mut command = std::process::Command::new(binary());
        let output = command.env_remove("SPARRING_LOG").arg("judge-agreement").arg("--db").arg(file).output();
        let output = output.unwrap();
        let words = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{words}");
        assert!(words.contains(why) && words.contains(&*file.to_string_lossy()), "{words}");
        assert!(output.stdout.is_empty() && words.lines().count() <= 3, "{words}");
    }
    assert_eq!(std::fs::metadata(&empty).unwrap().len(), 0);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "nothing is left behind");
}

struct Kept {
    step: i64,
    episode: String,
    score: Option<f64>,
    error: Option<String>,
    rule_score: Option<f64>,
    rule_case: Option<String>,
    cached: bool,
    tokens: i64,
}

/// What a server that is stopped kept.
async fn kept(server: &Server) -> Vec<Kept> {
    use sqlx::{Connection, Row};
    let path = format!("sqlite://{}", server.db().display());
    let mut connection = sqlx::SqliteConnection::connect(&path).await.unwrap();
    let sql = "SELECT step, episode, score, error, rule_score, rule_case, cached, tokens_in + tokens_out FROM judge_verdicts ORDER BY id";
    let rows = sqlx::query(sql).fetch_all(&mut connection).await.unwrap();
    rows.iter()
        .map(|row| Kept {
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
