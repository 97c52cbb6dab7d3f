//! Flights of pilots at full fidelity, side by side in lanes.

use crate::bracket::EpisodeOutcome;
use crate::log::{ActionLog, Precision};
use crate::tasking::error::TaskingError;
use crate::tasking::simulation::{AgentAction, DrivenEpisodes, StepResult, TaskingSim, drive};
use crate::tasking::task::blind::CyclePolicy;
use crate::tasking::task::rule::TaskingRule;
use crate::tasking::task::run::TaskRun;
use crate::tasking::tick::dispatch::InstructionSet;

/// A way to choose actions, which may know everything about the episode.
pub(in crate::tasking::task) trait Pilot {
    /// Appends the index of each satellite's action to `indices`; `None` for satellites that go on.
    fn choose(&mut self, run: &mut TaskRun, indices: &mut Vec<Option<usize>>);
}

/// Gives no action: satellites drift.
pub(in crate::tasking::task) struct HoldPilot;

impl Pilot for HoldPilot {
    fn choose(&mut self, run: &mut TaskRun, indices: &mut Vec<Option<usize>>) {
        indices.resize(run.sim.len(), None);
    }
}

impl Pilot for CyclePolicy {
    fn choose(&mut self, run: &mut TaskRun, indices: &mut Vec<Option<usize>>) {
        for satellite in 0..run.sim.len() {
            let count = run.sim.action_count(satellite);
            indices.push(run.needs_action(satellite).then(|| self.next(satellite, count)));
        }
    }
}

impl Pilot for TaskingRule {
    fn choose(&mut self, run: &mut TaskRun, indices: &mut Vec<Option<usize>>) {
        for satellite in 0..run.sim.len() {
            let index = run.needs_action(satellite).then(|| {
                let count = run.sim.action_count(satellite);
                Self::choose(self, &run.satellite_telemetry(satellite)).index(count)
            });
            indices.push(index);
        }
    }
}

/// Result of a flight.
#[derive(Debug, Clone)]
pub(in crate::tasking::task) struct FlightResult {
    /// Outcome of the episode.
    pub(in crate::tasking::task) outcome: EpisodeOutcome,
    /// Actions of all steps.
    pub(in crate::tasking::task) log: ActionLog,
}

/// Index of the first flight with the largest score; 0 if there are none.
pub(in crate::tasking::task) fn best_index(flown: &[FlightResult]) -> usize {
    let score = |index: usize| flown[index].outcome.score;
    (0..flown.len()).fold(0, |best, index| if score(index) > score(best) { index } else { best })
}

/// A flight of one pilot.
struct Flight<'a> {
    pilot: Box<dyn Pilot + 'a>,
    run: TaskRun,
    log: ActionLog,
    /// Memory for the indices of a step.
    indices: Vec<Option<usize>>,
}

/// Flies all pilots from the same start.
pub(in crate::tasking::task) fn fly_all(
    start: &TaskRun,
    pilots: Vec<Box<dyn Pilot + '_>>,
) -> Vec<FlightResult> {
    let mut flights: Vec<Flight<'_>> = pilots
        .into_iter()
        .map(|pilot| Flight {
            pilot,
            run: start.clone(),
            log: ActionLog::new(1, Precision::F64),
            indices: Vec::new(),
        })
        .collect();
    drive(&mut Flights(&mut flights), InstructionSet::detect());
    flights
        .into_iter()
        .map(|flight| FlightResult { outcome: flight.run.outcome(), log: flight.log })
        .collect()
}

/// Flights side by side.
struct Flights<'a, 'b>(&'a mut [Flight<'b>]);

impl DrivenEpisodes for Flights<'_, '_> {
    fn len(&self) -> usize {
        self.0.len()
    }

    fn episode(&mut self, index: usize) -> &mut TaskingSim {
        &mut self.0[index].run.sim
    }

    fn next_actions(
        &mut self,
        index: usize,
        last: Option<Result<StepResult, TaskingError>>,
    ) -> Option<Vec<Option<AgentAction>>> {
        let flight = &mut self.0[index];
        if let Some(last) = last {
            flight.run.finish_step(last);
        }
        (!flight.run.is_done()).then(|| flight.choose())
    }
}

impl Flight<'_> {
    /// Chooses and logs the actions of the next step.
    fn choose(&mut self) -> Vec<Option<AgentAction>> {
        self.indices.clear();
        self.pilot.choose(&mut self.run, &mut self.indices);
        for (agent, index) in (0u32..).zip(&self.indices) {
            if let Some(index) = index {
                self.log.push_entry(agent, &[*index as f64]);
            }
        }
        self.log.end_step();
        let indices = &self.indices;
        self.run.choose(|agent| indices.get(agent).copied().flatten())
    }
}
