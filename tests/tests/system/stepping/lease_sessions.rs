//! Vector sessions on a lease.

use serde_json::{Value, json};
use system_tests::{ApiClient, Server, wait_until};

use super::client::{SessionSocket, StepFrame, VectorSession, open_message, uniform};
use super::single::create_run;

async fn episodes(api: &ApiClient) -> Vec<Value> {
    api.get("/v1/runs/run/episodes?limit=500").await.expect(200)["episodes"].as_array().unwrap().clone()
}

fn open_options(lease: &str, envs: usize, autoreset: &str) -> Value {
    json!({"run": "run", "lease_id": lease, "vector": {"envs": envs, "autoreset": autoreset, "observe": "tracks"}})
}

/// Steps until every slot is idle; returns all frames.
async fn step_until_idle(vector: &mut VectorSession, first: StepFrame) -> Vec<StepFrame> {
    let mut all = vec![first];
    for step in 0..600 {
        if all.last().unwrap().flags.iter().all(|flags| flags & 2 == 2) {
            return all;
        }
        let actions: Vec<f32> =
            (0..vector.action_len()).map(|cell| uniform(cell as u64, step) * 0.4 - 0.2).collect();
        all.push(vector.step(&actions).await);
    }
    panic!("no end");
}

#[tokio::test]
async fn every_episode_of_a_lease_runs_and_counts_once() {
    for mode in ["next_step", "same_step"] {
        let server = Server::start().await;
        let api = server.api();
        create_run(&api, "run").await;
        let lease = api.lease("run", json!({"groups": 9, "policy_version": 3})).await;
        let mut options = open_options(lease.id(), 4, mode);
        options["policy_version"] = json!(5); // a later one than that of the lease
        let (mut vector, first) = VectorSession::open(&api, options).await;
        assert_eq!(first.episodes, [0, 1, 2, 3], "{mode}");
        let frames = step_until_idle(&mut vector, first).await;
        let last = frames.last().unwrap();
        assert_eq!((&last.episodes, last.observations.iter().all(|x| *x == 0.0)), (&vec![-1; 4], true));
        let mut episodes_seen: Vec<i32> =
            frames.iter().flat_map(|frame| frame.episodes.clone()).filter(|e| *e >= 0).collect();
        episodes_seen.sort_unstable();
        episodes_seen.dedup();
        assert_eq!(episodes_seen, (0..18).collect::<Vec<_>>(), "{mode}");
        // An idle slot can be stepped, and stays idle.
        let hold = vec![0.0; vector.action_len()];
        let idle = vector.step(&hold).await;
        assert!(
            idle.flags.iter().all(|flags| *flags == 2) && idle.team_rewards.iter().all(|r| *r == 0.0),
            "{idle:?}"
        );
        let closed = vector.socket.request(&json!({"type": "close", "id": 1})).await;
        assert_eq!(
            (&closed["reported"]["finished"], &closed["reported"]["counted"]),
            (&json!(18), &json!(18)),
            "{closed}"
        );
        assert_eq!(closed["reported"]["waiting"], 0);
        let stored = episodes(&api).await;
        assert_eq!(stored.len(), 18);
        assert!(
            stored.iter().all(|episode| episode["policy_version"] == 5 && episode["state"] == "finished")
        );
        assert_rewards_match_scores(&frames, &stored);
        let id = lease.id();
        assert_eq!(api.get(&format!("/v1/runs/run/leases/{id}")).await.expect(200)["status"], "done");
        let mastery = api.get("/v1/runs/run/mastery").await.expect(200).to_string();
        assert!(mastery.contains("\"episodes\":18"), "{mastery}");
        let rejected =
            SessionSocket::connect(&api).await.request(&open_message(open_options(id, 2, mode))).await;
        assert_eq!(
            (&rejected["type"], &rejected["code"]),
            (&json!("error"), &json!("lease_closed")),
            "{rejected}"
        );
    }
}

