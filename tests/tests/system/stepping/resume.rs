//! Dropped connections and resumed sessions.

use std::time::Duration;

use orchestrator::service::Config;
use orchestrator::sessions::SessionLimits;
use serde_json::json;
use system_tests::{Received, Server, wait_until};

use super::client::{SessionSocket, VectorSession, open_message, uniform};
use super::single::{create_run, hold_to_the_end};

async fn server_with_resume_time(resume: Duration) -> Server {
    let limits = SessionLimits { max_sessions: 2, resume_timeout: resume, ..SessionLimits::default() };
    Server::with_config(move |config| Config { sessions: limits, ..config }).await
}

#[tokio::test]
async fn interrupted_step_is_executed_once() {
    let server = Server::start().await;
    let api = server.api();
    let options = json!({"seed": 9, "params": {"debris": 30}});
    let (mut uninterrupted, _) = SessionSocket::open(&api, options.clone()).await;
    let (mut socket, opened) = SessionSocket::open(&api, options).await;
    let action = |step: u64| json!({"burns": [{"satellite_id": 1, "delta_vx": uniform(3, step) - 0.5, "delta_vy": 0.1}]});
    let mut done = false;
    for id in 1..=50 {
        let expected = uninterrupted.step(id, &action(id)).await;
        if done || expected["type"] == "error" {
            break;
        }
        if id % 5 == 0 {
            // The connection is aborted before the reply is read: the client cannot know whether the step was executed.
            socket.send_text(json!({"type": "step", "id": id, "action": action(id)}).to_string()).await;
            socket.abort();
            let resumed;
            (socket, resumed) = SessionSocket::resume(&api, &opened).await;
            assert_eq!(
                (&resumed["type"], &resumed["mode"]),
                (&json!("resumed"), &json!("single")),
                "{resumed}"
            );
            assert!(resumed["last_id"] == id || resumed["last_id"] == id - 1, "{resumed}");
            assert_eq!(resumed["steps"], resumed["last_id"]);
        }
        let reply = socket.step(id, &action(id)).await;
        assert_eq!(reply, expected);
        done = reply["done"] == true;
    }
    assert!(done);
}

#[tokio::test]
async fn interrupted_frame_is_executed_once() {
    let server = Server::start().await;
    let api = server.api();
    let options = json!({"seed": 9, "task": "rendezvous", "vector": {"envs": 40, "observe": "tracks"}});
    let (mut uninterrupted, _) = VectorSession::open(&api, options.clone()).await;
    let (mut vector, _) = VectorSession::open(&api, options).await;
    for step in 1..=60u32 {
        let actions: Vec<f32> =
            (0..vector.action_len()).map(|cell| uniform(cell as u64, step.into()) - 0.5).collect();
        let expected = uninterrupted.step(&actions).await;
        if step % 7 == 0 {
            let frame = vector.action_frame(step, &actions);
            vector.socket.send_bytes(&frame).await;
            vector.socket.abort();
            let (socket, resumed) = SessionSocket::resume(&api, &vector.opened).await;
            assert_eq!(
                (&resumed["type"], &resumed["mode"], &resumed["frames"]),
                (&json!("resumed"), &json!("vector"), &vector.opened["frames"]),
                "{resumed}"
            );
            assert!(resumed["sequence"] == step || resumed["sequence"] == step - 1, "{resumed}");
            vector.socket = socket;
        }
        assert_eq!(vector.step(&actions).await, expected);
    }
}

#[tokio::test]
async fn resumed_episode_of_a_run_counts_once() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run").await;
    let (mut socket, opened) = SessionSocket::open(&api, json!({"run": "run"})).await;
    for id in 1..=10 {
        let _ = socket.step(id, &json!({"burns": []})).await;
    }
    socket.abort();
    let (mut socket, resumed) = SessionSocket::resume(&api, &opened).await;
    assert_eq!((&resumed["episode"], &resumed["steps"]), (&opened["episode"], &json!(10)));
    let reply = hold_to_the_end(&mut socket, 11).await;
    assert_eq!(reply["reported"]["status"], "counted");
    let episodes = api.get("/v1/runs/run/episodes").await.expect(200);
    assert_eq!(episodes["episodes"].as_array().unwrap().len(), 1);
}

