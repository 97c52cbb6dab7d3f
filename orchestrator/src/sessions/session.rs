//! One environment, reset and stepped from elsewhere.

use std::sync::Arc;

use env_core::log::Precision;
use env_core::task::{Episode, StepReport};
use env_core::wire::WireFault;
use env_core::{ActionLog, Scenario, ScenarioError, StepError};
use serde_json::Value;
use uuid::Uuid;

use super::judged::{self, Standard};
use super::leased::{Leased, Ticket, for_no_runs};
use super::seat::{Seat, Who};
use super::wish::Wished;
use crate::judging::{Judge, Judges, Step};
use crate::policy::Seen;
use crate::training::TrainingError;
use crate::training::receipt::Receipt;

/// Why a session does not do what is asked.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The action is none of this task.
    #[error("the action cannot be read")]
    Action(Vec<WireFault>),
    /// The environment does not take it.
    #[error(transparent)]
    Refused(#[from] StepError),
    /// Nothing flies yet.
    #[error("nothing flies yet: reset first")]
    NotStarted,
    /// The episode is over.
    #[error("the episode is over: reset to begin another")]
    Over,
    /// It cannot start.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The run, its lease, or the store.
    #[error(transparent)]
    Training(#[from] TrainingError),
}

/// A session: at most one episode at a time.
#[derive(Debug)]
pub struct Session {
    id: String,
    leased: Arc<Leased>,
    judges: Arc<Judges>,
    episode_id: String,
    resets: u64,
    flying: Option<Flying>,
    /// Whose it is.
    who: Who,
    _seat: Seat,
}

struct Flying {
    scenario: Scenario,
    episode: Box<dyn Episode>,
    log: ActionLog,
    report: StepReport,
    ticket: Option<Ticket>,
    reported: Option<Report>,
    /// What judges say; none where nobody judges.
    standard: Option<Standard>,
}

/// What became of an outcome that was reported to a run.
#[derive(Debug, Clone)]
pub enum Report {
    /// It was answered.
    Told(Receipt),
    /// It could not be told.
    Lost(String),
}

/// What a session shows after a reset or a step.
pub struct Stepped<'a> {
    /// The environment.
    pub episode: &'a dyn Episode,
    /// The team's reward of the last step, as a judge has it where one judges; 0 after a reset.
    pub reward: f64,
    /// The episode is over.
    pub done: bool,
    /// What every agent that was there before the last step is told; nothing after a reset.
    pub report: &'a StepReport,
    /// What a judge changes of it; none where nobody judges.
    pub judged: Option<&'a Standard>,
}

impl Stepped<'_> {
    /// What the agents see, without reward and end, as a judge has it where one judges.
    #[must_use]
    pub fn observation(&self) -> Value {
        let mut observation = judged::plain(self.episode);
        if let Some(standard) = self.judged {
            standard.amend(&mut observation);
        }
        observation
    }
}

/// Where a session stands.
#[derive(Debug, Clone)]
pub struct Standing<'a> {
    /// What the episode is called.
    pub episode_id: &'a str,
    /// Steps taken.
    pub steps: u32,
    /// What it flies; none before the first reset.
    pub scenario: Option<&'a Scenario>,
    /// The run that it flies for.
    pub run: Option<&'a str>,
    /// What became of its outcome.
    pub reported: Option<&'a Report>,
}

impl std::fmt::Debug for Flying {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Flying").field("scenario", &self.scenario.id()).field("ticket", &self.ticket).finish()
    }
}

impl Session {
    pub(super) fn new((seat, who): (Seat, Who), leased: Arc<Leased>, judges: Arc<Judges>) -> Self {
        let id = Uuid::new_v4().to_string();
        let episode_id = Uuid::new_v4().to_string();
        Self { id, leased, judges, episode_id, resets: 0, flying: None, who, _seat: seat }
    }

    /// What it is called, from its beginning to its end.
    #[must_use]
    pub fn id(&self) -> &str {
        &self.id
    }

    /// Whose it is.
    #[must_use]
    pub const fn who(&self) -> &Who {
        &self.who
    }

    /// How often it was reset.
    #[must_use]
    pub const fn resets(&self) -> u64 {
        self.resets
    }

