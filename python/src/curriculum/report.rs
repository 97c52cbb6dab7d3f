//! Thread that submits results and renews leases.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use env_core::batch::episode_assigner::RecordedActions;
use env_core::log::JointAction;
use serde_json::{Value, json};

use super::episode_queue::{ColumnLease, EpisodeCounts, EpisodeResult, Submission};
use super::http_client::{HttpClient, RETRY_DELAY, RequestError};
use super::lease::Lease;
use super::shared_queue::SharedQueue;

/// Interval at which the idle report thread checks the queue even without a notification.
const REPORT_CHECK_INTERVAL: Duration = Duration::from_secs(1);
/// Problem type of a lease that ended before its results arrived.
const LEASE_CLOSED: &str = "lease_closed";
/// Maximum number of results in one request.
const MAX_BATCH_RESULTS: usize = 256;
/// Maximum number of action values in one request, unless a single episode has more.
const MAX_BATCH_VALUES: usize = 400_000;

/// Submits results until the curriculum is closed and everything is sent.
pub(super) fn run_report(shared: &SharedQueue, client: &HttpClient, run: &str) {
    let api = RunApi { shared, client, run };
    let mut renewed = Instant::now();
    while let Some(submissions) = wait_for_submissions(shared, renewed) {
        let active = shared.lock().active_leases();
        if renewed.elapsed() >= renewal_interval(&active) {
            renewed = Instant::now();
            for lease in active {
                // A lease that cannot be renewed expires; its results are then reported as late.
                let _ = client.post(&format!("/v1/runs/{run}/leases/{}/renew", lease.id), &json!({}));
            }
        }
        if !submissions.is_empty() {
            let outcome = api.submit(&submissions);
            record_outcome(shared, &submissions, outcome);
        }
    }
}

/// Waits for something to send or to renew; `None` if the curriculum is closed and everything is sent.
fn wait_for_submissions(shared: &SharedQueue, renewed: Instant) -> Option<Vec<Submission>> {
    let mut queue = shared.lock();
    while queue.outbox.is_empty()
        && (!queue.is_closing || queue.is_fetching)
        && renewed.elapsed() < renewal_interval(&queue.active_leases())
    {
        queue = shared.wait(queue, REPORT_CHECK_INTERVAL);
    }
    if queue.outbox.is_empty() && queue.is_closing && !queue.is_fetching {
        queue.is_drained = true;
        shared.notify();
        return None;
    }
    let submissions = take_batch(&mut queue.outbox);
    queue.is_sending = !submissions.is_empty();
    Some(submissions)
}

/// Half of the shortest time to live of any lease.
fn renewal_interval(active: &[Arc<Lease>]) -> Duration {
    active.iter().map(|lease| lease.ttl / 2).min().unwrap_or(Duration::MAX)
}

/// Takes the submissions of the next request: several results, or one claim or release.
fn take_batch(outbox: &mut VecDeque<Submission>) -> Vec<Submission> {
    let (mut batch, mut values) = (Vec::new(), 0);
    while let Some(submission) = outbox.front() {
        let len = match submission {
            Submission::Result { actions, .. } => actions.len(),
            Submission::Columns(_) | Submission::Release(_) if batch.is_empty() => {
                return outbox.pop_front().into_iter().collect();
            }
            Submission::Columns(_) | Submission::Release(_) => break,
        };
        if batch.len() == MAX_BATCH_RESULTS || (values > 0 && values + len > MAX_BATCH_VALUES) {
            break;
        }
        values += len;
        batch.extend(outbox.pop_front());
    }
    batch
}

/// Updates the queue after a request.
fn record_outcome(
    shared: &SharedQueue,
    submissions: &[Submission],
    outcome: Result<Option<String>, SubmitError>,
) {
    let count: usize = submissions.iter().map(Submission::episodes).sum();
    let mut queue = shared.lock();
    queue.is_sending = false;
    queue.unsent = queue.unsent.saturating_sub(count);
    for submission in submissions {
        if let Submission::Result { episode, .. } = submission {
            queue.mark_reported(&episode.lease);
        }
    }
    if queue.is_abandoned && !matches!(outcome, Err(SubmitError::Abandoned(_))) {
        // The caller closed the curriculum without these results, but they were submitted later.
        queue.counts.lost = queue.counts.lost.saturating_sub(count as u64);
    }
    match outcome {
        Ok(None) => {}
        // Results of an ended lease of groups have a status each; an ended lease of columns is late as a whole.
        Err(SubmitError::Late) => queue.counts.late += count as u64,
        Err(SubmitError::Refused(message)) => {
            queue.counts.refused += count as u64;
            queue.error = Some(message);
        }
        Ok(Some(message)) | Err(SubmitError::Abandoned(message)) => queue.error = Some(message),
    }
    shared.notify();
}

