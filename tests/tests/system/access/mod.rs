//! Access control: every role on every operation, limits of tokens, the audit log, and headers for browsers.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use futures_util::StreamExt;
use orchestrator::limits::ClientLimits;
use orchestrator::service::{Config, Service, StartError};
use serde_json::{Value, json};
use system_tests::{ApiClient, ApiResponse, Server, http_client, sparring_binary};
use tokio_tungstenite::connect_async;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;

mod cross_site;
mod limits;
mod members;
mod ownership;
mod policy_versions;
mod tokens;

const ROLES: [&str; 3] = ["viewer", "trainer", "admin"];

fn run_sparring(db: &Path, args: &[&str]) -> (Option<i32>, String, String) {
    let out = Command::new(sparring_binary()).args(args).arg("--db").arg(db).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (out.status.code(), text(out.stdout), text(out.stderr))
}

fn create_token(db: &Path, role: &str) -> String {
    create_token_of(db, role, role, role)
}

/// Creates a token that acts for a principal.
fn create_token_of(db: &Path, name: &str, principal: &str, role: &str) -> String {
    let arguments = ["token", "create", name, "--principal", principal, "--role", role];
    let (code, token, stderr) = run_sparring(db, &arguments);
    assert_eq!(code, Some(0), "{stderr}");
    token.trim().to_owned()
}

/// Starts a server that requires a token; returns it with one token for each role.
pub(crate) async fn start_with_tokens(
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

/// Server with tokens and clients of several principals.
///
/// The run `run` belongs to the principal `owner` and has the member `member`.
struct Parties {
    server: Server,
    owner: ApiClient,
    member: ApiClient,
    /// Trainer that is neither the owner nor a member of the run.
    other: ApiClient,
    viewer: ApiClient,
    admin: ApiClient,
}

impl Parties {
    /// Starts a server with the run, whose settings `settings` replaces.
    async fn start(settings: Value) -> Self {
        Self::start_with(settings, |config| config).await
    }

    async fn start_with(settings: Value, setup: impl Fn(Config) -> Config + Send + Sync + 'static) -> Self {
        let (server, tokens) = start_with_tokens(setup).await;
        let db = server.db_path();
        let create =
            move || ["owner", "member", "other"].map(|name| create_token_of(&db, name, name, "trainer"));
        let trainers = tokio::task::spawn_blocking(create).await.unwrap();
        let api = server.api();
        let [owner, member, other] = trainers.map(|token| api.clone().with_token(&token));
        let [viewer, admin] = ["viewer", "admin"].map(|role| api.clone().with_token(&tokens[role]));
        let mut request = json!({"strategy": "ladder", "id": "run", "seed": 5, "tasks": ["kessler/survival"], "contested_share": 0.0,
            "placement": false, "design": {"designer": "off"}});
        request.as_object_mut().unwrap().extend(settings.as_object().unwrap().clone());
        let _ = owner.post("/v1/runs", request).await.expect(201);
        let _ =
            owner.send_json("PUT", "/v1/runs/run/members", json!({"members": ["member"]})).await.expect(200);
        Self { server, owner, member, other, viewer, admin }
    }

    /// Creates another token and returns a client with it.
    async fn create_client(
        &self,
        name: &'static str,
        principal: &'static str,
        role: &'static str,
    ) -> ApiClient {
        let db = self.server.db_path();
        let create = move || create_token_of(&db, name, principal, role);
        self.server.api().with_token(&tokio::task::spawn_blocking(create).await.unwrap())
    }
}

/// Asserts that the server denied a request for a reason.
#[track_caller]
fn assert_denied(response: ApiResponse, code: &str) {
    let body = response.expect(403);
    assert_eq!(body["type"], format!("urn:sparring:problem:{code}"));
    // The dashboard reads the role of a token from the last word of a denial.
    assert!(ROLES.iter().all(|role| !body["detail"].as_str().unwrap().ends_with(role)), "{body}");
}

/// Operation of the OpenAPI document.
struct ListedOperation {
    method: String,
    path: String,
    /// Id of the operation.
    operation: String,
    /// Lowest role that may use it; `None` if it needs no token.
    role: Option<String>,
    /// Relation to the run that a trainer needs: `member` or `owner`.
    relation: Option<String>,
}

/// Lists the operations of the OpenAPI document.
fn operations() -> Vec<ListedOperation> {
    let document = serde_json::to_value(orchestrator::http::openapi()).unwrap();
    let mut operations = Vec::new();
    for (path, item) in document["paths"].as_object().unwrap() {
        for (method, operation) in item.as_object().unwrap() {
            let Some(operation) = operation.as_object().filter(|o| o.contains_key("responses")) else {
                continue;
            };
            let scope = |at: usize| {
                let security = operation.get("security")?;
                security[0]["token"].get(at).map(|scope| scope.as_str().unwrap().to_owned())
            };
            let (method, path) = (method.to_uppercase(), path.clone());
            let id = operation["operationId"].as_str().unwrap_or_default().to_owned();
            let (role, relation) = (scope(0), scope(1));
            operations.push(ListedOperation { method, path, operation: id, role, relation });
        }
    }
    operations
}

#[test]
fn every_operation_declares_its_role() {
    let lines = operations().into_iter().map(|ListedOperation { method, path, role, relation, .. }| {
        let relation = relation.map_or_else(String::new, |relation| format!(" for {relation}"));
        format!("{:<8} {method:<4} {path}{relation}", role.as_deref().unwrap_or("-"))
    });
    let mut lines: Vec<String> = lines.collect();
    lines.sort();
    // The snapshot makes the role of a new operation visible in review. An operation without a rule is for admins.
    insta::assert_snapshot!("roles", lines.join("\n"));
}

/// Client of the test of all operations.
struct Caller<'a> {
    name: &'a str,
    /// Index in `ROLES`; `None` without a valid token.
    rank: Option<usize>,
    /// True if the principal may take part in the run, and if it owns the run.
    may: [bool; 2],
    api: ApiClient,
}

