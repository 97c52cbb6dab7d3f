//! Jobs that design layouts, with their results.
//!
//! A [`DesignJob`] has everything that a designer and its gate need; the endpoint of a language model is configured where it is called.
//! A [`DesignOutput`] has the layouts with their verdicts. The server checks it by [`DesignOutput::check`]: it parses and builds every
//! admitted layout again, replays the plan of its bracket, and judges a random share of the layouts again. If the worker is expelled
//! later, [`DesignOutput::judge_admitted`] judges the others. `wire_brief` and `output` have the messages.

mod check;
mod output;
#[cfg(test)]
mod tests;
mod wire_brief;

use designer::{DesignBrief, Gate, design_language};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use self::wire_brief::WireBrief;
use crate::kind::JobKind;
use crate::wire::{MAX_ENTRIES, WireError, from_bytes, list, to_bytes};

pub use self::check::{DesignFault, RejudgedLayout};
pub use self::output::DesignOutput;

/// Largest number of layouts of a job.
const MAX_COUNT: usize = 1024;

/// Designer of a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum JobDesigner {
    /// The procedural designer, which needs no model.
    Procedural,
    /// The language model of the process that designs.
    Llm,
}

impl JobDesigner {
    /// Returns the kind of jobs for this designer.
    #[must_use]
    pub const fn kind(self) -> JobKind {
        match self {
            Self::Procedural => JobKind::DesignProcedural,
            Self::Llm => JobKind::DesignLlm,
        }
    }

    /// Returns the name of the designer, which is stored with its layouts.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Procedural => "procedural",
            Self::Llm => "llm",
        }
    }
}

/// Request to a designer, with the gate's archive.
#[derive(Debug, Clone, PartialEq)]
pub struct DesignJob {
    /// Id of the run, which pays for the calls of a language model.
    pub run: String,
    /// Designer that the request is for.
    pub designer: JobDesigner,
    /// Brief of the designer.
    pub brief: DesignBrief,
    /// Known designs, which the gate compares new ones with.
    pub archive: Vec<Value>,
}

#[derive(Serialize, Deserialize)]
struct WireDesignJob {
    run: String,
    designer: JobDesigner,
    brief: WireBrief,
    /// Known designs as JSON.
    #[serde(deserialize_with = "list::<_, _, MAX_ENTRIES>")]
    archive: Vec<String>,
}

impl DesignJob {
    /// Creates the gate of the job.
    ///
    /// # Errors
    /// Returns [`WireError::Mismatch`] if the task has no design language.
    pub fn gate(&self) -> Result<Gate, WireError> {
        let language = design_language(self.brief.recipe.task());
        let language = language.ok_or(WireError::Mismatch("the task has no design language"))?;
        Ok(Gate::new(language, self.archive.clone()))
    }

    /// Writes the job.
    ///
    /// # Errors
    /// Returns [`WireError::Encode`] if a value cannot be written.
    pub fn encode(&self) -> Result<Vec<u8>, WireError> {
        to_bytes(&WireDesignJob {
            run: self.run.clone(),
            designer: self.designer,
            brief: WireBrief::from(&self.brief),
            archive: self.archive.iter().map(Value::to_string).collect(),
        })
    }

    /// Reads a job.
    ///
    /// # Errors
    /// Returns [`WireError`] if the bytes are no valid job.
    pub fn decode(bytes: &[u8]) -> Result<Self, WireError> {
        let WireDesignJob { run, designer, brief, archive } = from_bytes(bytes)?;
        let brief = brief.read()?;
        if brief.count > MAX_COUNT {
            return Err(WireError::Mismatch("it wants too many layouts"));
        }
        if brief.profile.validate().is_err() {
            return Err(WireError::Mismatch("its failure profile is invalid"));
        }
        let archive = archive.iter().map(|design| serde_json::from_str(design)).collect::<Result<_, _>>()?;
        Ok(Self { run, designer, brief, archive })
    }
}
