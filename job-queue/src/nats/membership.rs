//! Heartbeats of workers, and the answers of servers. Their form is the same in all versions, so that every server can refuse every
//! worker with a reason.

use jobs::JobKind;
use jobs::envelope::JobId;
use serde::{Deserialize, Serialize};

/// State of a worker, which it publishes every second.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Heartbeat {
    /// Id of the worker process.
    pub(crate) id: String,
    /// Name of the worker's host, or the name that its operator gave it.
    pub(crate) host: String,
    /// Version of the program.
    pub(crate) version: String,
    /// World version of the program.
    pub(crate) world: String,
    /// Kinds of jobs that the worker takes; those of rollouts name its policies. A server ignores kinds that it does not know.
    pub(crate) kinds: Vec<String>,
    /// Number of jobs that it does at once.
    pub(crate) concurrency: u32,
    /// Number of calls of its language model that it makes at once; 0 if it rolls out no chat policy.
    #[serde(default)]
    pub(crate) chat_calls: u32,
    /// Name of this language model, at most 200 characters.
    #[serde(default)]
    pub(crate) chat_model: Option<String>,
    /// Number of design requests to its language model that it runs at once; 0 if it has none for designs.
    #[serde(default)]
    pub(crate) llm_designs: u32,
    /// Jobs that it holds.
    #[serde(default)]
    pub(crate) active: Vec<JobId>,
    /// True if the worker takes no jobs yet, and waits for a welcome.
    #[serde(default)]
    pub(crate) is_waiting: bool,
    /// True if the worker ends.
    #[serde(default)]
    pub(crate) is_leaving: bool,
}

impl Heartbeat {
    /// Kinds of jobs that this program knows.
    pub(crate) fn known_kinds(&self) -> Vec<JobKind> {
        self.kinds.iter().filter_map(|kind| kind.parse().ok()).collect()
    }
}

/// Answer of a server to a heartbeat.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum ControlMessage {
    /// The worker may take jobs of this server.
    Welcome {
        /// Name of the server.
        server: String,
    },
    /// The worker may not take jobs, for this reason.
    Refused {
        /// What differs, and how to fix it.
        reason: String,
    },
    /// The worker may not take jobs any more, because a result of it was wrong.
    Expelled {
        /// The result that was wrong.
        reason: String,
    },
}

/// Writes a message with the names of its fields.
pub(crate) fn write<T: Serialize>(message: &T) -> Vec<u8> {
    // The types above have no value that MessagePack cannot express.
    rmp_serde::to_vec_named(message).unwrap_or_default()
}

/// Reads a message; `None` if it is malformed.
pub(crate) fn read<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> Option<T> {
    rmp_serde::from_slice(bytes).ok()
}
