//! Jobs of every kind: running them, and their compact form.

use crate::audit::{AuditOutput, AuditPayload};
use crate::critique::{self, CritiqueOutput};
use crate::episode_batch::EpisodeBatch;
use crate::kind::JobKind;
use crate::prepare::DrawContext;
use crate::prepare::job::{PrepareOutput, PreparePayload};
use crate::prepare::unsolvable::{IsWanted, UnsolvableParams};
use crate::wire::WireError;

/// Payload of a job.
#[derive(Debug, Clone)]
pub enum JobPayload {
    /// Proposals that need scenarios.
    Prepare(PreparePayload),
    /// Episodes to replay, or scenarios without a bracket.
    Audit(AuditPayload),
    /// Episodes that are to be criticised.
    Critique(EpisodeBatch),
}

/// Result of a job.
#[derive(Debug, Clone, PartialEq)]
pub enum JobOutput {
    /// Scenarios of the proposals.
    Prepare(PrepareOutput),
    /// Replayed episodes, or brackets.
    Audit(AuditOutput),
    /// Findings of the critiques.
    Critique(CritiqueOutput),
}

/// Shared state of the jobs of a process.
#[derive(Clone, Copy)]
pub struct JobContext<'a> {
    /// Params under which no scenario is solvable.
    pub unsolvable: &'a UnsolvableParams,
    /// Returns false once the result is not wanted any more.
    pub is_wanted: IsWanted<'a>,
}

impl JobPayload {
    /// Kind of the job.
    #[must_use]
    pub const fn kind(&self) -> JobKind {
        match self {
            Self::Prepare(_) => JobKind::Prepare,
            Self::Audit(_) => JobKind::Audit,
            Self::Critique(_) => JobKind::Critique,
        }
    }

    /// Number of results, one for each item.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Prepare(payload) => payload.0.len(),
            Self::Audit(payload) => payload.len(),
            Self::Critique(batch) => batch.0.len(),
        }
    }

    /// True if there is nothing to do.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Id of the task of the first item, by which the cost of jobs is estimated.
    #[must_use]
    pub fn task(&self) -> &str {
        let task = match self {
            Self::Prepare(payload) => payload.0.first().map(|pending| pending.proposal.task.as_str()),
            Self::Audit(AuditPayload::Brackets(scenarios)) => {
                scenarios.first().map(|scenario| scenario.task().id())
            }
            Self::Audit(AuditPayload::Replays(batch)) | Self::Critique(batch) => {
                batch.0.first().map(|episode| episode.scenario.task().id())
            }
        };
        task.unwrap_or_default()
    }

    /// Does the job. The result depends on the payload alone.
    #[must_use]
    pub fn run(&self, context: JobContext<'_>) -> JobOutput {
        match self {
            Self::Prepare(payload) => {
                let JobContext { unsolvable, is_wanted } = context;
                JobOutput::Prepare(payload.run(DrawContext { unsolvable, is_wanted }))
            }
            Self::Audit(payload) => JobOutput::Audit(payload.run()),
            Self::Critique(batch) => JobOutput::Critique(critique::criticise(batch)),
        }
    }

    /// Splits the job into jobs of at most `items` items, in order.
    #[must_use]
    pub fn split(self, items: usize) -> Vec<Self> {
        let items = items.max(1);
        if self.len() <= items {
            return vec![self];
        }
        match self {
            Self::Prepare(payload) => parts(payload.0, items, |part| Self::Prepare(PreparePayload(part))),
            Self::Audit(AuditPayload::Brackets(scenarios)) => {
                parts(scenarios, items, |part| Self::Audit(AuditPayload::Brackets(part)))
            }
            Self::Audit(AuditPayload::Replays(batch)) => {
                parts(batch.0, items, |part| Self::Audit(AuditPayload::Replays(EpisodeBatch(part))))
            }
            Self::Critique(batch) => parts(batch.0, items, |part| Self::Critique(EpisodeBatch(part))),
        }
    }

    /// Returns the job of one item.
    #[must_use]
    pub fn item(&self, index: usize) -> Option<Self> {
        Some(match self {
            Self::Prepare(payload) => Self::Prepare(PreparePayload(vec![payload.0.get(index)?.clone()])),
            Self::Audit(AuditPayload::Brackets(scenarios)) => {
                Self::Audit(AuditPayload::Brackets(vec![scenarios.get(index)?.clone()]))
            }
            Self::Audit(AuditPayload::Replays(batch)) => {
                let episode = batch.0.get(index)?.clone();
                Self::Audit(AuditPayload::Replays(EpisodeBatch(vec![episode])))
            }
            Self::Critique(batch) => Self::Critique(EpisodeBatch(vec![batch.0.get(index)?.clone()])),
        })
    }

    /// Writes the payload.
    ///
    /// # Errors
    /// Returns [`WireError::Encode`] if a value cannot be written.
    pub fn encode(&self) -> Result<Vec<u8>, WireError> {
        match self {
            Self::Prepare(payload) => payload.encode(),
            Self::Audit(payload) => payload.encode(),
            Self::Critique(batch) => batch.encode(),
        }
    }

    /// Reads the payload of a job of a kind.
    ///
    /// # Errors
    /// Returns [`WireError`] if the bytes are no valid payload.
    pub fn decode(kind: JobKind, bytes: &[u8]) -> Result<Self, WireError> {
        Ok(match kind {
            JobKind::Prepare => Self::Prepare(PreparePayload::decode(bytes)?),
            JobKind::Audit => Self::Audit(AuditPayload::decode(bytes)?),
            JobKind::Critique => Self::Critique(EpisodeBatch::decode(bytes)?),
            JobKind::DesignProcedural | JobKind::DesignLlm => {
                return Err(WireError::Mismatch("a design is no list of items"));
            }
            JobKind::RolloutBuiltIn | JobKind::RolloutFile | JobKind::RolloutChat => {
                return Err(WireError::Mismatch("a rollout is no pure function of its payload"));
            }
        })
    }
}