impl Caller<'_> {
    /// Returns the status of a denied request; `None` if the caller may use the operation.
    fn denial(&self, operation: &ListedOperation) -> Option<u16> {
        let needed = ROLES.iter().position(|known| Some(*known) == operation.role.as_deref())?;
        let Some(rank) = self.rank else { return Some(401) };
        let is_related = match operation.relation.as_deref() {
            None => true,
            Some("member") => self.may[0],
            Some("owner") => self.may[1],
            Some(other) => panic!("unknown relation {other}"),
        };
        (rank < needed || !is_related).then_some(403)
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn each_principal_reaches_only_its_operations() {
    let client_limits = ClientLimits {
        requests: 10_000.try_into().unwrap(),
        anonymous: 10_000.try_into().unwrap(),
        ..ClientLimits::default()
    };
    let parties = Parties::start_with(json!({}), move |config| Config { client_limits, ..config }).await;
    let anonymous = parties.server.api();
    let unknown = anonymous.clone().with_token(&format!("sparring_1_{}", "0".repeat(64)));
    let callers = [
        ("no token", None, [false, false], anonymous.clone()),
        ("unknown token", None, [false, false], unknown),
        ("viewer", Some(0), [false, false], parties.viewer.clone()),
        ("other trainer", Some(1), [false, false], parties.other.clone()),
        ("member", Some(1), [true, false], parties.member.clone()),
        ("owner", Some(1), [true, true], parties.owner.clone()),
        ("admin", Some(2), [true, true], parties.admin.clone()),
    ]
    .map(|(name, rank, may, api)| Caller { name, rank, may, api });
    let mut open = Vec::new();
    for operation in operations() {
        let ListedOperation { method, path, .. } = &operation;
        let concrete =
            path.replace("{run}", "run").replace("{lease}", "1-aaaaaa").replace("{episode}", "ep_1-aaaaaa_0");
        let concrete = concrete
            .replace("{design}", "layout-1")
            .replace("{layout}", "layout-1")
            .replace("{request}", "ask-1");
        for caller in &callers {
            if path.ends_with("/events") && caller.rank.is_some() {
                continue; // the stream never ends; assert_undocumented_routes tests it
            }
            let answer = caller.api.request(method, &concrete, "application/json", "{}").await;
            let context = format!("{method} {concrete} {} {}", caller.name, answer.body);
            match caller.denial(&operation) {
                Some(status) => {
                    assert_eq!(answer.status, status, "{context}");
                    assert_eq!(answer.content_type, "application/problem+json");
                }
                None => assert!(![401, 403].contains(&answer.status), "{context}"),
            }
        }
        if operation.role.is_none() {
            open.push(format!("{method} {path}"));
        }
    }
    assert_eq!(open, ["GET /livez", "GET /readyz"]);
    assert_undocumented_routes(&parties).await;
}

/// Checks routes that the document omits, unknown routes, the event stream and WebSockets.
async fn assert_undocumented_routes(parties: &Parties) {
    let anonymous = parties.server.api();
    for path in ["/", "/ws", "/mcp", "/ws/ui", "/web/state", "/web/metadata"] {
        assert_eq!(anonymous.get(path).await.status, 401, "{path}");
    }
    for path in ["/web/reset", "/web/step"] {
        assert_eq!(anonymous.post(path, json!({})).await.status, 401, "{path}");
        assert_eq!(parties.viewer.post(path, json!({})).await.status, 403, "{path}");
    }
    // Pages are public: they have no data of runs, which they request with a token.
    for path in ["/web/", "/dashboard/"] {
        let page = http_client().get(format!("{}{path}", anonymous.base())).send().await.unwrap();
        assert_eq!(page.status(), 200, "{path}");
    }
    assert_eq!(anonymous.get("/nothing").await.status, 404);
    let events = http_client()
        .get(format!("{}/v1/runs/run/events", anonymous.base()))
        .bearer_auth(parties.viewer.token().unwrap());
    assert_eq!(events.send().await.unwrap().status(), 200);
    // The upgrade request of a WebSocket session is checked.
    for (caller, status) in [(&anonymous, Some(401)), (&parties.viewer, Some(403)), (&parties.other, None)] {
        assert_eq!(connect(anonymous.base(), "/v1/sessions", caller.token()).await.err(), status);
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
    let _ = trainer.post("/v1/runs", json!({"strategy": "ladder", "id": "run"})).await.expect(201);
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
