//! A lease, flown by the environments of a vector session.

use serde_json::{Value, json};
use system_tests::{Api, Server};

use super::client::{Socket, Stepped, Vector, draw};
use super::single::run;

async fn episodes(api: &Api) -> Vec<Value> {
    api.get("/v1/runs/run/episodes?limit=500").await.expect(200)["episodes"].as_array().unwrap().clone()
}

fn wish(lease: &str, envs: usize, autoreset: &str) -> Value {
    json!({"run": "run", "lease_id": lease, "vector": {"envs": envs, "autoreset": autoreset, "observe": "tracks"}})
}

/// Flies until nothing is left; all that was told.
async fn fly(vector: &mut Vector, first: Stepped) -> Vec<Stepped> {
    let mut all = vec![first];
    for step in 0..600 {
        if all.last().unwrap().flags.iter().all(|flags| flags & 2 == 2) {
            return all;
        }
        let actions: Vec<f32> = (0..vector.width()).map(|cell| draw(cell as u64, step) * 0.4 - 0.2).collect();
        let told = vector.step(&actions).await;
        all.push(told);
    }
    panic!("no end");
}

#[tokio::test]
async fn every_episode_of_a_lease_is_flown_and_reported_once() {
    for mode in ["next_step", "same_step"] {
        let server = Server::start().await;
        let api = server.api();
        run(&api, "run").await;
        let lease = api.lease("run", json!({"groups": 9, "policy_version": 3})).await;
        let (mut vector, first) = Vector::open(&api, wish(lease.id(), 4, mode)).await;
        assert_eq!(first.episodes, [0, 1, 2, 3], "{mode}");
        let told = fly(&mut vector, first).await;
        let last = told.last().unwrap();
        assert_eq!((&last.episodes, last.observations.iter().all(|x| *x == 0.0)), (&vec![-1; 4], true));
        let mut flown: Vec<i32> =
            told.iter().flat_map(|told| told.episodes.clone()).filter(|e| *e >= 0).collect();
        flown.sort_unstable();
        flown.dedup();
        assert_eq!(flown, (0..18).collect::<Vec<_>>(), "{mode}");
        // An idle slot can be stepped, and stays idle.
        let hold = vec![0.0; vector.width()];
        let idle = vector.step(&hold).await;
        assert!(
            idle.flags.iter().all(|flags| *flags == 2) && idle.team_rewards.iter().all(|r| *r == 0.0),
            "{idle:?}"
        );
        let closed = vector.socket.ask(json!({"type": "close", "id": 1})).await;
        assert_eq!(
            (&closed["reported"]["flown"], &closed["reported"]["counted"]),
            (&json!(18), &json!(18)),
            "{closed}"
        );
        assert_eq!(closed["reported"]["waiting"], 0);
        let stored = episodes(&api).await;
        assert_eq!(stored.len(), 18);
        assert!(
            stored.iter().all(|episode| episode["policy_version"] == 3 && episode["state"] == "finished")
        );
        // What was earned by the rewards that were told is what the replay says.
        let mut scores = [0.0; 18];
        for pair in told.windows(2) {
            for env in 0..4 {
                if let Ok(episode) = usize::try_from(pair[0].episodes[env]) {
                    scores[episode] += f64::from(pair[1].team_rewards[env]);
                }
            }
        }
        for episode in &stored {
            let index: usize =
                episode["episode"].as_str().unwrap().rsplit('_').next().unwrap().parse().unwrap();
            let (found, score) = (scores[index], episode["score"].as_f64().unwrap());
            // Within the clamp of a score and fifty roundings.
            assert!((found - score).abs() < 1.1e-3, "{mode} {index}: {found} {score}");
        }
        let id = lease.id();
        assert_eq!(api.get(&format!("/v1/runs/run/leases/{id}")).await.expect(200)["status"], "done");
        let mastery = api.get("/v1/runs/run/mastery").await.expect(200).to_string();
        assert!(mastery.contains("\"episodes\":18"), "{mastery}");
        let over = Socket::to(&api).await.ask(super::client::opening(wish(id, 2, mode))).await;
        assert_eq!((&over["type"], &over["code"]), (&json!("error"), &json!("lease_over")), "{over}");
    }
}

/// A lease is looked at anew by whoever opens it: what became of it by other ways is known.
#[tokio::test]
async fn what_became_of_a_lease_meanwhile_is_known() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run").await;
    let lease = api.lease("run", json!({"groups": 2})).await;
    let open = async || Vector::open(&api, wish(lease.id(), 4, "disabled")).await;
    let (mut vector, first) = open().await;
    assert_eq!(first.episodes, [0, 1, 2, 3]);
    let _ = vector.socket.ask(json!({"type": "close", "id": 1})).await;
    let results =
        lease.episodes().iter().take(3).map(|(id, s)| system_tests::result(id, s, "hold")).collect();
    let _ = api.report("run", results).await;
    let (mut vector, first) = open().await;
    assert_eq!(first.episodes, [3, -1, -1, -1], "the others were reported");
    let _ = vector.socket.ask(json!({"type": "close", "id": 1})).await;
    let _ = api.post(&format!("/v1/runs/run/leases/{}/release", lease.id()), json!({})).await.expect(200);
    let over = Socket::to(&api).await.ask(super::client::opening(wish(lease.id(), 4, "disabled"))).await;
    assert_eq!((&over["type"], &over["code"]), (&json!("error"), &json!("lease_over")), "{over}");
}

