//! Workers that a server knows, by their heartbeats and results.

#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use jobs::JobKind;
use jobs::envelope::JobId;

use super::unverified::{UnverifiedDesign, UnverifiedJob, UnverifiedWork};
use crate::nats::membership::{ControlMessage, Heartbeat};
use crate::status::{QueueNotice, WorkerIdentity, WorkerState, WorkerStatus};

/// Time without a heartbeat after which a worker counts as stalled.
const STALLED_AFTER: Duration = Duration::from_secs(4);
/// Time without a heartbeat after which a worker is forgotten.
const FORGOTTEN_AFTER: Duration = Duration::from_secs(120);
/// Largest number of known workers.
const MAX_WORKERS: usize = 10_000;
/// Weight of the last second in the rate of jobs.
const RATE_WEIGHT: f64 = 0.1;

/// A worker with its results.
#[derive(Debug)]
struct WorkerRecord {
    heartbeat: Heartbeat,
    kinds: Vec<JobKind>,
    state: WorkerState,
    reason: Option<String>,
    last_seen: Instant,
    jobs: u64,
    errors: u64,
    verified: u64,
    /// Value of `jobs` at the last tick.
    counted: u64,
    jobs_per_s: f64,
    unverified: UnverifiedWork,
}

/// Known workers by id.
#[derive(Debug)]
pub(super) struct WorkerRegistry {
    world: &'static str,
    server: String,
    workers: BTreeMap<String, WorkerRecord>,
    /// Hosts whose results were wrong, with the reasons. A worker of such a host is expelled at once.
    expelled_hosts: BTreeMap<String, String>,
}

/// A worker that was expelled.
#[derive(Debug)]
pub(super) struct ExpelledWorker {
    pub(super) identity: WorkerIdentity,
    /// Results of all workers of its host since their last agreements.
    pub(super) unverified: UnverifiedWork,
}

/// Reaction to a heartbeat.
#[derive(Debug, Default)]
pub(super) struct HeartbeatReaction {
    /// Answer to the worker.
    pub(super) answer: Option<ControlMessage>,
    /// Change that is announced.
    pub(super) notice: Option<QueueNotice>,
}

impl WorkerRegistry {
    /// Creates an empty registry of a server with a world version.
    pub(super) fn new(server: String, world: &'static str) -> Self {
        Self { world, server, workers: BTreeMap::new(), expelled_hosts: BTreeMap::new() }
    }

    /// Notes the heartbeat of a worker.
    pub(super) fn note_heartbeat(&mut self, heartbeat: Heartbeat) -> HeartbeatReaction {
        let identity = WorkerIdentity { id: heartbeat.id.clone(), host: heartbeat.host.clone() };
        if heartbeat.is_leaving {
            let known = self.workers.remove(&heartbeat.id);
            let was_welcome =
                known.is_some_and(|known| matches!(known.state, WorkerState::Active | WorkerState::Stalled));
            let notice = was_welcome.then_some(QueueNotice::Left(identity));
            return HeartbeatReaction { answer: None, notice };
        }
        if !self.workers.contains_key(&heartbeat.id) {
            return self.add(heartbeat, identity);
        }
        let Some(known) = self.workers.get_mut(&heartbeat.id) else { return HeartbeatReaction::default() };
        known.last_seen = Instant::now();
        known.kinds = heartbeat.known_kinds();
        known.heartbeat = heartbeat;
        let reason = known.reason.clone().unwrap_or_default();
        let welcome = ControlMessage::Welcome { server: self.server.clone() };
        // After an interruption, or if the first welcome was lost, the worker waits for another one.
        let answer = known.heartbeat.is_waiting.then_some(welcome);
        match known.state {
            WorkerState::Active => HeartbeatReaction { answer, notice: None },
            WorkerState::Stalled => {
                known.state = WorkerState::Active;
                HeartbeatReaction { answer, notice: Some(QueueNotice::Joined(identity)) }
            }
            WorkerState::Refused => {
                HeartbeatReaction { answer: Some(ControlMessage::Refused { reason }), notice: None }
            }
            WorkerState::Expelled => {
                HeartbeatReaction { answer: Some(ControlMessage::Expelled { reason }), notice: None }
            }
        }
    }

