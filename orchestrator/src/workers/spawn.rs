//! Starts all workers of a service.

use std::path::PathBuf;
use std::sync::Arc;

use clock::Clock;
use futures_util::FutureExt;
use futures_util::future::BoxFuture;
use job_queue::nats::server::{DesignQueue, RolloutQueue};
use job_queue::status::QueueNotice;
use policy_files::PolicyFolder;
use rayon::{ThreadPool, ThreadPoolBuildError};
use rollout::{Endpoint, PolicySources};
use tokio::sync::mpsc::UnboundedReceiver;
use tokio::sync::watch;
use tokio::task::JoinSet;

use super::alert::AlertWorker;
use super::critique::CritiqueWorker;
use super::delete_archived::ArchivedRunWorker;
use super::design::DesignWorker;
use super::evaluate::EvaluationWorker;
use super::feed_stream::{FeedServer, FeedSignals, FeedStreamWorker};
use super::prepare::PrepareWorker;
use super::rollout::RolloutWorker;
use super::{clock as clock_worker, delete_runs, expire, remote_workers, retention, revoke_connections};
use crate::alerts::AlertSettings;
use crate::designs::Designers;
use crate::engine::signals::WorkerSignals;
use crate::leases::lease_service::LeaseService;
use crate::retention::archived::ArchivedRetention;
use crate::sessions::SessionManager;
use crate::threads::{self, ThreadPriority};

/// Parts of a service that its workers use.
#[derive(Debug)]
pub struct WorkerConfig {
    /// Source of the current time.
    pub clock: Clock,
    /// Database, writer and prepared scenarios.
    pub lease_service: LeaseService,
    /// Signals that wake the workers.
    pub signals: WorkerSignals,
    /// Signals that scenarios were prepared.
    pub ready: watch::Sender<u64>,
    /// Open sessions, for the worker that closes those of revoked tokens.
    pub sessions: Arc<SessionManager>,
    /// Designers of new layouts.
    pub designers: Arc<dyn Designers>,
    /// Language model for runs with the policy `chat`, if one is configured.
    pub endpoint: Option<Endpoint>,
    /// Folder of policy files, if one is configured.
    pub policy_folder: PolicyFolder,
    /// How long archived runs are kept; `None` keeps them for ever.
    pub archived_retention: Option<ArchivedRetention>,
    /// Rules of alerts, and their webhook.
    pub alerts: AlertSettings,
    /// Folder of the database, whose free space is watched.
    pub folder: PathBuf,
    /// Workers on other machines, if they are configured.
    pub remote: Option<RemoteQueue>,
    /// Where trajectory feeds are published, if NATS is configured.
    pub feeds: Option<FeedServer>,
}

/// Workers on other machines, as the workers of a service use them.
#[derive(Debug)]
pub struct RemoteQueue {
    /// Notices about the workers.
    pub notices: UnboundedReceiver<QueueNotice>,
    /// Designs by the workers.
    pub designs: DesignQueue,
    /// Rollouts by the workers.
    pub rollouts: RolloutQueue,
}

impl WorkerConfig {
    /// Spawns all workers.
    ///
    /// # Errors
    /// Returns an error if the system cannot create the threads of a worker.
    pub fn spawn(self) -> Result<JoinSet<()>, ThreadPoolBuildError> {
        // Boxed futures have one type, so the runtime's code for a task is compiled once.
        let mut jobs = JoinSet::new();
        for job in self.jobs()? {
            jobs.spawn(job);
        }
        Ok(jobs)
    }

