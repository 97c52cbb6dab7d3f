//! Thread that leases episodes ahead.

use std::time::Duration;

use serde_json::{Value, json};

use super::episode_queue::SharedQueue;
use super::http_client::{HttpClient, RETRY_DELAY, RequestError};
use super::lease::LeaseEpisodes;

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
        let episodes = LeaseEpisodes::read(response, self.ttl, self.purpose == "eval");
        episodes.map_err(|message| RequestError::Rejected { status: 201, field: None, kind: None, message })
    }
}

/// Keeps episodes ready until the curriculum is closed.
pub(super) fn run_fetch(shared: &SharedQueue, client: &HttpClient, request: &LeaseRequest) {
    let mut request = request.clone();
    while let Some(policy_version) = wait_for_demand(shared) {
        let response = request.send(client, policy_version);
        let delay = handle_response(shared, &mut request, response);
        if let Some(delay) = delay {
            shared.pause(delay);
        }
    }
}

/// Waits until episodes are needed; returns the policy version, or `None` if the curriculum is closed.
fn wait_for_demand(shared: &SharedQueue) -> Option<u32> {
    let mut queue = shared.lock();
    while !queue.is_closing && (queue.ready() >= queue.target || queue.error.is_some() || queue.is_exhausted)
    {
        queue = shared.wait(queue, FETCH_CHECK_INTERVAL);
    }
    if queue.is_closing {
        return None;
    }
    queue.is_fetching = true;
    Some(queue.policy_version)
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
        Ok(episodes) if episodes.left == 0 => queue.is_exhausted = true,
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
            queue.end_outage();
            queue.paused = Some(message);
            return Some(RETRY_DELAY);
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
            queue.paused = None; // unknown during an outage
            queue.begin_outage(message);
            return Some(retry_after.unwrap_or(RETRY_DELAY));
        }
    }
    None
}
