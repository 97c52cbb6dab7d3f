//! Who may come in: every role on every operation of the API's document, limits, the audit log, and what browsers are told.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use futures_util::StreamExt;
use orchestrator::http::Each;
use orchestrator::service::{Config, Service, StartError};
use serde_json::{Value, json};
use system_tests::{Api, Server, binary, http_client};
use tokio_tungstenite::connect_async;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;

mod limits;
mod tokens;

const ROLES: [&str; 3] = ["viewer", "trainer", "admin"];

fn sparring(db: &Path, args: &[&str]) -> (Option<i32>, String, String) {
    let out = Command::new(binary()).args(args).arg("--db").arg(db).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (out.status.code(), text(out.stdout), text(out.stderr))
}

fn token(db: &Path, role: &str) -> String {
    let (code, token, told) = sparring(db, &["token", "create", role, "--role", role]);
    assert_eq!(code, Some(0), "{told}");
    token.trim().to_owned()
}

/// A server that lets in whoever has one of these tokens, by role.
async fn closed(
    setup: impl Fn(Config) -> Config + Send + Sync + 'static,
) -> (Server, BTreeMap<&'static str, String>) {
    let mut server = Server::set_up(setup).await;
    server.stop().await;
    let db = server.db();
    let tokens =
        tokio::task::spawn_blocking(move || ROLES.map(|role| (role, token(&db, role)))).await.unwrap();
    server.restart().await;
    (server, tokens.into())
}

/// Operations of the document: method, path, the role they need.
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
fn every_operation_says_which_role_it_needs() {
    let told = operations()
        .into_iter()
        .map(|(method, path, role)| format!("{:<8} {method:<4} {path}", role.as_deref().unwrap_or("-")));
    let mut told: Vec<String> = told.collect();
    told.sort();
    // Whoever adds an operation reads here whom it is for; one that nobody thought of says nothing, and is for admins.
    insta::assert_snapshot!("roles", told.join("\n"));
}