    /// Adds a worker, or refuses it.
    fn add(&mut self, heartbeat: Heartbeat, identity: WorkerIdentity) -> HeartbeatReaction {
        if self.workers.len() >= MAX_WORKERS {
            let reason = format!("the server knows {MAX_WORKERS} workers, which is its limit");
            return HeartbeatReaction { answer: Some(ControlMessage::Refused { reason }), notice: None };
        }
        let (state, reason, answer, notice) = if let Some(reason) = self.expelled_hosts.get(&heartbeat.host) {
            let answer = ControlMessage::Expelled { reason: reason.clone() };
            (WorkerState::Expelled, Some(reason.clone()), answer, None)
        } else if heartbeat.world != self.world {
            let reason = format!(
                "the worker {} on {} computes the worlds {} and the server {} computes {}; install the same version of sparring on both",
                heartbeat.id, heartbeat.host, heartbeat.world, self.server, self.world
            );
            let notice = QueueNotice::Refused(identity, reason.clone());
            let answer = ControlMessage::Refused { reason: reason.clone() };
            (WorkerState::Refused, Some(reason), answer, Some(notice))
        } else {
            let answer = ControlMessage::Welcome { server: self.server.clone() };
            (WorkerState::Active, None, answer, Some(QueueNotice::Joined(identity)))
        };
        let record = WorkerRecord {
            kinds: heartbeat.known_kinds(),
            state,
            reason,
            last_seen: Instant::now(),
            jobs: 0,
            errors: 0,
            verified: 0,
            counted: 0,
            jobs_per_s: 0.0,
            unverified: UnverifiedWork::default(),
            heartbeat,
        };
        self.workers.insert(record.heartbeat.id.clone(), record);
        HeartbeatReaction { answer: Some(answer), notice }
    }

    /// Finds workers that send no heartbeats any more. It is called every `interval`.
    pub(super) fn tick(&mut self, interval: Duration) -> Vec<QueueNotice> {
        let mut notices = Vec::new();
        for record in self.workers.values_mut() {
            let jobs = (record.jobs - record.counted) as f64 / interval.as_secs_f64().max(1e-3);
            record.counted = record.jobs;
            record.jobs_per_s += RATE_WEIGHT * interval.as_secs_f64() * (jobs - record.jobs_per_s);
            if record.state == WorkerState::Active && record.last_seen.elapsed() > STALLED_AFTER {
                record.state = WorkerState::Stalled;
                notices.push(QueueNotice::Stalled(record.identity()));
            }
        }
        self.workers.retain(|_, record| {
            let is_known = record.last_seen.elapsed() < FORGOTTEN_AFTER;
            if !is_known && record.state == WorkerState::Stalled {
                notices.push(QueueNotice::Left(record.identity()));
            }
            is_known
        });
        notices
    }

    /// Marks all workers as stalled: the connection that brings their heartbeats is interrupted.
    pub(super) fn stall_all(&mut self) {
        for record in self.workers.values_mut().filter(|record| record.state == WorkerState::Active) {
            record.state = WorkerState::Stalled;
        }
    }

    /// Number of jobs of a kind that the active workers do at once.
    pub(super) fn slots(&self, kind: JobKind) -> usize {
        let active = self.active().filter(|record| record.kinds.contains(&kind));
        active.map(|record| record.heartbeat.concurrency as usize).sum()
    }

    /// Number of design requests of a kind that the active workers design at once. Each designs one procedurally.
    pub(super) fn design_slots(&self, kind: JobKind) -> usize {
        let active = self.active().filter(|record| record.kinds.contains(&kind));
        match kind {
            JobKind::DesignLlm => active.map(|record| record.heartbeat.llm_designs as usize).sum(),
            _ => active.count(),
        }
    }

    /// Number of calls of language models that the active workers make at once for rollouts.
    pub(super) fn chat_calls(&self) -> usize {
        let active = self.active().filter(|record| record.kinds.contains(&JobKind::RolloutChat));
        active.map(|record| record.heartbeat.chat_calls as usize).sum()
    }

    /// Kinds of jobs that active workers take.
    pub(super) fn served_kinds(&self) -> BTreeSet<JobKind> {
        self.active().flat_map(|record| record.kinds.iter().copied()).collect()
    }

    /// Jobs that active workers hold.
    pub(super) fn active_jobs(&self) -> BTreeSet<JobId> {
        self.active().flat_map(|record| record.heartbeat.active.iter().copied()).collect()
    }

    fn active(&self) -> impl Iterator<Item = &WorkerRecord> {
        self.workers.values().filter(|record| record.state == WorkerState::Active)
    }

    /// True if the results of a worker may be used. A result can arrive before the first heartbeat after a restart of the server.
    pub(super) fn may_work(&self, worker: &str) -> bool {
        self.workers.get(worker).is_none_or(WorkerRecord::is_welcome)
    }

