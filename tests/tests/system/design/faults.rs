//! Whatever a designer does, and whatever it is asked, the run goes on and the fault is told.

use std::sync::Arc;

use orchestrator::service::Config;
use serde_json::{Value, json};
use system_tests::{Lease, Server, result};

use super::fake::{Fake, Script, asked};
use super::{caught_up, create, lose, summary, until};

/// A server whose designers do as the script says.
async fn with_fake(script: &Script) -> Server {
    let designers = Arc::new(Fake(script.clone()));
    Server::set_up(move |config| Config { designers: designers.clone(), ..config }).await
}

fn held(lease: &Lease) -> Vec<Value> {
    lease.episodes().iter().map(|(episode, scenario)| result(episode, scenario, "hold")).collect()
}

#[tokio::test]
async fn whatever_a_designer_does_the_run_goes_on() {
    let script = Script::default();
    let server = with_fake(&script).await;
    let api = server.api();
    create(&api, json!({"designer": "off"})).await;
    lose(&api).await;
    caught_up(&api).await;
    // The language model fails: the procedural designer does its part.
    for (word, trouble) in [("error", "it is down"), ("panic", "it panicked: nonsense"), ("garbage", "blah")]
    {
        script.llm(word);
        let ask = asked(&api, json!({"n": 2, "designer": "llm"})).await;
        assert_eq!((&ask["state"], &ask["admitted"]), (&json!("done"), &json!(2)), "{word}: {ask}");
        let troubles = ask["troubles"].as_array().unwrap();
        assert!(troubles.iter().any(|t| t.as_str().unwrap().contains(trouble)), "{word}: {ask}");
        if word == "garbage" {
            assert_eq!((&ask["refused"], &ask["cost"]), (&json!(100), &json!(0.0)));
            let path =
                format!("/v1/runs/run/designs?state=refused&ask={}&limit=500", ask["id"].as_str().unwrap());
            let kept = api.get(&path).await.expect(200);
            let kept = kept["designs"].as_array().unwrap();
            assert!(kept.len() <= 64 && kept.iter().all(|d| d["name"].as_str().unwrap().len() <= 200));
            let refused = kept[0]["id"].as_str().unwrap();
            let path = format!("/v1/runs/run/designs/{refused}/retire");
            assert_eq!(api.post(&path, json!({})).await.status, 409);
            assert_eq!(api.get(&format!("/v1/layouts/{refused}")).await.status, 404);
            let counted = &summary(&api).await["tasks"][0]["refused"];
            let schema = counted.as_array().unwrap().iter().find(|c| c["check"] == "schema").unwrap();
            assert_eq!(schema["count"], 100, "counted though not kept");
        }
    }
    // The procedural one fails: so does the ask, and nothing else.
    script.procedural("panic");
    let ask = asked(&api, json!({"n": 2, "designer": "procedural"})).await;
    assert_eq!(ask["state"], "failed", "{ask}");
    assert!(ask["error"].as_str().unwrap().contains("nonsense"));
    let lease = api.lease("run", json!({"groups": 4})).await;
    api.report("run", held(&lease)).await;
    script.procedural("real");
    let ask = asked(&api, json!({"designer": "procedural", "n": 1})).await;
    assert_eq!(ask["state"], "done", "{ask}");
}

