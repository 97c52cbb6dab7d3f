//! Sessions that leave an episode and fly it again: only the first attempt counts.

use serde_json::{Value, json};
use system_tests::ApiClient;

use super::{EvidenceServer, create_run, task};
use crate::stepping::client::{SessionSocket, VectorSession};

/// Steps a session to the end of its episode with `hold`.
async fn hold_to_the_end(socket: &mut SessionSocket) {
    for id in 0..60 {
        let reply = socket.step(id, &json!({"burns": []})).await;
        if reply["done"] == true {
            return;
        }
    }
    panic!("the episode does not end");
}

async fn settled(api: &ApiClient, n: u64) -> Value {
    let settled = system_tests::wait_for("the slots are settled", async || {
        let task = task(api, "run").await;
        (task["mastery"]["n"] == n).then_some(task["mastery"].clone())
    });
    settled.await
}

/// A client leaves the episode of a lease and flies it again in a new session.
#[tokio::test(flavor = "multi_thread")]
async fn second_attempt_of_a_session_never_raises_the_worst_case() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let lease = api.lease("run", json!({"groups": 1})).await;
    let options = json!({"run": "run", "lease_id": lease.id()});
    let (mut socket, _) = SessionSocket::open(&api, options.clone()).await;
    let _ = socket.step(0, &json!({"burns": []})).await;
    // The client asks for the episode again, in the same session and in another one.
    let mut reset = options.clone();
    (reset["type"], reset["id"]) = (json!("reset"), json!(1));
    let again = socket.request(&reset).await;
    assert_ne!(again["type"], "error", "{again}");
    hold_to_the_end(&mut socket).await;
    let shown = settled(&api, 1).await;
    let counts = (&shown["mean"], &shown["missing"]);
    // One abandoned attempt of one episode: neither a success nor a failure is certain.
    assert_eq!(counts, (&json!(1.0 / 3.0), &json!(1.0)), "{shown}");
}

/// A client steps an episode in a session to see how it goes, and reports other actions over HTTP before the session ends.
#[tokio::test(flavor = "multi_thread")]
async fn report_beside_a_session_is_a_second_attempt() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let lease = api.lease("run", json!({"groups": 1})).await;
    let (mut socket, _) = SessionSocket::open(&api, json!({"run": "run", "lease_id": lease.id()})).await;
    let _ = socket.step(0, &json!({"burns": []})).await;
    let report = api.report("run", lease.results("hold")).await;
    assert_eq!(report["results"][0]["status"], "counted", "{report}");
    let shown = settled(&api, 1).await;
    assert_eq!((&shown["mean"], &shown["missing"]), (&json!(1.0 / 3.0), &json!(1.0)), "{shown}");
}

/// The same with a vector session, which runs several episodes of a lease.
#[tokio::test(flavor = "multi_thread")]
async fn reports_beside_a_vector_session_are_second_attempts() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let lease = api.lease("run", json!({"groups": 4})).await;
    let options = json!({"run": "run", "lease_id": lease.id(),
        "vector": {"envs": 2, "autoreset": "next_step", "observe": "tracks"}});
    let (mut vector, _) = VectorSession::open(&api, options).await;
    let hold = vec![0.0; vector.action_len()];
    let _ = vector.step(&hold).await;
    let _ = api.report("run", lease.results("hold")).await;
    let shown = settled(&api, 4).await;
    assert_eq!(shown["missing"], json!(0.5), "the session runs two of four episodes: {shown}");
}

/// A session of a run takes a lease of its own. Leaving its episode loses the slot.
#[tokio::test(flavor = "multi_thread")]
async fn reset_of_a_lost_episode_is_missing() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    for _ in 0..3 {
        let (mut socket, _) = SessionSocket::open(&api, json!({"run": "run"})).await;
        let _ = socket.step(0, &json!({"burns": []})).await;
        let closed = socket.request(&json!({"type": "close", "id": 1})).await;
        assert_ne!(closed["type"], "error", "{closed}");
    }
    // The scenario is offered again to the second and third session, which is no first attempt.
    let shown = settled(&api, 1).await;
    assert_eq!((&shown["missing"], &shown["open"]), (&json!(1.0), &json!(0)), "{shown}");
}

/// A vector session begins the groups of a lease as it flies them; the others return without loss.
#[tokio::test(flavor = "multi_thread")]
async fn vector_session_begins_groups_as_it_flies() {
    let server = EvidenceServer::start();
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let lease = api.lease("run", json!({"groups": 40, "disclosure": "begin"})).await;
    let options = json!({"run": "run", "lease_id": lease.id(),
        "vector": {"envs": 4, "autoreset": "next_step", "observe": "tracks"}});
    let (mut vector, _) = VectorSession::open(&api, options).await;
    let hold = vec![0.0; vector.action_len()];
    for _ in 0..8 {
        let _ = vector.step(&hold).await;
    }
    let path = format!("/v1/runs/run/leases/{}", lease.id());
    let begun = api.get(&path).await.expect(200)["groups"].as_array().unwrap().len();
    assert!((4..40).contains(&begun), "{begun} groups are begun");
    let _ = vector.socket.request(&json!({"type": "close", "id": 1})).await;
    let _ = api.post(&format!("{path}/release"), json!({})).await.expect(200);
    let open = system_tests::wait_for("no slot is open", async || {
        let task = task(&api, "run").await;
        (task["mastery"]["open"] == 0).then_some(task["mastery"].clone())
    });
    let shown = open.await;
    assert!(shown["seen"].as_u64().unwrap() <= begun as u64, "{shown}");
}