/// Reason why a submission failed.
enum SubmitError {
    /// The lease had ended.
    Late,
    /// The server refused all of it, with a message.
    Refused(String),
    /// The curriculum was closed before the server answered; the message says why it did not.
    Abandoned(String),
}

/// The server's response to a batch of results.
struct ResultsSummary {
    /// Number of results with each status.
    statuses: BTreeMap<String, u64>,
    /// Message of the first refused result.
    refused: Option<String>,
}

/// The endpoints of one run.
struct RunApi<'a> {
    shared: &'a SharedQueue,
    client: &'a HttpClient,
    run: &'a str,
}

impl RunApi<'_> {
    /// Sends a batch and repeats it until the server answers or the curriculum is abandoned.
    ///
    /// Returns a message if the server refused some of the results.
    ///
    /// # Errors
    /// [`SubmitError`] if the server accepted none of it.
    fn submit(&self, submissions: &[Submission]) -> Result<Option<String>, SubmitError> {
        match submissions {
            [Submission::Columns(columns)] => self.claim(columns).map(|()| None),
            [Submission::Release(lease)] => {
                let path = format!("/v1/runs/{}/leases/{}/release", self.run, lease.id);
                self.retry(|| self.client.post(&path, &json!({}))).map(|_| None)
            }
            _ => {
                let results = submissions.iter().filter_map(|submission| match submission {
                    Submission::Result { episode, actions, policy_version } => Some(json!({
                        "episode": episode.id(),
                        "actions": action_log(actions),
                        "policy_version": policy_version,
                    })),
                    _ => None,
                });
                let summary = self.report_results(&results.collect::<Vec<_>>())?;
                add_statuses(&mut self.shared.lock().counts, &summary.statuses);
                Ok(summary.refused)
            }
        }
    }

    /// Repeats a request until the server answers or rejects it.
    fn retry(&self, send: impl Fn() -> Result<Value, RequestError>) -> Result<Value, SubmitError> {
        loop {
            match send() {
                Ok(response) => {
                    self.shared.lock().end_outage();
                    return Ok(response);
                }
                Err(RequestError::Rejected { kind: Some(kind), .. }) if kind == LEASE_CLOSED => {
                    return Err(SubmitError::Late);
                }
                Err(RequestError::Rejected { status, message, .. }) => {
                    let message = format!("the server refuses finished episodes ({status}): {message}");
                    return Err(SubmitError::Refused(message));
                }
                Err(RequestError::Unavailable { message, retry_after, .. }) => {
                    self.wait_for_server(message, retry_after)?;
                }
            }
        }
    }

    /// Waits before a repeated request.
    fn wait_for_server(&self, reason: String, retry_after: Option<Duration>) -> Result<(), SubmitError> {
        let is_closing = {
            let mut queue = self.shared.lock();
            if queue.is_abandoned {
                let message = format!("finished episodes could not be submitted: {reason}");
                return Err(SubmitError::Abandoned(message));
            }
            queue.begin_outage(reason);
            queue.is_closing
        };
        self.shared.notify();
        if is_closing {
            std::thread::sleep(RETRY_DELAY / 5);
        } else {
            self.shared.pause(retry_after.unwrap_or(RETRY_DELAY));
        }
        Ok(())
    }

    /// Reports results with action logs.
    fn report_results(&self, results: &[Value]) -> Result<ResultsSummary, SubmitError> {
        let path = format!("/v1/runs/{}/results", self.run);
        let body = json!({ "results": results });
        let response = self.retry(|| self.client.post(&path, &body))?;
        let mut summary = ResultsSummary { statuses: BTreeMap::new(), refused: None };
        for result in response["results"].as_array().into_iter().flatten() {
            let status = result["status"].as_str().unwrap_or_default();
            *summary.statuses.entry(status.to_owned()).or_default() += 1;
            if matches!(status, "refused" | "conflict") {
                let detail = result["detail"].as_str().unwrap_or(status);
                let message = || format!("the server refuses a finished episode: {detail}");
                summary.refused.get_or_insert_with(message);
            }
        }
        Ok(summary)
    }

    /// Claims a lease of columns and reports the episodes that the server audits.
    fn claim(&self, columns: &ColumnLease) -> Result<(), SubmitError> {
        let path = format!("/v1/runs/{}/leases/{}/columns", self.run, columns.lease.id);
        let body = claim_body(columns);
        let claim = self.retry(|| self.client.post(&path, &body))?;
        let mut audited = audited_episodes(columns, &claim).into_iter().peekable();
        while audited.peek().is_some() {
            let (mut batch, mut values) = (Vec::new(), 0);
            while let Some((id, actions)) = audited.next_if(|(_, actions)| {
                batch.len() < MAX_BATCH_RESULTS && (values == 0 || values + actions.len() <= MAX_BATCH_VALUES)
            }) {
                values += actions.len();
                batch.push(json!({"episode": id, "actions": action_log(actions)}));
            }
            if let Some(message) = self.report_results(&batch)?.refused {
                return Err(SubmitError::Refused(message));
            }
        }
        let state = self.retry(|| self.client.get(&path))?;
        let episodes = columns.results.iter().flatten().count() as u64;
        let counts = &mut self.shared.lock().counts;
        match state["state"].as_str() {
            Some("accepted") => counts.accepted += episodes,
            Some("refused") => counts.refused += episodes,
            _ => counts.unproven += episodes,
        }
        Ok(())
    }
}

