//! Reset and step of a batch, without the interpreter lock.

use env_core::batch::episode_assigner::BatchCall;

use super::NativeBatch;
use super::lock::lock_detached;
use super::step_error::StepError;
use crate::batch_state::StepBuffers;
use crate::curriculum::WaitError;

impl NativeBatch {
    /// Resets environments without the interpreter lock.
    pub(super) fn reset_detached(
        &self,
        mask: Option<&[bool]>,
        observations: &mut [f32],
    ) -> Result<(), StepError> {
        let state = &mut *lock_detached(&self.state);
        if let Some(curriculum) = &self.curriculum {
            let assigner = state.assigner.as_mut().ok_or_else(closed)?;
            // If no episode can be assigned, nothing has changed and the current episodes continue.
            curriculum.assign(assigner, BatchCall::Reset(mask)).map_err(StepError::Curriculum)?;
            curriculum.return_running(assigner, mask);
        }
        let reset = self.step_threads.run(|| {
            state.batch.reset(mask, observations)?;
            state.batch.observe(observations)
        });
        if let Some(assigner) = &mut state.assigner {
            assigner.record_reset(mask);
        }
        state.start_episodes(mask, self.shape);
        reset.map_err(StepError::Batch)
    }

    /// Steps all environments without the interpreter lock; returns true if any episode ended.
    pub(super) fn step_detached(
        &self,
        actions: Vec<f32>,
        buffers: &mut StepBuffers<'_>,
    ) -> Result<bool, StepError> {
        let state = &mut *lock_detached(&self.state);
        if let Some(curriculum) = &self.curriculum {
            let assigner = state.assigner.as_mut().ok_or_else(closed)?;
            curriculum.assign(assigner, BatchCall::Step).map_err(StepError::Curriculum)?;
        }
        let stepped =
            self.step_threads.run(|| state.step(&actions, buffers, self.shape, self.config.autoreset));
        state.actions = actions;
        if let (Ok(_), Some(curriculum), Some(assigner)) = (&stepped, &self.curriculum, &mut state.assigner) {
            assigner.record_step(&state.last_actions, &state.buffers.team_rewards, &state.buffers.done);
            curriculum.finish(assigner);
        }
        stepped.map_err(StepError::Batch)
    }
}

fn closed() -> StepError {
    StepError::Curriculum(WaitError::Failed(
        "the environments are closed: make others to continue".to_owned(),
    ))
}
