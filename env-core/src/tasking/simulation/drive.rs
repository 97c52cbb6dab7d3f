//! Episodes that run from step to step without waiting for each other.
//!
//! [`step_all`](super::step_all) ends when the longest step has ended. Here the lanes of an episode begin its next step at once, so that
//! episodes whose steps differ in duration leave no lane idle.

use super::TaskingSim;
use super::actions::AgentAction;
use super::run::{RunSet, run_all};
use super::step::StepResult;
use crate::tasking::error::TaskingError;
use crate::tasking::tick::dispatch::InstructionSet;

/// Episodes that choose their own actions. All have ticks of one length.
pub(crate) trait DrivenEpisodes {
    /// Number of the episodes.
    fn len(&self) -> usize;

    /// The episode of an index.
    fn episode(&mut self, index: usize) -> &mut TaskingSim;

    /// Actions of the next step of an episode, given the result of its last one, if there was one; `None` ends the episode.
    fn next_actions(
        &mut self,
        index: usize,
        last: Option<Result<StepResult, TaskingError>>,
    ) -> Option<Vec<Option<AgentAction>>>;
}

/// Runs all steps of the episodes, side by side.
pub(crate) fn drive(episodes: &mut impl DrivenEpisodes, set: InstructionSet) {
    let running = (0..episodes.len()).filter(|index| begin_step(episodes, *index, None)).collect();
    run_all(&mut RunningEpisodes { episodes, running }, set);
}

/// Begins the next step of an episode. Returns false if the episode is over.
fn begin_step(
    episodes: &mut impl DrivenEpisodes,
    index: usize,
    mut last: Option<Result<StepResult, TaskingError>>,
) -> bool {
    while let Some(actions) = episodes.next_actions(index, last.take()) {
        let sim = episodes.episode(index);
        match sim.give_actions(&actions).and_then(|()| sim.begin_ticks()) {
            Ok(false) => return true,
            Ok(true) => last = Some(sim.finish_step()),
            Err(error) => last = Some(Err(error)),
        }
    }
    false
}

/// The episodes that have begun a step.
struct RunningEpisodes<'a, E> {
    episodes: &'a mut E,
    /// Indices of those that run at the start.
    running: Vec<usize>,
}

impl<E: DrivenEpisodes> RunSet for RunningEpisodes<'_, E> {
    fn len(&self) -> usize {
        self.running.len()
    }

    fn episode(&mut self, index: usize) -> &mut TaskingSim {
        self.episodes.episode(self.running[index])
    }

    fn begin_next_step(&mut self, index: usize) -> bool {
        let index = self.running[index];
        let last = self.episodes.episode(index).finish_step();
        begin_step(self.episodes, index, Some(last))
    }
}