fn claim_body(columns: &ColumnLease) -> Value {
    let results = columns.results.iter().map(Option::as_ref);
    let scores = results.clone().map(|result| result.map_or(0.0, |result| result.score));
    let steps = results.clone().map(|result| result.map_or(0, |result| result.actions.steps() as u64));
    let failed = results.map(|result| u8::from(result.is_none()));
    json!({
        "score": scores.collect::<Vec<f64>>(),
        "steps": steps.collect::<Vec<u64>>(),
        "failed": failed.collect::<Vec<u8>>(),
        "policy_version": columns.policy_version,
    })
}

/// Ids and actions of the episodes that the server audits, by its response to a claim.
fn audited_episodes<'a>(columns: &'a ColumnLease, claim: &Value) -> Vec<(String, &'a RecordedActions)> {
    let mut audited = Vec::new();
    for group in claim["audited_groups"].as_array().into_iter().flatten() {
        let entries = group["entries"].as_array().into_iter().flatten().filter_map(Value::as_u64);
        let ids = group["episodes"].as_array().into_iter().flatten().filter_map(Value::as_str);
        for (entry, id) in entries.zip(ids) {
            let result = usize::try_from(entry).ok().and_then(|entry| columns.results.get(entry)?.as_ref());
            if let Some(EpisodeResult { actions, .. }) = result {
                audited.push((id.to_owned(), actions));
            }
        }
    }
    audited
}

/// Action log as JSON, without entries of agents that hold.
fn action_log(actions: &RecordedActions) -> Value {
    let log = actions.to_log();
    let step = |step: JointAction<'_>| -> Vec<Value> {
        let entries = step.agents.iter().zip(step.values.chunks_exact(log.dim().max(1)));
        entries
            .map(|(agent, values)| {
                let values = values.iter().map(|value| json!(value));
                Value::Array(std::iter::once(json!(agent)).chain(values).collect())
            })
            .collect()
    };
    json!({"steps": log.steps().map(step).collect::<Vec<_>>(), "precision": "f32"})
}

fn add_statuses(counts: &mut EpisodeCounts, statuses: &BTreeMap<String, u64>) {
    for (status, count) in statuses {
        match status.as_str() {
            "counted" => counts.counted += count,
            "stored" => counts.stored += count,
            "duplicate" => counts.duplicate += count,
            "late" => counts.late += count,
            "refused" | "conflict" => counts.refused += count,
            _ => {}
        }
    }
}
