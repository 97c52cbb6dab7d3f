//! Result of a design job, and its compact form.

use std::time::Duration;

use designer::reported::{ReportedLayout, ReportedVerdict};
use designer::{DesignOutcome, DesignUsage, GateCheck};
use env_core::Seed;
use serde::{Deserialize, Serialize};

use crate::wire::{MAX_ENTRIES, WireBracket, WireError, from_bytes, list, to_bytes};

/// Layouts that a designer made, with the verdicts of its gate.
#[derive(Debug, Clone, PartialEq)]
pub struct DesignOutput {
    /// The layouts in order.
    pub layouts: Vec<ReportedLayout>,
    /// Effort of the designer.
    pub usage: DesignUsage,
    /// Problems that did not end the work, one sentence each.
    pub warnings: Vec<String>,
}

#[derive(Serialize, Deserialize)]
struct WireOutput {
    #[serde(deserialize_with = "list::<_, _, MAX_ENTRIES>")]
    layouts: Vec<WireLayout>,
    usage: WireUsage,
    #[serde(deserialize_with = "list::<_, _, MAX_ENTRIES>")]
    warnings: Vec<String>,
}

#[derive(Serialize, Deserialize)]
struct WireLayout {
    name: String,
    /// The design as JSON.
    design: Option<String>,
    attempt: u64,
    round: u32,
    verdict: WireVerdict,
}

#[derive(Serialize, Deserialize)]
enum WireVerdict {
    Admitted(u64, WireBracket),
    /// Name of the check, and the message.
    Refused(String, String),
}

#[derive(Serialize, Deserialize)]
struct WireUsage {
    model: Option<String>,
    prompt: Option<String>,
    rounds: u32,
    tokens_in: u64,
    tokens_out: u64,
    cost: f64,
    latency_ms: u64,
}

impl From<&DesignOutcome> for DesignOutput {
    fn from(outcome: &DesignOutcome) -> Self {
        Self {
            layouts: outcome.judged.iter().map(ReportedLayout::from).collect(),
            usage: outcome.usage.clone(),
            warnings: outcome.warnings.clone(),
        }
    }
}

impl DesignOutput {
    /// Writes the result.
    ///
    /// # Errors
    /// Returns [`WireError::Encode`] if a value cannot be written.
    pub fn encode(&self) -> Result<Vec<u8>, WireError> {
        let DesignUsage { model, prompt, rounds, tokens_in, tokens_out, cost, latency } = self.usage.clone();
        let latency_ms = u64::try_from(latency.as_millis()).unwrap_or(u64::MAX);
        to_bytes(&WireOutput {
            layouts: self.layouts.iter().map(WireLayout::from).collect(),
            usage: WireUsage { model, prompt, rounds, tokens_in, tokens_out, cost, latency_ms },
            warnings: self.warnings.clone(),
        })
    }

    /// Reads the result of a job.
    ///
    /// # Errors
    /// Returns [`WireError`] if the bytes are no valid result.
    pub fn decode(bytes: &[u8]) -> Result<Self, WireError> {
        let WireOutput { layouts, usage, warnings } = from_bytes(bytes)?;
        let WireUsage { model, prompt, rounds, tokens_in, tokens_out, cost, latency_ms } = usage;
        let latency = Duration::from_millis(latency_ms);
        Ok(Self {
            layouts: layouts.into_iter().map(WireLayout::read).collect::<Result<_, _>>()?,
            usage: DesignUsage { model, prompt, rounds, tokens_in, tokens_out, cost, latency },
            warnings,
        })
    }
}

impl From<&ReportedLayout> for WireLayout {
    fn from(layout: &ReportedLayout) -> Self {
        let verdict = match &layout.verdict {
            ReportedVerdict::Admitted { seed, bracket } => {
                WireVerdict::Admitted(seed.get(), (&**bracket).into())
            }
            ReportedVerdict::Refused { check, message } => {
                WireVerdict::Refused(check.as_str().to_owned(), message.clone())
            }
        };
        Self {
            name: layout.name.clone(),
            design: layout.design.as_ref().map(ToString::to_string),
            attempt: layout.attempt,
            round: layout.round,
            verdict,
        }
    }
}

impl WireLayout {
    fn read(self) -> Result<ReportedLayout, WireError> {
        let verdict = match self.verdict {
            WireVerdict::Admitted(seed, bracket) => {
                ReportedVerdict::Admitted { seed: Seed::new(seed)?, bracket: Box::new(bracket.read()?) }
            }
            WireVerdict::Refused(check, message) => {
                let check = GateCheck::of_name(&check);
                let check = check.ok_or(WireError::Mismatch("a refusal names no check of the gate"))?;
                ReportedVerdict::Refused { check, message }
            }
        };
        Ok(ReportedLayout {
            name: self.name,
            design: self.design.map(|design| serde_json::from_str(&design)).transpose()?,
            attempt: self.attempt,
            round: self.round,
            verdict,
        })
    }
}
