//! Repeats every exchange that was captured from the public kessler-env on openenv-core 0.3.0. Fields, types, status codes,
//! error codes and the fate of the connection must be the same, except for the listed differences.

use std::collections::BTreeMap;

use orchestrator::service::Config;
use serde_json::{Value, json};
use system_tests::{ApiClient, Received, Server, http_client, wait_until};

use super::socket::{OpenEnvSocket, captured_exchanges, find_difference};

/// How our response may differ from a captured one.
#[derive(Debug, Clone, Copy)]
enum Difference {
    /// Has this status and any body.
    Status(u16),
    /// Redirects to this path.
    Location(&'static str),
    /// Is an observation instead of an error.
    Observation,
    /// Is a frame with this error code, and the session continues.
    Code(&'static str),
    /// Is a JSON-RPC result.
    Result,
    /// Has all captured fields and further ones.
    More,
    /// Is problem details with the same `detail` and further fields.
    Problem,
}

const TOOLS: &str = "this server has tools";
const KEPT: &str = "the environment of /reset is available at /step";
const ALIVE: &str = "no message of a client ends its session";

/// Each intended difference: name of the exchange, our response and the reason.
const DIFFERENCES: [(&str, Difference, &str); 33] = [
    ("http_get_openapi_json", Difference::Status(200), "one document for all routes of this server"),
    ("web_openapi", Difference::Status(200), "one document for all routes of this server"),
    ("http_get_root", Difference::Status(307), "web mode is always on"),
    ("http_get_web", Difference::Status(307), "web mode is always on"),
    ("web_get_root_redirect", Difference::Location("/dashboard/"), "the dashboard is the front page"),
    ("http_get_unknown_404", Difference::Problem, "problem details (RFC 9457) with the same detail"),
    ("http_get_reset_405", Difference::Problem, "problem details (RFC 9457) with the same detail"),
    ("http_get_schema", Difference::More, "physics options add fields to observations"),
    ("http_reset_extra_field", Difference::Observation, "the field selects the task"),
    ("http_step_burns_bad_string_500", Difference::Status(422), KEPT),
    ("http_step_empty_burns", Difference::Observation, KEPT),
    ("http_step_one_burn", Difference::Observation, KEPT),
    ("http_step_nan", Difference::Status(422), "NaN is no valid thrust"),
    ("http_step_missing_action_422", Difference::Observation, "the README of kessler-env steps like this"),
    ("http_mcp_initialize", Difference::Result, "clients of the protocol start like this"),
    ("http_mcp_no_id", Difference::Result, TOOLS),
    ("http_mcp_string_id", Difference::Result, TOOLS),
    ("http_mcp_tools_list", Difference::Result, TOOLS),
    ("http_mcp_tools_list_in_session", Difference::Result, TOOLS),
    ("http_mcp_tools_call", Difference::Status(200), "a call without a session names the missing parameter"),
    ("web_step_bad_action", Difference::Status(422), "names the invalid field instead of a server error"),
    ("web_step_message", Difference::Status(422), "names the invalid field instead of a server error"),
    ("web_step_before_reset", Difference::Status(409), "a clear rejection instead of a server error"),
    ("ws_err_mcp_tools_list", Difference::Result, TOOLS),
    (
        "ws_err_reset_seed_negative_ignored",
        Difference::Code("VALIDATION_ERROR"),
        "seeds are used: an invalid one is rejected",
    ),
    ("ws_fatal_binary_frame", Difference::Code("SESSION_ERROR"), ALIVE),
    ("ws_fatal_json_array", Difference::Code("VALIDATION_ERROR"), ALIVE),
    ("ws_fatal_json_null", Difference::Code("VALIDATION_ERROR"), ALIVE),
    ("ws_fatal_json_number", Difference::Code("VALIDATION_ERROR"), ALIVE),
    ("ws_fatal_step_burns_bad_string", Difference::Code("VALIDATION_ERROR"), ALIVE),
    ("ws_step_burn_inf", Difference::Code("VALIDATION_ERROR"), "infinity is no valid thrust"),
    ("ws_step_burn_nan", Difference::Code("VALIDATION_ERROR"), "NaN is no valid thrust"),
    ("wsmcp_tools_list", Difference::Result, TOOLS),
];

fn expected_difference(name: &str) -> Option<Difference> {
    DIFFERENCES.iter().find(|(listed, _, _)| *listed == name).map(|(_, difference, _)| *difference)
}

/// Checks that a response equals the captured one, or differs as listed. `already_differs` is true if its status or the end of
/// its session differs already.
fn check_response(name: &str, captured: &Value, ours: &Value, already_differs: bool) {
    match expected_difference(name) {
        None => assert_eq!(find_difference(captured, ours, ""), None, "{name}: {ours}"),
        Some(Difference::Observation) => {
            let observation = ours.pointer("/data/observation").or_else(|| ours.get("observation"));
            assert!(observation.is_some_and(|it| it["satellites"].is_array()), "{name}: {ours}");
        }
        Some(Difference::Code(code)) => assert_eq!(ours["data"]["code"], code, "{name}: {ours}"),
        Some(Difference::Result) => {
            let result = ours.get("result").or_else(|| ours.pointer("/data/result"));
            assert!(result.is_some_and(Value::is_object), "{name}: {ours}");
        }
        Some(Difference::Status(_) | Difference::Location(_)) => {}
        Some(Difference::Problem) => {
            assert!(ours["detail"].is_string() && ours["type"].is_string(), "{name}: {ours}");
        }
        Some(Difference::More) => {
            assert_eq!(
                find_difference(captured, &without_new_fields(captured, ours), ""),
                None,
                "{name}: {ours}"
            );
        }
    }
    if expected_difference(name).is_some() && !already_differs {
        assert_ne!(
            find_difference(captured, ours, ""),
            None,
            "{name} is as captured: remove it from the list"
        );
    }
}

/// Returns our response without the fields that were not captured.
fn without_new_fields(captured: &Value, ours: &Value) -> Value {
    match (captured, ours) {
        (Value::Object(theirs), Value::Object(us)) => {
            let known = us
                .iter()
                .filter_map(|(key, ours)| Some((key.clone(), without_new_fields(theirs.get(key)?, ours))));
            Value::Object(known.collect())
        }
        _ => ours.clone(),
    }
}

/// Repeats an exchange over HTTP in a session. `session_ids` maps captured session ids to ours.
async fn repeat_http_exchange(
    api: &ApiClient,
    session: &str,
    name: &str,
    exchange: &Value,
    session_ids: &mut BTreeMap<String, String>,
) {
    let request = &exchange["request"];
    let method = request["method"].as_str().unwrap().parse().unwrap();
    let url = format!("{}{}", api.base(), request["path"].as_str().unwrap());
    let client = http_client_without_redirects();
    let mut builder = client.request(method, url).header("x-session-id", session);
    for (key, value) in request["headers"].as_object().unwrap() {
        builder = builder.header(key, value.as_str().unwrap());
    }
    if let Some(text) = request["body_text"].as_str() {
        // Replaces captured session ids by those of this server.
        builder = builder.body(
            session_ids
                .iter()
                .fold(text.to_owned(), |text, (captured_id, our_id)| text.replace(captured_id, our_id)),
        );
    }
    let response = builder.send().await.unwrap();
    let captured = &exchange["response"];
    let status = response.status().as_u16();
    match expected_difference(name) {
        Some(Difference::Status(wanted)) => assert_eq!(status, wanted, "{name}"),
        Some(Difference::Observation | Difference::Result) => assert_eq!(status, 200, "{name}"),
        _ => assert_eq!(u64::from(status), captured["status"].as_u64().unwrap(), "{name}"),
    }
    let is_elsewhere = if let Some(captured) = captured["headers"]["location"].as_str() {
        let wanted = match expected_difference(name) {
            Some(Difference::Location(wanted)) => wanted,
            _ => captured,
        };
        assert_eq!(response.headers()["location"], wanted, "{name}");
        wanted != captured
    } else {
        false
    };
    let ours: Value = serde_json::from_str(&response.text().await.unwrap()).unwrap_or_default();
    let mut captured_body = captured["body_json"].clone();
    if let (Some(captured_id), Some(our_id)) =
        (captured_body.pointer("/result/session_id"), ours.pointer("/result/session_id"))
    {
        session_ids.insert(captured_id.as_str().unwrap().to_owned(), our_id.as_str().unwrap().to_owned());
    }
    for field in ["/result/session_id", "/error/message"] {
        if let Some(Value::String(text)) = captured_body.pointer_mut(field) {
            *text = session_ids
                .iter()
                .fold(text.clone(), |text, (captured_id, our_id)| text.replace(captured_id, our_id));
        }
    }
    if name.contains("state") && ours.get("task").is_some() {
        return check_response(name, &captured_body, &common_state(&ours), false); // openenv-core's State allows further fields
    }
    let already_differs = is_elsewhere || u64::from(status) != captured["status"].as_u64().unwrap();
    check_response(name, &captured_body, &ours, already_differs);
}

/// Returns a state without the fields that only this server has.
fn common_state(state: &Value) -> Value {
    json!({"episode_id": state["episode_id"], "step_count": state["step_count"]})
}

fn http_client_without_redirects() -> reqwest::Client {
    llm::http_client_builder(llm::TrustedRoots::None)
        .unwrap()
        .redirect(reqwest::redirect::Policy::none())
        .build()
        .unwrap()
}

#[tokio::test]
async fn http_responses_match_the_capture() {
    let server = Server::start().await;
    let api = server.api();
    let mut session_ids = BTreeMap::new();
    let all = captured_exchanges();
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
        repeat_http_exchange(&api, &session, name, exchange, &mut session_ids).await;
    }
    // The requests of the web page use one environment, in this order.
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
        repeat_http_exchange(&api, "web", name, &all[name], &mut session_ids).await;
    }
}

