//! `NativeCurriculum`: the curriculum of a run as a Python class.

use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use serde_json::json;

use super::client::CurriculumClient;
use super::error::{curriculum_error, deadline};
use super::fetch::{LeaseRequest, run_fetch};
use super::http_client::HttpClient;
use super::report::run_report;
use super::shared_queue::SharedQueue;
use crate::errors::invalid;

/// A run's curriculum for one trainer, with the threads that lease episodes and submit results.
#[pyclass(frozen, module = "sparring._native")]
pub(crate) struct NativeCurriculum {
    pub(crate) client: Arc<CurriculumClient>,
    threads: Mutex<Vec<JoinHandle<()>>>,
}

#[pymethods]
impl NativeCurriculum {
    /// Starts to lease episodes of a run.
    #[new]
    #[pyo3(signature = (url, run, token, *, columns, groups, fallback_groups, group_size, purpose, evaluation, ttl_s, ahead, buffer, max_wait_s))]
    #[expect(clippy::too_many_arguments, reason = "called in one place, by keywords")]
    fn new(
        url: &str,
        run: String,
        token: Option<String>,
        columns: bool,
        groups: u32,
        fallback_groups: Option<u32>,
        group_size: Option<u32>,
        purpose: String,
        evaluation: Option<String>,
        ttl_s: u32,
        ahead: usize,
        buffer: usize,
        max_wait_s: f64,
    ) -> PyResult<Self> {
        let max_wait = Duration::try_from_secs_f64(max_wait_s)
            .map_err(|_| invalid("max_wait_s", "a number of seconds >= 0", max_wait_s))?;
        let ttl = Duration::from_secs(u64::from(ttl_s));
        let client = CurriculumClient {
            shared: SharedQueue::default(),
            http: HttpClient::new(url, token).map_err(PyValueError::new_err)?,
            lease_request: LeaseRequest {
                run,
                columns,
                groups,
                fallback_groups,
                group_size,
                purpose,
                evaluation,
                ttl,
            },
            max_wait,
            max_unsent: buffer,
        };
        client.shared.lock().target = ahead.max(1);
        let client = Arc::new(client);
        let spawn = |name: &str, work: fn(&CurriculumClient)| {
            let client = Arc::clone(&client);
            std::thread::Builder::new().name(name.to_owned()).spawn(move || work(&client))
        };
        let threads = [
            spawn("sparring-fetch", |client| run_fetch(&client.shared, &client.http, &client.lease_request)),
            spawn("sparring-report", |client| {
                run_report(&client.shared, &client.http, &client.lease_request.run);
            }),
        ];
        let threads = threads.into_iter().collect::<Result<Vec<_>, _>>()?;
        Ok(Self { client, threads: Mutex::new(threads) })
    }

    /// Policy version of the episodes that begin from now on.
    #[getter]
    fn policy_version(&self, py: Python<'_>) -> u32 {
        py.detach(|| self.client.shared.lock().policy_version)
    }

    #[setter]
    fn set_policy_version(&self, py: Python<'_>, version: u32) {
        py.detach(|| self.client.shared.lock().policy_version = version);
    }

    /// Returns counts of episodes by outcome, and the state of the queue, as JSON.
    fn stats(&self, py: Python<'_>) -> String {
        py.detach(|| {
            let queue = self.client.shared.lock();
            let mut stats = serde_json::to_value(&queue.counts).unwrap_or_default();
            stats["ready"] = json!(queue.ready());
            stats["unclaimed"] = json!(queue.unclaimed());
            stats["unsent"] = json!(queue.unsent);
            let outage_s = queue.outage.as_ref().map(|outage| outage.since.elapsed().as_secs_f64());
            stats["unreachable_s"] = json!(outage_s);
            stats["paused"] = json!(queue.paused.is_some());
            stats["error"] = json!(queue.error);
            stats.to_string()
        })
    }

    /// Waits until the results of all complete leases are submitted.
    fn flush(&self, py: Python<'_>, timeout_s: f64) -> PyResult<()> {
        let until = deadline("timeout_s", timeout_s)?;
        py.detach(|| {
            let mut queue = self.client.shared.lock();
            while queue.outbox.iter().any(|submission| submission.episodes() > 0) || queue.is_sending {
                if queue.error.is_some() {
                    break;
                }
                if Instant::now() >= until || queue.server_exit.is_some() {
                    let (unsent, reason) = (queue.unsent, queue.stall_reason());
                    return Err(curriculum_error(format!(
                        "{unsent} episodes wait to be submitted; {reason}"
                    )));
                }
                queue = self.client.wait_for_change(queue)?;
            }
            queue.failure().map_or(Ok(()), |failure| Err(curriculum_error(failure)))
        })
    }

    /// Records that the server of this process has ended: callers stop waiting for it, unless it answers again.
    fn server_exited(&self, py: Python<'_>, reason: String) {
        py.detach(|| {
            self.client.shared.lock().server_exit = Some(reason);
            self.client.shared.notify();
        });
    }

    /// Submits all results, releases unfinished episodes and ends the threads.
    ///
    /// Raises `CurriculumError` if results could not be submitted in time or were refused. After an interrupt it can be
    /// called again.
    fn close(&self, py: Python<'_>, timeout_s: f64) -> PyResult<()> {
        let until = deadline("timeout_s", timeout_s)?;
        py.detach(|| {
            let shared = &self.client.shared;
            let mut queue = shared.lock();
            if !queue.is_closing {
                queue.is_closing = true;
                queue.release_unfinished();
            }
            shared.notify();
            while !queue.is_drained && queue.server_exit.is_none() && Instant::now() < until {
                queue = self.client.wait_for_change(queue)?;
            }
            let is_drained = queue.is_drained;
            let (lost, failure, reason) = (queue.drop_unsent(), queue.failure(), queue.stall_reason());
            queue.error = None;
            drop(queue);
            let threads = std::mem::take(&mut *self.threads.lock().unwrap_or_else(PoisonError::into_inner));
            if is_drained {
                for thread in threads {
                    let _ = thread.join();
                }
            }
            match (lost, failure) {
                (0, None) => Ok(()),
                (0, Some(failure)) => Err(curriculum_error(failure)),
                (lost, _) => {
                    let message = format!("{lost} finished episodes could not be submitted; {reason}");
                    Err(curriculum_error(message))
                }
            }
        })
    }
}
