//! Messages that carry jobs and results between processes.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::kind::JobKind;
use crate::wire::{WireBytes, WireError, from_bytes, to_bytes};
use crate::world_version::FORMAT;

/// Largest message of NATS, in bytes. JetStream itself refuses messages above 1 MiB. Larger jobs and results go to its object store.
pub const MAX_MESSAGE_BYTES: usize = 512 * 1024;
/// Largest job or result, in bytes.
pub const MAX_ENVELOPE_BYTES: usize = 16 << 20;

/// Id of a job: the start of the server that published it, and a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct JobId {
    /// Number of the server's start, which grows from start to start.
    pub epoch: u64,
    /// Number of the job since that start.
    pub number: u64,
}

impl fmt::Display for JobId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:x}.{}", self.epoch, self.number)
    }
}

/// Fencing token of a job: it changes when the server takes a job back. A result with another token is ignored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct FencingToken(pub u64);

/// A job on its way to a worker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JobEnvelope {
    format: u16,
    /// World version of the server.
    pub world: String,
    /// Name of the server, to which the result is sent.
    pub server: String,
    /// Kind of the job.
    pub kind: JobKind,
    /// Id of the job.
    pub id: JobId,
    /// Token that the result must carry.
    pub token: FencingToken,
    body: WireBytes,
}

/// A result on its way to the server.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ResultEnvelope {
    format: u16,
    /// Id of the job.
    pub id: JobId,
    /// Token of the job.
    pub token: FencingToken,
    /// Id of the worker.
    pub worker: String,
    /// Result of the job.
    pub reply: JobReply,
}

/// Reply of a worker to a job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum JobReply {
    /// The job was done.
    Done {
        /// The result: an encoded [`JobOutput`](crate::JobOutput), the layouts of a design, or the group of a rollout.
        body: ReplyBody,
        /// Time that the worker computed, µs.
        micros: u64,
    },
    /// The job cannot be done by any worker, for this reason; the server does it itself.
    Failed(String),
    /// This worker may not do the job, for this reason, for example its world version.
    Refused(String),
    /// The policy of the job has a newer version.
    Superseded,
}

/// Encoded result of a job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ReplyBody(WireBytes);

impl ReplyBody {
    /// Wraps an encoded result.
    #[must_use]
    pub const fn new(bytes: Vec<u8>) -> Self {
        Self(WireBytes(bytes))
    }

    /// Returns the encoded result.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.0.0
    }
}

/// Reason why a message cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum EnvelopeError {
    /// The message cannot be decoded or encoded.
    #[error(transparent)]
    Wire(#[from] WireError),
    /// The message has another format.
    #[error(
        "the message has format {got}, this program has format {FORMAT}; use the same version everywhere"
    )]
    Format {
        /// Format of the message.
        got: u16,
    },
    /// The message is too large.
    #[error("the message has {bytes} bytes, and at most {MAX_ENVELOPE_BYTES} are allowed")]
    TooLarge {
        /// Size of the message.
        bytes: usize,
    },
}

/// Address of a job: the fields that travel with its payload.
#[derive(Debug, Clone, Copy)]
pub struct JobAddress<'a> {
    /// World version of the server.
    pub world: &'a str,
    /// Name of the server.
    pub server: &'a str,
    /// Kind of the job.
    pub kind: JobKind,
    /// Id of the job.
    pub id: JobId,
    /// Token of the job.
    pub token: FencingToken,
}

impl JobEnvelope {
    /// Writes a job with an encoded payload.
    ///
    /// # Errors
    /// Returns [`EnvelopeError::TooLarge`] if the message is above the bound.
    pub fn write(address: JobAddress<'_>, body: Vec<u8>) -> Result<Vec<u8>, EnvelopeError> {
        let JobAddress { world, server, kind, id, token } = address;
        let (world, server) = (world.to_owned(), server.to_owned());
        bounded(to_bytes(&Self { format: FORMAT, world, server, kind, id, token, body: WireBytes(body) })?)
    }

    /// Reads a job.
    ///
    /// # Errors
    /// Returns [`EnvelopeError`] if the message is invalid or of another format.
    pub fn read(bytes: &[u8]) -> Result<Self, EnvelopeError> {
        let envelope: Self = from_bytes(bytes)?;
        check_format(envelope.format)?;
        Ok(envelope)
    }

    /// Returns the encoded payload.
    #[must_use]
    pub fn body(&self) -> &[u8] {
        &self.body.0
    }
}

impl ResultEnvelope {
    /// Writes a result.
    ///
    /// # Errors
    /// Returns [`EnvelopeError::TooLarge`] if the message is above the bound.
    pub fn write(job: &JobEnvelope, worker: &str, reply: JobReply) -> Result<Vec<u8>, EnvelopeError> {
        let (id, token, worker) = (job.id, job.token, worker.to_owned());
        bounded(to_bytes(&Self { format: FORMAT, id, token, worker, reply })?)
    }

    /// Reads a result.
    ///
    /// # Errors
    /// Returns [`EnvelopeError`] if the message is invalid or of another format.
    pub fn read(bytes: &[u8]) -> Result<Self, EnvelopeError> {
        let envelope: Self = from_bytes(bytes)?;
        check_format(envelope.format)?;
        Ok(envelope)
    }
}

fn check_format(got: u16) -> Result<(), EnvelopeError> {
    if got == FORMAT { Ok(()) } else { Err(EnvelopeError::Format { got }) }
}

fn bounded(message: Vec<u8>) -> Result<Vec<u8>, EnvelopeError> {
    if message.len() <= MAX_ENVELOPE_BYTES {
        Ok(message)
    } else {
        Err(EnvelopeError::TooLarge { bytes: message.len() })
    }
}