#[tokio::test]
async fn websocket_replies_match_the_capture() {
    let server = Server::start().await;
    let api = server.api();
    let all = captured_exchanges();
    for (name, exchange) in
        all.iter().filter(|(name, _)| name.starts_with("ws_") && !name.contains("capacity"))
    {
        let mut socket = OpenEnvSocket::connect(&api, "/ws").await;
        for _ in 0..resets_before(name) {
            let _ = socket.reset(json!({})).await;
        }
        repeat_frame_exchange(&mut socket, name, exchange).await;
    }
    for (name, exchange) in
        all.iter().filter(|(name, _)| name.starts_with("wsmcp_") && !name.contains("capacity"))
    {
        repeat_frame_exchange(&mut OpenEnvSocket::connect(&api, "/mcp").await, name, exchange).await;
    }
}

/// Returns how often the session had been reset before the captured exchange, modulo the three tasks.
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

async fn repeat_frame_exchange(socket: &mut OpenEnvSocket, name: &str, exchange: &Value) {
    let (request, captured) = (&exchange["request"], &exchange["response"]);
    let text = request["text"].as_str().unwrap_or_default();
    if request["frame"] == "binary" {
        socket.send_bytes(text.as_bytes()).await;
    } else {
        socket.send_text(text).await;
    }
    if captured["json"].is_null() {
        assert_eq!(socket.receive().await, Received::Closed(1000), "{name}");
        return;
    }
    let Received::Text(mut ours) = socket.receive().await else { panic!("{name}: no frame") };
    if ours["type"] == "state" {
        ours["data"] = common_state(&ours["data"]);
    }
    let ends = captured["after"] != "open"; // in the captured exchange
    check_response(name, &captured["json"], &ours, ends);
    // The session ends as captured, unless a listed difference keeps it open.
    if captured["after"] == "open" || expected_difference(name).is_some() {
        socket.send_text("{\"type\": \"state\"}").await;
        assert!(matches!(socket.receive().await, Received::Text(_)), "{name}: the session continues");
    } else {
        assert_eq!(socket.receive().await, Received::Closed(1000), "{name}");
    }
}

