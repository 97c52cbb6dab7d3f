//! Deaths: their reasons, and the last action after which a satellite could have been kept alive.

use super::finding::Finding;
use super::fork::{ForkChange, ForkRequest, ForkResult};
use super::tasked_action::TaskedAction;
use super::trace::{Death, TaskingTrace};
use crate::critique::Measure;

/// Time after its death for which a satellite must live in a fork, s: an orbit.
const SURVIVAL_S: f64 = 5700.0;

/// Mode and description of a death, from the names of the checks that failed.
pub(in crate::tasking::task) fn death_reason(checks: &str) -> (&'static str, &'static str) {
    let reasons = [
        ("battery_valid", "power", "its battery was empty"),
        ("rw_speeds_valid", "wheels", "a wheel was too fast"),
        ("data_storage_valid", "other", "its storage was full"),
    ];
    let found = reasons.iter().find(|(check, _, _)| checks.contains(check));
    found.map_or(("other", "its orbit was too low"), |(_, mode, reason)| (*mode, *reason))
}

/// The action that could have kept a satellite alive; `None` if there is none.
fn saving_action(death: &Death) -> Option<TaskedAction> {
    match death_reason(&death.checks).0 {
        "power" => Some(TaskedAction::Charge),
        "wheels" => Some(TaskedAction::Desaturate),
        _ => None,
    }
}

/// Forks that try to keep a satellite alive: the saving action repeated from one of its actions on.
pub(super) struct Rescue {
    /// Number of the satellite.
    pub agent: usize,
    /// Ticks at which the forks begin, in the order of their requests.
    pub starts: Vec<u64>,
    /// The forks to run.
    pub requests: Vec<ForkRequest>,
}

impl Rescue {
    /// Rescues of all satellites that died. The forks begin at the last action, at the second, fourth, eighth … before the death, and at
    /// the start of the episode.
    pub(super) fn plan(trace: &TaskingTrace) -> Vec<Self> {
        let mut rescues = Vec::new();
        for (agent, satellite) in trace.satellites.iter().enumerate() {
            let Some(death) = &satellite.death else { continue };
            let Some(kind) = saving_action(death) else { continue };
            let action = kind.index(trace.run.sim.action_count(agent));
            let survival = (SURVIVAL_S / trace.run.sim.tick_length().seconds()) as u64;
            let change = ForkChange::Repeat { agent, action, until: death.tick + survival };
            let given = satellite.actions.iter().rev();
            let mut points: Vec<_> = (1..)
                .zip(given)
                .filter_map(|(back, action): (usize, _)| {
                    back.is_power_of_two().then_some((action.step, action.start))
                })
                .collect();
            if points.last().is_none_or(|(step, _)| *step > 1) {
                points.push((1, 0));
            }
            rescues.push(Self {
                agent,
                starts: points.iter().map(|(_, start)| *start).collect(),
                requests: points.iter().map(|(step, _)| ForkRequest { step: *step, change }).collect(),
            });
        }
        rescues
    }

    /// Tick of the latest rescue that succeeded.
    pub(super) fn last_chance(&self, results: &[ForkResult]) -> Option<u64> {
        let starts = self.starts.iter().zip(results).filter(|(_, result)| result.has_succeeded());
        starts.map(|(start, _)| *start).max()
    }
}

/// Adds the measure and the sentence about the last chance of a satellite.
pub(super) fn add_last_chance(finding: &mut Finding, trace: &TaskingTrace, doing: &str, last: Option<u64>) {
    match last.map(|tick| trace.time_s(tick)) {
        Some(time_s) => {
            finding.measures.push(Measure::new("last_chance", time_s, "s"));
            finding.explanation += &format!(" {doing} from {time_s:.0} s on would have kept it alive.");
        }
        None => {
            finding.explanation += &format!(" {doing} would not have kept it alive, even from the start on.");
        }
    }
}

/// The death of a satellite for a reason other than power and wheels.
pub(super) fn other_death(trace: &TaskingTrace, agent: usize, death: &Death) -> Finding {
    let time_s = trace.time_s(death.tick);
    let reason = death_reason(&death.checks).1;
    Finding {
        mode: "other",
        agent,
        tick: death.tick,
        orbit_angle_deg: None,
        loss: 1.0,
        measures: vec![Measure::new("time", time_s, "s")],
        explanation: format!("Satellite {agent} died at {time_s:.0} s: {reason}."),
    }
}
