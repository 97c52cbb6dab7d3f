//! Thread that leases episodes ahead.

use std::time::Duration;

use serde_json::{Value, json};

use super::episode_queue::EpisodeQueue;
use super::http_client::{HttpClient, RETRY_DELAY, RequestError};
use super::lease::{LeaseEpisodes, UnbegunGroups};
use super::shared_queue::SharedQueue;

/// Interval at which the idle fetch thread checks the queue even without a notification.
const FETCH_CHECK_INTERVAL: Duration = Duration::from_secs(5);

/// Parameters of all lease requests of a curriculum.
#[derive(Debug, Clone)]
pub(super) struct LeaseRequest {
    pub(super) run: String,
    pub(super) columns: bool,
    /// Number of groups per lease.
    pub(super) groups: u32,
    /// Groups per lease of groups, requested once the run's strategy rejects columns; `None` treats that as an error.
    pub(super) fallback_groups: Option<u32>,
    pub(super) group_size: Option<u32>,
    pub(super) purpose: String,
    pub(super) evaluation: Option<String>,
    pub(super) ttl: Duration,
}

impl LeaseRequest {
    fn body(&self, policy_version: u32) -> Value {
        let mut body = json!({
            "groups": self.groups,
            "policy_version": policy_version,
            "ttl_s": self.ttl.as_secs(),
            "purpose": self.purpose,
            "form": if self.columns { "columns" } else { "groups" },
        });
        if !self.columns && self.purpose != "eval" {
            // Groups that are never begun return to the run without loss.
            body["disclosure"] = "begin".into();
        }
        if let Some(size) = self.group_size {
            body["group_size"] = size.into();
        }
        if let Some(evaluation) = &self.evaluation {
            body["evaluation"] = evaluation.as_str().into();
        }
        body
    }

    fn send(&self, client: &HttpClient, policy_version: u32) -> Result<LeaseEpisodes, RequestError> {
        let response = client.post(&format!("/v1/runs/{}/leases", self.run), &self.body(policy_version))?;
        LeaseEpisodes::read(response, self.ttl, self.purpose == "eval").map_err(unreadable)
    }
}

/// Error of a response that this version cannot read.
fn unreadable(message: String) -> RequestError {
    RequestError::Rejected { status: 201, field: None, kind: None, message }
}

/// Request that the queue needs.
enum Demand {
    /// A lease for this policy version.
    Lease(u32),
    /// The scenarios of groups of a lease.
    Begin(UnbegunGroups),
}

/// Keeps episodes ready until the curriculum is closed.
pub(super) fn run_fetch(shared: &SharedQueue, client: &HttpClient, request: &LeaseRequest) {
    let mut request = request.clone();
    while let Some(demand) = wait_for_demand(shared) {
        let delay = match demand {
            Demand::Lease(policy_version) => {
                let response = request.send(client, policy_version);
                handle_response(shared, &mut request, response)
            }
            Demand::Begin(unbegun) => {
                let path = format!("/v1/runs/{}/leases/{}/groups/begin", request.run, unbegun.lease);
                let response = client.post(&path, &json!({"groups": unbegun.groups}));
                handle_begun(shared, &unbegun, response)
            }
        };
        if let Some(delay) = delay {
            shared.pause(delay);
        }
    }
}

/// Waits until episodes are needed; returns the request for them, or `None` if the curriculum is closed.
fn wait_for_demand(shared: &SharedQueue) -> Option<Demand> {
    let mut queue = shared.lock();
    loop {
        if queue.is_closing {
            return None;
        }
        if let Some(demand) = current_demand(&queue) {
            queue.is_fetching = true;
            return Some(demand);
        }
        queue = shared.wait(queue, FETCH_CHECK_INTERVAL);
    }
}

/// Request that the queue needs now.
fn current_demand(queue: &EpisodeQueue) -> Option<Demand> {
    if queue.error.is_some() {
        return None;
    }
    let begun = queue.next_unbegun().map(Demand::Begin);
    let needs_lease = !queue.is_exhausted && queue.ready() + queue.undisclosed() < queue.target;
    begun.or_else(|| needs_lease.then_some(Demand::Lease(queue.policy_version)))
}

/// Adds the scenarios of groups that were begun, or records the error; returns how long to wait before the next request.
fn handle_begun(
    shared: &SharedQueue,
    unbegun: &UnbegunGroups,
    response: Result<Value, RequestError>,
) -> Option<Duration> {
    let mut queue = shared.lock();
    queue.is_fetching = false;
    shared.notify();
    match response {
        Ok(response) => {
            queue.end_outage();
            queue.paused = None;
            if let Err(message) = queue.add_begun(unbegun, response) {
                queue.error = Some(message);
            }
        }
        // The lease has ended: the server offers its groups again.
        Err(RequestError::Rejected { status: 404 | 409, kind, .. }) if kind.as_deref() != Some("paused") => {
            queue.end_outage();
            queue.drop_unbegun(&unbegun.lease);
        }
        Err(RequestError::Rejected { status: 409, message, .. }) => {
            return Some(wait_for_resume(&mut queue, message));
        }
        Err(RequestError::Rejected { status, message, .. }) => {
            queue.error = Some(format!("the server refuses to disclose scenarios ({status}): {message}"));
        }
        Err(RequestError::Unavailable { message, retry_after, .. }) => {
            return Some(wait_for_server(&mut queue, message, retry_after));
        }
    }
    None
}

/// Records that the run is paused; it may resume.
fn wait_for_resume(queue: &mut EpisodeQueue, message: String) -> Duration {
    queue.end_outage();
    queue.paused = Some(message);
    RETRY_DELAY
}

/// Records that the server does not answer. Whether the run is paused is unknown during an outage.
fn wait_for_server(queue: &mut EpisodeQueue, message: String, retry_after: Option<Duration>) -> Duration {
    queue.paused = None;
    queue.begin_outage(message);
    retry_after.unwrap_or(RETRY_DELAY)
}

/// Adds the leased episodes, or records the error; returns how long to wait before the next request.
fn handle_response(
    shared: &SharedQueue,
    request: &mut LeaseRequest,
    response: Result<LeaseEpisodes, RequestError>,
) -> Option<Duration> {
    let mut queue = shared.lock();
    queue.is_fetching = false;
    shared.notify(); // a caller that closes the curriculum waits for this
    match response {
        Ok(episodes) if episodes.lease.episodes == 0 => queue.is_exhausted = true,
        Ok(episodes) => {
            queue.end_outage();
            queue.paused = None;
            queue.add(episodes);
            if queue.is_closing {
                // The lease arrived too late to be used and is released with the others.
                queue.release_unfinished();
            }
        }
        // A paused run may resume.
        Err(RequestError::Rejected { status: 409, message, .. }) => {
            return Some(wait_for_resume(&mut queue, message));
        }
        // The strategy of a run may change to one that rejects columns.
        Err(RequestError::Rejected { field: Some(field), .. })
            if field == "form"
                && request.columns
                && let Some(groups) = request.fallback_groups =>
        {
            (request.columns, request.groups) = (false, groups);
        }
        // All scenarios of the evaluation are leased, here or by another client.
        Err(RequestError::Rejected { field: Some(field), .. })
            if field == "evaluation" && queue.counts.leases > 0 =>
        {
            queue.is_exhausted = true;
        }
        Err(RequestError::Rejected { status, message, .. }) => {
            queue.error = Some(format!("the server refuses leases ({status}): {message}"));
        }
        Err(RequestError::Unavailable { message, retry_after, .. }) => {
            return Some(wait_for_server(&mut queue, message, retry_after));
        }
    }
    None
}
