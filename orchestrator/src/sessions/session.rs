//! [`Session`]: one environment that a client resets and steps.

use std::sync::Arc;

use api_types::{Judge, ResultReceipt};
use env_core::log::Precision;
use env_core::task::{Episode, StepReport};
use env_core::{ActionLog, Scenario, ScenarioError, StepError};
use openenv_wire::ValidationError;
use serde_json::Value;
use uuid::Uuid;

use super::client::ClientIdentity;
use super::judged_score::{JudgedScore, observation_without_reward, verdict_row};
use super::session_leases::{EpisodeReservation, SessionLeases, runs_not_allowed};
use super::session_request::EpisodeSource;
use crate::engine::error::ServiceError;
use crate::limits::QuotaPermit;
use llm_policy::TimeStep;
use llm_policy::judging::{JudgedStep, Judges};

/// Error of a reset or a step.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The action is not an action of the task.
    #[error("the action cannot be read")]
    Action(Vec<ValidationError>),
    /// The environment rejects the action.
    #[error(transparent)]
    Refused(#[from] StepError),
    /// The session was not reset yet.
    #[error("no episode is running; reset first")]
    NotStarted,
    /// The step names another episode than the running one: another client reset the session.
    #[error("the session runs the episode {running}, not {named}; use a session of its own for each client")]
    OtherEpisode {
        /// Id of the running episode.
        running: String,
        /// Id that the step names.
        named: String,
    },
    /// The episode has ended.
    #[error("the episode is over; reset to start another")]
    Over,
    /// The scenario cannot start.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The run, its lease or the store rejects the request.
    #[error(transparent)]
    Service(#[from] ServiceError),
}

/// Session with at most one episode at a time.
#[derive(Debug)]
pub struct Session {
    id: String,
    leases: Arc<SessionLeases>,
    judges: Arc<Judges>,
    /// Name of the episode, or a random one before the first reset.
    episode_id: String,
    resets: u64,
    running: Option<RunningEpisode>,
    client: ClientIdentity,
    _permit: QuotaPermit,
}

/// Episode since the last reset; it may have ended.
struct RunningEpisode {
    scenario: Scenario,
    episode: Box<dyn Episode>,
    log: ActionLog,
    report: StepReport,
    reservation: Option<EpisodeReservation>,
    outcome: Option<ReportOutcome>,
    /// Reward and score under the judge; `None` without a judge.
    judged: Option<JudgedScore>,
}

/// Result of the report of an episode to its run.
#[derive(Debug, Clone)]
pub enum ReportOutcome {
    /// The server acknowledged the episode.
    Acknowledged(ResultReceipt),
    /// The report failed with this error.
    Failed(String),
}

/// State of the environment after a reset or a step.
pub struct StepView<'a> {
    /// Environment of the episode.
    pub episode: &'a dyn Episode,
    /// Team reward of the last step, as the judge changed it; 0 after a reset.
    pub reward: f64,
    /// True if the episode has ended.
    pub done: bool,
    /// Report for every agent that was there before the last step; empty after a reset.
    pub report: &'a StepReport,
    /// Reward and score under the judge; `None` without a judge.
    pub judged: Option<&'a JudgedScore>,
}

impl StepView<'_> {
    /// Returns the observation without reward and end, as the judge changed it.
    #[must_use]
    pub fn observation(&self) -> Value {
        let mut observation = observation_without_reward(self.episode);
        if let Some(judged) = self.judged {
            judged.amend(&mut observation);
        }
        observation
    }
}

/// Status of a session.
#[derive(Debug, Clone)]
pub struct SessionStatus<'a> {
    /// Name of the episode.
    pub episode_id: &'a str,
    /// Number of steps taken.
    pub steps: u32,
    /// Scenario of the episode; `None` before the first reset.
    pub scenario: Option<&'a Scenario>,
    /// Run that receives the outcome, if any.
    pub run: Option<&'a str>,
    /// Result of the report to the run; `None` before the end of the episode.
    pub outcome: Option<&'a ReportOutcome>,
}

impl Session {
    /// Creates a session of a client without an episode.
    pub(super) fn new(
        id: String,
        permit: QuotaPermit,
        client: ClientIdentity,
        leases: Arc<SessionLeases>,
        judges: Arc<Judges>,
    ) -> Self {
        Self {
            id,
            leases,
            judges,
            episode_id: Uuid::new_v4().to_string(),
            resets: 0,
            running: None,
            client,
            _permit: permit,
        }
    }

    /// Returns the id of the session, which never changes.
    #[must_use]
    pub fn id(&self) -> &str {
        &self.id
    }

    /// Returns the client that opened the session.
    #[must_use]
    pub const fn client(&self) -> &ClientIdentity {
        &self.client
    }

    /// Returns the number of successful resets.
    #[must_use]
    pub const fn resets(&self) -> u64 {
        self.resets
    }