#[tokio::test(flavor = "multi_thread")]
async fn each_role_may_what_it_may_and_nothing_else() {
    let each = Each {
        requests: 10_000.try_into().unwrap(),
        anonymous: 10_000.try_into().unwrap(),
        ..Each::default()
    };
    let (server, tokens) = closed(move |config| Config { each, ..config }).await;
    let anonymous = server.api();
    let callers: Vec<(Option<usize>, Api)> = std::iter::once((None, anonymous.clone()))
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
            .replace("{ask}", "ask-1");
        for (rank, api) in &callers {
            if path.ends_with("/events") && rank.is_some() {
                continue; // it goes on for ever; below
            }
            let query = if path.ends_with("/trajectories") { "?wait_s=0" } else { "" };
            let answer = api.raw(&method, &format!("{concrete}{query}"), "application/json", "{}").await;
            let needed = role.as_ref().map(|role| ROLES.iter().position(|known| known == role).unwrap());
            let expected = match (needed, rank) {
                (None, _) => None,
                (Some(_), None) => Some(401),
                (Some(needed), Some(rank)) => (*rank < needed).then_some(403),
            };
            match expected {
                Some(status) => {
                    assert_eq!(answer.status, status, "{method} {path} {rank:?} {}", answer.body);
                    assert_eq!(answer.kind, "application/problem+json");
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
    beside_the_document(&anonymous, &tokens).await;
}

/// What the document does not name, what is nowhere, and what goes on for ever.
async fn beside_the_document(anonymous: &Api, tokens: &BTreeMap<&'static str, String>) {
    for path in ["/", "/ws", "/mcp", "/ws/ui", "/web/state", "/web/metadata"] {
        assert_eq!(anonymous.get(path).await.status, 401, "{path}");
    }
    for path in ["/web/reset", "/web/step"] {
        assert_eq!(anonymous.post(path, json!({})).await.status, 401, "{path}");
        let viewer = anonymous.clone().with_token(&tokens["viewer"]);
        assert_eq!(viewer.post(path, json!({})).await.status, 403, "{path}");
    }
    // Pages say nothing of anybody's runs: what they ask does.
    for path in ["/web/", "/dashboard/"] {
        let page = http_client().get(format!("{}{path}", anonymous.base())).send().await.unwrap();
        assert_eq!(page.status(), 200, "{path}");
    }
    assert_eq!(anonymous.get("/nothing").await.status, 404);
    let listen =
        http_client().get(format!("{}/v1/runs/run/events", anonymous.base())).bearer_auth(&tokens["viewer"]);
    assert_eq!(listen.send().await.unwrap().status(), 200);
    // A session over a WebSocket, by its first request.
    for (caller, refused) in [(None, Some(401)), (Some("viewer"), Some(403)), (Some("trainer"), None)] {
        let token = caller.map(|role| tokens[role].as_str());
        assert_eq!(connected(anonymous.base(), "/v1/sessions", token).await.err(), refused);
    }
}

type Socket = tokio_tungstenite::WebSocketStream<tokio_tungstenite::MaybeTlsStream<tokio::net::TcpStream>>;

/// A WebSocket, or the status that it is refused by.
async fn connected(base: &str, path: &str, token: Option<&str>) -> Result<Socket, u16> {
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

/// The next message.
async fn said(socket: &mut Socket) -> Value {
    serde_json::from_str(socket.next().await.unwrap().unwrap().to_text().unwrap()).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn openenv_alone_may_be_for_anybody() {
    let (server, tokens) = closed(|config| Config { openenv_public: true, ..config }).await;
    let api = server.api();
    let _ = api.post("/reset", json!({"seed": 1})).await.expect(200);
    let _ = api.get("/metadata").await.expect(200);
    assert_eq!(api.get("/v1/runs").await.status, 401);
    let trainer = api.clone().with_token(&tokens["trainer"]);
    let _ = trainer.post("/v1/runs", json!({"id": "run"})).await.expect(201);
    let refused = api.post("/reset", json!({"run": "run"})).await;
    assert!(
        refused.status == 422 && refused.body.to_string().contains("fly for no runs"),
        "{}",
        refused.body
    );
    let _ = trainer.lease("run", json!({"groups": 1})).await; // once scenarios are prepared
    let _ = trainer.post("/reset", json!({"run": "run"})).await.expect(200);
}

#[tokio::test(flavor = "multi_thread")]
async fn without_tokens_this_machine_alone_is_let_in() {
    let folder = tempfile::tempdir().unwrap();
    let bind = "0.0.0.0:0".parse().unwrap();
    let refused = Service::start(Config { bind, ..Config::local(folder.path().join("db")) }).await;
    assert!(matches!(refused, Err(StartError::Public(_))), "{refused:?}");
    let server = Server::start().await;
    let url = format!("{}/v1/runs", server.api().base());
    let port = url.split(':').nth(2).unwrap().split('/').next().unwrap().to_owned();
    let ask = |name: &'static str, value: String| {
        let request = http_client().get(&url).header(name, value);
        async move { request.send().await.unwrap().status().as_u16() }
    };
    for (name, value, status) in [
        ("host", format!("localhost:{port}"), 200),
        ("host", "evil.example".to_owned(), 403), // a name that was made to lead here
        ("host", "127.0.0.1.evil.example".to_owned(), 403),
        ("origin", format!("http://localhost:{port}"), 200),
        ("origin", "http://127.0.0.1:3000".to_owned(), 200),
        ("origin", "https://evil.example".to_owned(), 403), // a page that is open beside
        ("origin", "null".to_owned(), 403),
    ] {
        assert_eq!(ask(name, value.clone()).await, status, "{name}: {value}");
    }
}

#[tokio::test]
async fn browsers_are_told_what_nothing_here_is_for() {
    let server = Server::start().await;
    for path in ["/v1/runs", "/docs/", "/web/", "/nothing"] {
        let answer = http_client().get(format!("{}{path}", server.api().base())).send().await.unwrap();
        let header = |name: &str| answer.headers().get(name).map(|value| value.to_str().unwrap().to_owned());
        assert_eq!(header("x-content-type-options").as_deref(), Some("nosniff"), "{path}");
        assert_eq!(header("referrer-policy").as_deref(), Some("no-referrer"));
        assert!(header("content-security-policy").unwrap().starts_with("default-src '"));
        assert_eq!(header("access-control-allow-origin"), None, "no other site's page reads this");
        assert_eq!(header("cache-control").as_deref() == Some("no-store"), path.starts_with("/v1/"));
        assert_eq!(header("x-request-id").unwrap().len(), 36);
    }
}
