//! Jobs on a real NATS server: every result is that of this process, whatever happens to workers, messages and connections.

mod designs;
mod fake_worker;
mod faults;
mod large;
mod trust;

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use curriculum::{Curriculum, Settings, TaskPlan};
use env_core::rollout::roll_out;
use env_core::{Recipe, Scenario, SeedSpace};
use jobs::audit::AuditPayload;
use jobs::prepare::job::{PendingProposal, PreparePayload};
use jobs::seeds::seed_of;
use jobs::world_version::world_version;
use jobs::{EpisodeBatch, JobKind, JobOutput, JobPayload, LoggedEpisode};
use rayon::ThreadPoolBuilder;
use tokio::runtime::Runtime;
use tokio::sync::mpsc::UnboundedReceiver;
use tokio::sync::watch;

use super::NatsConfig;
use super::server::{NatsQueue, NatsQueueConfig};
use super::worker::{WorkerConfig, WorkerDesigners, WorkerError, run_in_world};
use crate::status::QueueNotice;
use crate::testing::NatsServer;
use crate::{CompletedJob, JobQueue, LocalQueue, QueuePools};

/// A task whose replays are fast.
const TASK: &str = "kessler/survival";
/// Longest time that a test waits for a state.
const DEADLINE: Duration = Duration::from_secs(60);

fn local_queue() -> LocalQueue {
    let pool = || Arc::new(ThreadPoolBuilder::new().num_threads(2).build().unwrap());
    LocalQueue::new(QueuePools { prepare: pool(), audit: pool(), critique: pool() })
}

fn config(nats: &NatsServer) -> NatsConfig {
    NatsConfig {
        url: nats.url().parse().unwrap(),
        credentials: None,
        authorities: None,
        cluster: "test".parse().unwrap(),
    }
}

/// Patience of a test in which workers lose jobs.
const SHORT: Duration = Duration::from_secs(1);
/// Patience of a test in which every job is done by a worker, however slow the machine is.
const LONG: Duration = Duration::from_secs(60);

/// Starts a queue that sends every job, and recomputes a share of the results.
fn start_queue(
    nats: &NatsServer,
    verified_share: f64,
    patience: Duration,
) -> (NatsQueue, UnboundedReceiver<QueueNotice>) {
    let config = NatsQueueConfig {
        nats: config(nats),
        server: "server".to_owned(),
        epoch: 1,
        verified_share,
        min_job: Duration::ZERO,
        patience,
    };
    NatsQueue::start(config, local_queue())
}

/// A worker with a runtime of its own. Dropping it is a kill: nothing that it holds is finished or acknowledged.
struct TestWorker {
    runtime: Option<Runtime>,
    end: tokio::task::JoinHandle<Result<(), WorkerError>>,
    stop: watch::Sender<bool>,
}

impl TestWorker {
    fn start(nats: &NatsServer, host: &str) -> Self {
        Self::start_in_world(nats, host, world_version())
    }

    fn start_in_world(nats: &NatsServer, host: &str, world: &'static str) -> Self {
        let config = WorkerConfig {
            nats: config(nats),
            host: host.to_owned(),
            kinds: JobKind::ALL.into_iter().collect::<BTreeSet<_>>(),
            concurrency: 2,
            policies: rollout::PolicySources::default(),
            designers: WorkerDesigners::default(),
        };
        let (stop, stopped) = watch::channel(false);
        let runtime =
            tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
        let end = runtime.spawn(run_in_world(config, stopped, world));
        Self { runtime: Some(runtime), end, stop }
    }
}

