//! Check of the result of a design job by the server.

use designer::procedural::ProceduralDesigner;
use designer::reported::{LayoutCheck, ReportFault, ReportedDesigner, ReportedLayout};
use designer::{DesignOutcome, DesignUsage, Gate};
use env_core::ScenarioId;

use super::output::DesignOutput;
use super::{DesignJob, JobDesigner};
use crate::wire::WireError;

/// Largest number of layouts of a language model, for each requested one: two conversations of four answers of eight layouts, of which
/// twice as many are judged.
const MAX_LLM_LAYOUTS_EACH: usize = 128;
/// Largest number of warnings of a result.
const MAX_WARNINGS: usize = 10_000;

/// Reason why a result of a design job cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DesignFault {
    /// A layout is wrong.
    #[error("layout {number} is wrong: {fault}")]
    Layout {
        /// Number of the layout, from 1.
        number: usize,
        /// Fault of the layout.
        fault: ReportFault,
    },
    /// The result does not fit the job.
    #[error("it does not fit its job: {0}")]
    Form(&'static str),
}

/// An admitted layout that was judged again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RejudgedLayout {
    /// Scenario of the layout.
    pub scenario: ScenarioId,
    /// True if the gate of this process admits it with the same bracket.
    pub is_equal: bool,
}

impl JobDesigner {
    const fn reported(self) -> ReportedDesigner {
        match self {
            Self::Procedural => ReportedDesigner::Procedural,
            Self::Llm => ReportedDesigner::Llm,
        }
    }
}

impl DesignOutput {
    /// Checks the result with the gate of its job, which admits the layouts again. Layouts for whose index `is_audited` returns true are
    /// judged again.
    ///
    /// # Errors
    /// Returns [`DesignFault`] if the result is wrong: its worker is broken or forged.
    pub fn check(
        self,
        job: &DesignJob,
        gate: &mut Gate,
        is_audited: impl Fn(usize) -> bool,
    ) -> Result<DesignOutcome, DesignFault> {
        self.check_form(job)?;
        let designer = job.designer.reported();
        let mut judged = Vec::with_capacity(self.layouts.len());
        for (index, layout) in self.layouts.into_iter().enumerate() {
            let check = if is_audited(index) { LayoutCheck::Judge } else { LayoutCheck::Confirm };
            let layout = layout.check(&job.brief, gate, designer, check);
            judged.push(layout.map_err(|fault| DesignFault::Layout { number: index + 1, fault })?);
        }
        Ok(DesignOutcome { judged, usage: self.usage, warnings: self.warnings })
    }

    /// Judges the admitted layouts of a checked result again. Each is compared with the archive that its worker had, so that a wrong
    /// layout makes no later one wrong.
    ///
    /// # Errors
    /// Returns [`WireError::Mismatch`] if the task has no design language.
    pub fn judge_admitted(self, job: &DesignJob) -> Result<Vec<RejudgedLayout>, WireError> {
        let (designer, mut gate) = (job.designer.reported(), job.gate()?);
        let mut rejudged = Vec::new();
        for layout in self.layouts.into_iter().filter(ReportedLayout::is_admitted) {
            let mut judging = Gate::new(gate.language(), gate.archive().to_vec());
            let again = layout.clone().check(&job.brief, &mut judging, designer, LayoutCheck::Judge);
            let admitted = layout.check(&job.brief, &mut gate, designer, LayoutCheck::Confirm);
            // The check of the result has confirmed it before.
            if let Ok(admitted) = admitted.and_then(|judged| judged.verdict.map_err(ReportFault::NotAdmitted))
            {
                let scenario = admitted.scenario().id();
                rejudged.push(RejudgedLayout { scenario, is_equal: again.is_ok() });
            }
        }
        Ok(rejudged)
    }

    /// Checks what follows from the job without looking at a layout.
    fn check_form(&self, job: &DesignJob) -> Result<(), DesignFault> {
        let attempts = || self.layouts.iter().map(|layout| layout.attempt);
        let is_model = job.designer == JobDesigner::Llm;
        let max_layouts = if is_model {
            job.brief.count.saturating_mul(MAX_LLM_LAYOUTS_EACH)
        } else {
            usize::try_from(ProceduralDesigner::max_attempts(&job.brief)).unwrap_or(usize::MAX)
        };
        let in_order = if is_model {
            attempts().eq(0..self.layouts.len() as u64)
        } else {
            attempts().is_sorted_by(|a, b| a < b)
                && attempts().all(|attempt| attempt < ProceduralDesigner::max_attempts(&job.brief))
        };
        let DesignUsage { model, cost, tokens_in, tokens_out, .. } = &self.usage;
        let costs_nothing = model.is_none() && *cost == 0.0 && (*tokens_in, *tokens_out) == (0, 0);
        let fault = if self.layouts.len() > max_layouts {
            "it has too many layouts"
        } else if !in_order {
            "its attempts are not in order"
        } else if self.warnings.len() > MAX_WARNINGS {
            "it has too many warnings"
        } else if !(cost.is_finite() && *cost >= 0.0) {
            "its cost is no amount"
        } else if !is_model && !costs_nothing {
            "the procedural designer calls no model"
        } else {
            return Ok(());
        };
        Err(DesignFault::Form(fault))
    }
}
