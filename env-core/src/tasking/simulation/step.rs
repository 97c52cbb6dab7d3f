//! What follows the ticks of a step: data, rewards, communication and ends.

use std::cmp::Reverse;

use super::TaskingSim;
use super::actions::AgentAction;
use super::communication::{Pair, StepTicks, communication_pairs, share_images};
use super::rewards::{collect, rewards, share_rewards};
use super::run::{run_all, run_one, run_traced};
use crate::tasking::error::TaskingError;
use crate::tasking::setup::environment::{EnvironmentMode, Rewarder};
use crate::tasking::tick::dispatch::InstructionSet;

/// Result of a step.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StepResult {
    /// Duration of the step, s.
    pub elapsed_s: f64,
    /// Reward of each satellite, without penalties.
    pub rewards: Vec<f64>,
    /// Penalty of each satellite.
    pub penalties: Vec<f64>,
    /// True for satellites whose episode ends by the rules.
    pub terminated: Vec<bool>,
    /// True if the time limit is reached.
    pub truncated: bool,
    /// Pairs of satellites that shared data.
    pub pairs: Vec<Pair>,
    /// Targets that were imaged in the step, by satellite.
    pub imaged: Vec<Option<usize>>,
    /// Numbers of satellites that share the reward of the image of each satellite; 0 if it has none that pays.
    pub sharers: Vec<u32>,
    /// Time of the data that each satellite scanned in the step, s.
    pub scanned_s: Vec<f64>,
}

/// Runs a step of several episodes side by side. An episode whose actions are not valid does not take part.
pub fn step_all(
    episodes: &mut [&mut TaskingSim],
    actions: &[Vec<Option<AgentAction>>],
    set: InstructionSet,
) -> Vec<Result<StepResult, TaskingError>> {
    let mut running = Vec::with_capacity(episodes.len());
    let mut errors = Vec::with_capacity(episodes.len());
    for (episode, actions) in episodes.iter_mut().zip(actions) {
        match episode.give_actions(actions).and_then(|()| episode.begin_ticks()) {
            Ok(is_ended) => {
                errors.push(None);
                if !is_ended {
                    running.push(&mut **episode);
                }
            }
            Err(error) => errors.push(Some(error)),
        }
    }
    // The lanes of a block have ticks of one length. Lanes whose bodies point alike share the work of guidance, and long steps that
    // begin first leave fewer lanes idle at the end.
    running.sort_by_key(|episode| {
        let ticks = episode.next_event().map_or(u64::MAX, |event| event - episode.now);
        (episode.setup.clock.tick, episode.agents[0].satellite.is_aligned_with_hill(), Reverse(ticks))
    });
    for group in running.chunk_by_mut(|a, b| a.setup.clock.tick == b.setup.clock.tick) {
        run_all(group, set);
    }
    let finish = |(episode, error): (&mut &mut TaskingSim, Option<TaskingError>)| match error {
        None => episode.finish_step(),
        Some(error) => Err(error),
    };
    episodes.iter_mut().zip(errors).map(finish).collect()
}

impl TaskingSim {
    /// Runs a step with one action for each satellite; `None` lets a satellite go on.
    ///
    /// # Errors
    /// Returns [`TaskingError`] if an action is not valid, or nothing can end the step. The episode has not changed then,
    /// except that the actions are given if nothing can end the step. After [`TaskingError::Diverged`] it cannot go on.
    pub fn step(
        &mut self,
        actions: &[Option<AgentAction>],
        set: InstructionSet,
    ) -> Result<StepResult, TaskingError> {
        self.give_actions(actions)?;
        if !self.begin_ticks()? {
            run_one(self, set);
        }
        self.finish_step()
    }

    /// Runs a step like [`TaskingSim::step`], and calls `observe` after every tick.
    ///
    /// # Errors
    /// Returns the errors of [`TaskingSim::step`].
    pub fn step_traced(
        &mut self,
        actions: &[Option<AgentAction>],
        observe: &mut dyn FnMut(&Self),
    ) -> Result<StepResult, TaskingError> {
        self.give_actions(actions)?;
        if !self.begin_ticks()? {
            run_traced(self, observe);
        }
        self.finish_step()
    }

