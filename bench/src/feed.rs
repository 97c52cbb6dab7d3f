//! Trajectory feed over HTTP and over NATS JetStream: episodes/s and bytes of an episode, for one trainer and for four that share the
//! groups of a run. The feed is filled before, so that rollouts are not measured.

use std::io::Write;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};
use async_nats::jetstream;
use async_nats::jetstream::consumer::{AckPolicy, pull};
use futures_util::StreamExt;
use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::json;
use system_tests::nats_server::NatsServer;
use system_tests::worker_cluster::WorkerCluster;
use system_tests::{ApiClient, http_client};
use tokio::task::JoinSet;

use crate::Row;
use crate::sockets::process::cpu_s;

/// Groups in a feed before its trainers start.
const GROUPS: usize = 400;
/// Episodes of a group: with more of them, groups are objects instead of messages.
const GROUP_SIZE: usize = 2;
/// Groups of a claim, and of a request to JetStream.
const GROUPS_AT_ONCE: usize = 16;
/// Numbers of trainers that share a feed.
const TRAINERS: [usize; 2] = [1, 4];
/// Largest time in which a feed is filled or emptied.
const DEADLINE: Duration = Duration::from_secs(300);
/// Pause of a trainer that received nothing from JetStream.
const EMPTY_PAUSE: Duration = Duration::from_millis(2);
/// Interval between two looks at a feed.
const POLL: Duration = Duration::from_millis(500);

/// Way in which trainers receive a feed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum FeedTransport {
    Http,
    Nats,
}

impl FeedTransport {
    const fn as_str(self) -> &'static str {
        match self {
            Self::Http => "http",
            Self::Nats => "nats",
        }
    }
}

/// Measured delivery of a feed.
#[derive(Debug, Clone, Copy)]
struct FeedCost {
    episodes_per_s: f64,
    bytes_per_episode: f64,
    /// CPU time of the server for an episode, µs.
    server_us: f64,
}

/// Parts of a group that a trainer reads.
#[derive(Deserialize)]
struct GroupHead {
    id: i64,
    episodes: Vec<IgnoredAny>,
}

#[derive(Deserialize)]
struct Page {
    groups: Vec<GroupHead>,
}

/// Groups that the trainers of a feed have received together.
#[derive(Default)]
struct ReceivedGroups {
    groups: AtomicUsize,
    episodes: AtomicUsize,
    bytes: AtomicUsize,
}

impl ReceivedGroups {
    fn add(&self, groups: &[GroupHead], bytes: usize) {
        let episodes = groups.iter().map(|group| group.episodes.len()).sum();
        self.episodes.fetch_add(episodes, Ordering::Relaxed);
        self.bytes.fetch_add(bytes, Ordering::Relaxed);
        self.groups.fetch_add(groups.len(), Ordering::SeqCst);
    }

    fn is_complete(&self, groups: usize) -> bool {
        self.groups.load(Ordering::SeqCst) >= groups
    }
}

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(async {
        let nats = NatsServer::start().context("the package index has no NATS server")?;
        let cluster = WorkerCluster::start(Some(nats), 0).await;
        let mut rows = Vec::new();
        for trainers in TRAINERS {
            let http = deliver(&cluster, FeedTransport::Http, trainers).await?;
            let nats = deliver(&cluster, FeedTransport::Nats, trainers).await?;
            rows.extend(compare(trainers, http, nats));
        }
        Ok(rows)
    })
}

/// Rows that compare both ways of delivery.
fn compare(trainers: usize, http: FeedCost, nats: FeedCost) -> [Row; 3] {
    let row = |what: &str, of: fn(&FeedCost) -> f64| {
        let (nats, http) = (of(&nats), of(&http));
        Row {
            label: format!("feed, {trainers} trainers, JetStream / HTTP: {what}"),
            measured: format!("{nats:.0} / {http:.0}"),
            goal: String::new(),
            ratio: Some(nats / http),
        }
    };
    [
        row("episodes/s", |cost| cost.episodes_per_s),
        row("bytes of an episode", |cost| cost.bytes_per_episode),
        row("CPU of the server for an episode, µs", |cost| cost.server_us),
    ]
}

