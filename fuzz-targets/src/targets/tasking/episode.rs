//! Runs an episode of any options, and checks its laws.

use std::collections::BTreeSet;

use env_core::tasking::error::TaskingError;
use env_core::tasking::setup::Setup;
use env_core::tasking::setup::actions::ActionSpec;
use env_core::tasking::setup::environment::{Links, Rewarder, SatelliteClass};
use env_core::tasking::simulation::{AgentAction, StepResult, TaskingSim};

use super::options::ByteOptions;
use super::setups::read_setup;

/// Steps of an episode.
const STEPS: usize = 10;

/// Options and events of episodes, by their names.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct EpisodeCoverage {
    /// Names of all that was seen.
    pub seen: BTreeSet<&'static str>,
}

impl EpisodeCoverage {
    fn note(&mut self, is_seen: bool, name: &'static str) {
        if is_seen {
            self.seen.insert(name);
        }
    }

    fn note_setup(&mut self, setup: &Setup) {
        let rewarders = &setup.rewarders;
        let is_resource = |rewarder: &Rewarder| matches!(rewarder, Rewarder::Resource { .. });
        let is_scanning = |rewarder: &Rewarder| matches!(rewarder, Rewarder::ScanningTime { .. });
        self.note(rewarders.contains(&Rewarder::None), "NoReward");
        self.note(rewarders.iter().any(is_resource), "ResourceReward");
        self.note(rewarders.iter().any(is_scanning), "ScanningTimeReward");
        self.note(rewarders.contains(&Rewarder::UniqueImages), "UniqueImageReward");
        self.note(rewarders.len() > 1, "several rewarders");
        self.note(setup.targets.iter().any(|target| target.name.starts_with("city")), "cities");
        let clock = &setup.clock;
        self.note(clock.time_limit_s < clock.max_step_s, "time limit below the longest step");
        self.note(setup.communicator.multi_degree, "MultiDegreeCommunication");
        self.note(setup.communicator.links == Links::LineOfSight, "LOSCommunication");
        let models = |index: usize| {
            let satellite = &setup.agents[index].satellite;
            (satellite.dynamics, satellite.software)
        };
        let is_mixed = (1..setup.agents.len()).any(|index| models(index) != models(0));
        self.note(is_mixed, "heterogeneous satellites");
        for agent in &setup.agents {
            let (dynamics, software) = (agent.satellite.dynamics, agent.satellite.software);
            self.note(agent.class == SatelliteClass::Plain, "Satellite");
            self.note(matches!(agent.class, SatelliteClass::Access(_)), "AccessSatellite");
            self.note(matches!(agent.class, SatelliteClass::Imaging(_)), "ImagingSatellite");
            self.note(!dynamics.instrument, "BasicDynamicsModel");
            self.note(!software.imaging && !software.steering, "BasicFSWModel");
            self.note(!software.imaging && software.steering, "SteeringFSWModel");
            self.note(software.continuous, "ContinuousImagingFSWModel");
            self.note(agent.satellite.records_always(), "instrument without commands");
            for (action, name) in agent.actions.iter().map(|action| (action, action_name(action))) {
                self.note(true, name);
                let resets = matches!(action, ActionSpec::Software { reset_task: true, .. });
                self.note(resets && name != "Desat", "DiscreteFSWAction with reset_task");
            }
        }
    }
}

const fn action_name(action: &ActionSpec) -> &'static str {
    use env_core::tasking::setup::actions::SoftwareAction;
    match action {
        ActionSpec::Image { .. } => "Image",
        ActionSpec::Broadcast { .. } => "Broadcast",
        ActionSpec::Software { action, .. } => match action {
            SoftwareAction::Scan => "Scan",
            SoftwareAction::Charge => "Charge",
            SoftwareAction::Downlink => "Downlink",
            SoftwareAction::Desaturate => "Desat",
            SoftwareAction::NadirPoint => "NadirPoint",
            SoftwareAction::Drift => "Drift",
        },
    }
}

