//! The plan of a vector session: how large its frames are and how much memory its environments need.

use std::sync::Arc;

use env_core::batch::episode_assigner::AssignedScenarios;
use env_core::batch::{
    Autoreset, Batch, BatchConfig, BatchError, BatchShape, ObservationMode, ScenarioSource, SeedSequence,
};
use env_core::{Scenario, TaskSpec};

use super::env_batch::EnvBatch;
use super::error::VectorError;
use super::frame::{FrameLayout, MAX_REPLY_BYTES, MAX_REQUEST_BYTES};
use crate::sessions::session_request::SessionRequestError;

/// Memory of an environment over its lifetime, in percent of a new one: kessler adds rogue debris and fragments.
const MEMORY_PERCENT: usize = 150;

/// Request for the environments of a vector session.
#[derive(Clone)]
pub struct VectorRequest {
    /// Number of environments, 1 to [`env_core::batch::MAX_ENVS`].
    pub envs: usize,
    /// Handling of environments whose episode has ended.
    pub autoreset: Autoreset,
    /// Form of the observations.
    pub observe: ObservationMode,
    /// Task whose episodes of a lease are used; required if the lease has several tasks.
    pub task: Option<&'static dyn TaskSpec>,
}

/// Batch of environments that was just created.
pub(crate) struct PlannedBatch {
    pub(crate) batch: Box<dyn Batch>,
    /// Slots for the scenarios of a lease; `None` without a lease.
    pub(crate) assigned: Option<AssignedScenarios>,
}

/// Sizes that a plan measured.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Measured {
    pub(crate) shape: BatchShape,
    /// Bytes of one environment.
    pub(crate) bytes_per_env: usize,
}

/// Plan of the environments of a vector session.
pub(crate) struct VectorPlan {
    pub(crate) task: &'static dyn TaskSpec,
    pub(crate) config: BatchConfig,
    /// Scenarios to measure, one at least. [`Self::measure`] puts the one with the largest observation first.
    pub(crate) scenarios: Vec<Scenario>,
    /// True if the environments run the episodes of a lease.
    pub(crate) is_leased: bool,
}

impl VectorPlan {
    /// Measures one environment of each scenario, and returns the largest sizes.
    pub(crate) fn measure(&mut self) -> Result<Measured, BatchError> {
        let (mut largest, mut bytes_per_env): (Option<BatchShape>, usize) = (None, 0);
        for index in 0..self.scenarios.len() {
            let (source, _) = self.scenario_source(1, &self.scenarios[index]);
            let mut batch = self.task.batch(source, BatchConfig { envs: 1, ..self.config })?;
            let shape = batch.shape();
            batch.reset(None, &mut vec![0.0; shape.observation])?;
            bytes_per_env = bytes_per_env.max(batch.bytes_per_env());
            if largest.is_none_or(|known| shape.observation > known.observation) {
                largest = Some(shape);
                self.scenarios.swap(0, index);
            }
        }
        // A plan has one scenario at least.
        let shape = largest.ok_or(BatchError::Unsupported("the plan has no scenario"))?;
        Ok(Measured { shape: BatchShape { envs: self.config.envs, ..shape }, bytes_per_env })
    }

    /// Returns the layout of the frames.
    ///
    /// # Errors
    /// Returns the error of the field `vector.envs` if the frames would be too large.
    pub(crate) fn layout(&self, shape: BatchShape) -> Result<FrameLayout, VectorError> {
        let BatchShape { envs, agents, action, observation } = shape;
        let has_finals = self.config.autoreset == Autoreset::SameStep;
        let layout = FrameLayout { envs, agents, action, observation, is_leased: self.is_leased, has_finals };
        if layout.max_reply_bytes() > MAX_REPLY_BYTES || layout.actions_bytes() > MAX_REQUEST_BYTES {
            let reason = format!(
                "is too large: replies would have {} MiB and actions {} MiB; the maxima are {} MiB and {} MiB",
                layout.max_reply_bytes() >> 20,
                layout.actions_bytes() >> 20,
                MAX_REPLY_BYTES >> 20,
                MAX_REQUEST_BYTES >> 20
            );
            return Err(SessionRequestError::new("vector.envs", reason).into());
        }
        Ok(layout)
    }

    /// Returns the memory that the environments need with their logs and frames, in bytes.
    pub(crate) fn memory_bytes(&self, measured: Measured, layout: FrameLayout) -> usize {
        let BatchShape { envs, agents, action, .. } = measured.shape;
        // The log of a lease's episode is kept until it is reported: one horizon at most.
        let log_bytes = if self.is_leased {
            self.task.horizon(self.scenarios[0].recipe()) as usize * agents * (4 + 8 * action)
        } else {
            0
        };
        let env_bytes = measured.bytes_per_env * MEMORY_PERCENT / 100;
        envs * (env_bytes + log_bytes) + EnvBatch::buffer_bytes(layout)
    }

    /// Creates the environments without resetting them.
    pub(crate) fn create_batch(&self) -> Result<PlannedBatch, BatchError> {
        let (source, assigned) = self.scenario_source(self.config.envs, &self.scenarios[0]);
        Ok(PlannedBatch { batch: self.task.batch(source, self.config)?, assigned })
    }

    fn scenario_source(
        &self,
        envs: usize,
        first: &Scenario,
    ) -> (Box<dyn ScenarioSource>, Option<AssignedScenarios>) {
        if !self.is_leased {
            return (Box::new(SeedSequence::new(Arc::clone(first.recipe()), first.seed().get())), None);
        }
        let assigned = AssignedScenarios::new(envs, first);
        (Box::new(assigned.clone()), Some(assigned))
    }
}