    /// True if the next result of a worker must be verified. That of a worker without a heartbeat is: nothing counts its results.
    pub(super) fn must_verify(&self, worker: &str) -> bool {
        self.workers.get(worker).is_none_or(|record| record.unverified.is_full_of_jobs())
    }

    /// True if a layout of the next design request of a worker must be judged again.
    pub(super) fn must_judge(&self, worker: &str) -> bool {
        self.workers.get(worker).is_none_or(|record| record.unverified.is_full_of_designs())
    }

    /// Counts a result, which may be used. Returns false if the worker was expelled meanwhile: the result may not be used.
    pub(super) fn count_job(&mut self, worker: &str, unverified: UnverifiedJob) -> bool {
        let Some(record) = self.workers.get_mut(worker) else { return true };
        if record.is_welcome() {
            record.jobs += 1;
            record.unverified.jobs.push(unverified);
        }
        record.is_welcome()
    }

    /// Counts layouts, of which `judged` were judged again. Then earlier layouts of the worker count as verified, but no jobs of other
    /// kinds. Returns false if the worker was expelled meanwhile: the layouts may not be used.
    pub(super) fn count_design(&mut self, worker: &str, judged: u64, unverified: UnverifiedDesign) -> bool {
        let Some(record) = self.workers.get_mut(worker) else { return true };
        if record.is_welcome() {
            record.jobs += 1;
            record.verified += judged;
            if judged > 0 {
                record.unverified.designs.clear();
            }
            record.unverified.designs.push(unverified);
        }
        record.is_welcome()
    }

    /// Counts a group that was rolled out.
    pub(super) fn count_rollout(&mut self, worker: &str) {
        if let Some(record) = self.workers.get_mut(worker) {
            record.jobs += 1;
        }
    }

    /// Counts results that were verified: what the worker did before counts as verified too.
    pub(super) fn count_agreement(&mut self, worker: &str, items: u64) {
        if let Some(record) = self.workers.get_mut(worker) {
            record.verified += items;
            record.unverified.jobs.clear();
        }
    }

    /// Counts a job that failed.
    pub(super) fn count_error(&mut self, worker: &str) {
        if let Some(record) = self.workers.get_mut(worker) {
            record.errors += 1;
        }
    }

    /// Expels a worker, and every other worker of its host. `None` if it was expelled before.
    pub(super) fn expel(&mut self, worker: &str, reason: &str) -> Option<ExpelledWorker> {
        let host = self.workers.get(worker).map(|record| record.heartbeat.host.clone());
        let host = host.unwrap_or_else(|| worker.to_owned());
        if self.expelled_hosts.insert(host.clone(), reason.to_owned()).is_some() {
            return None;
        }
        let mut unverified = UnverifiedWork::default();
        for record in self.workers.values_mut().filter(|record| record.heartbeat.host == host) {
            record.state = WorkerState::Expelled;
            record.reason = Some(reason.to_owned());
            record.errors += u64::from(record.heartbeat.id == worker);
            unverified.append(&mut record.unverified);
        }
        Some(ExpelledWorker { identity: WorkerIdentity { id: worker.to_owned(), host }, unverified })
    }

    /// Returns all known workers.
    pub(super) fn list(&self) -> Vec<WorkerStatus> {
        self.workers.values().map(WorkerRecord::status).collect()
    }
}

impl WorkerRecord {
    /// True if the results of the worker may be used.
    const fn is_welcome(&self) -> bool {
        matches!(self.state, WorkerState::Active | WorkerState::Stalled)
    }

    fn identity(&self) -> WorkerIdentity {
        WorkerIdentity { id: self.heartbeat.id.clone(), host: self.heartbeat.host.clone() }
    }

    fn status(&self) -> WorkerStatus {
        let heartbeat = &self.heartbeat;
        WorkerStatus {
            id: heartbeat.id.clone(),
            host: heartbeat.host.clone(),
            version: heartbeat.version.clone(),
            world: heartbeat.world.clone(),
            kinds: self.kinds.clone(),
            concurrency: heartbeat.concurrency,
            chat_model: heartbeat.chat_model.clone(),
            active: u32::try_from(heartbeat.active.len()).unwrap_or(u32::MAX),
            state: self.state,
            reason: self.reason.clone(),
            jobs: self.jobs,
            errors: self.errors,
            jobs_per_s: self.jobs_per_s,
            verified: self.verified,
            last_seen: self.last_seen.elapsed(),
        }
    }
}