    /// Starts an episode named `name`. An unfinished episode of a run is returned to its lease.
    ///
    /// # Errors
    /// Returns an error if the scenario cannot start, or the run or lease has no free episode. The previous episode goes on
    /// then, unless it belongs to the requested lease: it was returned first, since it may be the only free one.
    pub async fn reset(
        &mut self,
        source: EpisodeSource,
        name: Option<String>,
    ) -> Result<StepView<'_>, SessionError> {
        let (reservation, scenario) = match source {
            EpisodeSource::Scenario(scenario) => (None, scenario),
            source => {
                let reservation = self.reserve(source).await?;
                let scenario = reservation.scenario.clone();
                (Some(reservation), scenario)
            }
        };
        let episode = scenario.task().start(&scenario)?;
        let leased_id = reservation.as_ref().map(|reservation| reservation.episode.to_string());
        self.episode_id = name.or(leased_id).unwrap_or_else(|| Uuid::new_v4().to_string());
        self.resets += 1;
        let judge = self.judges.resolve(reservation.as_ref().and_then(|reservation| reservation.judge));
        let running = RunningEpisode {
            log: ActionLog::new(scenario.task().action_space().dim(), Precision::F64),
            scenario,
            episode,
            report: StepReport::default(),
            reservation,
            outcome: None,
            judged: (judge != Judge::Off).then(|| JudgedScore::new(judge)),
        };
        Ok(self.running.insert(running).view())
    }

    /// Takes one step with an action in the task's wire form. The last step of a leased episode returns after its outcome is
    /// committed.
    ///
    /// # Errors
    /// Returns an error if no episode is running or the action is rejected. A rejected action changes nothing.
    pub async fn step(&mut self, action: &Value) -> Result<StepView<'_>, SessionError> {
        let running = self.running.as_mut().ok_or(SessionError::NotStarted)?;
        if running.episode.done() {
            return Err(SessionError::Over);
        }
        running.reservation.as_ref().map_or(Ok(()), EpisodeReservation::check_run)?;
        let wire_format = openenv_wire::wire_format(running.scenario.task());
        wire_format.read_action(action, &mut running.log).map_err(SessionError::Action)?;
        running.log.keep_agents(running.scenario.task().agents(running.scenario.recipe()));
        let index = running.episode.steps() as usize;
        let before = running.judged.as_ref().and_then(|judged| judged.capture(&*running.episode));
        if let Err(error) = running.episode.step(running.log.step(index), &mut running.report) {
            running.log.truncate(index);
            return Err(error.into());
        }
        running.report_or_renew().await;
        running.judge(&self.judges, &self.leases, &self.episode_id, before).await;
        Ok(running.view())
    }

    /// Renews the lease of the episode if a third of its time is over.
    pub(super) async fn renew_lease(&mut self) {
        if let Some(reservation) = self.running.as_ref().and_then(|running| running.reservation.as_ref()) {
            reservation.renew_lease().await;
        }
    }

    /// Returns the current state of the environment.
    ///
    /// # Errors
    /// Returns [`SessionError::NotStarted`] before the first reset.
    pub fn view(&self) -> Result<StepView<'_>, SessionError> {
        self.running.as_ref().map(RunningEpisode::view).ok_or(SessionError::NotStarted)
    }

    /// Returns the status of the session.
    #[must_use]
    pub fn status(&self) -> SessionStatus<'_> {
        let running = self.running.as_ref();
        let reservation = running.and_then(|running| running.reservation.as_ref());
        SessionStatus {
            episode_id: &self.episode_id,
            steps: running.map_or(0, |running| running.episode.steps()),
            scenario: running.map(|running| &running.scenario),
            run: reservation.map(|reservation| reservation.run.as_str()),
            outcome: running.and_then(|running| running.outcome.as_ref()),
        }
    }

    /// Reserves an episode of a run. The current episode is returned first if it belongs to the same lease, so that the
    /// session may reserve it again.
    async fn reserve(&mut self, source: EpisodeSource) -> Result<EpisodeReservation, ServiceError> {
        let current = self.running.as_ref().and_then(|running| running.reservation.as_ref());
        if current.is_some_and(|reservation| reservation.overlaps(&source)) {
            self.running = None;
        }
        if !self.client.may_use_runs {
            return Err(runs_not_allowed());
        }
        self.leases.reserve(source, self.client.actor).await
    }
}

impl RunningEpisode {
    fn view(&self) -> StepView<'_> {
        let judged = self.judged.as_ref();
        StepView {
            episode: &*self.episode,
            reward: judged.map_or(self.report.reward, JudgedScore::reward),
            done: self.episode.done(),
            report: &self.report,
            judged,
        }
    }

    /// Reports a leased episode that has ended, or renews its lease.
    async fn report_or_renew(&mut self) {
        let Some(reservation) = &mut self.reservation else { return };
        if !self.episode.done() {
            return reservation.renew_lease().await;
        }
        self.outcome = Some(match reservation.report(&self.log).await {
            Ok(receipt) => ReportOutcome::Acknowledged(receipt),
            Err(error) => ReportOutcome::Failed(error.to_string()),
        });
    }

    /// Judges the last step and stores the verdict of a model. The report to the run does not depend on it.
    async fn judge(
        &mut self,
        judges: &Judges,
        leases: &SessionLeases,
        episode_id: &str,
        before: Option<TimeStep>,
    ) {
        let Some(judged) = &mut self.judged else { return };
        let after = judged.capture(&*self.episode);
        let step = JudgedStep {
            run: self.reservation.as_ref().map(|reservation| reservation.run.as_str()),
            episode: episode_id,
            scenario: &self.scenario,
            log: &self.log,
            before: before.as_ref(),
            after: after.as_ref(),
        };
        let verdicts = judges.judge(judged.judge(), step).await;
        judged.add_step(self.report.reward, &verdicts);
        if let Some(row) = verdict_row(&step, &verdicts) {
            leases.store_verdict(row).await;
        }
    }
}

impl std::fmt::Debug for RunningEpisode {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RunningEpisode")
            .field("scenario", &self.scenario.id())
            .field("reservation", &self.reservation)
            .finish_non_exhaustive()
    }
}