/// Checks that the sums of the rewards of 18 episodes in 4 slots equal the replayed scores.
fn assert_rewards_match_scores(frames: &[StepFrame], stored: &[Value]) {
    let mut returns = [0.0; 18];
    for pair in frames.windows(2) {
        for env in 0..4 {
            if let Ok(episode) = usize::try_from(pair[0].episodes[env]) {
                returns[episode] += f64::from(pair[1].team_rewards[env]);
            }
        }
    }
    for episode in stored {
        let index: usize = episode["episode"].as_str().unwrap().rsplit('_').next().unwrap().parse().unwrap();
        let (sum, score) = (returns[index], episode["score"].as_f64().unwrap());
        // Scores are clamped to 0.001 to 0.999, and fifty rewards are rounded.
        assert!((sum - score).abs() < 1.1e-3, "{index}: {sum} {score}");
    }
}

/// A session reads the state of its lease when it opens, including results that were reported otherwise.
#[tokio::test]
async fn reopened_lease_skips_reported_episodes() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run").await;
    let lease = api.lease("run", json!({"groups": 2})).await;
    let open = async || VectorSession::open(&api, open_options(lease.id(), 4, "disabled")).await;
    let (mut vector, first) = open().await;
    assert_eq!(first.episodes, [0, 1, 2, 3]);
    let _ = vector.socket.request(&json!({"type": "close", "id": 1})).await;
    let results =
        lease.episodes().iter().take(3).map(|(id, s)| system_tests::episode_result(id, s, "hold")).collect();
    let _ = api.report("run", results).await;
    let (mut vector, first) = open().await;
    assert_eq!(first.episodes, [3, -1, -1, -1], "the other episodes were reported");
    let _ = vector.socket.request(&json!({"type": "close", "id": 1})).await;
    let _ = api.post(&format!("/v1/runs/run/leases/{}/release", lease.id()), json!({})).await.expect(200);
    let rejected = SessionSocket::connect(&api)
        .await
        .request(&open_message(open_options(lease.id(), 4, "disabled")))
        .await;
    assert_eq!(
        (&rejected["type"], &rejected["code"]),
        (&json!("error"), &json!("lease_closed")),
        "{rejected}"
    );
}

/// A connected session renews its lease, also if the trainer pauses for longer than the lease's time to live.
#[tokio::test]
async fn idle_session_renews_its_lease() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run").await;
    const TTL_S: i64 = 5;
    let lease = api.lease("run", json!({"groups": 1, "ttl_s": TTL_S})).await;
    let (mut vector, first) = VectorSession::open(&api, open_options(lease.id(), 2, "next_step")).await;
    let expires_at =
        |lease: &Value| lease["expires_at"].as_str().unwrap().parse::<jiff::Timestamp>().unwrap().as_second();
    // A renewal sets the deadline to `ttl_s` from then: twice `ttl_s` is set after the first deadline.
    wait_until("the session renews the lease after its first deadline", async || {
        let now = api.get(&format!("/v1/runs/run/leases/{}", lease.id())).await.expect(200);
        assert_eq!(now["status"], "active");
        expires_at(&now) > expires_at(&lease.0) + TTL_S
    })
    .await;
    let _ = step_until_idle(&mut vector, first).await;
    let closed = vector.socket.request(&json!({"type": "close", "id": 1})).await;
    assert_eq!(
        (&closed["reported"]["counted"], &closed["reported"]["late"]),
        (&json!(2), &json!(0)),
        "{closed}"
    );
}