#[tokio::test]
async fn full_server_matches_the_capture_and_frees_places() {
    let limits = orchestrator::sessions::SessionLimits { max_sessions: 1, ..Default::default() };
    let server = Server::with_config(move |config| Config { sessions: limits, ..config }).await;
    let api = server.api();
    let all = captured_exchanges();
    let holder = OpenEnvSocket::connect(&api, "/ws").await;
    for name in ["ws_capacity_on_connect", "ws_capacity_reset_at_capacity"] {
        let Received::Text(frame) = OpenEnvSocket::connect(&api, "/ws").await.receive().await else {
            panic!("{name}")
        };
        check_response(name, &all[name]["response"]["json"], &frame, false);
    }
    let name = "wsmcp_capacity_tools_list_at_capacity";
    let mut refused = OpenEnvSocket::connect(&api, "/mcp").await;
    let Received::Text(frame) = refused.receive().await else { panic!("{name}") };
    check_response(name, &all[name]["response"]["json"], &frame, false);
    assert_eq!(refused.receive().await, Received::Closed(1000));
    let name = "http_mcp_session_create_capacity";
    repeat_http_exchange(&api, "x", name, &all[name], &mut BTreeMap::new()).await;
    assert_eq!(api.post("/reset", json!({})).await.status, 503);
    drop(holder);
    wait_until("the place of the dropped connection is free", async || {
        api.post("/reset", json!({})).await.status == 200
    })
    .await;
}

#[tokio::test]
async fn web_session_viewer_matches_the_capture() {
    let server = Server::start().await;
    let api = server.api();
    let all = captured_exchanges();
    let mut socket = OpenEnvSocket::connect(&api, "/ws/ui").await;
    let mut check_next_frame = async |name: &str| {
        let Received::Text(frame) = socket.receive().await else { panic!("{name}") };
        check_response(name, &all[name]["response"]["json"], &frame, false);
    };
    check_next_frame("wsui_on_connect").await;
    let _ = api.post("/web/reset", json!({})).await.expect(200);
    check_next_frame("wsui_after_reset").await;
    let burn = json!({"action": {"burns": [{"satellite_id": 0, "delta_vx": 0.2, "delta_vy": 0}]}});
    let _ = api.post("/web/step", burn).await.expect(200);
    check_next_frame("wsui_after_step").await;
}

#[test]
fn every_captured_exchange_is_known() {
    let all = captured_exchanges();
    assert_eq!(all.len(), 138);
    let unknown: Vec<_> = DIFFERENCES.iter().filter(|(name, _, _)| !all.contains_key(*name)).collect();
    assert!(unknown.is_empty(), "{unknown:?}");
}
