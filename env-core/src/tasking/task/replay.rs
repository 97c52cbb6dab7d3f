//! Replays of logs, side by side in lanes.

use super::run::TaskRun;
use super::task_setup::TaskSetup;
use crate::bracket::EpisodeOutcome;
use crate::error::ReplayError;
use crate::rollout::{LogCursor, ReplayItem};
use crate::tasking::simulation::{AgentAction, step_all};
use crate::tasking::tick::dispatch::InstructionSet;

/// An episode that is replayed.
struct Replay<'a> {
    run: TaskRun,
    cursor: LogCursor<'a>,
    /// False once the log has ended.
    is_active: bool,
}

/// Replays logs with the outcomes that each has by itself.
pub(super) fn replay_all(items: &[ReplayItem<'_>]) -> Vec<Result<EpisodeOutcome, ReplayError>> {
    let mut replays: Vec<Result<Replay<'_>, ReplayError>> = items.iter().map(Replay::start).collect();
    loop {
        let mut actions = Vec::with_capacity(replays.len());
        for replay in &mut replays {
            if let Ok(active) = replay
                && active.is_active
            {
                match active.next_actions() {
                    Ok(Some(chosen)) => actions.push(chosen),
                    Ok(None) => {}
                    Err(error) => *replay = Err(error),
                }
            }
        }
        if actions.is_empty() {
            break;
        }
        let mut active: Vec<&mut Replay<'_>> = replays.iter_mut().flatten().filter(|r| r.is_active).collect();
        let mut sims: Vec<_> = active.iter_mut().map(|replay| &mut replay.run.sim).collect();
        let results = step_all(&mut sims, &actions, InstructionSet::detect());
        for (replay, result) in active.into_iter().zip(results) {
            replay.run.finish_step(result);
        }
    }
    replays.into_iter().map(|replay| replay.map(|replay| replay.run.outcome())).collect()
}

impl<'a> Replay<'a> {
    fn start(item: &ReplayItem<'a>) -> Result<Self, ReplayError> {
        let run = TaskRun::start(TaskSetup::read(item.scenario.recipe())?, item.scenario.seed())?;
        Ok(Self { run, cursor: LogCursor::new(item.log), is_active: true })
    }

    /// The actions of the next step; `None` after the last.
    fn next_actions(&mut self) -> Result<Option<Vec<Option<AgentAction>>>, ReplayError> {
        let Some(action) = self.cursor.next(self.run.is_done())? else {
            self.is_active = false;
            return Ok(None);
        };
        let actions = self.run.read_actions(action);
        Ok(Some(actions.map_err(|source| self.cursor.error(action, source))?))
    }
}