/// Fills the feed of a new run, and measures how trainers empty it.
async fn deliver(
    cluster: &WorkerCluster,
    transport: FeedTransport,
    trainers: usize,
) -> anyhow::Result<FeedCost> {
    let api = cluster.api();
    let run = format!("feed-{}-{trainers}", transport.as_str());
    let groups = fill(cluster, &api, &run, transport).await?;
    let received = Arc::new(ReceivedGroups::default());
    let pid = cluster.server().pid();
    let (cpu, start) = (cpu_s(pid)?, Instant::now());
    let mut consumers: JoinSet<anyhow::Result<()>> = JoinSet::new();
    for _ in 0..trainers {
        let (received, run) = (Arc::clone(&received), run.clone());
        match transport {
            FeedTransport::Http => consumers.spawn(read_http(api.base().to_owned(), run, groups, received)),
            FeedTransport::Nats => {
                let url = cluster.nats.as_ref().context("NATS runs")?.url();
                consumers.spawn(read_nats(url, run, groups, received))
            }
        };
    }
    let done = async {
        while let Some(ended) = consumers.join_next().await {
            ended??;
        }
        anyhow::Ok(())
    };
    tokio::time::timeout(DEADLINE, done).await.context("the feed was not emptied in time")??;
    let seconds = start.elapsed().as_secs_f64();
    // The server notices acknowledgements on NATS a moment later.
    wait_for_feed(&api, &run, |feed| feed.unacknowledged == 0).await?;
    let cpu = cpu_s(pid)? - cpu;
    let episodes = received.episodes.load(Ordering::SeqCst) as f64;
    let cost = FeedCost {
        episodes_per_s: episodes / seconds,
        bytes_per_episode: received.bytes.load(Ordering::SeqCst) as f64 / episodes,
        server_us: 1e6 * cpu / episodes,
    };
    writeln!(std::io::stderr(), "{run}: {episodes} episodes in {seconds:.2} s, {cost:?}")?;
    Ok(cost)
}

/// Numbers of groups of a run.
struct FeedFill {
    /// Groups that were pushed to the feed.
    pushed: u64,
    /// Groups that no trainer has acknowledged.
    unacknowledged: u64,
}

/// Creates a run and fills its feed. Returns the number of groups in it.
async fn fill(
    cluster: &WorkerCluster,
    api: &ApiClient,
    run: &str,
    transport: FeedTransport,
) -> anyhow::Result<usize> {
    let settings = json!({"strategy": "ladder", "id": run, "seed": 5, "group_size": GROUP_SIZE, "tasks": ["kessler/survival"],
        "contested_share": 0.0, "placement": false, "design": {"designer": "off"}});
    let created = api.post("/v1/runs", settings).await;
    ensure!(created.status == 201, "no run: {}", created.body);
    set_policy(api, run, "random", transport).await?;
    wait_for_feed(api, run, |feed| feed.pushed >= GROUPS as u64).await?;
    set_policy(api, run, "off", transport).await?;
    let mut before = 0;
    // Groups that had begun are pushed, too.
    let feed = wait_for_feed(api, run, |feed| std::mem::replace(&mut before, feed.pushed) == feed.pushed);
    let groups = usize::try_from(feed.await?.unacknowledged)?;
    let start = Instant::now();
    while !cluster.metrics().await.contains("sparring_feed_unpublished 0\n") {
        ensure!(start.elapsed() < DEADLINE, "the feed of {run} was not published in time");
        tokio::time::sleep(POLL).await;
    }
    Ok(groups)
}

