//! Creation, expiry and revocation of tokens, the audit log, and open connections of a revoked token.

use std::process::Command;
use std::time::{Duration, Instant};

use futures_util::SinkExt;
use orchestrator::service::Config;
use serde_json::{Value, json};
use system_tests::{ApiClient, ServerProcess, sparring_binary, wait_until};
use tokio_tungstenite::tungstenite::Message;

use super::{connect, create_token, next_message, run_sparring, start_with_tokens};

async fn wait_until_rejected(api: &ApiClient) {
    wait_until("the server rejects the token", async || api.get("/v1/runs").await.status == 401).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn play_sends_the_token_of_the_named_variable() {
    let (server, tokens) = start_with_tokens(|config| config).await;
    let url = server.api().base().to_owned();
    let trainer = tokens["trainer"].clone();
    let play = async |arguments: &str| {
        let mut command = Command::new(sparring_binary());
        let line = format!("play --env-url {url} --policy hold --task survival {arguments}");
        command.args(line.split_whitespace()).env("ENV_TOKEN", &trainer).env("EMPTY", "");
        let out = tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap();
        (out.status.code(), String::from_utf8(out.stderr).unwrap())
    };
    assert_eq!(play("--env-token-env ENV_TOKEN").await.0, Some(0));
    let (code, stderr) = play("").await;
    assert!(
        code == Some(2) && stderr.contains("requires a token; name the environment variable"),
        "{stderr}"
    );
    let (code, stderr) = play("--env-token-env EMPTY").await;
    assert!(code == Some(2) && stderr.contains("is not set or is empty"), "{stderr}");
}

#[tokio::test(flavor = "multi_thread")]
async fn tokens_can_be_managed_while_a_server_runs() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("db.sqlite3");
    let process = ServerProcess::start(&db);
    let api = process.api();
    let _ = api.post("/v1/runs", json!({"strategy": "ladder", "id": "before"})).await.expect(201); // without tokens, loopback is admin
    let path = db.clone();
    let (admin, short) = tokio::task::spawn_blocking(move || {
        let admin = create_token(&path, "admin");
        let (_, short, _) =
            run_sparring(&path, &["token", "create", "short", "--role", "viewer", "--expires", "2s"]);
        (admin, short.trim().to_owned())
    })
    .await
    .unwrap();
    wait_until_rejected(&api).await; // a running server finds the first token within 5 s
    let _ = api.clone().with_token(&admin).get("/v1/runs").await.expect(200);
    wait_until_rejected(&api.clone().with_token(&short)).await; // it expires after 2 s

    let nowhere = folder.path().join("nowhere");
    for args in [["token", "list"].as_slice(), &["token", "revoke", "1"]] {
        let (code, _, output) = run_sparring(&nowhere, args);
        assert!(code == Some(2) && output.contains("does not exist") && !nowhere.exists(), "{output}");
    }
    let (code, listed, _) = run_sparring(&db, &["token", "list"]);
    assert_eq!(code, Some(0));
    assert!(listed.contains("admin") && listed.contains("expired") && !listed.contains(&admin), "{listed}");
    assert_eq!(run_sparring(&db, &["token", "revoke", "1"]).0, Some(0));
    let (code, _, output) = run_sparring(&db, &["token", "revoke", "1"]);
    assert_eq!((code, output.contains("was already revoked")), (Some(2), true), "{output}");
    let (code, _, output) = run_sparring(&db, &["token", "revoke", "9"]);
    assert_eq!((code, output.contains("does not exist")), (Some(2), true), "{output}");
    let (code, _, output) =
        run_sparring(&db, &["token", "create", "x", "--role", "viewer", "--expires", "soon"]);
    assert_eq!((code, output.contains("use a form such as 90d")), (Some(2), true), "{output}");
    wait_until_rejected(&api.clone().with_token(&admin)).await; // a revoked token works for 5 s at most
    drop(process);
    // Only the hash of a token is stored.
    for file in std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path()) {
        let bytes = std::fs::read(&file).unwrap();
        let secret = admin.rsplit('_').next().unwrap().as_bytes();
        assert!(!bytes.windows(secret.len()).any(|window| window == secret), "{}", file.display());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn audit_log_has_changes_and_denials() {
    let (server, tokens) = start_with_tokens(|config| config).await;
    let api = server.api();
    let start = Instant::now();
    let admin = api.clone().with_token(&tokens["admin"]);
    let _ = admin.post("/v1/runs", json!({"strategy": "ladder", "id": "run"})).await.expect(201);
    let _ = admin.post("/v1/runs/run/pause", json!({})).await.expect(200);
    assert_eq!(
        api.clone().with_token(&tokens["viewer"]).post("/v1/runs/run/resume", json!({})).await.status,
        403
    );
    for _ in 0..20 {
        assert_eq!(api.get("/v1/runs").await.status, 401);
    }
    // A token in a path is not logged.
    let _ = admin.post(&format!("/v1/runs/{}/pause", tokens["viewer"]), json!({})).await;
    let changed = admin.get("/v1/audit").await.expect(200);
    let denied = admin.get("/v1/audit?denied=true").await.expect(200);
    let audit = json!({"changed": changed, "denied": denied});
    let entries = |log: &Value| log["entries"].as_array().unwrap().clone();
    let lines = [entries(&changed), entries(&denied)].concat();
    let line =
        |line: &Value| format!("{} {} {}", line["operation"].as_str().unwrap(), line["status"], line["name"]);
    let log: Vec<String> = lines.iter().map(line).collect();
    assert!(log.contains(&"POST /v1/runs 201 \"admin\"".to_owned()), "{log:?}");
    assert!(log.contains(&"POST /v1/runs/{run}/pause 200 \"admin\"".to_owned()), "{log:?}");
    assert!(log.contains(&"POST /v1/runs/{run}/resume 403 \"viewer\"".to_owned()), "{log:?}");
    assert!(log.iter().any(|line| line.ends_with("401 null")), "{log:?}");
    assert_eq!(log.iter().filter(|line| *line == "sparring token create 200 null").count(), 3, "{log:?}");
    let denials = log.iter().filter(|line| line.contains(" 40")).count();
    // The server logs at most two denials of an address at once and one a second, and the pause of an unknown run.
    let max_denials = 3 + start.elapsed().as_secs() as usize;
    assert!((1..=max_denials).contains(&denials), "repeated denials do not fill the log: {log:?}");
    assert!(
        lines
            .iter()
            .filter(|line| !line["operation"].as_str().unwrap().starts_with("sparring token"))
            .all(|line| line["address"] == "127.0.0.1" && line["request_id"].as_str().unwrap().len() == 36)
    );
    let text = audit.to_string();
    assert!(tokens.values().all(|token| !text.contains(token.as_str())));
}

#[tokio::test(flavor = "multi_thread")]
async fn revoked_token_loses_its_connections() {
    let (server, tokens) = start_with_tokens(|config| config).await;
    let api = server.api();
    let admin = api.clone().with_token(&tokens["admin"]);
    let _ = admin.post("/v1/runs", json!({"strategy": "ladder", "id": "run"})).await.expect(201);
    let open = |token: &str| {
        let (base, token) = (api.base().to_owned(), token.to_owned());
        async move {
            let mut session = connect(&base, "/v1/sessions", Some(&token)).await.unwrap();
            let wish = json!({"type": "open", "version": 2, "seed": 1});
            session.send(Message::text(wish.to_string())).await.unwrap();
            let key = next_message(&mut session).await["session"].as_str().unwrap().to_owned();
            let mut openenv = connect(&base, "/ws", Some(&token)).await.unwrap();
            openenv.send(Message::text(json!({"type": "reset", "data": {}}).to_string())).await.unwrap();
            assert_eq!(next_message(&mut openenv).await["type"], "observation");
            (session, key, openenv)
        }
    };
    let (mut session, key, mut openenv) = open(&tokens["trainer"]).await;
    let (mut unaffected, ..) = open(&tokens["admin"]).await;
    let (_, _, mut busy) = open(&tokens["trainer"]).await;
    let url = format!("{}/v1/runs/run/events", api.base());
    let event_stream =
        system_tests::http_client().get(url).bearer_auth(&tokens["trainer"]).send().await.unwrap();

    // A session key is valid for the token that opened the session only.
    let mut other = connect(api.base(), "/v1/sessions", Some(&tokens["admin"])).await.unwrap();
    let resume = json!({"type": "resume", "session": key});
    other.send(Message::text(resume.to_string())).await.unwrap();
    let reply = next_message(&mut other).await;
    assert!(reply["type"] == "error" && reply.to_string().contains("the session does not exist"), "{reply}");

    let db = server.db_path();
    let number = tokens["trainer"].split('_').nth(1).unwrap().to_owned();
    let revoked = tokio::task::spawn_blocking(move || run_sparring(&db, &["token", "revoke", &number]).0);
    assert_eq!(revoked.await.unwrap(), Some(0));
    let deadline = Duration::from_secs(120);
    let reply = tokio::time::timeout(deadline, next_message(&mut session))
        .await
        .expect("the connection is closed in time");
    assert!(reply["type"] == "error" && reply.to_string().contains("revoked"), "{reply}");
    let reply = tokio::time::timeout(deadline, next_message(&mut openenv))
        .await
        .expect("the connection is closed in time");
    assert!(reply["type"] == "error" && reply.to_string().contains("revoked"), "{reply}");
    // A connection that sends without a pause is closed, too.
    let send_until_error = async {
        loop {
            let state = json!({"type": "state"}).to_string();
            if busy.send(Message::text(state)).await.is_err()
                || next_message(&mut busy).await["type"] == "error"
            {
                return;
            }
        }
    };
    tokio::time::timeout(deadline, send_until_error).await.expect("the connection is closed in time");
    tokio::time::timeout(deadline, event_stream.bytes()).await.expect("the stream ends in time").unwrap();
    wait_until_rejected(&api.clone().with_token(&tokens["trainer"])).await;
    assert_eq!(connect(api.base(), "/v1/sessions", Some(&tokens["trainer"])).await.err(), Some(401));
    // Connections of other tokens continue.
    unaffected.send(Message::text(json!({"type": "state"}).to_string())).await.unwrap();
    assert_eq!(next_message(&mut unaffected).await["type"], "state");
}

#[tokio::test(flavor = "multi_thread")]
async fn serve_refuses_to_start_without_a_valid_token() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("db.sqlite3");
    let _ = create_token(&db, "admin");
    assert_eq!(run_sparring(&db, &["token", "revoke", "1"]).0, Some(0));
    let (code, _, output) = run_sparring(&db, &["serve", "--bind", "0.0.0.0:0"]);
    assert!(code == Some(2) && output.contains("every token has expired or was revoked"), "{output}");
}

