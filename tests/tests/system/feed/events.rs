//! Events: what happens in a run, in order, and nothing twice or missed across connections.

use std::time::Duration;

use serde_json::{Value, json};
use system_tests::{Api, Server, http_client, result};

use super::trainer::{Flight, run};

/// A listener, as a browser is one.
struct Listener {
    response: reqwest::Response,
    text: String,
}

#[derive(Debug, Clone)]
struct Heard {
    id: u64,
    kind: String,
    data: Value,
}

impl Listener {
    async fn new(api: &Api, path: &str, last: Option<u64>) -> Self {
        let mut request = http_client().get(format!("{}{path}", api.base()));
        if let Some(last) = last {
            request = request.header("last-event-id", last.to_string());
        }
        let response = request.send().await.unwrap();
        assert_eq!(response.status().as_u16(), 200);
        assert_eq!(response.headers()["content-type"], "text/event-stream");
        Self { response, text: String::new() }
    }

    /// The next event; none where the server ended the stream.
    async fn next(&mut self) -> Option<Heard> {
        loop {
            if let Some((event, rest)) = self.text.split_once("\n\n") {
                let (event, rest) = (event.to_owned(), rest.to_owned());
                self.text = rest;
                let field =
                    |name: &str| event.lines().find_map(|line| line.strip_prefix(name)).map(str::trim);
                let Some(data) = field("data:") else { continue }; // a comment
                return Some(Heard {
                    id: field("id:").unwrap().parse().unwrap(),
                    kind: field("event:").unwrap().to_owned(),
                    data: serde_json::from_str(data).unwrap(),
                });
            }
            let chunk = tokio::time::timeout(Duration::from_secs(20), self.response.chunk()).await;
            self.text.push_str(std::str::from_utf8(&chunk.expect("an event in time").ok()??).unwrap());
        }
    }

    /// Events until one of a kind comes, with it.
    async fn until(&mut self, kind: &str) -> Vec<Heard> {
        let mut heard = Vec::new();
        loop {
            heard.push(self.next().await.expect("the stream goes on"));
            if heard.last().unwrap().kind == kind {
                return heard;
            }
        }
    }
}

#[tokio::test]
async fn what_happens_is_told_in_order_and_can_be_heard_again() {
    let mut server = Server::start().await;
    let api = server.api();
    run(&api, "run", json!({"group_size": 2})).await;
    run(&api, "other", json!({})).await;
    let mut live = Listener::new(&api, "/v1/runs/run/events?after=0", None).await;
    assert_eq!(live.next().await.unwrap().data["state"], "created");
    let lease = api.lease("run", json!({"groups": 2})).await;
    let _ = api.lease("other", json!({"groups": 1})).await;
    let taken = live.next().await.unwrap();
    assert_eq!((taken.kind.as_str(), &taken.data["state"]), ("lease", &json!("taken")));
    assert_eq!(taken.data["lease"], lease.id());
    let renew = format!("/v1/runs/run/leases/{}/renew", lease.id());
    let _ = api.post(&renew, json!({})).await.expect(200);
    assert_eq!(live.next().await.unwrap().data["state"], "renewed");
    let results: Vec<Value> =
        lease.episodes().iter().map(|(id, scenario)| result(id, scenario, "hold")).collect();
    let _ = api.report("run", results).await;
    let heard = live.until("failures").await;
    let kinds: Vec<&str> = heard.iter().map(|heard| heard.kind.as_str()).collect();
    assert_eq!(kinds, ["group", "group", "lease", "failures"], "{heard:?}");
    assert_eq!((&heard[0].data["group"], &heard[0].data["finished"]), (&json!(0), &json!(2)));
    assert_eq!(heard[2].data["state"], "done");
    assert!(heard[0].data["at"].as_str().unwrap().ends_with('Z'));
    assert_eq!(heard[3].data["criticised"], 4);
    // Another listener hears the same from where it left, and nothing of another run.
    let mut again = Listener::new(&api, "/v1/runs/run/events", Some(taken.id)).await;
    let mut ids = vec![again.next().await.unwrap().id];
    while ids.len() < 5 {
        ids.push(again.next().await.unwrap().id);
    }
    assert!(ids.is_sorted() && ids[0] > taken.id && ids[4] == heard[3].id);
    // Without a word where to begin: only what happens from now on.
    let mut fresh = Listener::new(&api, "/v1/runs/run/events", None).await;
    let _ = api.post("/v1/runs/run/pause", json!({})).await.expect(200);
    assert_eq!(fresh.next().await.unwrap().data["state"], "paused");
    assert_eq!(live.next().await.unwrap().data["state"], "paused");
    // A server that stops ends streams; what was told is still there when it is back.
    server.stop().await;
    assert!(live.next().await.is_none() && fresh.next().await.is_none());
    server.restart().await;
    let mut back = Listener::new(&server.api(), "/v1/runs/run/events", Some(heard[3].id)).await;
    assert_eq!(back.next().await.unwrap().data["state"], "paused");
}

