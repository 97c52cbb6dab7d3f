//! What each token may do at most.

use futures_util::SinkExt;
use orchestrator::http::Each;
use orchestrator::service::Config;
use serde_json::json;
use system_tests::Api;
use tokio_tungstenite::tungstenite::Message;

use super::{Socket, closed, connected, said};

#[tokio::test(flavor = "multi_thread")]
async fn each_token_has_its_limits() {
    let each =
        Each { requests: 20.try_into().unwrap(), anonymous: 5.try_into().unwrap(), runs: 2, leases: 3 };
    let setup = move |mut config: Config| {
        config.sessions.each = 2;
        Config { each, ..config }
    };
    let (server, tokens) = closed(setup).await;
    let trainer = server.api().with_token(&tokens["trainer"]);
    for id in ["a", "b"] {
        let _ = trainer.post("/v1/runs", json!({"id": id})).await.expect(201);
    }
    let more = trainer.post("/v1/runs", json!({"id": "c"})).await;
    assert_eq!((more.status, more.body["type"].as_str()), (403, Some("urn:sparring:problem:too_many_runs")));
    let _ = server.api().with_token(&tokens["admin"]).post("/v1/runs", json!({"id": "c"})).await.expect(201);
    let mut taken = Vec::new();
    for form in ["groups", "columns", "groups"] {
        taken.push(trainer.lease("a", json!({"groups": 1, "form": form})).await);
    }
    let more = trainer.post("/v1/runs/b/leases", json!({"groups": 1})).await;
    assert_eq!(
        (more.status, more.body["type"].as_str()),
        (429, Some("urn:sparring:problem:too_many_leases"))
    );
    let _ =
        trainer.post(&format!("/v1/runs/a/leases/{}/release", taken[0].id()), json!({})).await.expect(200);
    let _ = trainer.lease("b", json!({"groups": 1})).await;

    let _sessions = two_sessions(&server.api(), &tokens["trainer"]).await;
    // Requests: of who is known, and of an address.
    let mut often = trainer.get("/v1/tasks").await;
    for _ in 0..60 {
        often = trainer.get("/v1/tasks").await;
        if often.status == 429 {
            break;
        }
    }
    assert_eq!((often.status, often.body["type"].as_str()), (429, Some("urn:sparring:problem:too_often")));
    assert_eq!(often.retry_after.as_deref(), Some("1"));
    let _ = server.api().with_token(&tokens["viewer"]).get("/v1/tasks").await.expect(200);
    let statuses =
        futures_util::future::join_all((0..20).map(|_| async { server.api().get("/v1/tasks").await.status }))
            .await;
    assert!(statuses.contains(&401) && statuses.contains(&429), "{statuses:?}");
}

/// Opens three sessions where two may be: the last is refused.
async fn two_sessions(api: &Api, token: &str) -> Vec<Socket> {
    let mut sessions = Vec::new();
    for at in 0..3 {
        let mut socket = connected(api.base(), "/v1/sessions", Some(token)).await.unwrap();
        let open = json!({"type": "open", "version": 1, "seed": at});
        socket.send(Message::text(open.to_string())).await.unwrap();
        let told = said(&mut socket).await;
        assert_eq!(told["type"] == "error", at == 2, "{told}");
        sessions.push(socket);
    }
    sessions
}
