//! What moves: the environments, the buffers they write, and what is counted of their episodes.

use std::time::Instant;

use env_core::batch::book::Book;
use env_core::batch::{Autoreset, Batch, BatchError, Buffers, Output, Shape};

use crate::batch::Wrong;
use crate::curriculum::Episode;
use crate::picture::Picture;

/// Everything that moves.
pub(crate) struct State {
    /// Who flies what, where a curriculum says so.
    pub(crate) book: Option<Book<Episode>>,
    pub(crate) batch: Box<dyn Batch>,
    pub(crate) buffers: Buffers,
    pub(crate) actions: Vec<f32>,
    pub(crate) taken: Vec<f32>,
    /// Of each environment's episode so far.
    pub(crate) returns: Vec<f64>,
    pub(crate) lengths: Vec<i64>,
    begun: Vec<Instant>,
    /// Its episode ended in the last step.
    pub(crate) ended: Vec<bool>,
    /// A curriculum had nothing for it then.
    rested: Vec<bool>,
    pub(crate) pictures: Vec<Option<Picture>>,
}

/// Of each environment, zeros where no episode ended.
pub(crate) struct Ended {
    pub(crate) returns: Vec<f64>,
    pub(crate) lengths: Vec<i64>,
    pub(crate) seconds: Vec<f64>,
}

/// What a step writes for the caller.
pub(crate) struct Slices<'a> {
    pub(crate) observations: &'a mut [f32],
    pub(crate) rewards: &'a mut [f64],
    pub(crate) terminations: &'a mut [bool],
    pub(crate) truncations: &'a mut [bool],
}

impl State {
    /// Of a batch that is yet to be reset.
    pub(crate) fn new(batch: Box<dyn Batch>, autoreset: Autoreset, book: Option<Book<Episode>>) -> Self {
        let shape = batch.shape();
        let Shape { envs, agents, action, .. } = shape;
        Self {
            buffers: Buffers::new(shape, autoreset),
            actions: Vec::new(),
            taken: vec![0.0; envs * agents * action],
            returns: vec![0.0; envs],
            lengths: vec![0; envs],
            begun: vec![Instant::now(); envs],
            ended: vec![false; envs],
            rested: vec![false; envs],
            pictures: Vec::new(),
            batch,
            book,
        }
    }

    /// The curriculum's book.
    pub(crate) fn book(&mut self) -> Result<&mut Book<Episode>, Wrong> {
        self.book.as_mut().ok_or_else(|| Wrong::Curriculum("these environments are closed".to_owned().into()))
    }

    /// Of the episodes that ended in the last step.
    pub(crate) fn of_ended(&self) -> Ended {
        let mut told = Ended {
            returns: vec![0.0; self.ended.len()],
            lengths: vec![0; self.ended.len()],
            seconds: vec![0.0; self.ended.len()],
        };
        let now = Instant::now();
        for (env, _) in self.ended.iter().enumerate().filter(|(_, ended)| **ended) {
            told.returns[env] = self.returns[env];
            told.lengths[env] = self.lengths[env];
            // As Gymnasium has it: microseconds are enough.
            let micros = now.duration_since(self.begun[env]).as_micros();
            told.seconds[env] = micros as f64 / 1e6;
        }
        told
    }

    /// Episodes begin, of all or of those in the mask.
    pub(crate) fn begin(&mut self, mask: Option<&[bool]>, shape: Shape) {
        let now = Instant::now();
        for env in 0..shape.envs {
            if mask.is_none_or(|mask| mask[env]) {
                (self.returns[env], self.lengths[env], self.ended[env]) = (0.0, 0, false);
                self.rested[env] = self.batch.rests(env);
                self.begun[env] = now;
                let agents = env * shape.agents..(env + 1) * shape.agents;
                self.batch.absent(env, &mut self.buffers.terminated[agents.clone()]);
                self.buffers.truncated[agents.clone()].fill(false);
                self.buffers.rewards[agents].fill(0.0);
                let width = shape.agents * shape.action;
                self.taken[env * width..(env + 1) * width].fill(0.0);
                if let Some(Some(picture)) = self.pictures.get_mut(env) {
                    picture.begin();
                }
            }
        }
    }

    pub(crate) fn step(
        &mut self,
        actions: &[f32],
        out: &mut Slices<'_>,
        shape: Shape,
        autoreset: Autoreset,
    ) -> Result<bool, BatchError> {
        let buffers = &mut self.buffers;
        let output = Output {
            observations: &mut *out.observations,
            final_observations: &mut buffers.final_observations,
            rewards: &mut buffers.rewards,
            team_rewards: &mut buffers.team_rewards,
            terminated: &mut buffers.terminated,
            truncated: &mut buffers.truncated,
            done: &mut buffers.done,
            taken: &mut self.taken,
        };
        self.batch.step(actions, output)?;
        let mut any = false;
        let mut now = None;
        for env in 0..shape.envs {
            let (reward, done) = (f64::from(buffers.team_rewards[env]), buffers.done[env]);
            if self.ended[env] || self.rested[env] {
                // The last step ended its episode, or flew none: what is counted now is another's.
                self.begun[env] = *now.get_or_insert_with(Instant::now);
                // A step that begins an episode is none of it.
                let begins = autoreset == Autoreset::NextStep || self.rested[env];
                (self.returns[env], self.lengths[env]) = (0.0, if begins { -1 } else { 0 });
                if let Some(Some(picture)) = self.pictures.get_mut(env) {
                    picture.begin();
                }
            }
            self.returns[env] += reward;
            self.lengths[env] += 1;
            self.ended[env] = done;
            self.rested[env] = self.book.is_some() && self.batch.rests(env);
            any |= done;
            let agents = env * shape.agents..(env + 1) * shape.agents;
            out.rewards[env] = reward;
            out.terminations[env] = done && buffers.terminated[agents.clone()].iter().all(|left| *left);
            out.truncations[env] = done && buffers.truncated[agents].iter().any(|cut| *cut);
        }
        Ok(any)
    }

    pub(crate) fn draw(&mut self, env: usize, shape: Shape, size: (u32, u32)) -> Option<Vec<u8>> {
        let width = shape.agents * shape.action;
        let scene = self.batch.scene(env, &self.taken[env * width..(env + 1) * width])?;
        self.pictures.resize_with(shape.envs, || None);
        let picture = &mut self.pictures[env];
        if picture.as_ref().is_none_or(|picture| picture.size() != size) {
            *picture = Picture::new(size);
        }
        Some(picture.as_mut()?.draw(&scene))
    }
}
