//! Limits of each token: runs, leases, sessions and requests.

use futures_util::SinkExt;
use orchestrator::limits::ClientLimits;
use orchestrator::service::Config;
use serde_json::json;
use system_tests::ApiClient;
use tokio_tungstenite::tungstenite::Message;

use super::{Socket, connect, next_message, start_with_tokens};

#[tokio::test(flavor = "multi_thread")]
async fn each_token_has_its_own_limits() {
    let client_limits = ClientLimits {
        requests: 20.try_into().unwrap(),
        anonymous: 5.try_into().unwrap(),
        runs: 2,
        leases: 3,
    };
    let setup = move |mut config: Config| {
        config.sessions.max_per_client = 2;
        Config { client_limits, ..config }
    };
    let (server, tokens) = start_with_tokens(setup).await;
    let trainer = server.api().with_token(&tokens["trainer"]);
    for id in ["a", "b"] {
        let _ = trainer.post("/v1/runs", json!({"strategy": "ladder", "id": id})).await.expect(201);
    }
    let rejected = trainer.post("/v1/runs", json!({"strategy": "ladder", "id": "c"})).await;
    assert_eq!(
        (rejected.status, rejected.body["type"].as_str()),
        (403, Some("urn:sparring:problem:too_many_runs"))
    );
    let _ = server
        .api()
        .with_token(&tokens["admin"])
        .post("/v1/runs", json!({"strategy": "ladder", "id": "c"}))
        .await
        .expect(201);
    let mut leases = Vec::new();
    for form in ["groups", "columns", "groups"] {
        leases.push(trainer.lease("a", json!({"groups": 1, "form": form})).await);
    }
    let rejected = trainer.post("/v1/runs/b/leases", json!({"groups": 1})).await;
    assert_eq!(
        (rejected.status, rejected.body["type"].as_str()),
        (429, Some("urn:sparring:problem:too_many_leases"))
    );
    let _ =
        trainer.post(&format!("/v1/runs/a/leases/{}/release", leases[0].id()), json!({})).await.expect(200);
    let _ = trainer.lease("b", json!({"groups": 1})).await;

    let _sessions = open_sessions_up_to_limit(&server.api(), &tokens["trainer"]).await;
    // Request rates are limited by token, and by address without a token.
    let burst = futures_util::future::join_all((0..200).map(|_| trainer.get("/v1/tasks"))).await;
    let throttled = burst.into_iter().find(|response| response.status == 429).expect("a rejected request");
    assert_eq!(
        (throttled.status, throttled.body["type"].as_str()),
        (429, Some("urn:sparring:problem:rate_limited"))
    );
    assert_eq!(throttled.retry_after.as_deref(), Some("1"));
    let _ = server.api().with_token(&tokens["viewer"]).get("/v1/tasks").await.expect(200);
    let statuses = futures_util::future::join_all(
        (0..100).map(|_| async { server.api().get("/v1/tasks").await.status }),
    )
    .await;
    assert!(statuses.contains(&401) && statuses.contains(&429), "{statuses:?}");
}

/// Opens three sessions with a limit of two; the server rejects the third.
async fn open_sessions_up_to_limit(api: &ApiClient, token: &str) -> Vec<Socket> {
    let mut sessions = Vec::new();
    for index in 0..3 {
        let mut socket = connect(api.base(), "/v1/sessions", Some(token)).await.unwrap();
        let open = json!({"type": "open", "version": 2, "seed": index});
        socket.send(Message::text(open.to_string())).await.unwrap();
        let reply = next_message(&mut socket).await;
        assert_eq!(reply["type"] == "error", index == 2, "{reply}");
        sessions.push(socket);
    }
    sessions
}
