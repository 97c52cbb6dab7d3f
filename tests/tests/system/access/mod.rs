//! Access control: every role on every operation, limits of tokens, the audit log, and headers for browsers.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use futures_util::StreamExt;
use orchestrator::limits::ClientLimits;
use orchestrator::service::{Config, Service, StartError};
use serde_json::{Value, json};
use system_tests::{ApiClient, Server, http_client, sparring_binary};
use tokio_tungstenite::connect_async;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;

mod limits;
mod tokens;

const ROLES: [&str; 3] = ["viewer", "trainer", "admin"];

fn run_sparring(db: &Path, args: &[&str]) -> (Option<i32>, String, String) {
    let out = Command::new(sparring_binary()).args(args).arg("--db").arg(db).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (out.status.code(), text(out.stdout), text(out.stderr))
}

fn create_token(db: &Path, role: &str) -> String {
    let (code, token, stderr) = run_sparring(db, &["token", "create", role, "--role", role]);
    assert_eq!(code, Some(0), "{stderr}");
    token.trim().to_owned()
}

/// Starts a server that requires a token; returns it with one token for each role.
async fn start_with_tokens(
    setup: impl Fn(Config) -> Config + Send + Sync + 'static,
) -> (Server, BTreeMap<&'static str, String>) {
    let mut server = Server::with_config(setup).await;
    server.stop().await;
    let db = server.db_path();
    let tokens =
        tokio::task::spawn_blocking(move || ROLES.map(|role| (role, create_token(&db, role)))).await.unwrap();
    server.restart().await;
    (server, tokens.into())
}

/// Lists the operations of the OpenAPI document: method, path and required role.
fn operations() -> Vec<(String, String, Option<String>)> {
    let document = serde_json::to_value(orchestrator::http::openapi()).unwrap();
    let mut operations = Vec::new();
    for (path, item) in document["paths"].as_object().unwrap() {
        for (method, operation) in item.as_object().unwrap() {
            let Some(operation) = operation.as_object().filter(|o| o.contains_key("responses")) else {
                continue;
            };
            let role = operation
                .get("security")
                .map(|security| security[0]["token"][0].as_str().unwrap().to_owned());
            operations.push((method.to_uppercase(), path.clone(), role));
        }
    }
    operations
}

#[test]
fn every_operation_declares_its_role() {
    let lines = operations()
        .into_iter()
        .map(|(method, path, role)| format!("{:<8} {method:<4} {path}", role.as_deref().unwrap_or("-")));
    let mut lines: Vec<String> = lines.collect();
    lines.sort();
    // The snapshot makes the role of a new operation visible in review. An operation without a rule is for admins.
    insta::assert_snapshot!("roles", lines.join("\n"));
}

#[tokio::test(flavor = "multi_thread")]
async fn each_role_reaches_only_its_operations() {
    let client_limits = ClientLimits {
        requests: 10_000.try_into().unwrap(),
        anonymous: 10_000.try_into().unwrap(),
        ..ClientLimits::default()
    };
    let (server, tokens) = start_with_tokens(move |config| Config { client_limits, ..config }).await;
    let anonymous = server.api();
    let callers: Vec<(Option<usize>, ApiClient)> = std::iter::once((None, anonymous.clone()))
        .chain(std::iter::once((
            None,
            anonymous.clone().with_token(&format!("sparring_1_{}", "0".repeat(64))),
        )))
        .chain(
            ROLES
                .iter()
                .enumerate()
                .map(|(rank, role)| (Some(rank), anonymous.clone().with_token(&tokens[role]))),
        )
        .collect();
    let admin = &callers.last().unwrap().1;
    let _ = admin.post("/v1/runs", json!({"id": "run"})).await.expect(201);
    let mut open = Vec::new();
    for (method, path, role) in operations() {
        let concrete =
            path.replace("{run}", "run").replace("{lease}", "1-aaaaaa").replace("{episode}", "ep_1-aaaaaa_0");
        let concrete = concrete
            .replace("{design}", "layout-1")
            .replace("{layout}", "layout-1")
            .replace("{request}", "ask-1");
        for (rank, api) in &callers {
            if path.ends_with("/events") && rank.is_some() {
                continue; // the stream never ends; assert_undocumented_routes tests it
            }
            let query = if path.ends_with("/trajectories") { "?wait_s=0" } else { "" };
            let answer = api.request(&method, &format!("{concrete}{query}"), "application/json", "{}").await;
            let needed = role.as_ref().map(|role| ROLES.iter().position(|known| known == role).unwrap());
            let expected = match (needed, rank) {
                (None, _) => None,
                (Some(_), None) => Some(401),
                (Some(needed), Some(rank)) => (*rank < needed).then_some(403),
            };
            match expected {
                Some(status) => {
                    assert_eq!(answer.status, status, "{method} {path} {rank:?} {}", answer.body);
                    assert_eq!(answer.content_type, "application/problem+json");
                }
                None => {
                    assert!(![401, 403].contains(&answer.status), "{method} {path} {rank:?} {}", answer.body);
                }
            }
        }
        if role.is_none() {
            open.push(format!("{method} {path}"));
        }
    }
    assert_eq!(open, ["GET /livez", "GET /readyz"]);
    assert_undocumented_routes(&anonymous, &tokens).await;
}