#[tokio::test]
async fn an_ask_that_is_cut_off_is_told_and_another_can_be_made() {
    let script = Script::default();
    script.llm("slow");
    let mut server = with_fake(&script).await;
    create(&server.api(), json!({"designer": "off"})).await;
    lose(&server.api()).await;
    caught_up(&server.api()).await;
    let answer =
        server.api().post("/v1/runs/run/designs", json!({"designer": "llm", "n": 1})).await.expect(202);
    let path = format!("/v1/runs/run/designs/asks/{}", answer["id"].as_str().unwrap());
    until(&server.api(), &path, |ask| ask["state"] == "running").await;
    // One at a time: the next waits.
    let next = server.api().post("/v1/runs/run/designs", json!({"n": 1, "designer": "procedural"})).await;
    let next = next.expect(202);
    let lease = server.api().lease("run", json!({"groups": 4})).await;
    server.api().report("run", held(&lease)).await;
    assert_eq!(server.api().get(&path).await.expect(200)["state"], "running");
    server.restart().await;
    let api = server.api();
    let ask = api.get(&path).await.expect(200);
    assert_eq!(ask["state"], "failed");
    assert!(ask["error"].as_str().unwrap().starts_with("interrupted"), "{ask}");
    let path = format!("/v1/runs/run/designs/asks/{}", next["id"].as_str().unwrap());
    let next = until(&api, &path, |ask| ask["ended_at"].is_string()).await;
    assert_eq!((&next["state"], &next["admitted"]), (&json!("done"), &json!(1)), "{next}");
}

/// Bodies of `POST …/designs`, by run.
const POSTED: [(&str, &str); 13] = [
    ("run", "{}"),
    ("run", "[]"),
    ("run", r#"{"n": 0, "designer": "auto"}"#),
    ("run", r#"{"n": 33, "designer": "auto"}"#),
    ("run", r#"{"n": "many"}"#),
    ("run", r#"{"designer": "llm"}"#),
    ("run", r#"{"designer": "off"}"#),
    ("run", r#"{"designer": "chance"}"#),
    ("run", r#"{"designer": "auto", "task": "kessler/rendezvous"}"#),
    ("run", r#"{"layouts": 3}"#),
    ("run", r#"{"n": 1, "n": 2}"#),
    ("docks", r#"{"n": 1}"#),
    ("nobody", r#"{"n": 1}"#),
];

/// Queries that are none, and what is not there.
const ASKED: [&str; 18] = [
    "/v1/runs/run/designs?state=lost",
    "/v1/runs/run/designs?task=kessler/rendezvous",
    "/v1/runs/run/designs?ask=7",
    "/v1/runs/run/designs?limit=0",
    "/v1/runs/run/designs?cursor=x",
    "/v1/runs/run/designs?page=2",
    "/v1/runs/nobody/designs",
    "/v1/runs/run/designs/7",
    "/v1/runs/run/designs/layout-7",
    "/v1/runs/run/designs/asks?state=admitted",
    "/v1/runs/run/designs/asks/ask-7",
    "/v1/runs/run/designs/summary?task=x",
    "/v1/layouts?state=refused",
    "/v1/layouts?task=kessler/golf",
    "/v1/layouts?task=kessler/survival&aim=boredom",
    "/v1/runs/run/designs?mode=boredom",
    "/v1/layouts/layout-7",
    "/v1/layouts/layout-07",
];

#[tokio::test]
async fn bodies_and_queries_that_are_none() {
    let server = Server::start().await;
    let api = server.api();
    create(&api, json!({"designer": "off"})).await;
    let docking = json!({"id": "docks", "seed": 1, "tasks": ["docking/single"]});
    let _ = api.post("/v1/runs", docking).await.expect(201);
    let mut answers = Vec::new();
    let mut told = |what: String, answer: system_tests::Answer| {
        assert_eq!(answer.kind, "application/problem+json", "{what}");
        answers.push(format!("{what}\n{:#}", answer.body));
    };
    for (run, body) in POSTED {
        let path = format!("/v1/runs/{run}/designs");
        told(format!("POST {path} {body}"), api.raw("POST", &path, "application/json", body).await);
    }
    for path in ASKED {
        told(format!("GET {path}"), api.get(path).await);
    }
    for design in [
        json!({"share": 1.5}),
        json!({"layout_share": 0}),
        json!({"stock": 0}),
        json!({"stock": 65}),
        json!({"designer": "nobody"}),
        json!({"shares": 0.5}),
        json!("off"),
    ] {
        told(
            format!("POST /v1/runs design: {design}"),
            api.post("/v1/runs", json!({"design": design})).await,
        );
    }
    insta::assert_snapshot!("problems", answers.join("\n\n"));
}
