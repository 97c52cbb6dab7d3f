//! Blind panel, floor and reference of a scenario. All plans are flown at full fidelity, side by side in lanes.

use super::blind::BlindAction::{self, Charge, Desaturate, Downlink, Work};
use super::blind::{BLIND_CYCLE, CyclePolicy};
use super::rule::TaskingRule;
use super::run::TaskRun;
use super::task_setup::TaskSetup;
use crate::bracket::{Bracket, EpisodeOutcome};
use crate::error::ScenarioError;
use crate::log::{ActionLog, Precision};
use crate::task::Scenario;
use crate::tasking::simulation::{AgentAction, step_all};
use crate::tasking::tick::dispatch::InstructionSet;

/// Version of the planner. A change that alters any bracket increments it.
pub(super) const PLANNER_VERSION: u32 = 1;

/// The blind plans after the first one, which gives no action.
const CYCLES: [&[BlindAction]; 7] = [
    &[Charge],
    &[Work(0)],
    &[Work(0), Charge],
    BLIND_CYCLE,
    &[Work(0), Charge, Charge],
    &[Work(0), Work(0), Charge, Downlink],
    &[Work(0), Work(0), Charge, Charge, Downlink, Desaturate],
];

/// Thresholds of the rules that are candidates for the reference; all combinations are flown.
struct CandidateGrid {
    /// Thresholds of the battery's charge.
    charges: &'static [f64],
    /// Times before an eclipse from which a candidate charges, s.
    eclipses_s: &'static [f64],
    /// Time constants of patience, s, which matter with targets only.
    patiences_s: &'static [f64],
}

/// Candidates of one satellite without targets.
const SCANNING_GRID: CandidateGrid = CandidateGrid {
    charges: &[0.15, 0.25, 0.4, 0.6, 0.8],
    eclipses_s: &[1000.0, 2500.0, 6000.0],
    patiences_s: &[60.0],
};
/// Candidates of one satellite with targets.
const IMAGING_GRID: CandidateGrid = CandidateGrid { patiences_s: &[60.0, 300.0], ..SCANNING_GRID };
/// Candidates of several satellites: fewer, since each costs more.
const CONSTELLATION_GRID: CandidateGrid =
    CandidateGrid { charges: &[0.25, 0.4, 0.6], eclipses_s: &[1000.0, 6000.0], patiences_s: &[300.0] };

/// Computes the bracket.
///
/// The floor is the best score of the blind plans, at least 0: the mean of plans of which some die would be far below what a
/// survivor gets for nothing. The reference is the best of the rules, or of the panel if that is better.
///
/// # Errors
/// Returns [`ScenarioError::Unfair`] if the scenario cannot start.
pub(super) fn bracket(scenario: &Scenario) -> Result<Bracket, ScenarioError> {
    let start = TaskRun::start(TaskSetup::read(scenario.recipe())?, scenario.seed())?;
    let mut pilots = vec![Pilot::Hold];
    pilots.extend(CYCLES.map(|cycle| Pilot::Cycle(CyclePolicy::new(cycle))));
    let panel_len = pilots.len();
    pilots.extend(candidates(&start).into_iter().map(Pilot::Rule));
    let mut flown = fly_all(&start, pilots);
    let best = (0..flown.len())
        .fold(0, |best, index| if flown[index].0.score > flown[best].0.score { index } else { best });
    let panel: Vec<EpisodeOutcome> = flown[..panel_len].iter().map(|(outcome, _)| *outcome).collect();
    let floor = panel.iter().map(|outcome| outcome.score).fold(0.0, f64::max);
    let (reference, reference_plan) = flown.swap_remove(best);
    Ok(Bracket { planner_version: PLANNER_VERSION, panel, floor, reference, reference_plan })
}

fn candidates(start: &TaskRun) -> Vec<TaskingRule> {
    let grid = match (start.sim.targets().is_empty(), start.sim.len()) {
        (true, _) => SCANNING_GRID,
        (false, 1) => IMAGING_GRID,
        (false, _) => CONSTELLATION_GRID,
    };
    let mut rules = vec![TaskingRule::HEURISTIC];
    for charge_below in grid.charges {
        for eclipse_within_s in grid.eclipses_s {
            for patience_s in grid.patiences_s {
                rules.push(TaskingRule {
                    charge_below: *charge_below,
                    eclipse_within_s: *eclipse_within_s,
                    patience_s: *patience_s,
                    ..TaskingRule::HEURISTIC
                });
            }
        }
    }
    rules
}

/// A way to choose actions.
enum Pilot {
    Hold,
    Cycle(CyclePolicy),
    Rule(TaskingRule),
}

impl Pilot {
    /// The indices of the actions of all satellites that need one.
    fn choose(&mut self, run: &mut TaskRun) -> Vec<Option<usize>> {
        (0..run.sim.len())
            .map(|satellite| {
                if !run.needs_action(satellite) {
                    return None;
                }
                let count = run.sim.action_count(satellite);
                match self {
                    Self::Hold => None,
                    Self::Cycle(cycle) => Some(cycle.next(satellite, count)),
                    Self::Rule(rule) => Some(rule.choose(&run.satellite_telemetry(satellite)).index(count)),
                }
            })
            .collect()
    }
}

/// A flight of one pilot.
struct Flight {
    pilot: Pilot,
    run: TaskRun,
    log: ActionLog,
}

/// Flies all pilots from the same start; returns outcomes and actions.
fn fly_all(start: &TaskRun, pilots: Vec<Pilot>) -> Vec<(EpisodeOutcome, ActionLog)> {
    let mut flights: Vec<Flight> = pilots
        .into_iter()
        .map(|pilot| Flight { pilot, run: start.clone(), log: ActionLog::new(1, Precision::F64) })
        .collect();
    loop {
        let mut active: Vec<&mut Flight> =
            flights.iter_mut().filter(|flight| !flight.run.is_done()).collect();
        if active.is_empty() {
            break;
        }
        let actions: Vec<Vec<Option<AgentAction>>> =
            active.iter_mut().map(|flight| flight.choose()).collect();
        let mut sims: Vec<_> = active.iter_mut().map(|flight| &mut flight.run.sim).collect();
        let results = step_all(&mut sims, &actions, InstructionSet::detect());
        for (flight, result) in active.iter_mut().zip(results) {
            flight.run.finish_step(result);
        }
    }
    flights.into_iter().map(|flight| (flight.run.outcome(), flight.log)).collect()
}

impl Flight {
    /// Chooses and logs the actions of the next step.
    fn choose(&mut self) -> Vec<Option<AgentAction>> {
        let indices = self.pilot.choose(&mut self.run);
        for (agent, index) in (0u32..).zip(&indices) {
            if let Some(index) = index {
                self.log.push_entry(agent, &[*index as f64]);
            }
        }
        self.log.end_step();
        self.run.choose(|agent| indices[agent])
    }
}