    /// Collects data, rewards and knowledge after the ticks of a step.
    ///
    /// # Errors
    /// Returns [`TaskingError::Diverged`] if the motion of a satellite is no longer finite.
    pub(super) fn finish_step(&mut self) -> Result<StepResult, TaskingError> {
        self.steps += 1;
        if let Some(agent) = self.agents.iter().find(|agent| !agent.satellite.is_finite()) {
            return Err(TaskingError::Diverged { satellite: agent.name().to_owned() });
        }
        let resources = self.resource_values();
        let are_images_rewarded = self.setup.rewarders.contains(&Rewarder::UniqueImages);
        let mut data: Vec<_> = self
            .agents
            .iter_mut()
            .zip(resources)
            .map(|(agent, resources)| collect(agent, resources, are_images_rewarded))
            .collect();
        share_rewards(&mut data, &mut self.rewarded);
        let rewards = rewards(&self.setup.rewarders, &data, &self.setup.targets);
        self.totals.iter_mut().zip(&rewards).for_each(|(total, reward)| *total += reward);
        let pairs = self.communicate();
        let was_alive: Vec<bool> = self.agents.iter().map(|agent| agent.is_alive).collect();
        let now_s = self.time_s();
        for agent in &mut self.agents {
            agent.is_alive &= agent.satellite.is_alive();
            if let Some(journal) = &mut agent.journal {
                journal.now_s = now_s;
            }
        }
        let truncated = self.time_limit.is_some_and(|limit| self.now >= limit);
        let is_constellation = self.setup.mode == EnvironmentMode::Constellation;
        let mut penalties = vec![0.0; self.agents.len()];
        for ((agent, penalty), was_alive) in self.agents.iter_mut().zip(&mut penalties).zip(&was_alive) {
            if agent.is_alive {
                continue;
            }
            if *was_alive || !is_constellation {
                *penalty = self.setup.failure_penalty;
            }
            if is_constellation && *was_alive {
                agent.delete_events();
            }
        }
        let limit_terminates = truncated && self.setup.clock.terminate_on_time_limit;
        Ok(StepResult {
            elapsed_s: self.setup.clock.tick.time_s(self.now) - self.setup.clock.tick.time_s(self.step_start),
            rewards,
            penalties,
            terminated: self.agents.iter().map(|agent| limit_terminates || !agent.is_alive).collect(),
            truncated,
            pairs,
            imaged: data.iter().map(|new| new.imaged).collect(),
            sharers: data.iter().map(|new| new.sharers).collect(),
            scanned_s: data.iter().map(|new| new.scanned_s).collect(),
        })
    }

    /// Declares a satellite dead that the checks of the simulation call alive. It takes no action any more, and in a constellation it
    /// ends no step.
    pub fn set_dead(&mut self, index: usize) {
        let agent = &mut self.agents[index];
        if agent.is_alive && self.setup.mode == EnvironmentMode::Constellation {
            agent.delete_events();
        }
        agent.is_alive = false;
    }

    /// Lets satellites share data, unless the last time is too recent.
    fn communicate(&mut self) -> Vec<Pair> {
        let time = self.time_s();
        if time - self.last_communication_s < self.setup.communicator.min_period_s {
            return Vec::new();
        }
        let ticks = StepTicks { start: self.step_start, end: self.now, tick: self.setup.clock.tick };
        let pairs = communication_pairs(&self.setup.communicator, &mut self.agents, &ticks, &mut self.sky);
        share_images(&mut self.agents, &pairs);
        self.last_communication_s = time;
        pairs
    }

    /// Values of the rewarded properties of each satellite.
    fn resource_values(&mut self) -> Vec<Vec<f64>> {
        let properties: Vec<_> = self
            .setup
            .rewarders
            .iter()
            .filter_map(|rewarder| match rewarder {
                Rewarder::Resource { property, .. } => Some(*property),
                _ => None,
            })
            .collect();
        (0..self.agents.len())
            .map(|index| {
                let mut values = Vec::new();
                if !properties.is_empty() {
                    let moment = self.moment(index);
                    for property in &properties {
                        let first = values.len();
                        property.write(&self.view(index, &moment), &mut values);
                        values.truncate(first + 1);
                    }
                }
                values
            })
            .collect()
    }

    /// Records the rewarded properties at the start of the episode.
    pub(super) fn log_resources(&mut self) {
        let values = self.resource_values();
        self.agents.iter_mut().zip(values).for_each(|(agent, values)| agent.logged_resources = values);
    }
}
