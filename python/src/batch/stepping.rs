//! Reset and step of a batch, without the interpreter lock.

use env_core::batch::BatchBuffers;
use env_core::batch::episode_assigner::BatchCall;

use super::NativeBatch;
use super::lock::lock_detached;
use super::step_error::StepError;
use crate::batch_state::{BatchState, RepeatedStep, StepBuffers};
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

    /// Steps all environments by the same actions, `repeat` times or until their episodes end, without the interpreter lock.
    /// Returns true if any episode ended.
    pub(super) fn step_detached(
        &self,
        actions: Vec<f32>,
        repeat: u32,
        buffers: &mut StepBuffers<'_>,
    ) -> Result<bool, StepError> {
        let state = &mut *lock_detached(&self.state);
        if let Some(curriculum) = &self.curriculum {
            // An environment begins at most one episode in a step, however often the actions are repeated.
            let assigner = state.assigner.as_mut().ok_or_else(closed)?;
            curriculum.assign(assigner, BatchCall::Step).map_err(StepError::Curriculum)?;
        }
        let mut repeated = RepeatedStep::new(self.shape, self.config.autoreset);
        let mut result = Ok(());
        for _ in 0..repeat {
            result = self.step_once(state, &actions, &mut repeated, buffers);
            if result.is_err() || !repeated.next() {
                break;
            }
        }
        state.actions = actions;
        result.map(|()| state.finish_step(repeated, buffers.rewards))
    }

    /// Steps the environments that still take part in a repeated step.
    fn step_once(
        &self,
        state: &mut BatchState,
        actions: &[f32],
        repeated: &mut RepeatedStep,
        buffers: &mut StepBuffers<'_>,
    ) -> Result<(), StepError> {
        let mask = repeated.mask().map(<[bool]>::to_vec);
        self.step_threads
            .run(|| state.step(actions, repeated, buffers, self.shape))
            .map_err(StepError::Batch)?;
        if let (Some(curriculum), Some(assigner)) = (&self.curriculum, &mut state.assigner) {
            let BatchBuffers { team_rewards, done, .. } = &state.buffers;
            assigner.record_step(mask.as_deref(), &state.last_actions, team_rewards, done);
            curriculum.finish(assigner);
        }
        Ok(())
    }
}

fn closed() -> StepError {
    StepError::Curriculum(WaitError::Failed(
        "the environments are closed: make others to continue".to_owned(),
    ))
}
