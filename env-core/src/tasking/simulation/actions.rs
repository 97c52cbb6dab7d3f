//! Actions that agents give to satellites.

use super::TaskingSim;
use super::agent::{ActionKey, Agent, TimedEvent};
use super::journal::SatelliteEvent;
use crate::tasking::access::{Opportunity, OpportunityKind};
use crate::tasking::clock::TickLength;
use crate::tasking::error::TaskingError;
use crate::tasking::orbit::Sky;
use crate::tasking::satellite::software::Command;
use crate::tasking::setup::actions::{ActionSpec, SoftwareAction, UNLIMITED_S};

/// An action of one satellite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AgentAction {
    /// An action by its index.
    Index(usize),
    /// The image of a target by the target's index.
    Target(usize),
}

impl TaskingSim {
    /// Gives actions to the satellites, one each; `None` lets a satellite go on. Nothing changes if one is not valid.
    ///
    /// # Errors
    /// Returns [`TaskingError`] if the number of actions is wrong, an action is not one of the satellite's, or a target has no
    /// upcoming window.
    pub(super) fn give_actions(&mut self, actions: &[Option<AgentAction>]) -> Result<(), TaskingError> {
        if actions.len() != self.agents.len() {
            return Err(TaskingError::Composition(format!(
                "there must be one action for each of the {} satellites, got {}",
                self.agents.len(),
                actions.len()
            )));
        }
        let mut choices = Vec::with_capacity(actions.len());
        let time = self.time_s();
        for (agent, action) in self.agents.iter_mut().zip(actions) {
            let choice = action.map(|action| agent.resolve(action, time, &mut self.sky)).transpose();
            choices.push(match choice {
                Err(TaskingError::NoOpportunity { .. }) if self.tolerates_missing => None,
                other => other?,
            });
        }
        for (agent, choice) in self.agents.iter_mut().zip(choices) {
            if let Some(choice) = choice {
                agent.needs_action = false;
                agent.apply(choice, self.now, time, self.setup.clock.tick);
            }
            if !agent.is_alive {
                agent.needs_action = false;
            }
        }
        Ok(())
    }
}

/// An action whose target is known.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Choice {
    Software { action: SoftwareAction, duration_s: f64, reset_task: bool },
    Broadcast { duration_s: f64 },
    Image { window: Opportunity, max_duration_s: f64 },
}

impl Agent {
    /// Finds out what an action does.
    fn resolve(&mut self, action: AgentAction, now_s: f64, sky: &mut Sky) -> Result<Choice, TaskingError> {
        let index = match action {
            AgentAction::Target(target) => {
                let max_duration_s = self.setup.actions.iter().find_map(|spec| match spec {
                    ActionSpec::Image { max_duration_s, .. } => Some(*max_duration_s),
                    _ => None,
                });
                return match max_duration_s {
                    Some(max_duration_s) => self.choose_target(target, max_duration_s, now_s),
                    None => Err(self.action_error("it has no action that images a target".to_owned())),
                };
            }
            AgentAction::Index(index) => index,
        };
        let mut rest = index;
        for spec in &self.setup.actions {
            if rest >= spec.count() {
                rest -= spec.count();
                continue;
            }
            return match spec {
                ActionSpec::Software { action, duration_s, reset_task, .. } => {
                    Ok(Choice::Software { action: *action, duration_s: *duration_s, reset_task: *reset_task })
                }
                ActionSpec::Broadcast { duration_s, .. } => Ok(Choice::Broadcast { duration_s: *duration_s }),
                ActionSpec::Image { max_duration_s, .. } => {
                    let max_duration_s = *max_duration_s;
                    let mut found = Vec::new();
                    self.next_opportunities(OpportunityKind::Target, rest + 1, now_s, sky, &mut found)?;
                    let target = found[rest].object;
                    self.choose_target(target, max_duration_s, now_s)
                }
            };
        }
        let count: usize = self.setup.actions.iter().map(ActionSpec::count).sum();
        Err(self.action_error(format!("it must be from 0 to {}, got {index}", count - 1)))
    }

    fn action_error(&self, reason: String) -> TaskingError {
        TaskingError::Action { satellite: self.name().to_owned(), reason }
    }

    /// The image of a target until its next window closes.
    fn choose_target(&self, target: usize, max_duration_s: f64, now_s: f64) -> Result<Choice, TaskingError> {
        let upcoming = self.opportunities.upcoming(OpportunityKind::Target, now_s);
        match upcoming.iter().find(|item| item.object == target) {
            Some(window) => Ok(Choice::Image { window: *window, max_duration_s }),
            None => Err(self.action_error(format!("target {target} has no upcoming window"))),
        }
    }

    /// Applies an action at a time.
    fn apply(&mut self, choice: Choice, now: u64, now_s: f64, tick: TickLength) {
        let timed = |duration_s: f64| TimedEvent {
            tick: (duration_s < UNLIMITED_S).then(|| tick.first_tick_at(now_s + duration_s)).flatten(),
            window_close_s: None,
        };
        match choice {
            Choice::Software { action, duration_s, reset_task } => {
                self.timed_event = Some(timed(duration_s));
                let key = ActionKey::Software(action);
                if reset_task || self.last_action != Some(key) {
                    self.satellite.command(command_of(action), now);
                }
                self.last_action = Some(key);
            }
            Choice::Broadcast { duration_s } => {
                self.timed_event = Some(timed(duration_s));
                self.broadcast_pending = true;
                self.last_action = Some(ActionKey::Broadcast);
            }
            Choice::Image { window, max_duration_s } => {
                let Opportunity { object: target, open_s, close_s, .. } = window;
                if let Some(journal) = &mut self.journal {
                    journal.add(now_s, SatelliteEvent::Tasked { target, open_s, close_s });
                }
                let key = ActionKey::Target(target);
                if self.last_action != Some(key) {
                    let position = *self.targets.position(target);
                    self.satellite.command(Command::Image(position), now);
                    self.latest_target = Some(target);
                }
                self.last_action = Some(key);
                self.satellite.awaited_bits = Some(self.satellite.stored()[0]);
                let end_s = close_s.min(now_s + max_duration_s);
                self.timed_event =
                    Some(TimedEvent { tick: tick.first_tick_at(end_s), window_close_s: Some(close_s) });
            }
        }
    }
}

const fn command_of(action: SoftwareAction) -> Command {
    match action {
        SoftwareAction::Scan => Command::Scan,
        SoftwareAction::Charge => Command::Charge,
        SoftwareAction::Downlink => Command::Downlink,
        SoftwareAction::Desaturate => Command::Desaturate,
        SoftwareAction::NadirPoint => Command::NadirPoint,
        SoftwareAction::Drift => Command::Drift,
    }
}