/// Runs the episode of these bytes. Returns what it had, or `None` if the set-up is not valid.
///
/// In an episode through any options, all numbers are finite, resources and rewards stay within their bounds, and the battery of
/// each satellite is the sum of its net power.
///
/// # Panics
/// If a law is violated.
#[must_use]
pub fn fly_episode(bytes: &[u8]) -> Option<EpisodeCoverage> {
    let mut options = ByteOptions(bytes);
    let setup = read_setup(&mut options);
    let mut sim = match TaskingSim::new(setup.clone()) {
        Ok(sim) => sim,
        Err(error) => {
            assert!(error.to_string().len() < 8192);
            return None;
        }
    };
    let mut coverage = EpisodeCoverage::default();
    coverage.note_setup(&setup);
    for _ in 0..STEPS {
        let actions = read_actions(&sim, &mut options);
        let before = resource_values(&setup, &mut sim);
        match step(&mut sim, actions, &mut coverage) {
            Ok(result) => {
                check_step(&setup, &mut sim, &result, &before);
                note_step(&setup, &sim, &result, &mut coverage);
                if result.truncated || (0..sim.len()).all(|index| !sim.is_alive(index)) {
                    break;
                }
            }
            Err(TaskingError::NoOpportunity { .. } | TaskingError::EndlessStep) => break,
            // Unlimited torques or long ticks make control unstable.
            Err(TaskingError::Diverged { .. }) => break,
            Err(error) => panic!("{error}"),
        }
        check_observations(&mut sim);
    }
    Some(coverage)
}

fn note_step(setup: &Setup, sim: &TaskingSim, result: &StepResult, coverage: &mut EpisodeCoverage) {
    coverage.note(!result.pairs.is_empty(), "communication");
    coverage.note(setup.communicator.broadcast && !result.pairs.is_empty(), "communication by broadcast");
    coverage.note(result.imaged.iter().any(Option::is_some), "images");
    coverage.note(result.scanned_s.iter().any(|seconds| *seconds > 0.0), "scanned data");
    coverage.note((0..sim.len()).any(|index| !sim.is_alive(index)), "deaths");
    coverage.note(result.truncated, "time limits");
    coverage.note(result.rewards.iter().any(|reward| *reward < 0.0), "negative rewards");
}

/// Actions of all satellites that need one, and now and then of others; some name a target.
fn read_actions(sim: &TaskingSim, options: &mut ByteOptions<'_>) -> Vec<Option<AgentAction>> {
    (0..sim.len())
        .map(|index| {
            let byte = options.byte();
            let acts = sim.needs_action(index) || byte > 200;
            let action = match options.byte() {
                // A target from the list of those with windows, or any.
                0..=20 if !sim.targets().is_empty() => {
                    AgentAction::Target(usize::from(byte) % sim.targets().len())
                }
                21..=60 => match sim.opportunities(index).all().get(usize::from(byte) % 8) {
                    Some(window) => AgentAction::Target(window.object),
                    None => AgentAction::Index(0),
                },
                _ => AgentAction::Index(usize::from(byte) % sim.action_count(index)),
            };
            acts.then_some(action)
        })
        .collect()
}

/// Runs a step tick by tick. Actions that are refused change nothing, and the step runs without those that name a target.
fn step(
    sim: &mut TaskingSim,
    mut actions: Vec<Option<AgentAction>>,
    coverage: &mut EpisodeCoverage,
) -> Result<StepResult, TaskingError> {
    let is_target = |action: &Option<AgentAction>| matches!(action, Some(AgentAction::Target(_)));
    let (hash, names_target) = (sim.state_hash(), actions.iter().any(is_target));
    match step_with_energy(sim, &actions) {
        Err(TaskingError::Action { .. }) if names_target => {
            assert_eq!(sim.state_hash(), hash, "a refused action changes the episode");
            coverage.note(true, "refused target");
            for action in actions.iter_mut().filter(|action| is_target(action)) {
                *action = Some(AgentAction::Index(0));
            }
            step_with_energy(sim, &actions)
        }
        result => {
            coverage.note(names_target && result.is_ok(), "action by target");
            result
        }
    }
}

