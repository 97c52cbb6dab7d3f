//! Event stream of a run: in order, complete across connections, and bounded.

use std::time::Duration;

use serde_json::{Value, json};
use system_tests::{ApiClient, Server, http_client, wait_until};

use super::column_trainer::{ColumnClaim, create_run};

/// Client of an event stream, as a browser implements it.
struct EventStream {
    response: reqwest::Response,
    text: String,
}

#[derive(Debug, Clone)]
struct Event {
    id: u64,
    kind: String,
    data: Value,
}

impl EventStream {
    async fn new(api: &ApiClient, path: &str, last: Option<u64>) -> Self {
        let mut request = http_client().get(format!("{}{path}", api.base()));
        if let Some(last) = last {
            request = request.header("last-event-id", last.to_string());
        }
        let response = request.send().await.unwrap();
        assert_eq!(response.status().as_u16(), 200);
        assert_eq!(response.headers()["content-type"], "text/event-stream");
        Self { response, text: String::new() }
    }

    /// Returns the next event, or `None` if the server ended the stream.
    async fn next(&mut self) -> Option<Event> {
        loop {
            if let Some((event, rest)) = self.text.split_once("\n\n") {
                let (event, rest) = (event.to_owned(), rest.to_owned());
                self.text = rest;
                let field =
                    |name: &str| event.lines().find_map(|line| line.strip_prefix(name)).map(str::trim);
                let Some(data) = field("data:") else { continue }; // a comment
                return Some(Event {
                    id: field("id:").unwrap().parse().unwrap(),
                    kind: field("event:").unwrap().to_owned(),
                    data: serde_json::from_str(data).unwrap(),
                });
            }
            let chunk = tokio::time::timeout(Duration::from_secs(120), self.response.chunk()).await;
            self.text.push_str(std::str::from_utf8(&chunk.expect("an event in time").ok()??).unwrap());
        }
    }

    /// Returns all events up to and including the next one of this kind.
    async fn until(&mut self, kind: &str) -> Vec<Event> {
        let mut events = Vec::new();
        loop {
            events.push(self.next().await.expect("the stream goes on"));
            if events.last().unwrap().kind == kind {
                return events;
            }
        }
    }
}

#[tokio::test]
async fn events_are_ordered_and_can_be_resumed() {
    let mut server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({"group_size": 2})).await;
    create_run(&api, "other", json!({})).await;
    let mut stream = EventStream::new(&api, "/v1/runs/run/events?after=0", None).await;
    assert_eq!(stream.next().await.unwrap().data["state"], "created");
    let lease = api.lease("run", json!({"groups": 2})).await;
    let _ = api.lease("other", json!({"groups": 1})).await;
    let taken = stream.next().await.unwrap();
    assert_eq!((taken.kind.as_str(), &taken.data["state"]), ("lease", &json!("created")));
    assert_eq!(taken.data["lease"], lease.id());
    let renew = format!("/v1/runs/run/leases/{}/renew", lease.id());
    let _ = api.post(&renew, json!({})).await.expect(200);
    assert_eq!(stream.next().await.unwrap().data["state"], "renewed");
    let _ = api.report("run", lease.results("hold")).await;
    let events = stream.until("failures").await;
    let kinds: Vec<&str> = events.iter().map(|event| event.kind.as_str()).collect();
    assert_eq!(kinds, ["group", "group", "lease", "failures"], "{events:?}");
    assert_eq!((&events[0].data["group"], &events[0].data["finished"]), (&json!(0), &json!(2)));
    assert_eq!(events[2].data["state"], "done");
    assert!(events[0].data["at"].as_str().unwrap().ends_with('Z'));
    assert_eq!(events[3].data["criticised"], 4);
    // A client that resumes receives the same events, and none of another run.
    let mut resumed = EventStream::new(&api, "/v1/runs/run/events", Some(taken.id)).await;
    let mut ids = vec![resumed.next().await.unwrap().id];
    while ids.len() < 5 {
        ids.push(resumed.next().await.unwrap().id);
    }
    assert!(ids.is_sorted() && ids[0] > taken.id && ids[4] == events[3].id);
    // `kind` selects events, and `last` counts these.
    let mut some = EventStream::new(&api, "/v1/runs/run/events?kind=lease,failures&last=2", None).await;
    let kinds = [some.next().await.unwrap().kind, some.next().await.unwrap().kind];
    assert_eq!(kinds, ["lease", "failures"]);
    let wrong = api.get("/v1/runs/run/events?kind=lease,moves").await.expect(422);
    assert_eq!(wrong["field"], "kind");
    assert!(wrong["detail"].as_str().unwrap().contains("got \"moves\""), "{wrong}");
    // Without `last-event-id` or `after`, the stream has only new events.
    let mut fresh = EventStream::new(&api, "/v1/runs/run/events", None).await;
    let _ = api.post("/v1/runs/run/pause", json!({})).await.expect(200);
    assert_eq!(fresh.next().await.unwrap().data["state"], "paused");
    assert_eq!(stream.next().await.unwrap().data["state"], "paused");
    // A server that stops ends its streams; events are stored over the restart.
    server.stop().await;
    assert!(stream.next().await.is_none() && fresh.next().await.is_none());
    server.restart().await;
    let mut reconnected = EventStream::new(&server.api(), "/v1/runs/run/events", Some(events[3].id)).await;
    assert_eq!(reconnected.next().await.unwrap().data["state"], "paused");
}

