//! The mode `duplicate`: the image of a target that another satellite had imaged.

use std::collections::HashMap;

use super::finding::Finding;
use super::trace::{TaskingTrace, TracedImage};
use crate::critique::Measure;

/// An image and the satellite that stored it.
#[derive(Clone, Copy)]
struct SatelliteImage {
    agent: usize,
    image: TracedImage,
}

/// Findings of all satellites: one for each image of a target that is not the first one.
pub(super) fn find(trace: &TaskingTrace) -> Vec<Finding> {
    let mut images: Vec<SatelliteImage> = Vec::new();
    for (agent, satellite) in trace.satellites.iter().enumerate() {
        images.extend(satellite.images.iter().map(|image| SatelliteImage { agent, image: *image }));
    }
    images.sort_by_key(|found| (found.image.tick, found.agent));
    let mut firsts: HashMap<usize, SatelliteImage> = HashMap::new();
    let mut findings = Vec::new();
    for found in images {
        match firsts.get(&found.image.target) {
            Some(first) if first.agent != found.agent => findings.extend(find_image(trace, first, &found)),
            Some(_) => {}
            None => {
                firsts.insert(found.image.target, found);
            }
        }
    }
    findings
}

fn find_image(trace: &TaskingTrace, first: &SatelliteImage, second: &SatelliteImage) -> Option<Finding> {
    let SatelliteImage { agent, image } = second;
    let target = image.target;
    let priority = trace.run.sim.targets().get(target)?.priority;
    let tasked = trace.satellites[*agent].actions.get(image.action)?.start;
    let [time_s, first_s, tasked_s] = [image.tick, first.image.tick, tasked].map(|tick| trace.time_s(tick));
    let is_preventable = first.image.tick <= tasked;
    let advice = if is_preventable {
        format!(
            "before satellite {agent} was tasked at {tasked_s:.0} s: with data shared in between, it would have chosen another one"
        )
    } else {
        format!(
            "after satellite {agent} was tasked at {tasked_s:.0} s: no communication could have prevented it, only different choices"
        )
    };
    let other = first.agent;
    Some(Finding {
        mode: "duplicate",
        agent: *agent,
        tick: image.tick,
        orbit_angle_deg: None,
        loss: priority,
        measures: vec![
            Measure::new("time", time_s, "s"),
            Measure::new("target", target as f64, ""),
            Measure::new("priority", priority, ""),
            Measure::new("first_satellite", other as f64, ""),
            Measure::new("first_time", first_s, "s"),
            Measure::new("tasked", tasked_s, "s"),
            Measure::new("preventable", f64::from(u8::from(is_preventable)), ""),
        ],
        explanation: format!(
            "Satellite {agent} imaged target {target} of priority {priority:.2} at {time_s:.0} s, for nothing. Satellite {other} imaged it \
             at {first_s:.0} s, {advice}."
        ),
    })
}