/// Runs a step tick by tick, and compares the battery of each satellite with the sum of its net power.
fn step_with_energy(
    sim: &mut TaskingSim,
    actions: &[Option<AgentAction>],
) -> Result<StepResult, TaskingError> {
    let mut charges: Vec<f64> = (0..sim.len()).map(|index| sim.satellite(index).battery_ws()).collect();
    let mut before = sim.time_s();
    sim.step_traced(actions, &mut |sim| {
        // Lengths of ticks are whole numbers of nanoseconds.
        let step_s = sim.time_s() - before;
        before = sim.time_s();
        for (index, charge) in charges.iter_mut().enumerate() {
            let satellite = sim.satellite(index);
            if satellite.is_finite() {
                let capacity = satellite.spec().args.battery_capacity_ws;
                let expected = (*charge + satellite.net_power_w() * step_s).clamp(0.0, capacity);
                let difference = (expected - satellite.battery_ws()).abs();
                let name = satellite.name();
                assert!(
                    difference <= 1e-6 * capacity.max(1.0),
                    "the battery of {name} differs by {difference} J"
                );
            }
            *charge = satellite.battery_ws();
        }
    })
}

/// Values of the rewarded properties of each satellite.
fn resource_values(setup: &Setup, sim: &mut TaskingSim) -> Vec<Vec<f64>> {
    let mut all = Vec::new();
    for index in 0..sim.len() {
        let moment = sim.moment(index);
        let mut values = Vec::new();
        for rewarder in &setup.rewarders {
            if let Rewarder::Resource { property, .. } = rewarder {
                let first = values.len();
                property.write(&sim.view(index, &moment), &mut values);
                values.truncate(first + 1);
            }
        }
        all.push(values);
    }
    all
}

fn check_step(setup: &Setup, sim: &mut TaskingSim, result: &StepResult, before: &[Vec<f64>]) {
    assert!(result.elapsed_s >= 0.0 && result.elapsed_s.is_finite(), "{}", result.elapsed_s);
    let after = resource_values(setup, sim);
    for index in 0..sim.len() {
        let satellite = sim.satellite(index);
        let args = &satellite.spec().args;
        let battery = satellite.battery_ws();
        assert!((0.0..=args.battery_capacity_ws).contains(&battery), "battery {battery}");
        let stored: f64 = satellite.stored().iter().sum();
        assert!((0.0..=args.storage_capacity_bits).contains(&stored), "stored {stored}");
        let penalty = result.penalties[index];
        assert!(penalty == 0.0 || penalty == setup.failure_penalty, "penalty {penalty}");
        check_reward(setup, result, index, &before[index], &after[index]);
    }
}

/// A reward is the sum of the changes of resources by their weights, and of what images and scanned data pay at most.
fn check_reward(setup: &Setup, result: &StepResult, index: usize, before: &[f64], after: &[f64]) {
    let tick_s = setup.clock.tick.seconds();
    let (mut changes, mut rounding, mut most, mut resource) = (0.0, 1e-9, 0.0, 0);
    for rewarder in &setup.rewarders {
        match rewarder {
            Rewarder::None => {}
            Rewarder::Resource { weight, .. } => {
                changes += weight * (after[resource] - before[resource]);
                rounding += 1e-9 * (weight * after[resource]).abs().max((weight * before[resource]).abs());
                resource += 1;
            }
            Rewarder::UniqueImages => {
                most += setup.targets.iter().map(|target| target.priority).fold(0.0, f64::max);
            }
            // An image of a tick has the data of a second.
            Rewarder::ScanningTime { value_per_second } => {
                most += value_per_second * result.elapsed_s * (1.0 / tick_s).max(1.0) * (1.0 + 1e-6);
            }
        }
    }
    let paid = result.rewards[index] - changes;
    assert!((-rounding..=most + rounding).contains(&paid), "{paid} beside {changes}, at most {most}");
}

fn check_observations(sim: &mut TaskingSim) {
    let mut values = Vec::new();
    for index in 0..sim.len() {
        values.clear();
        match sim.observe(index, &mut values) {
            Ok(()) => assert_eq!(values.len(), sim.observation_columns(index).len()),
            Err(TaskingError::NoOpportunity { .. }) => {}
            Err(error) => panic!("{error}"),
        }
        assert!(values.iter().all(|value| value.is_finite()), "{values:?}");
    }
}