    /// Begins an episode. What flew before is given up; where that was for a run, its episode is given back.
    ///
    /// # Errors
    /// A scenario that cannot start, a run or lease that has no episode to fly. What flew before flies on then, unless it was of the
    /// very lease that was wished for: where one has no other episode, its own was given back first.
    pub async fn reset(&mut self, wished: Wished, name: Option<String>) -> Result<Stepped<'_>, SessionError> {
        let (ticket, scenario) = match wished {
            Wished::Free(scenario) => (None, scenario),
            wished => {
                let (ticket, scenario) = self.take(wished).await?;
                (Some(ticket), scenario)
            }
        };
        let episode = scenario.task().start(&scenario)?;
        let ours = ticket.as_ref().map(|ticket| ticket.episode.to_string());
        self.episode_id = name.or(ours).unwrap_or_else(|| Uuid::new_v4().to_string());
        self.resets += 1;
        let log = ActionLog::new(scenario.task().action_space().columns.len(), Precision::F64);
        let report = StepReport::default();
        let judge = self.judges.meant(ticket.as_ref().and_then(|ticket| ticket.judge));
        let standard = (judge != Judge::Off).then(|| Standard::new(judge));
        let flying = Flying { scenario, episode, log, report, ticket, reported: None, standard };
        Ok(self.flying.insert(flying).shown())
    }

    /// An episode of a run. Of the lease that it flies for now a session may begin the very episode that it gives up.
    async fn take(&mut self, wished: Wished) -> Result<(Ticket, Scenario), TrainingError> {
        let flown = self.flying.as_ref().and_then(|flying| flying.ticket.as_ref());
        if flown.is_some_and(|ticket| ticket.is_of(&wished)) {
            self.flying = None;
        }
        if !self.who.runs {
            return Err(for_no_runs());
        }
        self.leased.take(wished).await
    }

    /// One step with an action in the task's wire form. Where the episode is flown for a run, the last step is answered once
    /// its outcome is on disk.
    ///
    /// # Errors
    /// An action that cannot be taken (nothing has moved then), or no episode that goes on.
    pub async fn step(&mut self, action: &Value) -> Result<Stepped<'_>, SessionError> {
        let flying = self.flying.as_mut().ok_or(SessionError::NotStarted)?;
        if flying.episode.done() {
            return Err(SessionError::Over);
        }
        let wire = flying.scenario.task().wire();
        wire.read_action(action, &mut flying.log).map_err(SessionError::Action)?;
        flying.log.keep_agents(flying.scenario.task().agents(flying.scenario.recipe()));
        let at = flying.episode.steps() as usize;
        let before = flying.standard.as_ref().and_then(|standard| standard.look(&*flying.episode));
        if let Err(refused) = flying.episode.step(flying.log.step(at), &mut flying.report) {
            flying.log.truncate(at);
            return Err(refused.into());
        }
        if let Some(ticket) = &mut flying.ticket {
            if flying.episode.done() {
                flying.reported = Some(match ticket.report(&flying.log).await {
                    Ok(receipt) => Report::Told(receipt),
                    Err(error) => Report::Lost(error.to_string()),
                });
            } else {
                ticket.renew().await;
            }
        }
        flying.judge(&self.judges, &self.leased, &self.episode_id, before).await;
        Ok(flying.shown())
    }

    /// Renews its lease where a third of its time is over.
    pub(super) async fn renew(&mut self) {
        if let Some(ticket) = self.flying.as_mut().and_then(|flying| flying.ticket.as_mut()) {
            ticket.renew().await;
        }
    }

    /// What the agents see now.
    ///
    /// # Errors
    /// Nothing flies yet.
    pub fn shown(&self) -> Result<Stepped<'_>, SessionError> {
        self.flying.as_ref().map(Flying::shown).ok_or(SessionError::NotStarted)
    }

    /// Where it stands.
    #[must_use]
    pub fn standing(&self) -> Standing<'_> {
        let flying = self.flying.as_ref();
        Standing {
            episode_id: &self.episode_id,
            steps: flying.map_or(0, |flying| flying.episode.steps()),
            scenario: flying.map(|flying| &flying.scenario),
            run: flying.and_then(|flying| flying.ticket.as_ref()).map(|ticket| ticket.run.as_str()),
            reported: flying.and_then(|flying| flying.reported.as_ref()),
        }
    }
}

impl Flying {
    fn shown(&self) -> Stepped<'_> {
        let judged = self.standard.as_ref();
        Stepped {
            episode: &*self.episode,
            reward: judged.map_or(self.report.reward, Standard::reward),
            done: self.episode.done(),
            report: &self.report,
            judged,
        }
    }

    /// Asks who judges. What the run was told stays what the world says.
    async fn judge(&mut self, judges: &Judges, leased: &Leased, episode: &str, before: Option<Seen>) {
        let Some(standard) = &mut self.standard else { return };
        let after = standard.look(&*self.episode);
        let step = Step {
            run: self.ticket.as_ref().map(|ticket| ticket.run.as_str()),
            episode,
            scenario: &self.scenario,
            log: &self.log,
            before: before.as_ref(),
            after: after.as_ref(),
        };
        let words = judges.judge(standard.judge(), step).await;
        standard.count(self.report.reward, &words);
        if let Some(row) = judged::row(&step, &words) {
            leased.keep(row).await;
        }
    }
}
