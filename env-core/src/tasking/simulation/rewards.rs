//! Rewards of a step.

use super::agent::Agent;
use super::target_set::TargetSet;
use crate::tasking::setup::environment::{Rewarder, Target};

/// New data of a satellite in a step.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct NewData {
    /// Target that was imaged.
    pub imaged: Option<usize>,
    /// Number of satellites that share the reward of the image; 0 if it pays nothing.
    pub sharers: u32,
    /// Time of scanned data, s.
    pub scanned_s: f64,
    /// Changes of the rewarded properties.
    pub resources: Vec<f64>,
}

/// New data of a satellite since the last step. `resources` are the values of the rewarded properties now. Images are known only
/// if they are rewarded.
pub(super) fn collect(agent: &mut Agent, resources: Vec<f64>, are_images_rewarded: bool) -> NewData {
    let [stored, other] = agent.satellite.stored();
    let [old_stored, old_level] = agent.logged_bits;
    let level = stored + other;
    let baud = agent.setup.satellite.args.instrument_bits;
    let changes = resources.iter().zip(&agent.logged_resources).map(|(new, old)| new - old).collect();
    agent.logged_bits = [stored, level];
    agent.logged_resources = resources;
    let has_image = are_images_rewarded && stored > old_stored;
    let imaged = if has_image { agent.latest_target } else { None };
    if let Some(target) = imaged {
        agent.imaged.insert(target);
    }
    NewData {
        imaged,
        sharers: 0,
        scanned_s: if level > old_level { (level - old_level) / baud } else { 0.0 },
        resources: changes,
    }
}

/// Counts the satellites that share the reward of each image. Those that image a target in the same step share it; a target that was
/// imaged before, and is therefore in `rewarded`, pays nothing. Adds the imaged targets to `rewarded`.
pub(super) fn share_rewards(data: &mut [NewData], rewarded: &mut TargetSet) {
    let images: Vec<usize> = data.iter().filter_map(|new| new.imaged).collect();
    for new in data {
        if let Some(target) = new.imaged.filter(|target| !rewarded.contains(*target)) {
            new.sharers = images.iter().map(|image| u32::from(*image == target)).sum();
        }
    }
    images.into_iter().for_each(|target| rewarded.insert(target));
}

/// Rewards of all satellites for their new data.
pub(super) fn rewards(rewarders: &[Rewarder], data: &[NewData], targets: &[Target]) -> Vec<f64> {
    let mut rewards = vec![0.0; data.len()];
    let mut resource = 0;
    for rewarder in rewarders {
        for (reward, new) in rewards.iter_mut().zip(data) {
            *reward += match rewarder {
                Rewarder::None => 0.0,
                Rewarder::ScanningTime { value_per_second } => new.scanned_s * value_per_second,
                Rewarder::UniqueImages => image_reward(new, targets),
                Rewarder::Resource { weight, .. } => {
                    weight * new.resources.get(resource).copied().unwrap_or_default()
                }
            };
        }
        resource += usize::from(matches!(rewarder, Rewarder::Resource { .. }));
    }
    rewards
}

/// Share of a satellite in the priority of its image.
fn image_reward(new: &NewData, targets: &[Target]) -> f64 {
    match new.imaged.and_then(|target| targets.get(target)) {
        Some(target) if new.sharers > 0 => target.priority / f64::from(new.sharers),
        _ => 0.0,
    }
}