#[tokio::test]
async fn claims_and_what_is_wrong_with_them_are_told() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run", json!({"audit_groups": 6})).await;
    let mut live = Listener::new(&api, "/v1/runs/run/events?after=0", None).await;
    let mut flight = Flight::new(&api, "run", json!({"groups": 20}), "hold").await;
    flight.scores.iter_mut().for_each(|score| *score = 0.01);
    let claim = flight.claim(&api).await;
    let _ = api.report("run", flight.due(&claim)).await;
    let heard = live.until("health").await;
    let states: Vec<&Value> = heard.iter().filter(|h| h.kind == "claim").map(|h| &h.data["state"]).collect();
    assert_eq!(states, ["claimed", "refused"]);
    assert!(heard.last().unwrap().data["words"].as_str().unwrap().contains("refused"));
    assert!(!heard.iter().any(|heard| heard.kind == "group" || heard.kind == "move"));
}

#[tokio::test]
async fn what_is_not_kept_any_more_is_a_gap() {
    let mut server = Server::start().await;
    run(&server.api(), "run", json!({})).await;
    server.stop().await;
    {
        use sqlx::Connection;
        let path = format!("sqlite://{}", server.db().display());
        let mut connection = sqlx::SqliteConnection::connect(&path).await.unwrap();
        for sql in [
            "INSERT INTO run_events (id, run, kind, body, at) VALUES (5000, 'run', 'health', '{\"words\": \"old\"}', 0)",
            "INSERT INTO forgotten_events (run, last) VALUES ('run', 4000)",
        ] {
            sqlx::query(sql).execute(&mut connection).await.unwrap();
        }
    }
    server.restart().await;
    let mut late = Listener::new(&server.api(), "/v1/runs/run/events", Some(17)).await;
    let gap = late.next().await.unwrap();
    assert_eq!((gap.kind.as_str(), gap.id, &gap.data["up_to"]), ("gap", 4000, &json!(4000)));
    assert_eq!(late.next().await.unwrap().data["words"], "old");
}

/// Who remembers a number that was never given (of another database, or of a newer copy of it) is told so.
#[tokio::test]
async fn a_number_from_elsewhere_is_a_gap() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run", json!({})).await;
    let mut lost = Listener::new(&api, "/v1/runs/run/events", Some(5_000)).await;
    let gap = lost.next().await.unwrap();
    assert_eq!((gap.kind.as_str(), &gap.data["after"]), ("gap", &json!(5_000)), "{gap:?}");
    let _ = api.lease("run", json!({"groups": 1})).await;
    assert_eq!(lost.next().await.unwrap().data["state"], "taken");
}

/// The ring of a run is bounded, whatever happens in it.
#[tokio::test]
async fn a_busy_run_forgets_its_oldest_events() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run", json!({})).await;
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
    let mut late = Listener::new(&api, "/v1/runs/run/events", Some(1)).await;
    let gap = late.next().await.unwrap();
    assert_eq!(gap.kind, "gap");
    let newest = 12_802; // created, taken, and 12 800 times renewed
    assert!((newest - 11_000..=newest - 10_000).contains(&gap.id), "{gap:?}");
    assert_eq!(late.next().await.unwrap().id, gap.id + 1);
}

#[tokio::test]
async fn what_cannot_be_heard_is_told() {
    let server = Server::start().await;
    let api = server.api();
    run(&api, "run", json!({})).await;
    assert_eq!(api.get("/v1/runs/none/events").await.status, 404);
    assert_eq!(api.get("/v1/runs/run/events?after=x").await.expect(400)["field"], "after");
    assert_eq!(api.get("/v1/runs/run/events?since=3").await.expect(400)["field"], "since");
    let mut all = Vec::new();
    for _ in 0..256 {
        all.push(Listener::new(&api, "/v1/runs/run/events", None).await);
    }
    let full = api.get("/v1/runs/run/events").await;
    assert_eq!((full.status, full.retry_after.as_deref()), (429, Some("5")));
    drop(all);
    for _ in 0..100 {
        // A listener that went away is noticed when there is something to tell it.
        let _ = api.post("/v1/runs/run/pause", json!({})).await.expect(200);
        let request = http_client().get(format!("{}/v1/runs/run/events", api.base()));
        if request.send().await.unwrap().status().as_u16() == 200 {
            return;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    panic!("nobody could listen any more");
}
