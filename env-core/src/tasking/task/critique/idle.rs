//! The mode `idle`: actions that gained nothing, so that their time was lost for scans or images.

use super::finding::Finding;
use super::sample::TickSample;
use super::tasked_action::TaskedAction;
use super::trace::{TaskingTrace, TracedAction};
use crate::critique::Measure;
use crate::tasking::access::OpportunityKind;

/// Share of an action's ticks in eclipse, or with a full battery, from which it is idle.
const IDLE_SHARE: f64 = 0.9;
/// Share of the battery below which the charge must not fall before the battery is full again, so that rest in eclipse was for nothing.
const RESERVE: f64 = 0.2;
/// Speed of the fastest wheel, as a share of the limit, below which wheels count as empty.
const EMPTY_WHEELS: f64 = 0.1;
/// Joules of a watt-hour.
const J_PER_WH: f64 = 3600.0;

/// Reason why an action gained nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum IdleReason {
    EmptyWheels,
    FullBattery,
    Eclipse,
}

/// Idle actions that follow each other for the same reason.
struct IdleTime {
    reason: IdleReason,
    start: u64,
    end: u64,
}

/// Findings of a satellite: one for each uninterrupted time of idle actions with the same reason.
pub(super) fn find(trace: &TaskingTrace, agent: usize) -> Vec<Finding> {
    let mut times: Vec<IdleTime> = Vec::new();
    for action in &trace.satellites[agent].actions {
        let Some(reason) = idle_reason(trace, agent, action) else { continue };
        match times.last_mut().filter(|last| last.reason == reason && last.end == action.start) {
            Some(last) => last.end = action.end,
            None => times.push(IdleTime { reason, start: action.start, end: action.end }),
        }
    }
    times.iter().map(|time| finding(trace, agent, time)).collect()
}

fn idle_reason(trace: &TaskingTrace, agent: usize, action: &TracedAction) -> Option<IdleReason> {
    let satellite = &trace.satellites[agent];
    let start = satellite.sample(action.start);
    if start.is_full || !has_work(trace, agent, action) {
        return None;
    }
    let share = |holds: fn(&TickSample) -> bool| {
        let ticks = action.start + 1..=action.end;
        let count = ticks.clone().filter(|tick| holds(&satellite.sample(*tick))).count() as f64;
        count / (ticks.count().max(1) as f64)
    };
    match action.kind {
        TaskedAction::Desaturate if f64::from(start.wheel_share) < EMPTY_WHEELS => {
            Some(IdleReason::EmptyWheels)
        }
        TaskedAction::Charge if share(|sample| sample.is_charged) >= IDLE_SHARE => {
            Some(IdleReason::FullBattery)
        }
        TaskedAction::Charge if share(|sample| sample.is_dark) >= IDLE_SHARE => {
            let capacity = trace.run.sim.satellite(agent).spec().args.battery_capacity_ws;
            let lowest = lowest_charge_j(trace, agent, action.end);
            (lowest >= RESERVE * capacity).then_some(IdleReason::Eclipse)
        }
        _ => None,
    }
}

/// True if the satellite could have worked: scanned, or imaged a target that no satellite imaged.
fn has_work(trace: &TaskingTrace, agent: usize, action: &TracedAction) -> bool {
    let sim = &trace.run.sim;
    if sim.targets().is_empty() {
        return true;
    }
    let (start_s, end_s) = (trace.time_s(action.start), trace.time_s(action.end));
    let mut upcoming = sim.opportunities(agent).upcoming(OpportunityKind::Target, start_s).iter();
    upcoming.any(|window| window.open_s < end_s && !trace.is_imaged(window.object))
}

/// The lowest charge of a battery from a tick until it is full, or to the end of the episode, J.
fn lowest_charge_j(trace: &TaskingTrace, agent: usize, from: u64) -> f64 {
    let satellite = &trace.satellites[agent];
    let samples = (from..=trace.end()).map(|tick| satellite.sample(tick));
    let lowest =
        samples.take_while(|sample| !sample.is_charged).fold(f32::INFINITY, |low, x| low.min(x.battery_j));
    f64::from(lowest.min(satellite.sample(from).battery_j))
}

fn finding(trace: &TaskingTrace, agent: usize, time: &IdleTime) -> Finding {
    let satellite = &trace.satellites[agent];
    let start = satellite.sample(time.start);
    let (from_s, to_s) = (trace.time_s(time.start), trace.time_s(time.end));
    let lost_s = to_s - from_s;
    let mut measures = vec![Measure::new("time", from_s, "s"), Measure::new("idle", lost_s, "s")];
    let charge_wh = f64::from(start.battery_j) / J_PER_WH;
    let what = match time.reason {
        IdleReason::EmptyWheels => {
            let share = 100.0 * f64::from(start.wheel_share);
            measures.push(Measure::new("wheel_speed", share, "%"));
            format!("desaturated although its fastest wheel had only {share:.0} % of the largest speed")
        }
        IdleReason::FullBattery => {
            measures.push(Measure::new("charge", charge_wh, "W·h"));
            format!("charged although its battery was full ({charge_wh:.1} W·h)")
        }
        IdleReason::Eclipse => {
            let lowest_wh = lowest_charge_j(trace, agent, time.end) / J_PER_WH;
            measures.push(Measure::new("charge", charge_wh, "W·h"));
            measures.push(Measure::new("lowest_charge", lowest_wh, "W·h"));
            format!(
                "charged in eclipse although its battery held {charge_wh:.1} W·h, and later never less than {lowest_wh:.1} W·h before it was \
                 full again or the episode ended"
            )
        }
    };
    let work = if trace.run.sim.targets().is_empty() { "scan" } else { "image targets" };
    Finding {
        mode: "idle",
        agent,
        tick: time.start + 1, // the first one of the step
        orbit_angle_deg: None,
        loss: lost_s,
        measures,
        explanation: format!(
            "Satellite {agent} {what}, from {from_s:.0} s to {to_s:.0} s: it had {lost_s:.0} s to {work} instead."
        ),
    }
}
