//! Alerts: they begin and end by rules, are listed, and reach a webhook that fails at first.

use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use axum::Router;
use axum::extract::State;
use axum::http::StatusCode;
use axum::routing::post;
use clock::{Clock, ManualClock};
use orchestrator::alerts::{AlertSettings, MessageFormat, Webhook};
use orchestrator::service::Config;
use serde_json::{Value, json};
use system_tests::{ApiClient, Server, wait_for};

/// Duration of a minute, ms.
const MINUTE: i64 = 60_000;

/// Receiver of messages, which refuses the first ones.
#[derive(Debug, Default)]
struct Receiver {
    messages: Mutex<Vec<Value>>,
    /// Number of messages that are still refused.
    refusals: Mutex<u32>,
}

impl Receiver {
    /// Listens on a free port. Returns the URL of the webhook.
    async fn listen(self: Arc<Self>) -> String {
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = format!("http://{}/hook/secret-key", listener.local_addr().unwrap());
        let routes = Router::new().route("/hook/{key}", post(take)).with_state(self);
        tokio::spawn(async move { axum::serve(listener, routes).await });
        url
    }

    /// Waits until this many messages were taken, and returns the last one.
    async fn message(&self, number: usize) -> Value {
        wait_for("the receiver has the message", async || {
            self.messages.lock().unwrap().get(number - 1).cloned()
        })
        .await
    }
}

async fn take(State(receiver): State<Arc<Receiver>>, body: axum::Json<Value>) -> StatusCode {
    let mut refusals = receiver.refusals.lock().unwrap();
    if *refusals > 0 {
        *refusals -= 1;
        return StatusCode::SERVICE_UNAVAILABLE;
    }
    receiver.messages.lock().unwrap().push(body.0);
    StatusCode::OK
}

/// Starts a server with the default rules.
async fn start(clock: Clock, url: &str, format: MessageFormat) -> Server {
    let webhook = Webhook::new(url, format).unwrap();
    Server::with_config(move |config| {
        let (check_interval, webhook) = (Duration::from_millis(50), Some(webhook.clone()));
        let alerts = AlertSettings { check_interval, webhook, ..AlertSettings::default() };
        Config { clock: clock.clone(), alerts, ..config }
    })
    .await
}

/// Lets some time pass.
fn advance(time: &ManualClock, ms: i64) {
    time.time.fetch_add(ms, Ordering::SeqCst);
}

/// Creates a run and reports the results of some groups.
async fn train(api: &ApiClient, groups: u32) {
    let settings = json!({"id": "r", "name": "first", "tasks": ["kessler/survival"], "strategy": "ladder",
                          "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await;
    let lease = api.lease("r", json!({"groups": groups})).await;
    let _ = api.report("r", lease.results("hold")).await;
}

/// Returns the alerts that last, once there are this many.
async fn lasting(api: &ApiClient, count: usize) -> Vec<Value> {
    wait_for("the alerts begin or end", async || {
        let page = api.get("/v1/alerts?lasting=true").await.expect(200);
        assert_eq!(page["lasting"].as_u64(), page["alerts"].as_array().map(|alerts| alerts.len() as u64));
        page["alerts"].as_array().filter(|alerts| alerts.len() == count).cloned()
    })
    .await
}

#[tokio::test(flavor = "multi_thread")]
async fn stalled_run_begins_an_alert_that_results_end() {
    let receiver = Arc::new(Receiver { refusals: Mutex::new(1), ..Receiver::default() });
    let url = Arc::clone(&receiver).listen().await;
    let time = Clock::manual(1_700_000_000_000);
    let mut server = start(time.clock.clone(), &url, MessageFormat::Json).await;
    train(&server.api(), 1).await;
    advance(&time, 16 * MINUTE);
    let [alert] = &lasting(&server.api(), 1).await[..] else { panic!("one alert") };
    assert_eq!((&alert["rule"], &alert["run"]), (&json!("no_results"), &json!("r")));
    // The receiver refuses the first message; the second attempt comes two seconds later, here after a restart.
    wait_for("the first attempt fails", async || {
        let page = server.api().get("/v1/alerts").await.expect(200);
        (page["alerts"][0]["message_error"] == "the receiver answered with status 503").then_some(())
    })
    .await;
    assert!(receiver.messages.lock().unwrap().is_empty());
    server.restart().await;
    advance(&time, 3_000);
    let began = receiver.message(1).await;
    assert_eq!(
        (&began["state"], &began["rule"], &began["run"]),
        (&json!("began"), &json!("no_results"), &json!({"id": "r", "name": "first"}))
    );
    train(&server.api(), 1).await;
    let ended = receiver.message(2).await;
    assert_eq!((&ended["state"], &ended["alert"]), (&json!("ended"), &began["alert"]));
    // The server stores that the message was taken after the receiver has it.
    wait_for("the end is sent", async || {
        let page = server.api().get("/v1/alerts?run=r").await.expect(200);
        assert_eq!(page["lasting"], 0);
        (page["alerts"][0]["message_state"] == "sent").then_some(())
    })
    .await;
    // A paused run is not reported.
    let _ = server.api().post("/v1/runs/r/pause", json!({})).await.expect(200);
    advance(&time, 16 * MINUTE);
    tokio::time::sleep(Duration::from_millis(300)).await; // tests the passing of time: no alert begins
    assert_eq!(server.api().get("/v1/alerts").await.expect(200)["alerts"].as_array().unwrap().len(), 1);
    assert_eq!(receiver.messages.lock().unwrap().len(), 2);
}

#[tokio::test(flavor = "multi_thread")]
async fn missing_episodes_are_reported_in_words_for_slack() {
    let receiver = Arc::new(Receiver::default());
    let url = Arc::clone(&receiver).listen().await;
    let time = Clock::manual(1_700_000_000_000);
    let server = start(time.clock.clone(), &url, MessageFormat::Slack).await;
    let api = server.api();
    train(&api, 2).await;
    let _ = api.lease("r", json!({"groups": 30, "ttl_s": 5})).await;
    advance(&time, 10_000);
    let [alert] = &lasting(&api, 1).await[..] else { panic!("one alert") };
    assert_eq!((&alert["rule"], &alert["subject"]), (&json!("missing_share"), &json!("kessler/survival")));
    let text = receiver.message(1).await["text"].as_str().unwrap().to_owned();
    assert!(
        text.starts_with("*Sparring, run first*: ") && text.contains("of kessler/survival are missing"),
        "{text}"
    );
}

#[tokio::test]
async fn invalid_queries_of_alerts_are_refused() {
    let server = Server::start().await;
    let api = server.api();
    for (query, status) in [
        ("limit=0", 422),
        ("limit=501", 422),
        ("cursor=x", 422),
        ("run=A", 422),
        ("lasting=maybe", 400),
        ("golf=1", 400),
    ] {
        assert_eq!(api.get(&format!("/v1/alerts?{query}")).await.status, status, "{query}");
    }
    let page = api.get("/v1/alerts?run=gone").await.expect(200);
    assert_eq!((&page["alerts"], &page["lasting"], &page["next"]), (&json!([]), &json!(0), &json!(null)));
    assert_eq!(page["has_webhook"], false);
    let rules: Vec<&str> =
        page["rules"].as_array().unwrap().iter().map(|rule| rule["rule"].as_str().unwrap()).collect();
    assert!(rules.contains(&"no_results") && rules.contains(&"worker_lost"), "{rules:?}");
    assert_eq!(page["missing_shards"], json!([]));
}