#[tokio::test]
async fn unfinished_episodes_are_returned_to_the_lease() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run").await;
    let lease = api.lease("run", json!({"groups": 3})).await;
    let (mut vector, first) = VectorSession::open(&api, open_options(lease.id(), 8, "disabled")).await;
    assert_eq!(first.episodes, [0, 1, 2, 3, 4, 5, -1, -1]);
    assert_eq!(first.flags, [0, 0, 0, 0, 0, 0, 2, 2]);
    let hold = vec![0.0; vector.action_len()];
    let _ = vector.step(&hold).await;
    // A reset before the end returns the episode, and the next free slot runs it again.
    let reply = vector.reset(&[1, 0, 0, 0, 0, 0, 0, 0]).await;
    assert_eq!(reply.episodes[..2], [0, 1]);
    // A second session on the lease finds no free episode.
    let mut other = SessionSocket::connect(&api).await;
    let none = other.request(&open_message(open_options(lease.id(), 1, "disabled"))).await;
    assert_eq!((&none["code"], &none["field"]), (&json!("invalid"), &json!("lease_id")), "{none}");
    let closed = vector.socket.request(&json!({"type": "close"})).await;
    assert_eq!(closed["reported"]["finished"], 0, "{closed}");
    let (mut vector, first) = VectorSession::open(&api, open_options(lease.id(), 2, "next_step")).await;
    assert_eq!(first.episodes, [0, 1]);
    let _ = step_until_idle(&mut vector, first).await;
    assert_eq!(vector.socket.request(&json!({"type": "close"})).await["reported"]["counted"], 6);
    assert_eq!(episodes(&api).await.len(), 6);
}

#[tokio::test]
async fn session_on_a_mixed_lease_names_its_task() {
    let server = Server::start().await;
    let api = server.api();
    let settings = json!({"strategy": "ladder", "id": "run", "seed": 3, "placement": false, "tasks": ["kessler/survival", "docking/multiagent"],
                      "design": {"designer": "off"}});
    let _ = api.post("/v1/runs", settings).await.expect(201);
    let lease = api.lease("run", json!({"groups": 8})).await;
    let open = |task: Option<&str>| {
        let mut vector = json!({"envs": 4});
        if let Some(task) = task {
            vector["task"] = json!(task);
        }
        open_message(json!({"run": "run", "lease_id": lease.id(), "vector": vector}))
    };
    let mut socket = SessionSocket::connect(&api).await;
    let reply = socket.request(&open(None)).await;
    assert_eq!(
        (&reply["field"], reply["detail"].as_str().unwrap().contains("docking/multiagent")),
        (&json!("vector.task"), true),
        "{reply}"
    );
    let reply = socket.request(&open(Some("kessler/formation"))).await;
    assert_eq!(reply["field"], "vector.task", "{reply}");
    let reply = socket.request(&open(Some("docking/multiagent"))).await;
    assert_eq!(
        (&reply["type"], &reply["task"], &reply["agents"]),
        (&json!("opened"), &json!("docking/multiagent"), &json!(5)),
        "{reply}"
    );
}

/// docs/reference/stepping.md describes the bytes of every frame as `opened` does.
#[tokio::test]
async fn stepping_document_matches_the_frame_layout() {
    let document = include_str!("../../../../docs/reference/stepping.md");
    let row = |begins: &str| document.lines().find(|line| line.starts_with(begins)).expect(begins);
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run").await;
    let lease = api.lease("run", json!({"groups": 4})).await;
    // Five environments, three agents, two values an action: every length is a different number.
    let (vector, _) = VectorSession::open(&api, open_options(lease.id(), 5, "same_step")).await;
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
        assert_eq!(fields[0]["offset"], 16, "fields start after the header");
        for field in fields {
            let dtype = match field["dtype"].as_str().unwrap() {
                "<f4" => "f32",
                "<i4" => "i32",
                "|u1" => "u8",
                other => panic!("{other}"),
            };
            let shape: Vec<String> = field["shape"].as_array().unwrap().iter().map(letter).collect();
            let words = format!("{} {dtype} [{}]", field["name"].as_str().unwrap(), shape.join(", "));
            let at = row.find(&words).unwrap_or_else(|| panic!("{kind}: {words} is missing or out of order"));
            row = &row[at + words.len()..];
        }
    }
}