/// Checks routes that the document omits, unknown routes, the event stream and WebSockets.
async fn assert_undocumented_routes(anonymous: &ApiClient, tokens: &BTreeMap<&'static str, String>) {
    for path in ["/", "/ws", "/mcp", "/ws/ui", "/web/state", "/web/metadata"] {
        assert_eq!(anonymous.get(path).await.status, 401, "{path}");
    }
    for path in ["/web/reset", "/web/step"] {
        assert_eq!(anonymous.post(path, json!({})).await.status, 401, "{path}");
        let viewer = anonymous.clone().with_token(&tokens["viewer"]);
        assert_eq!(viewer.post(path, json!({})).await.status, 403, "{path}");
    }
    // Pages are public: they have no data of runs, which they request with a token.
    for path in ["/web/", "/dashboard/"] {
        let page = http_client().get(format!("{}{path}", anonymous.base())).send().await.unwrap();
        assert_eq!(page.status(), 200, "{path}");
    }
    assert_eq!(anonymous.get("/nothing").await.status, 404);
    let events =
        http_client().get(format!("{}/v1/runs/run/events", anonymous.base())).bearer_auth(&tokens["viewer"]);
    assert_eq!(events.send().await.unwrap().status(), 200);
    // The upgrade request of a WebSocket session is checked.
    for (caller, status) in [(None, Some(401)), (Some("viewer"), Some(403)), (Some("trainer"), None)] {
        let token = caller.map(|role| tokens[role].as_str());
        assert_eq!(connect(anonymous.base(), "/v1/sessions", token).await.err(), status);
    }
}

type Socket = tokio_tungstenite::WebSocketStream<tokio_tungstenite::MaybeTlsStream<tokio::net::TcpStream>>;

/// Opens a WebSocket; returns the HTTP status if the server rejects the upgrade.
async fn connect(base: &str, path: &str, token: Option<&str>) -> Result<Socket, u16> {
    let mut request = format!("{}{path}", base.replacen("http", "ws", 1)).into_client_request().unwrap();
    if let Some(token) = token {
        request.headers_mut().insert("authorization", format!("Bearer {token}").parse().unwrap());
    }
    match connect_async(request).await {
        Ok((socket, _)) => Ok(socket),
        Err(tokio_tungstenite::tungstenite::Error::Http(response)) => Err(response.status().as_u16()),
        Err(error) => panic!("{error}"),
    }
}

/// Receives the next message as JSON.
async fn next_message(socket: &mut Socket) -> Value {
    serde_json::from_str(socket.next().await.unwrap().unwrap().to_text().unwrap()).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn openenv_can_be_public_alone() {
    let (server, tokens) = start_with_tokens(|config| Config { openenv_public: true, ..config }).await;
    let api = server.api();
    let _ = api.post("/reset", json!({"seed": 1})).await.expect(200);
    let _ = api.get("/metadata").await.expect(200);
    assert_eq!(api.get("/v1/runs").await.status, 401);
    let trainer = api.clone().with_token(&tokens["trainer"]);
    let _ = trainer.post("/v1/runs", json!({"id": "run"})).await.expect(201);
    let rejected = api.clone().with_session("own").post("/reset", json!({"run": "run"})).await;
    assert!(
        rejected.status == 422 && rejected.body.to_string().contains("cannot run episodes of runs"),
        "{}",
        rejected.body
    );
    let _ = trainer.lease("run", json!({"groups": 1})).await; // waits until scenarios are prepared
    let _ = trainer.with_session("own").post("/reset", json!({"run": "run"})).await.expect(200);
}

#[tokio::test(flavor = "multi_thread")]
async fn without_tokens_only_loopback_is_allowed() {
    let folder = tempfile::tempdir().unwrap();
    let bind = "0.0.0.0:0".parse().unwrap();
    let rejected = Service::start(Config { bind, ..Config::local(folder.path().join("db")) }).await;
    assert!(matches!(rejected, Err(StartError::NoTokens(_))), "{rejected:?}");
    let server = Server::start().await;
    let url = format!("{}/v1/runs", server.api().base());
    let port = url.split(':').nth(2).unwrap().split('/').next().unwrap().to_owned();
    let request_status = |name: &'static str, value: String| {
        let request = http_client().get(&url).header(name, value);
        async move { request.send().await.unwrap().status().as_u16() }
    };
    for (name, value, status) in [
        ("host", format!("localhost:{port}"), 200),
        ("host", "evil.example".to_owned(), 403), // DNS rebinding
        ("host", "127.0.0.1.evil.example".to_owned(), 403),
        ("origin", format!("http://localhost:{port}"), 200),
        ("origin", "http://127.0.0.1:3000".to_owned(), 200),
        ("origin", "https://evil.example".to_owned(), 403), // a page of another site
        ("origin", "null".to_owned(), 403),
    ] {
        assert_eq!(request_status(name, value.clone()).await, status, "{name}: {value}");
    }
}

#[tokio::test]
async fn responses_have_security_headers() {
    let server = Server::start().await;
    for path in ["/v1/runs", "/docs/", "/web/", "/nothing"] {
        let answer = http_client().get(format!("{}{path}", server.api().base())).send().await.unwrap();
        let header = |name: &str| answer.headers().get(name).map(|value| value.to_str().unwrap().to_owned());
        assert_eq!(header("x-content-type-options").as_deref(), Some("nosniff"), "{path}");
        assert_eq!(header("referrer-policy").as_deref(), Some("no-referrer"));
        assert!(header("content-security-policy").unwrap().starts_with("default-src '"));
        assert_eq!(header("access-control-allow-origin"), None, "other sites cannot read the response");
        assert_eq!(header("cache-control").as_deref() == Some("no-store"), path.starts_with("/v1/"));
        assert_eq!(header("x-request-id").unwrap().len(), 36);
    }
}