async fn set_policy(
    api: &ApiClient,
    run: &str,
    policy: &str,
    transport: FeedTransport,
) -> anyhow::Result<()> {
    let settings =
        json!({"policy": policy, "max_unacknowledged_groups": GROUPS, "delivery": transport.as_str()});
    let path = format!("/v1/runs/{run}/policy");
    let put = api.request("PUT", &path, "application/json", settings.to_string()).await;
    ensure!(put.status == 200, "no policy: {}", put.body);
    Ok(())
}

/// Waits until the feed of a run meets a condition.
async fn wait_for_feed(
    api: &ApiClient,
    run: &str,
    mut is_met: impl FnMut(&FeedFill) -> bool,
) -> anyhow::Result<FeedFill> {
    let start = Instant::now();
    loop {
        let state = api.get(&format!("/v1/runs/{run}/policy")).await.body;
        let feed = &state["feed"];
        let count = |value: &serde_json::Value| value.as_u64().context("no number of groups");
        let unacknowledged = count(&feed["waiting"])? + count(&feed["delivered"])?;
        let counts = FeedFill { pushed: count(&state["groups"])?, unacknowledged };
        if is_met(&counts) {
            return Ok(counts);
        }
        ensure!(start.elapsed() < DEADLINE, "the feed of {run} did not change in time: {state}");
        tokio::time::sleep(POLL).await;
    }
}

/// Claims and acknowledges groups over HTTP until all trainers together have `groups`.
async fn read_http(
    base: String,
    run: String,
    groups: usize,
    received: Arc<ReceivedGroups>,
) -> anyhow::Result<()> {
    let client = http_client();
    let url = format!("{base}/v1/runs/{run}/trajectories");
    let send = async |path: &str, body: serde_json::Value| -> anyhow::Result<Vec<u8>> {
        let request = client.post(format!("{url}/{path}")).header("content-type", "application/json");
        let response = request.body(body.to_string()).send().await?;
        ensure!(response.status().is_success(), "{path}: {}", response.status());
        Ok(response.bytes().await?.to_vec())
    };
    while !received.is_complete(groups) {
        let claimed = send("claim", json!({"limit": GROUPS_AT_ONCE, "ttl_s": 600})).await?;
        let page: Page = serde_json::from_slice(&claimed)?;
        let ids: Vec<i64> = page.groups.iter().map(|group| group.id).collect();
        if ids.is_empty() {
            break; // the others have the rest
        }
        send("ack", json!({ "ids": ids })).await?;
        received.add(&page.groups, claimed.len());
    }
    Ok(())
}

/// Reads and acknowledges groups from the stream of a run until all trainers together have `groups`.
async fn read_nats(
    url: String,
    run: String,
    groups: usize,
    received: Arc<ReceivedGroups>,
) -> anyhow::Result<()> {
    let context = jetstream::new(async_nats::connect(url).await?);
    let config = pull::Config {
        durable_name: Some("bench".to_owned()),
        ack_policy: AckPolicy::Explicit,
        ack_wait: Duration::from_secs(600),
        ..pull::Config::default()
    };
    let consumer = context.create_consumer_on_stream(config, format!("SPARRING_default_FEED_{run}")).await?;
    while !received.is_complete(groups) {
        let batch = consumer.fetch().max_messages(GROUPS_AT_ONCE).messages().await;
        let mut batch = batch.map_err(|error| anyhow::anyhow!("no groups: {error}"))?;
        let before = received.groups.load(Ordering::SeqCst);
        while let Some(message) = batch.next().await {
            let message = message.map_err(|error| anyhow::anyhow!("no group: {error}"))?;
            ensure!(!message.payload.is_empty(), "a group is too large for a message");
            let group: GroupHead = serde_json::from_slice(&message.payload)?;
            message.ack().await.map_err(|error| anyhow::anyhow!("not acknowledged: {error}"))?;
            received.add(std::slice::from_ref(&group), message.payload.len());
        }
        if received.groups.load(Ordering::SeqCst) == before {
            tokio::time::sleep(EMPTY_PAUSE).await; // the others have the rest
        }
    }
    context.client().flush().await?;
    Ok(())
}
