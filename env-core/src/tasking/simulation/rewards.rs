//! Rewards of a step.

use super::agent::Agent;
use super::target_set::TargetSet;
use crate::tasking::setup::environment::{Rewarder, Target};

/// New data of a satellite in a step.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct NewData {
    /// Target that was imaged.
    pub imaged: Option<usize>,
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
        scanned_s: if level > old_level { (level - old_level) / baud } else { 0.0 },
        resources: changes,
    }
}

/// Rewards of all satellites for their new data. `rewarded` are the targets that were imaged before.
pub(super) fn rewards(
    rewarders: &[Rewarder],
    data: &[NewData],
    targets: &[Target],
    rewarded: &mut TargetSet,
) -> Vec<f64> {
    let mut rewards = vec![0.0; data.len()];
    let mut resource = 0;
    for rewarder in rewarders {
        for (reward, new) in rewards.iter_mut().zip(data) {
            *reward += match rewarder {
                Rewarder::None => 0.0,
                Rewarder::ScanningTime { value_per_second } => new.scanned_s * value_per_second,
                Rewarder::UniqueImages => image_reward(new, data, targets, rewarded),
                Rewarder::Resource { weight, .. } => {
                    weight * new.resources.get(resource).copied().unwrap_or_default()
                }
            };
        }
        resource += usize::from(matches!(rewarder, Rewarder::Resource { .. }));
    }
    if rewarders.contains(&Rewarder::UniqueImages) {
        data.iter().filter_map(|new| new.imaged).for_each(|target| rewarded.insert(target));
    }
    rewards
}

/// Priority of a target that is imaged for the first time; satellites that image it in the same step share it.
fn image_reward(new: &NewData, data: &[NewData], targets: &[Target], rewarded: &TargetSet) -> f64 {
    let Some(target) = new.imaged.filter(|target| !rewarded.contains(*target)) else { return 0.0 };
    let count = data.iter().filter(|other| other.imaged == Some(target)).count();
    targets.get(target).map_or(0.0, |t| t.priority) / count as f64
}
