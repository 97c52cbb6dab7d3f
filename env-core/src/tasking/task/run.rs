//! An episode of a task: the simulation with the rules of scores and ends.

use super::motion::StepMotion;
use super::task_setup::TaskSetup;
use crate::bracket::EpisodeOutcome;
use crate::episode_rng::SeededRng;
use crate::error::{ScenarioError, StepError};
use crate::log::JointAction;
use crate::seed::Seed;
use crate::tasking::access::OpportunityKind;
use crate::tasking::error::TaskingError;
use crate::tasking::setup::environment::Rewarder;
use crate::tasking::simulation::{AgentAction, StepResult, TaskingSim};
use crate::tasking::tick::dispatch::InstructionSet;

/// An episode of a task.
#[derive(Debug, Clone)]
pub(super) struct TaskRun {
    pub(super) setup: TaskSetup,
    pub(super) sim: TaskingSim,
    /// Divisor of rewards: the value of all targets in view for imagers, else 1.
    pub(super) value_in_view: f64,
    /// Agents that died so far.
    dead: Vec<bool>,
    /// Sum of the team's rewards.
    total: f64,
    is_truncated: bool,
    last: LastStep,
    /// Index of the last action of each agent.
    current: Vec<Option<usize>>,
}

/// Result of the last step.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct LastStep {
    /// Reward of the team.
    pub(super) reward: f64,
    /// Reward of each agent.
    pub(super) rewards: Vec<f64>,
    /// Agents that were alive before the step.
    pub(super) were_alive: Vec<bool>,
    /// Duration of the step, s.
    pub(super) elapsed_s: f64,
    /// Names of the checks that failed for agents that died in the step.
    pub(super) deaths: Vec<(usize, String)>,
    /// Images as pairs of agent and target.
    pub(super) imaged: Vec<[usize; 2]>,
    /// Pairs of agents that shared data at the end of the step.
    pub(super) links: Vec<[usize; 2]>,
}

impl TaskRun {
    /// Draws the scenario of a seed and starts it.
    ///
    /// # Errors
    /// Returns [`ScenarioError::Unfair`] if the simulation cannot start.
    pub(super) fn start(setup: TaskSetup, seed: Seed) -> Result<Self, ScenarioError> {
        let drawn = setup.draw(&mut SeededRng::new(seed));
        let is_imaging = drawn.rewarders.contains(&Rewarder::UniqueImages);
        let mut sim = TaskingSim::new(drawn).map_err(|error| ScenarioError::Unfair {
            field: "params".to_owned(),
            reason: error.to_string(),
        })?;
        sim.observe_independently();
        let value_in_view = if is_imaging { value_in_view(&sim) } else { 1.0 };
        let count = sim.len();
        Ok(Self {
            setup,
            sim,
            value_in_view,
            dead: vec![false; count],
            total: 0.0,
            is_truncated: false,
            current: vec![None; count],
            last: LastStep {
                rewards: vec![0.0; count],
                were_alive: vec![true; count],
                ..LastStep::default()
            },
        })
    }

    /// Takes over the state of another copy of the same episode.
    pub(super) fn copy_state_from(&mut self, other: &Self) {
        self.sim.copy_state_from(&other.sim);
        self.dead.clone_from(&other.dead);
        self.total = other.total;
        self.is_truncated = other.is_truncated;
        self.current.clone_from(&other.current);
        self.last.clone_from(&other.last);
    }

    /// A copy of the episode with one of its satellites only, for whose actions the others do not matter.
    pub(super) fn only(&self, agent: usize) -> Self {
        Self {
            setup: self.setup.clone(),
            sim: self.sim.only(agent),
            value_in_view: self.value_in_view,
            dead: vec![self.dead[agent]],
            total: 0.0,
            is_truncated: self.is_truncated,
            current: vec![self.current[agent]],
            last: LastStep { rewards: vec![0.0], were_alive: vec![!self.dead[agent]], ..LastStep::default() },
        }
    }

    /// True if the episode is over.
    pub(super) fn is_done(&self) -> bool {
        self.is_truncated || self.dead.iter().all(|dead| *dead)
    }

    /// True if the time limit ended the episode.
    pub(super) const fn is_truncated(&self) -> bool {
        self.is_truncated
    }

    /// True if an agent is dead.
    pub(super) fn is_dead(&self, agent: usize) -> bool {
        self.dead.get(agent).copied().unwrap_or(true)
    }

    /// True if an agent needs a new action.
    pub(super) fn needs_action(&self, agent: usize) -> bool {
        !self.is_done() && !self.is_dead(agent) && self.sim.needs_action(agent)
    }

    /// Result of the last step.
    pub(super) const fn last_step(&self) -> &LastStep {
        &self.last
    }

    /// Actions of the simulation by the index of each agent's action; `None` lets an agent go on. Actions of dead agents are left
    /// out, and those of busy ones unless the option lets them count.
    pub(super) fn choose(
        &mut self,
        mut index_of: impl FnMut(usize) -> Option<usize>,
    ) -> Vec<Option<AgentAction>> {
        (0..self.sim.len())
            .map(|agent| {
                let accepts = !self.dead[agent] && (self.setup.retasks_busy || self.sim.needs_action(agent));
                let index = index_of(agent).filter(|_| accepts);
                self.current[agent] = index.or(self.current[agent]);
                index.map(AgentAction::Index)
            })
            .collect()
    }

