//! Samplers of a run's tasks: where they draw scenarios, and the success there.

use store::ids::RunId;

use crate::engine::change::{ReadTx, StateQuery};
use crate::engine::error::ServiceError;
use curriculum::{SamplerState, StrategyKind};

/// Asks for the sampler of each task of a run.
#[derive(Debug)]
pub struct SamplersQuery {
    /// Id of the run.
    pub run: RunId,
}

/// Samplers of a run at one moment.
#[derive(Debug, Clone, PartialEq)]
pub struct RunSamplers {
    /// Strategy of the run.
    pub strategy: StrategyKind,
    /// Sampler of each task, in the order of the settings.
    pub tasks: Vec<SamplerState>,
}

impl StateQuery for SamplersQuery {
    type Output = RunSamplers;

    async fn read(self, tx: &mut ReadTx<'_>) -> Result<RunSamplers, ServiceError> {
        let (state, _) = tx.run(self.run.as_str()).await?;
        let strategy = state.settings.curriculum.strategy;
        Ok(RunSamplers { strategy, tasks: state.curriculum.samplers() })
    }
}
