//! The mode `low_value`: an image of a target while one of higher priority, which no satellite imaged, was reachable instead.

use std::collections::BTreeSet;

use super::finding::Finding;
use super::fork::{ForkChange, ForkRequest, ForkResult};
use super::trace::{TaskingTrace, TracedImage};
use crate::critique::Measure;

/// Smallest difference of priorities that counts.
const MIN_LOSS: f64 = 0.1;
/// Alternatives of an image that are tried: those of the highest priorities.
const MAX_TRIED: usize = 2;
/// Time that an alternative may take at least, even if the image took less, s.
const MIN_DURATION_S: f64 = 60.0;
/// Largest number of alternatives that are tried in an episode: those with the largest differences.
const MAX_ALTERNATIVES: usize = 400;

/// A target that could have been imaged instead of another one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Alternative {
    agent: usize,
    image: TracedImage,
    /// Target of higher priority.
    target: usize,
    /// Difference of the priorities.
    loss: f64,
    /// The fork that images the target.
    pub request: ForkRequest,
}

/// Alternatives to try, by satellite and image, the highest priority first.
pub(super) fn alternatives(trace: &TaskingTrace) -> Vec<Alternative> {
    let mut found: Vec<Alternative> = Vec::new();
    for agent in 0..trace.satellites.len() {
        for image in &trace.satellites[agent].images {
            found.extend(alternatives_of(trace, agent, image));
        }
    }
    let mut losses: Vec<f64> = found.iter().map(|alternative| alternative.loss).collect();
    losses.sort_by(|a, b| b.total_cmp(a));
    if let Some(least) = losses.get(MAX_ALTERNATIVES) {
        found.retain(|alternative| alternative.loss > *least);
    }
    found
}

fn alternatives_of(trace: &TaskingTrace, agent: usize, image: &TracedImage) -> Vec<Alternative> {
    let targets = trace.run.sim.targets();
    let Some(action) = trace.satellites[agent].actions.get(image.action) else { return Vec::new() };
    let Some(imaged) = targets.get(image.target) else { return Vec::new() };
    let tick = trace.run.sim.tick_length();
    let duration = (image.tick - action.start).max((MIN_DURATION_S / tick.seconds()) as u64);
    let until = (action.start + duration).min(trace.end());
    let until_s = trace.time_s(until);
    let mut better: Vec<Alternative> = Vec::new();
    for window in &action.choices {
        let Some(target) = targets.get(window.object) else { continue };
        let loss = target.priority - imaged.priority;
        let is_new = better.iter().all(|other| other.target != window.object);
        if loss >= MIN_LOSS && is_new && window.open_s < until_s && !trace.is_imaged(window.object) {
            let change = ForkChange::Image { agent, target: window.object, until };
            let request = ForkRequest { step: action.step, change };
            better.push(Alternative { agent, image: *image, target: window.object, loss, request });
        }
    }
    better.sort_by(|a, b| b.loss.total_cmp(&a.loss));
    better.truncate(MAX_TRIED);
    better
}

/// Findings of all satellites: at most one for each image, and one for each target of higher priority.
pub(super) fn find(
    trace: &TaskingTrace,
    alternatives: &[Alternative],
    results: &[ForkResult],
) -> Vec<Finding> {
    let mut findings = Vec::new();
    let (mut last_image, mut missed) = (None, BTreeSet::new());
    for (alternative, result) in alternatives.iter().zip(results) {
        let image = Some((alternative.agent, alternative.image.step));
        if result.has_succeeded() && last_image != image && missed.insert(alternative.target) {
            last_image = image;
            findings.push(finding(trace, alternative));
        }
    }
    findings
}

fn finding(trace: &TaskingTrace, alternative: &Alternative) -> Finding {
    let Alternative { agent, image, target, loss, .. } = *alternative;
    let priority = |index: usize| trace.run.sim.targets().get(index).map_or(0.0, |target| target.priority);
    let (low, high, imaged) = (priority(image.target), priority(target), image.target);
    let start = trace.satellites[agent].actions.get(image.action).map_or(image.tick, |action| action.start);
    let (start_s, time_s) = (trace.time_s(start), trace.time_s(image.tick));
    Finding {
        mode: "low_value",
        agent,
        tick: image.tick,
        orbit_angle_deg: None,
        loss,
        measures: vec![
            Measure::new("time", time_s, "s"),
            Measure::new("tasked", start_s, "s"),
            Measure::new("target", imaged as f64, ""),
            Measure::new("priority", low, ""),
            Measure::new("better_target", target as f64, ""),
            Measure::new("better_priority", high, ""),
        ],
        explanation: format!(
            "Satellite {agent} imaged target {imaged} of priority {low:.2} at {time_s:.0} s. Tasked with target {target} of priority {high:.2} \
             instead at {start_s:.0} s, it would have imaged that one, which no satellite did."
        ),
    }
}