/// Divides items into parts of equal size.
fn parts<T>(items: Vec<T>, size: usize, part: impl Fn(Vec<T>) -> JobPayload) -> Vec<JobPayload> {
    let mut items = items.into_iter();
    let mut all = Vec::with_capacity(items.len().div_ceil(size));
    while items.len() > 0 {
        all.push(part(items.by_ref().take(size).collect()));
    }
    all
}

impl JobOutput {
    /// Number of results, one for each item.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Prepare(output) => output.0.len(),
            Self::Audit(AuditOutput::Brackets(brackets)) => brackets.len(),
            Self::Audit(AuditOutput::Replays(outcomes)) => outcomes.len(),
            Self::Critique(output) => output.0.len(),
        }
    }

    /// True if there are no results.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// True if the result has the form that a job promises: its kind, and one entry for each item.
    #[must_use]
    pub fn fits(&self, job: &JobPayload) -> bool {
        let is_same_form = match (self, job) {
            (Self::Prepare(_), JobPayload::Prepare(_)) | (Self::Critique(_), JobPayload::Critique(_)) => true,
            (Self::Audit(output), JobPayload::Audit(payload)) => matches!(
                (output, payload),
                (AuditOutput::Brackets(_), AuditPayload::Brackets(_))
                    | (AuditOutput::Replays(_), AuditPayload::Replays(_))
            ),
            _ => false,
        };
        is_same_form && self.len() == job.len()
    }

    /// True if the results of an item are equal to the bit.
    #[must_use]
    pub fn item_equals(&self, index: usize, alone: &Self) -> bool {
        match (self, alone) {
            (Self::Prepare(all), Self::Prepare(one)) => equal_item(&all.0, index, &one.0),
            (Self::Audit(AuditOutput::Brackets(all)), Self::Audit(AuditOutput::Brackets(one))) => {
                equal_item(all, index, one)
            }
            (Self::Audit(AuditOutput::Replays(all)), Self::Audit(AuditOutput::Replays(one))) => {
                equal_item(all, index, one)
            }
            (Self::Critique(all), Self::Critique(one)) => equal_item(&all.0, index, &one.0),
            _ => false,
        }
    }

    /// Joins the results of the parts of a job, in order. `None` if the parts are of different forms.
    #[must_use]
    pub fn join(parts: Vec<Self>) -> Option<Self> {
        let mut parts = parts.into_iter();
        let mut joined = parts.next()?;
        for part in parts {
            match (&mut joined, part) {
                (Self::Prepare(all), Self::Prepare(part)) => all.0.extend(part.0),
                (Self::Audit(AuditOutput::Brackets(all)), Self::Audit(AuditOutput::Brackets(part))) => {
                    all.extend(part);
                }
                (Self::Audit(AuditOutput::Replays(all)), Self::Audit(AuditOutput::Replays(part))) => {
                    all.extend(part);
                }
                (Self::Critique(all), Self::Critique(part)) => all.0.extend(part.0),
                _ => return None,
            }
        }
        Some(joined)
    }

    /// Writes the result.
    ///
    /// # Errors
    /// Returns [`WireError::Encode`] if a value cannot be written.
    pub fn encode(&self) -> Result<Vec<u8>, WireError> {
        match self {
            Self::Prepare(output) => output.encode(),
            Self::Audit(output) => output.encode(),
            Self::Critique(output) => output.encode(),
        }
    }

    /// Reads the result of a job.
    ///
    /// # Errors
    /// Returns [`WireError`] if the bytes are no valid result, or if it does not fit the job.
    pub fn decode(job: &JobPayload, bytes: &[u8]) -> Result<Self, WireError> {
        let output = match job {
            JobPayload::Prepare(_) => Self::Prepare(PrepareOutput::decode(bytes)?),
            JobPayload::Audit(_) => Self::Audit(AuditOutput::decode(bytes)?),
            JobPayload::Critique(_) => Self::Critique(CritiqueOutput::decode(bytes)?),
        };
        if output.fits(job) { Ok(output) } else { Err(WireError::Mismatch("it has other or fewer results")) }
    }
}

fn equal_item<T: PartialEq>(all: &[T], index: usize, one: &[T]) -> bool {
    matches!((all.get(index), one), (Some(reported), [computed]) if reported == computed)
}
