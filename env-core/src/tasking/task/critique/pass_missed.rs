//! The mode `pass_missed`: a pass over a ground station in which stored data were not sent, before the storage was full.

use super::finding::Finding;
use super::storage::{StoragePeriod, passes_after, station_name};
use super::trace::TaskingTrace;
use crate::critique::Measure;
use crate::tasking::access::Opportunity;

/// Shortest unused time of a pass that counts, s.
const MIN_UNUSED_S: f64 = 30.0;

/// Findings of a satellite: one for each time without sending data in which its storage was full, of the pass with the longest unused
/// time.
pub(super) fn find(trace: &TaskingTrace, agent: usize) -> Vec<Finding> {
    let periods = StoragePeriod::all(&trace.satellites[agent]);
    periods.into_iter().filter_map(|period| find_in(trace, agent, period)).collect()
}

/// A pass with the ticks in which it could have been used.
struct UnusedPass {
    pass: Opportunity,
    unused_s: f64,
    /// The last unused tick.
    last: u64,
}

fn find_in(trace: &TaskingTrace, agent: usize, period: StoragePeriod) -> Option<Finding> {
    let satellite = &trace.satellites[agent];
    let full = period.ticks().find(|tick| satellite.sample(*tick).is_full)?;
    let passes = passes_after(trace, agent, trace.time_s(period.first)).into_iter();
    let unused = passes.filter_map(|pass| unused_pass(trace, agent, period, pass));
    let longest = |best: Option<UnusedPass>, other: UnusedPass| match best {
        Some(best) if best.unused_s >= other.unused_s => Some(best),
        _ => Some(other),
    };
    let UnusedPass { pass, unused_s, last } = unused.fold(None, longest)?;
    let (open_s, close_s, full_s) = (pass.open_s, pass.close_s, trace.time_s(full));
    let station = station_name(trace, &pass);
    Some(Finding {
        mode: "pass_missed",
        agent,
        tick: last,
        orbit_angle_deg: None,
        loss: unused_s,
        measures: vec![
            Measure::new("time", trace.time_s(last), "s"),
            Measure::new("station", pass.object as f64, ""),
            Measure::new("open", open_s, "s"),
            Measure::new("close", close_s, "s"),
            Measure::new("unused", unused_s, "s"),
            Measure::new("full_from", full_s, "s"),
        ],
        explanation: format!(
            "Satellite {agent} passed {station} from {open_s:.0} s to {close_s:.0} s and did not send its data for {unused_s:.0} s of \
             the pass; its storage was full from {full_s:.0} s on. A downlink in the pass would have made room."
        ),
    })
}

/// The time of a pass within a period in which data were stored and the transmitter was off; `None` if it is too short.
fn unused_pass(
    trace: &TaskingTrace,
    agent: usize,
    period: StoragePeriod,
    pass: Opportunity,
) -> Option<UnusedPass> {
    let tick = trace.run.sim.tick_length();
    let satellite = &trace.satellites[agent];
    let first = tick.first_tick_at(pass.open_s)?.max(period.first);
    let until = tick.first_tick_at(pass.close_s)?.min(period.last + 1);
    let is_unused = |tick: &u64| {
        let sample = satellite.sample(*tick);
        sample.has_data && !sample.is_transmitting
    };
    let mut unused = (first..until).filter(is_unused);
    let start = unused.next()?;
    let (count, last) = unused.fold((1_u64, start), |(count, _), tick| (count + 1, tick));
    let unused_s = trace.time_s(count);
    (unused_s >= MIN_UNUSED_S).then_some(UnusedPass { pass, unused_s, last })
}