    /// Index of the last action of an agent; `None` before the first.
    pub(super) fn current_action(&self, agent: usize) -> Option<usize> {
        self.current[agent]
    }

    /// Actions of the simulation by the entries of a step.
    ///
    /// # Errors
    /// Returns an error if the episode is over, or an entry is not an action of this task.
    pub(super) fn read_actions(
        &mut self,
        action: JointAction<'_>,
    ) -> Result<Vec<Option<AgentAction>>, StepError> {
        if self.is_done() {
            return Err(StepError::Ended { step: self.sim.steps() });
        }
        action.check(1, Some(self.sim.len()))?;
        let mut indices = vec![None; self.sim.len()];
        for (&agent, &value) in action.agents.iter().zip(action.values) {
            let count = self.sim.action_count(agent as usize);
            let index = value as usize;
            if value < 0.0 || index as f64 != value || index >= count {
                return Err(StepError::UnknownAction { agent, value, last: count - 1 });
            }
            indices[agent as usize] = Some(index);
        }
        Ok(self.choose(|agent| indices[agent]))
    }

    /// Runs one step with these actions.
    pub(super) fn step(&mut self, actions: &[Option<AgentAction>]) {
        let result = self.sim.step(actions, InstructionSet::detect());
        self.finish_step(result);
    }

    /// Runs one step with these actions, and samples the motion within it.
    pub(super) fn step_sampled(&mut self, actions: &[Option<AgentAction>], motion: &mut StepMotion) {
        motion.clear();
        let start_s = self.sim.time_s();
        self.step_observed(actions, &mut |sim| motion.sample(sim, start_s));
        motion.finish(&self.sim);
    }

    /// Runs one step with these actions, and calls `observe` after every tick.
    pub(super) fn step_observed(
        &mut self,
        actions: &[Option<AgentAction>],
        observe: &mut dyn FnMut(&TaskingSim),
    ) {
        let result = self.sim.step_traced(actions, observe);
        self.finish_step(result);
    }

    /// Counts the result of a step.
    pub(super) fn finish_step(&mut self, result: Result<StepResult, TaskingError>) {
        let Ok(result) = result else {
            // Actions are checked before, and the longest duration ends every step; a fault would end the episode.
            self.is_truncated = true;
            self.last.reward = 0.0;
            self.last.elapsed_s = 0.0;
            self.last.rewards.fill(0.0);
            self.last.deaths.clear();
            return;
        };
        let count = self.sim.len();
        self.last.elapsed_s = result.elapsed_s;
        self.last.deaths.clear();
        self.last.reward = 0.0;
        for agent in 0..count {
            self.last.were_alive[agent] = !self.dead[agent];
            // A satellite that is dead may still store an image; it earns nothing.
            let earned = if self.dead[agent] { 0.0 } else { result.rewards[agent] / self.value_in_view };
            self.last.reward += earned;
            self.last.rewards[agent] = earned;
            if !self.dead[agent] && !self.sim.is_alive(agent) {
                self.dead[agent] = true;
                self.last.rewards[agent] -= 1.0;
                self.last.reward -= 1.0 / count as f64;
                self.last.deaths.push((agent, self.sim.satellite(agent).failures().join(", ")));
            }
        }
        let images = result.imaged.iter().enumerate().filter_map(|(agent, target)| Some([agent, (*target)?]));
        self.last.imaged.clear();
        self.last.imaged.extend(images);
        self.last.links.clear();
        self.last.links.extend_from_slice(&result.pairs);
        self.total += self.last.reward;
        self.is_truncated = result.truncated;
    }

    /// The outcome so far.
    pub(super) fn outcome(&self) -> EpisodeOutcome {
        EpisodeOutcome {
            // Shares that sum up to one may exceed it by rounding.
            score: self.total.clamp(-1.0, 1.0),
            total_reward: self.total,
            steps: self.sim.steps(),
            lost: self.dead.iter().filter(|dead| **dead).count() as u32,
            goal: None,
            fuel_used: 0.0,
            time_s: Some(self.sim.time_s()),
        }
    }

    /// Writes the observations of all agents, `agents × values`; those of dead and absent agents are zero.
    pub(super) fn observe(&mut self, memory: &mut Vec<f64>, out: &mut [f32], agents: usize) {
        out.fill(0.0);
        let width = out.len() / agents.max(1);
        for agent in 0..self.sim.len().min(agents) {
            if self.dead[agent] {
                continue;
            }
            memory.clear();
            // Missing opportunities are tolerated, so that an observation has no error.
            if self.sim.observe(agent, memory).is_ok() {
                let row = &mut out[agent * width..(agent + 1) * width];
                row.iter_mut().zip(memory.iter()).for_each(|(cell, value)| *cell = *value as f32);
            }
        }
    }
}

/// Sum of the priorities of all targets with a window before the time limit, for any satellite; 1 if there are none.
fn value_in_view(sim: &TaskingSim) -> f64 {
    let mut seen = vec![false; sim.targets().len()];
    for agent in 0..sim.len() {
        for item in sim.opportunities(agent).upcoming(OpportunityKind::Target, 0.0) {
            if item.open_s < sim.time_limit_s() {
                seen[item.object] = true;
            }
        }
    }
    let value: f64 =
        sim.targets().iter().zip(&seen).filter(|(_, seen)| **seen).map(|(target, _)| target.priority).sum();
    if value > 0.0 { value } else { 1.0 }
}
