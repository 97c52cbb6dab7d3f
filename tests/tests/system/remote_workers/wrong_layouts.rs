//! A worker that designed wrong layouts before it was expelled: the server judges them again, and serves the wrong ones no more.

use std::time::Duration;

use async_nats::jetstream::{self, consumer::PullConsumer};
use designer::procedural::ProceduralDesigner;
use designer::reported::ReportedVerdict;
use futures_util::StreamExt;
use jobs::design::{DesignJob, DesignOutput};
use jobs::envelope::{JobEnvelope, JobReply, ReplyBody, ResultEnvelope};
use jobs::world_version::world_version;
use serde_json::Value;
use system_tests::wait_until;

use super::servers::{OptionServer, wait_for_kind, workers};
use super::*;
use crate::design::{create, request_design};

/// Id of the forged worker.
const WORKER: &str = "liar";
/// Kind of its jobs.
const KIND: &str = "design_procedural";

/// Sends heartbeats of the forged worker.
async fn beat(client: async_nats::Client) {
    let heartbeat = json!({
        "id": WORKER, "host": WORKER, "version": "0", "world": world_version(), "kinds": [KIND], "concurrency": 1
    });
    let heartbeat = rmp_serde::to_vec_named(&heartbeat).unwrap();
    loop {
        client.publish(format!("sparring.default.workers.{WORKER}"), heartbeat.clone().into()).await.unwrap();
        tokio::time::sleep(Duration::from_millis(200)).await;
    }
}

/// Changes the bracket of the first admitted layout.
fn forge(output: &mut DesignOutput, is_obvious: bool) {
    let first = output.layouts.iter_mut().find(|layout| layout.is_admitted()).unwrap();
    let ReportedVerdict::Admitted { bracket, .. } = &mut first.verdict else { panic!("admitted") };
    if is_obvious {
        bracket.reference.score += 0.25; // its plan replays to another score
    } else {
        bracket.panel[1].score -= 1e-9; // only a second judgement shows it
    }
}

/// Designs for two requests: the second result is obviously wrong.
async fn serve(client: async_nats::Client) {
    let context = jetstream::new(client);
    let consumer: PullConsumer = loop {
        match context.get_consumer_from_stream(KIND, "SPARRING_default_JOBS").await {
            Ok(consumer) => break consumer,
            Err(_) => tokio::time::sleep(Duration::from_millis(20)).await,
        }
    };
    let mut messages = consumer.messages().await.unwrap();
    for is_obvious in [false, true] {
        let (message, acker) = messages.next().await.unwrap().unwrap().split();
        let envelope = JobEnvelope::read(&message.payload).unwrap();
        let job = DesignJob::decode(envelope.body()).unwrap();
        let outcome = ProceduralDesigner::design_layouts(&job.brief, &mut job.gate().unwrap());
        let mut output = DesignOutput::from(&outcome);
        forge(&mut output, is_obvious);
        let reply = JobReply::Done { body: ReplyBody::new(output.encode().unwrap()), micros: 1 };
        let result = ResultEnvelope::write(&envelope, WORKER, reply).unwrap();
        let subject = format!("sparring.default.results.{}.{KIND}.{WORKER}", envelope.server);
        context.publish(subject, result.into()).await.unwrap().await.unwrap();
        acker.ack().await.unwrap();
    }
    std::future::pending::<()>().await;
}

/// Designs of a list as id, state and reason, newest first.
fn states(list: &Value) -> Vec<[&Value; 3]> {
    let designs = list["designs"].as_array().unwrap().iter();
    designs.map(|design| [&design["id"], &design["state"], &design["state_reason"]]).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn wrong_layouts_of_an_expelled_worker_are_retired() {
    let Some(nats) = NatsServer::start() else { return };
    let url = nats.url();
    let options = ["--nats", &url, "--nats-min-job", "0", "--nats-patience", "60", "--nats-verify", "0"];
    let server = OptionServer::start(&options.map(str::to_owned));
    let api = server.api();
    let client = async_nats::connect(&url).await.unwrap();
    let worker = [tokio::spawn(beat(client.clone())), tokio::spawn(serve(client))];
    create(&api, json!({"designer": "off"})).await;
    wait_for_kind(&api, KIND).await;
    let request = async || request_design(&api, json!({"count": 2, "designer": "procedural"})).await;
    assert_eq!(request().await["admitted"], 2);
    let list = async || api.get("/v1/runs/run/designs?state=active").await.expect(200);
    let used = list().await;
    assert_eq!(states(&used).len(), 2, "nothing was judged again");
    let [wrong, ..] = states(&used)[1];
    // The worker is expelled, and the server designs itself.
    let second = request().await;
    assert_eq!((&second["state"], &second["admitted"]), (&json!("done"), &json!(2)), "{second}");
    assert_eq!(workers(&api).await["workers"][0]["state"], "expelled");

    wait_until("the wrong layout is retired", async || states(&list().await).len() == 3).await;
    let all = api.get("/v1/runs/run/designs").await.expect(200);
    let retired: Vec<_> = states(&all).into_iter().filter(|[_, state, _]| *state == "retired").collect();
    assert_eq!(retired, [[wrong, &json!("retired"), &json!("wrong")]], "{all:#}");
    let path = |verb: &str| format!("/v1/runs/run/designs/{}{verb}", wrong.as_str().unwrap());
    let details = api.get(&path("")).await.expect(200);
    let last = details["transitions"].as_array().unwrap().last().unwrap().clone();
    assert!(last["reason"].as_str().unwrap().contains("judges it otherwise"), "{details:#}");
    let statistics = api.get("/v1/runs/run/designs/statistics").await.expect(200);
    assert_eq!(statistics["tasks"][0]["retired"], json!({"wrong": 1}), "{statistics:#}");
    // It stays retired, whatever a user does.
    let _ = api.post(&path("/retire"), json!({})).await.expect(200);
    let _ = api.post(&path("/revive"), json!({})).await.expect(409);
    assert_eq!(states(&list().await).len(), 3);
    worker.iter().for_each(tokio::task::JoinHandle::abort);
}
