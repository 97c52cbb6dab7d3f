//! The mode `full`: data that were recorded while the storage was full.

use super::finding::Finding;
use super::storage::{StoragePeriod, passes_after, station_name};
use super::trace::TaskingTrace;
use crate::critique::Measure;

/// Findings of a satellite: one for each time without sending data in which recorded data were lost.
pub(super) fn find(trace: &TaskingTrace, agent: usize) -> Vec<Finding> {
    let periods = StoragePeriod::all(&trace.satellites[agent]);
    periods.into_iter().filter_map(|period| find_in(trace, agent, period)).collect()
}

fn find_in(trace: &TaskingTrace, agent: usize, period: StoragePeriod) -> Option<Finding> {
    let satellite = &trace.satellites[agent];
    let rejected: Vec<u64> = period.ticks().filter(|tick| satellite.sample(*tick).is_rejected).collect();
    let (first, last) = (*rejected.first()?, *rejected.last()?);
    let (first_s, last_s) = (trace.time_s(first), trace.time_s(last));
    let is_imager = !trace.run.sim.targets().is_empty();
    let lost = rejected.len() as f64 * if is_imager { 1.0 } else { trace.run.sim.tick_length().seconds() };
    let (name, unit) = if is_imager { ("images", "") } else { ("scanned", "s") };
    let what = match (is_imager, rejected.len()) {
        (true, 1) => "1 image was lost".to_owned(),
        (true, images) => format!("{images} images were lost"),
        (false, _) => format!("{lost:.0} s of scanning were lost"),
    };
    let mut measures = vec![
        Measure::new("time", first_s, "s"),
        Measure::new("until", last_s, "s"),
        Measure::new(name, lost, unit),
    ];
    let pass = passes_after(trace, agent, first_s).into_iter().next();
    let advice = match &pass {
        Some(pass) => {
            let wait_s = (pass.open_s - first_s).max(0.0);
            measures.push(Measure::new("next_pass", wait_s, "s"));
            let station = station_name(trace, pass);
            match wait_s > 0.0 {
                true => format!(
                    "the next pass, over {station}, began {wait_s:.0} s later: data sent in an earlier pass would have made room"
                ),
                false => format!("a pass over {station} was open: sending data would have made room"),
            }
        }
        None => "no other pass came: data sent in an earlier one would have made room".to_owned(),
    };
    let explanation = format!(
        "The storage of satellite {agent} was full: {what} from {first_s:.0} s to {last_s:.0} s. At {first_s:.0} s {advice}."
    );
    Some(Finding {
        mode: "full",
        agent,
        tick: first,
        orbit_angle_deg: None,
        loss: lost,
        measures,
        explanation,
    })
}
