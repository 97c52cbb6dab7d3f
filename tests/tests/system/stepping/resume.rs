//! Connections that drop, and who comes back.

use std::time::Duration;

use orchestrator::service::Config;
use orchestrator::sessions::Limits;
use serde_json::json;
use system_tests::Server;

use super::client::{Came, Socket, Vector, draw};
use super::single::{run, to_the_end};

async fn short(resume: Duration) -> Server {
    let limits = Limits { most: 2, resume, ..Limits::default() };
    Server::set_up(move |config| Config { sessions: limits, ..config }).await
}

#[tokio::test]
async fn a_step_that_was_cut_off_is_taken_once() {
    let server = Server::start().await;
    let api = server.api();
    let wish = json!({"seed": 9, "params": {"debris": 30}});
    let (mut steady, _) = Socket::open(&api, wish.clone()).await;
    let (mut socket, opened) = Socket::open(&api, wish).await;
    let action =
        |step: u64| json!({"burns": [{"satellite_id": 1, "delta_vx": draw(3, step) - 0.5, "delta_vy": 0.1}]});
    let mut done = false;
    for id in 1..=50 {
        let wanted = steady.step(id, &action(id)).await;
        if done || wanted["type"] == "error" {
            break;
        }
        if id % 5 == 0 {
            // Sent, and cut off before the answer is read: whether it was taken is not known.
            socket.text(json!({"type": "step", "id": id, "action": action(id)}).to_string()).await;
            socket.cut().await;
            let resumed;
            (socket, resumed) = Socket::resume(&api, &opened).await;
            assert_eq!(
                (&resumed["type"], &resumed["mode"]),
                (&json!("resumed"), &json!("single")),
                "{resumed}"
            );
            assert!(resumed["last_id"] == id || resumed["last_id"] == id - 1, "{resumed}");
            assert_eq!(resumed["steps"], resumed["last_id"]);
        }
        let told = socket.step(id, &action(id)).await;
        assert_eq!(told, wanted);
        done = told["done"] == true;
    }
    assert!(done);
}

#[tokio::test]
async fn a_frame_that_was_cut_off_is_taken_once() {
    let server = Server::start().await;
    let api = server.api();
    let wish = json!({"seed": 9, "task": "rendezvous", "vector": {"envs": 40, "observe": "tracks"}});
    let (mut steady, _) = Vector::open(&api, wish.clone()).await;
    let (mut vector, _) = Vector::open(&api, wish).await;
    for step in 1..=60u32 {
        let actions: Vec<f32> =
            (0..vector.width()).map(|cell| draw(cell as u64, step.into()) - 0.5).collect();
        let wanted = steady.step(&actions).await;
        if step % 7 == 0 {
            let frame = vector.actions(step, &actions);
            vector.socket.bytes(&frame).await;
            vector.socket.cut().await;
            let (socket, resumed) = Socket::resume(&api, &vector.opened).await;
            assert_eq!(
                (&resumed["type"], &resumed["mode"], &resumed["frames"]),
                (&json!("resumed"), &json!("vector"), &vector.opened["frames"]),
                "{resumed}"
            );
            assert!(resumed["sequence"] == step || resumed["sequence"] == step - 1, "{resumed}");
            vector.socket = socket;
        }
        assert_eq!(vector.step(&actions).await, wanted);
    }
}

#[tokio::test]
async fn what_flies_for_a_run_goes_on_and_counts_once() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run").await;
    let (mut socket, opened) = Socket::open(&api, json!({"run": "run"})).await;
    for id in 1..=10 {
        let _ = socket.step(id, &json!({"burns": []})).await;
    }
    socket.cut().await;
    let (mut socket, resumed) = Socket::resume(&api, &opened).await;
    assert_eq!((&resumed["episode"], &resumed["steps"]), (&opened["episode"], &json!(10)));
    let told = to_the_end(&mut socket, 11).await;
    assert_eq!(told["reported"]["status"], "counted");
    let episodes = api.get("/v1/runs/run/episodes").await.expect(200);
    assert_eq!(episodes["episodes"].as_array().unwrap().len(), 1);
}

