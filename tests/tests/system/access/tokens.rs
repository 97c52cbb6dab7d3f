//! The life of tokens, what is written down of who comes in by them, and what becomes of connections when one ends.

use std::time::Duration;

use futures_util::SinkExt;
use orchestrator::service::Config;
use serde_json::{Value, json};
use system_tests::{Api, Process};
use tokio_tungstenite::tungstenite::Message;

use super::{closed, connected, said, sparring, token};

/// Waits until they are let in no more.
async fn refused(api: &Api) {
    for _ in 0..70 {
        if api.get("/v1/runs").await.status == 401 {
            return;
        }
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    panic!("they are still let in");
}

#[tokio::test(flavor = "multi_thread")]
async fn tokens_are_made_listed_and_revoked_while_a_server_runs() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("db.sqlite3");
    let process = Process::start(&db);
    let api = process.api();
    let _ = api.post("/v1/runs", json!({"id": "before"})).await.expect(201); // nobody is known: this machine may everything
    let path = db.clone();
    let (admin, short) = tokio::task::spawn_blocking(move || {
        let admin = token(&path, "admin");
        let (_, short, _) =
            sparring(&path, &["token", "create", "short", "--role", "viewer", "--expires", "2s"]);
        (admin, short.trim().to_owned())
    })
    .await
    .unwrap();
    refused(&api).await; // a server that runs knows of the first token within 5 s
    let _ = api.clone().with_token(&admin).get("/v1/runs").await.expect(200);
    tokio::time::sleep(Duration::from_secs(2)).await;
    assert_eq!(api.clone().with_token(&short).get("/v1/runs").await.status, 401, "it expired");

    let nowhere = folder.path().join("nowhere");
    for args in [["token", "list"].as_slice(), &["token", "revoke", "1"]] {
        let (code, _, told) = sparring(&nowhere, args);
        assert!(code == Some(2) && told.contains("cannot be opened") && !nowhere.exists(), "{told}");
    }
    let (code, listed, _) = sparring(&db, &["token", "list"]);
    assert_eq!(code, Some(0));
    assert!(listed.contains("admin") && listed.contains("expired") && !listed.contains(&admin), "{listed}");
    assert_eq!(sparring(&db, &["token", "revoke", "1"]).0, Some(0));
    let (code, _, told) = sparring(&db, &["token", "revoke", "1"]);
    assert_eq!((code, told.contains("was revoked before")), (Some(2), true), "{told}");
    let (code, _, told) = sparring(&db, &["token", "revoke", "9"]);
    assert_eq!((code, told.contains("is not there")), (Some(2), true), "{told}");
    let (code, _, told) = sparring(&db, &["token", "create", "x", "--role", "viewer", "--expires", "soon"]);
    assert_eq!((code, told.contains("say it as 90d")), (Some(2), true), "{told}");
    refused(&api.clone().with_token(&admin)).await; // a revoked token is let in for 5 s at most
    drop(process);
    // Of a token nothing but its hash is anywhere.
    for file in std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path()) {
        let bytes = std::fs::read(&file).unwrap();
        let secret = admin.rsplit('_').next().unwrap().as_bytes();
        assert!(!bytes.windows(secret.len()).any(|window| window == secret), "{}", file.display());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_changed_by_hand_and_who_is_kept_out_is_written_down() {
    let (server, tokens) = closed(|config| config).await;
    let api = server.api();
    let admin = api.clone().with_token(&tokens["admin"]);
    let _ = admin.post("/v1/runs", json!({"id": "run"})).await.expect(201);
    let _ = admin.post("/v1/runs/run/pause", json!({})).await.expect(200);
    assert_eq!(
        api.clone().with_token(&tokens["viewer"]).post("/v1/runs/run/resume", json!({})).await.status,
        403
    );
    for _ in 0..20 {
        assert_eq!(api.get("/v1/runs").await.status, 401);
    }
    // A token where none belongs is not written down.
    let _ = admin.post(&format!("/v1/runs/{}/pause", tokens["viewer"]), json!({})).await;
    let changed = admin.get("/v1/audit").await.expect(200);
    let denied = admin.get("/v1/audit?denied=true").await.expect(200);
    let audit = json!({"changed": changed, "denied": denied});
    let of = |log: &Value| log["lines"].as_array().unwrap().clone();
    let lines = [of(&changed), of(&denied)].concat();
    let line =
        |line: &Value| format!("{} {} {}", line["operation"].as_str().unwrap(), line["status"], line["name"]);
    let told: Vec<String> = lines.iter().map(line).collect();
    assert!(told.contains(&"POST /v1/runs 201 \"admin\"".to_owned()), "{told:?}");
    assert!(told.contains(&"POST /v1/runs/{run}/pause 200 \"admin\"".to_owned()), "{told:?}");
    assert!(told.contains(&"POST /v1/runs/{run}/resume 403 \"viewer\"".to_owned()), "{told:?}");
    assert!(told.iter().any(|line| line.ends_with("401 null")), "{told:?}");
    assert_eq!(told.iter().filter(|line| *line == "sparring token create 200 null").count(), 3, "{told:?}");
    let denials = told.iter().filter(|line| line.contains(" 40")).count();
    assert!((1..8).contains(&denials), "who tries without end does not fill it: {told:?}");
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
async fn what_a_token_has_open_ends_with_it() {
    let (server, tokens) = closed(|config| config).await;
    let api = server.api();
    let admin = api.clone().with_token(&tokens["admin"]);
    let _ = admin.post("/v1/runs", json!({"id": "run"})).await.expect(201);
    let open = |token: &str| {
        let (base, token) = (api.base().to_owned(), token.to_owned());
        async move {
            let mut session = connected(&base, "/v1/sessions", Some(&token)).await.unwrap();
            let wish = json!({"type": "open", "version": 1, "seed": 1});
            session.send(Message::text(wish.to_string())).await.unwrap();
            let key = said(&mut session).await["session"].as_str().unwrap().to_owned();
            let mut flown = connected(&base, "/ws", Some(&token)).await.unwrap();
            flown.send(Message::text(json!({"type": "reset", "data": {}}).to_string())).await.unwrap();
            assert_eq!(said(&mut flown).await["type"], "observation");
            (session, key, flown)
        }
    };
    let (mut session, key, mut flown) = open(&tokens["trainer"]).await;
    let (mut others, ..) = open(&tokens["admin"]).await;
    let (_, _, mut talkative) = open(&tokens["trainer"]).await;
    let url = format!("{}/v1/runs/run/events", api.base());
    let heard = system_tests::http_client().get(url).bearer_auth(&tokens["trainer"]).send().await.unwrap();

    // A session's key is of use to whoever opened it, and to nobody else.
    let mut other = connected(api.base(), "/v1/sessions", Some(&tokens["admin"])).await.unwrap();
    let resume = json!({"type": "resume", "session": key});
    other.send(Message::text(resume.to_string())).await.unwrap();
    let told = said(&mut other).await;
    assert!(told["type"] == "error" && told.to_string().contains("no such session"), "{told}");

    let db = server.db();
    let number = tokens["trainer"].split('_').nth(1).unwrap().to_owned();
    let revoked = tokio::task::spawn_blocking(move || sparring(&db, &["token", "revoke", &number]).0);
    assert_eq!(revoked.await.unwrap(), Some(0));
    let soon = Duration::from_secs(5);
    let told = tokio::time::timeout(soon, said(&mut session)).await.expect("it is told within 5 s");
    assert!(told["type"] == "error" && told.to_string().contains("revoked"), "{told}");
    let told = tokio::time::timeout(soon, said(&mut flown)).await.expect("it is told within 5 s");
    assert!(told["type"] == "error" && told.to_string().contains("revoked"), "{told}");
    // Who always has something to say is not overlooked.
    let talk = async {
        loop {
            let state = json!({"type": "state"}).to_string();
            if talkative.send(Message::text(state)).await.is_err()
                || said(&mut talkative).await["type"] == "error"
            {
                return;
            }
        }
    };
    tokio::time::timeout(soon, talk).await.expect("it is told within 5 s");
    tokio::time::timeout(soon, heard.bytes()).await.expect("it ends within 5 s").unwrap();
    refused(&api.clone().with_token(&tokens["trainer"])).await;
    assert_eq!(connected(api.base(), "/v1/sessions", Some(&tokens["trainer"])).await.err(), Some(401));
    // Whatever others have open goes on.
    others.send(Message::text(json!({"type": "state"}).to_string())).await.unwrap();
    assert_eq!(said(&mut others).await["type"], "state");
}

#[tokio::test(flavor = "multi_thread")]
async fn where_every_token_is_worth_nothing_that_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("db.sqlite3");
    let _ = token(&db, "admin");
    assert_eq!(sparring(&db, &["token", "revoke", "1"]).0, Some(0));
    let (code, _, told) = sparring(&db, &["serve", "--bind", "0.0.0.0:0"]);
    assert!(code == Some(2) && told.contains("every token has expired or was revoked"), "{told}");
}

#[tokio::test(flavor = "multi_thread")]
async fn who_is_refused_before_their_body_is_read_is_told_that_the_connection_ends() {
    let (server, tokens) = closed(|config| config).await;
    let url = format!("{}/v1/runs", server.api().base());
    let ask = |token: Option<&str>| {
        let request =
            system_tests::http_client().post(&url).body("{}").header("content-type", "application/json");
        match token {
            Some(token) => request.bearer_auth(token),
            None => request,
        }
    };
    let refused = ask(None).send().await.unwrap();
    assert_eq!(
        (refused.status().as_u16(), &refused.headers()["connection"]),
        (401, &"close".parse().unwrap())
    );
    let made = ask(Some(&tokens["trainer"])).send().await.unwrap();
    assert!(made.status().as_u16() == 201 && !made.headers().contains_key("connection"));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_session_by_a_name_is_reached_by_whoever_gave_it_and_nobody_else() {
    let (server, tokens) = closed(|config| Config { openenv_public: true, ..config }).await;
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