impl Drop for TestWorker {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

async fn wait_until(what: &str, is_true: impl Fn() -> bool) {
    let started = Instant::now();
    while !is_true() {
        assert!(started.elapsed() < DEADLINE, "{what}");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

/// Waits until this many workers take jobs.
async fn wait_for_workers(queue: &NatsQueue, count: usize) {
    let active = || {
        let workers = queue.status().workers;
        workers.iter().filter(|worker| worker.state == crate::status::WorkerState::Active).count()
    };
    wait_until("the workers join", || active() >= count).await;
}

/// Episodes of scenarios from a number on.
fn episodes(first: u64, count: u64) -> EpisodeBatch {
    let task = env_core::task(TASK).unwrap();
    let recipe = Arc::new(Recipe::at_level(task, 3).unwrap());
    let episode = |number: u64| {
        let scenario = Scenario::new(Arc::clone(&recipe), seed_of(SeedSpace::Training, 9, number, 0));
        let name = if number.is_multiple_of(2) { "hold" } else { "heuristic" };
        let mut policy = task.policy(name, &scenario, 0).unwrap();
        let log = roll_out(&scenario, &mut *policy).unwrap().log;
        LoggedEpisode { scenario, log: Arc::new(log) }
    };
    EpisodeBatch((first..first + count).map(episode).collect())
}

fn replays(first: u64, count: u64) -> JobPayload {
    JobPayload::Audit(AuditPayload::Replays(episodes(first, count)))
}

/// One job of each form.
fn all_jobs() -> Vec<JobPayload> {
    let mut curriculum =
        Curriculum::new(0, Settings::ladder(vec![TaskPlan::standard(TASK).unwrap()])).unwrap();
    let batch = episodes(0, 9);
    let mut damaged = batch.clone();
    // A log that does not replay is refused by workers as by the server.
    let mut short = (*damaged.0[3].log).clone();
    short.truncate(2);
    damaged.0[3].log = Arc::new(short);
    let scenarios = batch.0.iter().map(|episode| episode.scenario.clone()).collect();
    let mut jobs = vec![
        JobPayload::Audit(AuditPayload::Replays(damaged.clone())),
        JobPayload::Audit(AuditPayload::Brackets(scenarios)),
        JobPayload::Critique(damaged),
    ];
    for _ in 0..3 {
        let curriculum::SequencedProposal { seq, proposal } = curriculum.propose();
        let pending = PendingProposal { run_seed: 5, seq, proposal, parent: None };
        jobs.push(JobPayload::Prepare(PreparePayload(vec![pending])));
    }
    jobs
}

/// Results of this process.
async fn local_outputs(jobs: &[JobPayload]) -> Vec<JobOutput> {
    outputs(&local_queue(), jobs).await
}

/// Results of a queue, acknowledged.
async fn outputs(queue: &dyn JobQueue, jobs: &[JobPayload]) -> Vec<JobOutput> {
    let running: Vec<_> = jobs.iter().map(|job| queue.run(job.clone())).collect();
    let mut outputs = Vec::new();
    for done in futures_util::future::join_all(running).await {
        let CompletedJob { output, receipt } = done.unwrap();
        receipt.acknowledge();
        outputs.push(output);
    }
    outputs
}

#[tokio::test(flavor = "multi_thread")]
async fn results_are_equal_with_any_number_of_workers() {
    let Some(nats) = NatsServer::start() else { return };
    let jobs = all_jobs();
    let expected = local_outputs(&jobs).await;
    assert!(
        matches!(&expected[0], JobOutput::Audit(jobs::audit::AuditOutput::Replays(all)) if all[3].is_err())
    );
    let (queue, _notices) = start_queue(&nats, 0.5, LONG);
    wait_until("the server connects", || {
        queue.status().degraded.is_some_and(|reason| reason.contains("no worker"))
    })
    .await;
    assert_eq!(outputs(&queue, &jobs).await, expected, "without workers");
    assert_eq!((queue.status().counters.sent, queue.status().counters.done_locally), (0, jobs.len() as u64));
    let mut workers = Vec::new();
    for count in [1, 4] {
        while workers.len() < count {
            workers.push(TestWorker::start(&nats, &format!("host{}", workers.len())));
        }
        wait_for_workers(&queue, count).await;
        let before = queue.status().counters;
        assert_eq!(outputs(&queue, &jobs).await, expected, "{count} workers");
        let counters = queue.status().counters;
        assert!(
            counters.done_remotely > before.done_remotely && counters.verified_items > before.verified_items
        );
    }
    assert_eq!(queue.status().degraded, None);
    let errors: u64 = queue.status().workers.iter().map(|worker| worker.errors).sum();
    assert_eq!(errors, 0);
    // A worker that is stopped leaves by itself.
    for worker in &workers {
        worker.stop.send_replace(true);
    }
    wait_until("the workers leave", || queue.status().workers.is_empty()).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_job_that_is_cheaper_to_do_than_to_send_stays_here() {
    let Some(nats) = NatsServer::start() else { return };
    let (queue, _notices) = {
        let config = NatsQueueConfig {
            nats: config(&nats),
            server: "server".to_owned(),
            epoch: 1,
            verified_share: 0.0,
            min_job: Duration::from_secs(30),
            patience: Duration::from_secs(1),
        };
        NatsQueue::start(config, local_queue())
    };
    let _worker = TestWorker::start(&nats, "host");
    wait_for_workers(&queue, 1).await;
    let jobs = [replays(0, 2), replays(0, 2)];
    assert_eq!(outputs(&queue, &jobs).await, local_outputs(&jobs).await);
    assert_eq!(queue.status().counters.sent, 0);
}
