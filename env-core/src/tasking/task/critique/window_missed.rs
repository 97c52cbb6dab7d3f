//! The mode `window_missed`: the window of a tasked target that closed without an image.

use super::finding::Finding;
use super::settling::MAX_SETTLING_S;
use super::trace::{MissedWindow, TaskingTrace};
use crate::critique::Measure;

/// Findings of a satellite: one for each missed window.
pub(super) fn find(trace: &TaskingTrace, agent: usize) -> Vec<Finding> {
    trace.satellites[agent].misses.iter().filter_map(|miss| find_miss(trace, agent, miss)).collect()
}

fn find_miss(trace: &TaskingTrace, agent: usize, miss: &MissedWindow) -> Option<Finding> {
    let action = trace.satellites[agent].actions.get(miss.action)?;
    let priority = trace.run.sim.targets().get(miss.target)?.priority;
    let tasked_s = trace.time_s(action.start);
    let (target, slew) = (miss.target, action.slew_deg);
    let left_s = (miss.close_s - tasked_s).max(0.0);
    let mut measures = vec![
        Measure::new("time", trace.time_s(miss.tick), "s"),
        Measure::new("target", target as f64, ""),
        Measure::new("priority", priority, ""),
        Measure::new("tasked", tasked_s, "s"),
        Measure::new("open", miss.open_s, "s"),
        Measure::new("close", miss.close_s, "s"),
        Measure::new("slew", slew, "°"),
    ];
    measures.extend(miss.short_s.map(|short_s| Measure::new("short", short_s, "s")));
    let advice = match miss.short_s {
        Some(short_s) => {
            format!(
                "it was {short_s:.0} s short. Tasked {short_s:.0} s earlier, or with a target nearer to its instrument's direction, it would have stored an image"
            )
        }
        None => format!(
            "it was more than {MAX_SETTLING_S:.0} s short. A target nearer to its instrument's direction would have helped"
        ),
    };
    Some(Finding {
        mode: "window_missed",
        agent,
        tick: miss.tick,
        orbit_angle_deg: None,
        loss: priority,
        measures,
        explanation: format!(
            "Satellite {agent} did not image target {target} of priority {priority:.2}: tasked at {tasked_s:.0} s, {left_s:.0} s before the \
             window closed, it had to turn its instrument by {slew:.0}°, and {advice}."
        ),
    })
}
