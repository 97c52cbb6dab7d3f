//! Every exchange that was captured from the public kessler-env on openenv-core 0.3.0, had again with this server: fields,
//! types, status codes, error codes and what becomes of the connection are the same, but for the differences that are listed.

use std::collections::BTreeMap;

use orchestrator::service::Config;
use serde_json::{Value, json};
use system_tests::{Api, Server, http_client};

use super::socket::{Came, Socket, difference, exchanges};

/// What is meant to be otherwise, how it is here, and why.
#[derive(Debug, Clone, Copy)]
enum Here {
    /// This status, whatever the body.
    Status(u16),
    /// An observation.
    Observation,
    /// A frame with this error code, and the session goes on.
    Code(&'static str),
    /// A JSON-RPC result.
    Result,
    /// All that was captured, and more.
    More,
    /// Problem details: the same `detail`, and more.
    Problem,
}

const TOOLS: &str = "there are tools here";
const KEPT: &str = "the environment of /reset is still there at /step";
const ALIVE: &str = "nothing that a client sends ends its session";

/// Each deliberate difference with its reason.
const DIFFERENCES: [(&str, Here, &str); 32] = [
    ("http_get_openapi_json", Here::Status(200), "one document of all that this server answers"),
    ("web_openapi", Here::Status(200), "one document of all that this server answers"),
    ("http_get_root", Here::Status(307), "web mode is always on"),
    ("http_get_web", Here::Status(307), "web mode is always on"),
    ("http_get_unknown_404", Here::Problem, "problem details (RFC 9457) with the same detail and more"),
    ("http_get_reset_405", Here::Problem, "problem details (RFC 9457) with the same detail and more"),
    ("http_get_schema", Here::More, "observations have fields more where physics options ask for them"),
    ("http_reset_extra_field", Here::Observation, "the task can be chosen: this asks for the third"),
    ("http_step_burns_bad_string_500", Here::Status(422), KEPT),
    ("http_step_empty_burns", Here::Observation, KEPT),
    ("http_step_one_burn", Here::Observation, KEPT),
    ("http_step_nan", Here::Status(422), "no number is no thrust"),
    ("http_step_missing_action_422", Here::Observation, "the original's README steps like this"),
    ("http_mcp_initialize", Here::Result, "clients of the protocol begin like this"),
    ("http_mcp_no_id", Here::Result, TOOLS),
    ("http_mcp_string_id", Here::Result, TOOLS),
    ("http_mcp_tools_list", Here::Result, TOOLS),
    ("http_mcp_tools_list_in_session", Here::Result, TOOLS),
    ("http_mcp_tools_call", Here::Status(200), "a call without a session says which parameter is missing"),
    ("web_step_bad_action", Here::Status(422), "the field at fault instead of a failure of the server"),
    ("web_step_message", Here::Status(422), "the field at fault instead of a failure of the server"),
    ("web_step_before_reset", Here::Status(409), "a clear refusal instead of a failure of the server"),
    ("ws_err_mcp_tools_list", Here::Result, TOOLS),
    (
        "ws_err_reset_seed_negative_ignored",
        Here::Code("VALIDATION_ERROR"),
        "seeds are honoured: one that cannot be is refused",
    ),
    ("ws_fatal_binary_frame", Here::Code("SESSION_ERROR"), ALIVE),
    ("ws_fatal_json_array", Here::Code("VALIDATION_ERROR"), ALIVE),
    ("ws_fatal_json_null", Here::Code("VALIDATION_ERROR"), ALIVE),
    ("ws_fatal_json_number", Here::Code("VALIDATION_ERROR"), ALIVE),
    ("ws_fatal_step_burns_bad_string", Here::Code("VALIDATION_ERROR"), ALIVE),
    ("ws_step_burn_inf", Here::Code("VALIDATION_ERROR"), "no number is no thrust"),
    ("ws_step_burn_nan", Here::Code("VALIDATION_ERROR"), "no number is no thrust"),
    ("wsmcp_tools_list", Here::Result, TOOLS),
];

fn here(name: &str) -> Option<Here> {
    DIFFERENCES.iter().find(|(of, _, _)| *of == name).map(|(_, here, _)| *here)
}

/// Whether an answer is as captured, or otherwise in the way it is meant to be; `otherwise`: its status or the end of its
/// session is already.
fn check(name: &str, captured: &Value, ours: &Value, otherwise: bool) {
    match here(name) {
        None => assert_eq!(difference(captured, ours, ""), None, "{name}: {ours}"),
        Some(Here::Observation) => {
            let seen = ours.pointer("/data/observation").or_else(|| ours.get("observation"));
            assert!(seen.is_some_and(|seen| seen["satellites"].is_array()), "{name}: {ours}");
        }
        Some(Here::Code(code)) => assert_eq!(ours["data"]["code"], code, "{name}: {ours}"),
        Some(Here::Result) => {
            let result = ours.get("result").or_else(|| ours.pointer("/data/result"));
            assert!(result.is_some_and(Value::is_object), "{name}: {ours}");
        }
        Some(Here::Status(_)) => {}
        Some(Here::Problem) => {
            assert!(ours["detail"].is_string() && ours["type"].is_string(), "{name}: {ours}");
        }
        Some(Here::More) => {
            assert_eq!(difference(captured, &only(captured, ours), ""), None, "{name}: {ours}");
        }
    }
    if here(name).is_some() && !otherwise {
        assert_ne!(difference(captured, ours, ""), None, "{name} is as captured: it is no difference");
    }
}

/// Of what is here the fields that were captured.
fn only(captured: &Value, ours: &Value) -> Value {
    match (captured, ours) {
        (Value::Object(theirs), Value::Object(us)) => {
            let known = us.iter().filter_map(|(key, ours)| Some((key.clone(), only(theirs.get(key)?, ours))));
            Value::Object(known.collect())
        }
        _ => ours.clone(),
    }
}

/// One exchange over HTTP in a session.
async fn over_http(
    api: &Api,
    session: &str,
    name: &str,
    exchange: &Value,
    seen: &mut BTreeMap<String, String>,
) {
    let request = &exchange["request"];
    let method = request["method"].as_str().unwrap().parse().unwrap();
    let url = format!("{}{}", api.base(), request["path"].as_str().unwrap());
    let client = reqwest_without_redirects();
    let mut asked = client.request(method, url).header("x-session-id", session);
    for (key, value) in request["headers"].as_object().unwrap() {
        asked = asked.header(key, value.as_str().unwrap());
    }
    if let Some(text) = request["body_text"].as_str() {
        // Ids that were given then are others now.
        asked = asked.body(seen.iter().fold(text.to_owned(), |text, (then, now)| text.replace(then, now)));
    }
    let answer = asked.send().await.unwrap();
    let captured = &exchange["response"];
    let status = answer.status().as_u16();
    match here(name) {
        Some(Here::Status(wanted)) => assert_eq!(status, wanted, "{name}"),
        Some(Here::Observation | Here::Result) => assert_eq!(status, 200, "{name}"),
        _ => assert_eq!(u64::from(status), captured["status"].as_u64().unwrap(), "{name}"),
    }
    if let Some(location) = captured["headers"]["location"].as_str() {
        assert_eq!(answer.headers()["location"], location, "{name}");
    }
    let ours: Value = serde_json::from_str(&answer.text().await.unwrap()).unwrap_or_default();
    let mut then = captured["body_json"].clone();
    if let (Some(then), Some(now)) = (then.pointer("/result/session_id"), ours.pointer("/result/session_id"))
    {
        seen.insert(then.as_str().unwrap().to_owned(), now.as_str().unwrap().to_owned());
    }
    for field in ["/result/session_id", "/error/message"] {
        if let Some(Value::String(text)) = then.pointer_mut(field) {
            *text = seen.iter().fold(text.clone(), |text, (then, now)| text.replace(then, now));
        }
    }
    if name.contains("state") && ours.get("task").is_some() {
        return check(name, &then, &standing(&ours), false); // openenv-core's State allows fields more
    }
    check(name, &then, &ours, u64::from(status) != captured["status"].as_u64().unwrap());
}

/// A state without the fields that only this server tells.
fn standing(state: &Value) -> Value {
    json!({"episode_id": state["episode_id"], "step_count": state["step_count"]})
}

fn reqwest_without_redirects() -> reqwest::Client {
    designer::llm::http_client(false).unwrap().redirect(reqwest::redirect::Policy::none()).build().unwrap()
}

#[tokio::test]
async fn requests_are_answered_as_captured() {
    let server = Server::start().await;
    let api = server.api();
    let mut seen = BTreeMap::new();
    let all = exchanges();
    let order = ["http_mcp_session_create", "http_mcp_tools_list_in_session", "http_mcp_session_close"];
    let first = order.iter().map(|name| (*name, &all[*name]));
    let rest = all.iter().map(|(name, exchange)| (name.as_str(), exchange));
    let rest = rest.filter(|(name, _)| {
        name.starts_with("http_") && !order.contains(name) && !name.ends_with("_capacity")
    });
    for (number, (name, exchange)) in first.chain(rest).enumerate() {
        let session = format!("session-{number}");
        if name.starts_with("http_step") {
            let reset = http_client().post(format!("{}/reset", api.base())).header("x-session-id", &session);
            assert_eq!(reset.send().await.unwrap().status(), 200);
        }
        over_http(&api, &session, name, exchange, &mut seen).await;
    }
    // The web page's requests are one after the other of one environment.
    let web = [
        "web_get_metadata",
        "web_get_root_redirect",
        "web_get_web_redirect",
        "web_openapi",
        "web_get_state",
        "web_step_before_reset",
        "web_reset_no_body",
        "web_step",
        "web_get_state_after",
        "web_step_bad_action",
        "web_step_message",
        "web_reset_seed",
        "web_step_burns_string",
        "web_step_empty",
    ];
    assert_eq!(web.len(), all.keys().filter(|name| name.starts_with("web_")).count());
    for name in web {
        over_http(&api, "web", name, &all[name], &mut seen).await;
    }
}

#[tokio::test]
async fn frames_are_answered_as_captured() {
    let server = Server::start().await;
    let api = server.api();
    let all = exchanges();
    for (name, exchange) in
        all.iter().filter(|(name, _)| name.starts_with("ws_") && !name.contains("capacity"))
    {
        let mut socket = Socket::to(&api, "/ws").await;
        for _ in 0..resets_before(name) {
            let _ = socket.reset(json!({})).await;
        }
        over_socket(&mut socket, name, exchange).await;
    }
    for (name, exchange) in
        all.iter().filter(|(name, _)| name.starts_with("wsmcp_") && !name.contains("capacity"))
    {
        over_socket(&mut Socket::to(&api, "/mcp").await, name, exchange).await;
    }
}

/// How often the session was reset when the exchange was captured, modulo the three tasks.
fn resets_before(name: &str) -> usize {
    match name {
        _ if name.contains("before_reset") || name.starts_with("ws_reset_task1") => 0,
        "ws_err_reset_seed_negative_ignored" => 0,
        "ws_reset_task2" | "ws_err_reset_unknown_kwarg_ignored" => 1,
        "ws_reset_task3" | "ws_step_task2_burn" => 2,
        "ws_reset_wraps_task1" | "ws_step_task3" => 3,
        _ => 1,
    }
}

async fn over_socket(socket: &mut Socket, name: &str, exchange: &Value) {
    let (request, captured) = (&exchange["request"], &exchange["response"]);
    let text = request["text"].as_str().unwrap_or_default();
    if request["frame"] == "binary" {
        socket.bytes(text.as_bytes()).await;
    } else {
        socket.text(text).await;
    }
    if captured["json"].is_null() {
        assert_eq!(socket.next().await, Came::Closed(1000), "{name}");
        return;
    }
    let Came::Frame(mut ours) = socket.next().await else { panic!("{name}: no frame") };
    if ours["type"] == "state" {
        ours["data"] = standing(&ours["data"]);
    }
    let ends = captured["after"] != "open"; // theirs
    check(name, &captured["json"], &ours, ends);
    // The captured after-effect, but where the session is meant to live on.
    if captured["after"] == "open" || here(name).is_some() {
        socket.text("{\"type\": \"state\"}").await;
        assert!(matches!(socket.next().await, Came::Frame(_)), "{name}: the session goes on");
    } else {
        assert_eq!(socket.next().await, Came::Closed(1000), "{name}");
    }
}

#[tokio::test]
async fn a_full_server_says_so_as_captured_and_has_room_at_once_when_somebody_goes() {
    let limits = orchestrator::sessions::Limits { most: 1, ..Default::default() };
    let server = Server::set_up(move |config| Config { sessions: limits, ..config }).await;
    let api = server.api();
    let all = exchanges();
    let holder = Socket::to(&api, "/ws").await;
    for name in ["ws_capacity_on_connect", "ws_capacity_reset_at_capacity"] {
        let Came::Frame(told) = Socket::to(&api, "/ws").await.next().await else { panic!("{name}") };
        check(name, &all[name]["response"]["json"], &told, false);
    }
    let name = "wsmcp_capacity_tools_list_at_capacity";
    let mut refused = Socket::to(&api, "/mcp").await;
    let Came::Frame(told) = refused.next().await else { panic!("{name}") };
    check(name, &all[name]["response"]["json"], &told, false);
    assert_eq!(refused.next().await, Came::Closed(1000));
    let name = "http_mcp_session_create_capacity";
    over_http(&api, "x", name, &all[name], &mut BTreeMap::new()).await;
    assert_eq!(api.post("/reset", json!({})).await.status, 503);
    holder.drop_dead();
    for _ in 0..100 {
        if api.post("/reset", json!({})).await.status == 200 {
            return;
        }
        tokio::time::sleep(std::time::Duration::from_millis(20)).await;
    }
    panic!("the place is not free");
}

#[tokio::test]
async fn who_looks_at_a_web_session_sees_it_as_captured() {
    let server = Server::start().await;
    let api = server.api();
    let all = exchanges();
    let mut socket = Socket::to(&api, "/ws/ui").await;
    let mut sees = async |name: &str| {
        let Came::Frame(told) = socket.next().await else { panic!("{name}") };
        check(name, &all[name]["response"]["json"], &told, false);
    };
    sees("wsui_on_connect").await;
    let _ = api.post("/web/reset", json!({})).await.expect(200);
    sees("wsui_after_reset").await;
    let burn = json!({"action": {"burns": [{"satellite_id": 0, "delta_vx": 0.2, "delta_vy": 0}]}});
    let _ = api.post("/web/step", burn).await.expect(200);
    sees("wsui_after_step").await;
}

#[test]
fn every_exchange_is_had_again() {
    let all = exchanges();
    assert_eq!(all.len(), 138);
    let unknown: Vec<_> = DIFFERENCES.iter().filter(|(name, _, _)| !all.contains_key(*name)).collect();
    assert!(unknown.is_empty(), "{unknown:?}");
}