#[tokio::test]
async fn who_waits_counts_and_who_comes_too_late_finds_nothing() {
    let server = short(Duration::from_millis(600)).await;
    let api = server.api();
    run(&api, "run").await;
    let (socket, opened) = Socket::open(&api, json!({"run": "run"})).await;
    let (_other, _) = Socket::open(&api, json!({"seed": 1})).await;
    socket.cut().await;
    // It holds its place.
    let mut third = Socket::to(&api).await;
    let full = third.ask(super::client::opening(json!({"seed": 2}))).await;
    assert_eq!((&full["code"], &full["retryable"]), (&json!("at_capacity"), &json!(true)), "{full}");
    assert_eq!(api.get("/v1/runs/run/leases").await.expect(200)["leases"][0]["status"], "active");
    tokio::time::sleep(Duration::from_millis(900)).await;
    let (_, late) = Socket::resume(&api, &opened).await;
    assert_eq!((&late["code"], &late["field"]), (&json!("unknown_session"), &json!("session")), "{late}");
    assert_eq!(third.ask(super::client::opening(json!({"seed": 2}))).await["type"], "opened");
    // Its lease went back.
    for _ in 0..100 {
        if api.get("/v1/runs/run/leases").await.expect(200)["leases"][0]["status"] == "released" {
            return;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    panic!("the lease is still held");
}

#[tokio::test]
async fn of_two_connections_the_later_has_it() {
    let server = Server::start().await;
    let api = server.api();
    let (mut first, opened) = Socket::open(&api, json!({"seed": 1})).await;
    let told = first.step(1, &json!({"burns": []})).await;
    // The first is still there: its client may know better than the server that it is not.
    let (mut second, resumed) = Socket::resume(&api, &opened).await;
    assert_eq!((&resumed["type"], &resumed["last_id"]), (&json!("resumed"), &json!(1)), "{resumed}");
    let superseded = first.told().await;
    assert_eq!(
        (&superseded["code"], &superseded["retryable"]),
        (&json!("superseded"), &json!(false)),
        "{superseded}"
    );
    assert_eq!(first.next().await, Came::Closed(1000));
    assert_eq!(second.step(1, &json!({"burns": []})).await, told);
    second.cut().await;
    // Many at once: one has it.
    let mut coming = tokio::task::JoinSet::new();
    for _ in 0..16 {
        let (api, opened) = (api.clone(), opened.clone());
        coming.spawn(async move { Socket::resume(&api, &opened).await });
    }
    let mut holders = Vec::new();
    while let Some(came) = coming.join_next().await {
        let (socket, told) = came.unwrap();
        match told["type"].as_str().unwrap() {
            "resumed" => holders.push(socket),
            _ => assert_eq!(told["code"], "superseded", "{told}"),
        }
    }
    let mut alive = 0;
    for mut holder in holders {
        match holder.next_within(1.0).await {
            Came::Nothing => {
                assert_eq!(holder.step(2, &json!({"burns": []})).await["step"], 2);
                alive += 1;
            }
            Came::Text(told) => assert_eq!(told["code"], "superseded", "{told}"),
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(alive, 1);
}

#[tokio::test]
async fn who_says_goodbye_ends_it() {
    let server = short(Duration::from_secs(60)).await;
    let api = server.api();
    let (mut socket, opened) = Socket::open(&api, json!({"seed": 1})).await;
    assert_eq!(socket.ask(json!({"type": "close", "id": 3})).await["type"], "closed");
    let (other, left) = Socket::open(&api, json!({"seed": 1})).await;
    other.leave().await;
    for opened in [opened, left] {
        for attempt in 0.. {
            let (_, told) = Socket::resume(&api, &opened).await;
            if told["code"] == "unknown_session" {
                break;
            }
            // The goodbye may still be on its way.
            assert!(attempt < 50, "{told}");
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }
}

#[tokio::test]
async fn a_service_that_stops_ends_all() {
    let mut server = Server::start().await;
    let api = server.api();
    run(&api, "run").await;
    let (gone, _) = Socket::open(&api, json!({"run": "run"})).await;
    gone.cut().await;
    let (mut single, _) = Socket::open(&api, json!({"seed": 1})).await;
    let (mut vector, _) = Vector::open(&api, json!({"seed": 1, "vector": {"envs": 3}})).await;
    let mut waiting = Socket::to(&api).await;
    let begun = std::time::Instant::now();
    server.stop().await;
    assert!(begun.elapsed() < Duration::from_secs(8), "{:?}", begun.elapsed());
    for socket in [&mut single, &mut vector.socket, &mut waiting] {
        assert_eq!(socket.told().await["code"], "stopping");
    }
    assert_eq!(single.next().await, Came::Closed(1000));
    server.restart().await;
    assert_eq!(server.api().get("/v1/runs/run/leases").await.expect(200)["leases"][0]["status"], "released");
}