#[tokio::test(flavor = "multi_thread")]
async fn rejection_before_the_body_closes_the_connection() {
    let (server, tokens) = start_with_tokens(|config| config).await;
    let url = format!("{}/v1/runs", server.api().base());
    let create_run = |token: Option<&str>| {
        let request =
            system_tests::http_client().post(&url).body("{}").header("content-type", "application/json");
        match token {
            Some(token) => request.bearer_auth(token),
            None => request,
        }
    };
    let rejected = create_run(None).send().await.unwrap();
    assert_eq!(
        (rejected.status().as_u16(), &rejected.headers()["connection"]),
        (401, &"close".parse().unwrap())
    );
    let made = create_run(Some(&tokens["trainer"])).send().await.unwrap();
    assert!(made.status().as_u16() == 201 && !made.headers().contains_key("connection"));
}

#[tokio::test(flavor = "multi_thread")]
async fn named_session_belongs_to_its_owner() {
    let (server, tokens) = start_with_tokens(|config| Config { openenv_public: true, ..config }).await;
    let api = server.api();
    let (admin, trainer) =
        (api.clone().with_token(&tokens["admin"]), api.clone().with_token(&tokens["trainer"]));
    let _ = admin.post("/reset", json!({"seed": 7})).await.expect(200);
    let call = |method: &str, id: &str| {
        let params = json!({"name": "hold", "session_id": id});
        json!({"jsonrpc": "2.0", "id": 1, "method": method, "params": params})
    };
    let number = tokens["admin"].split('_').nth(1).unwrap();
    let made_up = [format!("\0{number}\0shared"), format!("token {number}\0shared"), "shared".to_owned()];
    for (other, id) in
        [&trainer, &api].into_iter().flat_map(|other| made_up.iter().map(move |id| (other, id)))
    {
        for method in ["tools/call", "openenv/session/close"] {
            let answer = other.post("/mcp", call(method, id)).await.expect(200);
            assert!(
                answer["error"]["message"].as_str().unwrap().to_lowercase().contains("session"),
                "{answer}"
            );
        }
        assert_eq!(other.get("/state").await.expect(200)["step_count"], 0);
    }
    let _ = admin.post("/mcp", call("tools/call", "shared")).await.expect(200);
    assert_eq!(admin.get("/state").await.expect(200)["step_count"], 1);
}