/// A trainer that thinks for longer than its lease holds keeps it while it is connected.
#[tokio::test]
async fn a_silent_session_keeps_a_short_lease() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run").await;
    let lease = api.lease("run", json!({"groups": 1, "ttl_s": 2})).await;
    let (mut vector, first) = Vector::open(&api, wish(lease.id(), 2, "next_step")).await;
    tokio::time::sleep(std::time::Duration::from_secs(5)).await;
    let _ = fly(&mut vector, first).await;
    let closed = vector.socket.ask(json!({"type": "close", "id": 1})).await;
    assert_eq!(
        (&closed["reported"]["counted"], &closed["reported"]["late"]),
        (&json!(2), &json!(0)),
        "{closed}"
    );
}

#[tokio::test]
async fn what_is_not_flown_to_its_end_is_given_back() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run").await;
    let lease = api.lease("run", json!({"groups": 3})).await;
    let (mut vector, first) = Vector::open(&api, wish(lease.id(), 8, "disabled")).await;
    assert_eq!(first.episodes, [0, 1, 2, 3, 4, 5, -1, -1]);
    assert_eq!(first.flags, [0, 0, 0, 0, 0, 0, 2, 2]);
    let hold = vec![0.0; vector.width()];
    let _ = vector.step(&hold).await;
    // Reset before its end: given up, and flown again by the first that asks.
    let told = vector.reset(&[1, 0, 0, 0, 0, 0, 0, 0]).await;
    assert_eq!(told.episodes[..2], [0, 1]);
    // Two sessions share a lease.
    let mut other = Socket::to(&api).await;
    let none = other.ask(super::client::opening(wish(lease.id(), 1, "disabled"))).await;
    assert_eq!((&none["code"], &none["field"]), (&json!("invalid"), &json!("lease_id")), "{none}");
    let closed = vector.socket.ask(json!({"type": "close"})).await;
    assert_eq!(closed["reported"]["flown"], 0, "{closed}");
    let (mut vector, first) = Vector::open(&api, wish(lease.id(), 2, "next_step")).await;
    assert_eq!(first.episodes, [0, 1]);
    let _ = fly(&mut vector, first).await;
    assert_eq!(vector.socket.ask(json!({"type": "close"})).await["reported"]["counted"], 6);
    assert_eq!(episodes(&api).await.len(), 6);
}

#[tokio::test]
async fn a_lease_of_several_tasks_is_flown_task_by_task() {
    let server = Server::start().await;
    let api = server.api();
    let wish = json!({"id": "run", "seed": 3, "placement": false, "tasks": ["kessler/survival", "docking/multiagent"],
                      "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", wish).await.expect(201);
    let lease = api.lease("run", json!({"groups": 8})).await;
    let open = |task: Option<&str>| {
        let mut vector = json!({"envs": 4});
        if let Some(task) = task {
            vector["task"] = json!(task);
        }
        super::client::opening(json!({"run": "run", "lease_id": lease.id(), "vector": vector}))
    };
    let mut socket = Socket::to(&api).await;
    let told = socket.ask(open(None)).await;
    assert_eq!(
        (&told["field"], told["detail"].as_str().unwrap().contains("docking/multiagent")),
        (&json!("vector.task"), true),
        "{told}"
    );
    let told = socket.ask(open(Some("kessler/formation"))).await;
    assert_eq!(told["field"], "vector.task", "{told}");
    let told = socket.ask(open(Some("docking/multiagent"))).await;
    assert_eq!(
        (&told["type"], &told["task"], &told["agents"]),
        (&json!("opened"), &json!("docking/multiagent"), &json!(5)),
        "{told}"
    );
}

/// What docs/stepping.md says of the bytes of every frame is what a session is told of them.
#[tokio::test]
async fn the_document_has_the_frames_as_they_are() {
    let document = include_str!("../../../../docs/stepping.md");
    let row = |begins: &str| document.lines().find(|line| line.starts_with(begins)).expect(begins);
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run").await;
    let lease = api.lease("run", json!({"groups": 4})).await;
    // Five environments of three agents and two numbers an action: every length is another number.
    let (vector, _) = Vector::open(&api, wish(lease.id(), 5, "same_step")).await;
    let frames = &vector.opened["frames"];
    for field in frames["header"].as_array().unwrap() {
        let size = match field["dtype"].as_str().unwrap() {
            "|S4" => "4 bytes",
            "<u2" => "u16",
            "<u4" => "u32",
            other => panic!("{other}"),
        };
        row(&format!("| {} | {size} |", field["offset"]));
    }
    let letters = [("envs", "n"), ("agents", "a"), ("action", "d"), ("observation", "o")];
    let letter = |length: &Value| match letters.iter().find(|(name, _)| vector.opened[*name] == *length) {
        Some((_, letter)) => (*letter).to_owned(),
        None if *length == json!("done") => "k".to_owned(),
        None => panic!("{length}"),
    };
    for kind in ["actions", "reset", "stepped"] {
        let mut row = row(&format!("| {}, {kind} |", frames[kind]["kind"]));
        let fields = frames[kind]["fields"].as_array().unwrap();
        assert_eq!(fields[0]["offset"], 16, "after the header");
        for field in fields {
            let dtype = match field["dtype"].as_str().unwrap() {
                "<f4" => "f32",
                "<i4" => "i32",
                "|u1" => "u8",
                other => panic!("{other}"),
            };
            let shape: Vec<String> = field["shape"].as_array().unwrap().iter().map(letter).collect();
            let words = format!("{} {dtype} [{}]", field["name"].as_str().unwrap(), shape.join(", "));
            let at = row
                .find(&words)
                .unwrap_or_else(|| panic!("{kind}: no {words}, or not after what comes before"));
            row = &row[at + words.len()..];
        }
    }
}