    fn jobs(self) -> Result<Vec<BoxFuture<'static, ()>>, ThreadPoolBuildError> {
        let (rollouts, evaluator) = self.policy_workers()?;
        let alerts = self.alert_worker();
        let (feeds, designer) = (self.feed_worker(), self.design_worker());
        let Self { clock, lease_service, signals, ready, sessions, archived_retention, remote, .. } = self;
        let LeaseService { writer, readers, .. } = &lease_service;
        let preparer = PrepareWorker {
            readers: readers.clone(),
            writer: writer.clone(),
            wake: signals.prepare,
            ready,
            queue: Arc::clone(&lease_service.audits.queue),
        };
        let critic = CritiqueWorker {
            readers: readers.clone(),
            writer: writer.clone(),
            wake: signals.critique,
            queue: Arc::clone(&lease_service.audits.queue),
        };
        let archived = archived_retention.map(|retention| ArchivedRunWorker {
            readers: readers.clone(),
            writer: writer.clone(),
            clock: clock.clone(),
            sessions: Arc::clone(&sessions),
            retention,
        });
        let mut jobs = vec![
            preparer.run().boxed(),
            expire::run(writer.clone()).boxed(),
            clock_worker::run(clock.clone(), writer.clone()).boxed(),
            retention::run(readers.clone(), writer.clone()).boxed(),
            delete_runs::run(writer.clone(), signals.delete).boxed(),
            evaluator.run().boxed(),
            revoke_connections::run(readers.clone(), clock, sessions).boxed(),
            critic.run().boxed(),
            designer.run().boxed(),
            rollouts.run().boxed(),
            alerts.run().boxed(),
        ];
        jobs.extend(archived.map(|worker| worker.run().boxed()));
        jobs.extend(
            remote.map(|remote| remote_workers::run(readers.clone(), writer.clone(), remote.notices).boxed()),
        );
        jobs.extend(feeds.map(|worker| worker.run().boxed()));
        Ok(jobs)
    }

    /// Creates the worker that runs design requests.
    fn design_worker(&self) -> DesignWorker {
        DesignWorker {
            readers: self.lease_service.readers.clone(),
            writer: self.lease_service.writer.clone(),
            wake: Arc::clone(&self.signals.design),
            designers: Arc::clone(&self.designers),
            remote: self.remote.as_ref().map(|remote| remote.designs.clone()),
        }
    }

    /// Creates the worker that publishes trajectory feeds, if NATS is configured.
    fn feed_worker(&self) -> Option<FeedStreamWorker> {
        let LeaseService { readers, writer, .. } = &self.lease_service;
        let signals =
            FeedSignals { groups: self.signals.feed.subscribe(), runs: self.signals.run_states.subscribe() };
        Some(FeedStreamWorker::new(readers.clone(), writer.clone(), self.feeds.clone()?, signals))
    }

    /// Creates the worker that checks the rules of alerts.
    fn alert_worker(&self) -> AlertWorker {
        AlertWorker {
            readers: self.lease_service.readers.clone(),
            writer: self.lease_service.writer.clone(),
            clock: self.clock.clone(),
            settings: self.alerts.clone(),
            queue: Arc::clone(&self.lease_service.audits.queue),
            folder: self.folder.clone(),
        }
    }

    /// Creates the workers that roll out policies: for runs, and for evaluations.
    fn policy_workers(&self) -> Result<(RolloutWorker, EvaluationWorker), ThreadPoolBuildError> {
        let rollouts = RolloutWorker {
            lease_service: self.lease_service.clone(),
            readers: self.lease_service.readers.clone(),
            clock: self.clock.clone(),
            wake: Arc::clone(&self.signals.rollout),
            policies: PolicySources { endpoint: self.endpoint.clone(), folder: self.policy_folder.clone() },
            pool: background_pool("rollout")?,
            permits: RolloutWorker::group_permits(),
            remote: self.remote.as_ref().map(|remote| remote.rollouts.clone()),
        };
        let evaluator = EvaluationWorker {
            readers: self.lease_service.readers.clone(),
            writer: self.lease_service.writer.clone(),
            policy_folder: self.policy_folder.clone(),
            pool: background_pool("evaluate")?,
        };
        Ok((rollouts, evaluator))
    }
}

/// Pool of the lowest priority, of half of the cores.
fn background_pool(name: &'static str) -> Result<Arc<ThreadPool>, ThreadPoolBuildError> {
    threads::pool(name, threads::half_of_cores(), ThreadPriority::Background)
}