#[tokio::test]
async fn disconnected_session_keeps_its_place_until_it_expires() {
    let server = server_with_resume_time(Duration::from_secs(5)).await;
    let api = server.api();
    create_run(&api, "run").await;
    let (socket, opened) = SessionSocket::open(&api, json!({"run": "run"})).await;
    let (_other, _) = SessionSocket::open(&api, json!({"seed": 1})).await;
    socket.abort();
    // The disconnected session keeps its place.
    let mut third = SessionSocket::connect(&api).await;
    let full = third.request(&open_message(json!({"seed": 2}))).await;
    assert_eq!((&full["code"], &full["retryable"]), (&json!("at_capacity"), &json!(true)), "{full}");
    assert_eq!(api.get("/v1/runs/run/leases").await.expect(200)["leases"][0]["status"], "active");
    wait_until("the disconnected session expires and frees its place", async || {
        third.request(&open_message(json!({"seed": 2}))).await["type"] == "opened"
    })
    .await;
    let (_, late) = SessionSocket::resume(&api, &opened).await;
    assert_eq!((&late["code"], &late["field"]), (&json!("unknown_session"), &json!("session")), "{late}");
    wait_until("its lease is released", async || {
        api.get("/v1/runs/run/leases").await.expect(200)["leases"][0]["status"] == "released"
    })
    .await;
}

#[tokio::test]
async fn later_connection_supersedes_the_earlier() {
    let server = Server::start().await;
    let api = server.api();
    let (mut first, opened) = SessionSocket::open(&api, json!({"seed": 1})).await;
    let reply = first.step(1, &json!({"burns": []})).await;
    // The first connection is still open, but its client may know that it is dead before the server does.
    let (mut second, resumed) = SessionSocket::resume(&api, &opened).await;
    assert_eq!((&resumed["type"], &resumed["last_id"]), (&json!("resumed"), &json!(1)), "{resumed}");
    let superseded = first.receive_text().await;
    assert_eq!(
        (&superseded["code"], &superseded["retryable"]),
        (&json!("superseded"), &json!(false)),
        "{superseded}"
    );
    assert_eq!(first.receive().await, Received::Closed(1000));
    assert_eq!(second.step(1, &json!({"burns": []})).await, reply);
    second.abort();
    // Of many concurrent resumes one wins.
    let mut attempts = tokio::task::JoinSet::new();
    for _ in 0..16 {
        let (api, opened) = (api.clone(), opened.clone());
        attempts.spawn(async move { SessionSocket::resume(&api, &opened).await });
    }
    let mut holders = Vec::new();
    while let Some(attempt) = attempts.join_next().await {
        let (socket, reply) = attempt.unwrap();
        match reply["type"].as_str().unwrap() {
            "resumed" => holders.push(socket),
            _ => assert_eq!(reply["code"], "superseded", "{reply}"),
        }
    }
    let step = json!({"type": "step", "id": 2, "action": {"burns": []}}).to_string();
    let mut alive = 0;
    for mut holder in holders {
        holder.try_send_text(&step).await;
        match holder.receive().await {
            Received::Text(reply) if reply["type"] == "stepped" => {
                assert_eq!(reply["step"], 2);
                alive += 1;
            }
            Received::Text(reply) => assert_eq!(reply["code"], "superseded", "{reply}"),
            // The step arrived after the end of the connection, so that the last message was lost.
            Received::Closed(1006) => {}
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(alive, 1);
}

#[tokio::test]
async fn closed_session_cannot_be_resumed() {
    let server = server_with_resume_time(Duration::from_secs(60)).await;
    let api = server.api();
    let (mut socket, opened) = SessionSocket::open(&api, json!({"seed": 1})).await;
    assert_eq!(socket.request(&json!({"type": "close", "id": 3})).await["type"], "closed");
    let (other, closed) = SessionSocket::open(&api, json!({"seed": 1})).await;
    other.close().await;
    for opened in [opened, closed] {
        wait_until("the server has received the close", async || {
            let (_, reply) = SessionSocket::resume(&api, &opened).await;
            reply["code"] == "unknown_session"
        })
        .await;
    }
}

#[tokio::test]
async fn stopping_server_closes_every_session() {
    let mut server = Server::start().await;
    let api = server.api();
    create_run(&api, "run").await;
    let (gone, _) = SessionSocket::open(&api, json!({"run": "run"})).await;
    gone.abort();
    let (mut single, _) = SessionSocket::open(&api, json!({"seed": 1})).await;
    let (mut vector, _) = VectorSession::open(&api, json!({"seed": 1, "vector": {"envs": 3}})).await;
    let mut waiting = SessionSocket::connect(&api).await;
    let start = std::time::Instant::now();
    server.stop().await;
    // Disconnected sessions would be kept for a minute.
    assert!(start.elapsed() < Duration::from_secs(30), "{:?}", start.elapsed());
    for socket in [&mut single, &mut vector.socket, &mut waiting] {
        assert_eq!(socket.receive_text().await["code"], "stopping");
    }
    assert_eq!(single.receive().await, Received::Closed(1000));
    server.restart().await;
    assert_eq!(server.api().get("/v1/runs/run/leases").await.expect(200)["leases"][0]["status"], "released");
}