#[tokio::test]
async fn refused_claim_emits_claim_and_health_events() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({"audit_groups": 6})).await;
    let mut stream = EventStream::new(&api, "/v1/runs/run/events?after=0", None).await;
    let mut trainer = ColumnClaim::new(&api, "run", json!({"groups": 20}), "hold").await;
    trainer.scores.iter_mut().for_each(|score| *score = 0.01);
    let claim = trainer.claim(&api).await;
    let _ = api.report("run", trainer.audited_results(&claim)).await;
    let events = stream.until("warning").await;
    let states: Vec<&Value> = events.iter().filter(|h| h.kind == "claim").map(|h| &h.data["state"]).collect();
    assert_eq!(states, ["claimed", "refused"]);
    assert!(events.last().unwrap().data["message"].as_str().unwrap().contains("refused"));
    assert!(!events.iter().any(|event| event.kind == "group" || event.kind == "move"));
}

#[tokio::test]
async fn removed_events_are_reported_as_a_gap() {
    let mut server = Server::start().await;
    create_run(&server.api(), "run", json!({})).await;
    server.stop().await;
    {
        use sqlx::Connection;
        let path = format!("sqlite://{}", server.db_path().display());
        let mut connection = sqlx::SqliteConnection::connect(&path).await.unwrap();
        for sql in [
            "INSERT INTO run_events (id, run, kind, body, at) VALUES (5000, 'run', 'warning', '{\"message\": \"old\"}', 0)",
            "INSERT INTO deleted_run_events (run, last_id) VALUES ('run', 4000)",
        ] {
            sqlx::query(sql).execute(&mut connection).await.unwrap();
        }
    }
    server.restart().await;
    let mut late = EventStream::new(&server.api(), "/v1/runs/run/events", Some(17)).await;
    let gap = late.next().await.unwrap();
    assert_eq!((gap.kind.as_str(), gap.id, &gap.data["up_to"]), ("gap", 4000, &json!(4000)));
    assert_eq!(late.next().await.unwrap().data["message"], "old");
}

/// An id that the server never issued, for example of another database, is reported as a gap.
#[tokio::test]
async fn unknown_event_id_is_reported_as_a_gap() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let mut lost = EventStream::new(&api, "/v1/runs/run/events", Some(5_000)).await;
    let gap = lost.next().await.unwrap();
    assert_eq!((gap.kind.as_str(), &gap.data["after"]), ("gap", &json!(5_000)), "{gap:?}");
    let _ = api.lease("run", json!({"groups": 1})).await;
    assert_eq!(lost.next().await.unwrap().data["state"], "created");
}

/// The number of stored events of a run is bounded.
#[tokio::test]
async fn oldest_events_of_a_busy_run_are_removed() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    let lease = api.lease("run", json!({"groups": 1, "ttl_s": 3600})).await;
    let renew = format!("/v1/runs/run/leases/{}/renew", lease.id());
    let mut tasks = tokio::task::JoinSet::new();
    for _ in 0..32 {
        let (api, renew) = (api.clone(), renew.clone());
        tasks.spawn(async move {
            for _ in 0..400 {
                let _ = api.post(&renew, json!({})).await.expect(200);
            }
        });
    }
    while let Some(done) = tasks.join_next().await {
        done.unwrap();
    }
    let mut late = EventStream::new(&api, "/v1/runs/run/events", Some(1)).await;
    let gap = late.next().await.unwrap();
    assert_eq!(gap.kind, "gap");
    let newest = 12_802; // created, taken, and 12 800 renewals
    assert!((newest - 11_000..=newest - 10_000).contains(&gap.id), "{gap:?}");
    assert_eq!(late.next().await.unwrap().id, gap.id + 1);
}

#[tokio::test]
async fn invalid_and_excess_streams_are_rejected() {
    let server = Server::start().await;
    let api = server.api();
    create_run(&api, "run", json!({})).await;
    assert_eq!(api.get("/v1/runs/none/events").await.status, 404);
    assert_eq!(api.get("/v1/runs/run/events?after=x").await.expect(400)["field"], "after");
    assert_eq!(api.get("/v1/runs/run/events?since=3").await.expect(400)["field"], "since");
    let mut all = Vec::new();
    for _ in 0..256 {
        all.push(EventStream::new(&api, "/v1/runs/run/events", None).await);
    }
    let full = api.get("/v1/runs/run/events").await;
    assert_eq!((full.status, full.retry_after.as_deref()), (429, Some("5")));
    drop(all);
    wait_until("a stream is free again", async || {
        // The server notices a disconnected client when it sends the next event.
        let _ = api.post("/v1/runs/run/pause", json!({})).await.expect(200);
        let request = http_client().get(format!("{}/v1/runs/run/events", api.base()));
        request.send().await.unwrap().status().as_u16() == 200
    })
    .await;
}
