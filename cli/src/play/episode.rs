//! One episode, from its reset to its end.

use std::time::Duration;

use serde_json::{Value, json};
use tokio::sync::watch;

use super::pilot::{Decision, Pilot, PilotError};
use super::record::{Record, Tape};
use super::session::{Address, Session, SessionError};
use super::tasks::{Task, first_word};
use orchestrator::policy::TimeStep;

/// Resets until the wanted task comes: the public kessler-env takes its three in turn.
const RESETS: u32 = 4;
/// Score from which the public kessler-env calls an episode a success.
const SUCCESS: f64 = 0.1;
/// An episode that goes on for this many times its horizon never ends.
const HORIZONS: u32 = 10;

/// One episode to fly.
#[derive(Debug, Clone, Copy)]
pub(super) struct Job<'a> {
    /// Counted from 1, over all tasks.
    pub(super) number: u64,
    pub(super) task: &'a Task,
    pub(super) environment: &'a str,
    pub(super) model: &'a str,
    /// The goal's first word.
    pub(super) mission: &'a str,
    pub(super) seed: Option<u64>,
    pub(super) address: &'a Address,
    /// How long an answer of the environment may take.
    pub(super) timeout: Duration,
}

/// Why an episode was not flown to its end.
#[derive(Debug, thiserror::Error)]
pub(super) enum Fault {
    #[error(transparent)]
    Session(#[from] SessionError),
    #[error(transparent)]
    Pilot(#[from] PilotError),
    #[error("the environment flies no {wanted}: after {RESETS} resets its goals were {goals}")]
    OtherTask { wanted: String, goals: String },
    #[error("the episode has not ended after {steps} steps")]
    Endless { steps: u32 },
    #[error("it was told to stop")]
    Stopped,
    #[error(transparent)]
    Output(#[from] anyhow::Error),
}

/// How an episode went.
#[derive(Debug, Default)]
pub(super) struct Flown {
    pub(super) rewards: Vec<f64>,
    pub(super) score: f64,
    pub(super) fault: Option<Fault>,
    /// Answers of the model that were no action, and steps in which it gave none.
    pub(super) invalid: u64,
    pub(super) held: u64,
    pub(super) calls: u64,
    pub(super) tokens_in: u64,
    pub(super) tokens_out: u64,
    pub(super) waited: Duration,
}

/// Flies one episode and tells it.
pub(super) async fn fly(
    job: &Job<'_>,
    mut pilot: Pilot,
    tape: &mut Tape<'_>,
    stop: &mut watch::Receiver<bool>,
) -> Flown {
    let mut flown = Flown::default();
    let begun = tokio::select! {
        begun = begin(job) => begun,
        () = stopped(stop) => Err(Fault::Stopped),
    };
    let ended = match begun {
        Ok((mut session, seen)) => {
            let ended = tokio::select! {
                ended = go_on(job, &mut session, seen, &mut pilot, tape, &mut flown) => ended,
                () = stopped(stop) => Err(Fault::Stopped),
            };
            session.close().await;
            ended
        }
        Err(fault) => {
            flown.fault = Some(fault);
            return flown;
        }
    };
    let range = job.task.spec.score_range();
    flown.score = flown.rewards.iter().sum::<f64>().clamp(range.min, range.max);
    flown.fault = ended.err();
    let words = flown.fault.as_ref().map(ToString::to_string);
    let told = tape.push(&Record::End {
        episode: job.number,
        success: flown.fault.is_none() && flown.score >= SUCCESS,
        steps: flown.rewards.len(),
        score: flown.score,
        rewards: &flown.rewards,
        fault: words.as_deref(),
    });
    if let Err(error) = told.and_then(|()| tape.flush()) {
        flown.fault.get_or_insert(Fault::Output(error));
    }
    flown
}

/// Waits until all is to stop.
async fn stopped(stop: &mut watch::Receiver<bool>) {
    if stop.wait_for(|stop| *stop).await.is_err() {
        std::future::pending::<()>().await; // nobody is left who could say so
    }
}

/// A session in which the wanted task begins.
async fn begin(job: &Job<'_>) -> Result<(Session, TimeStep), Fault> {
    let mut data = json!({"task": job.task.spec.id()});
    if let Some(seed) = job.seed {
        data["seed"] = seed.into();
    }
    let (mut session, mut seen) = Session::begin(job.address, &data, job.timeout).await?;
    let mut goals: Vec<String> = Vec::new();
    for _ in 1..RESETS {
        let goal = goal(&seen);
        if goal == job.mission {
            return Ok((session, seen));
        }
        goals.push(goal);
        seen = session.reset(&data).await?;
    }
    let goal = goal(&seen);
    if goal == job.mission {
        return Ok((session, seen));
    }
    goals.push(goal);
    session.close().await;
    Err(Fault::OtherTask { wanted: job.task.spec.id().to_owned(), goals: goals.join(", ") })
}

fn goal(seen: &TimeStep) -> String {
    let goal = seen.observation["mission_objective"].as_str().unwrap_or("not said");
    llm::sanitize_line(first_word(goal))
}

async fn go_on(
    job: &Job<'_>,
    session: &mut Session,
    mut seen: TimeStep,
    pilot: &mut Pilot,
    tape: &mut Tape<'_>,
    flown: &mut Flown,
) -> Result<(), Fault> {
    tape.push(&Record::Start {
        episode: job.number,
        task: &job.task.name,
        env: job.environment,
        model: job.model,
        prompt: pilot.prompt(),
        seed: job.seed,
        observation: &seen.observation,
    })?;
    let horizon = job.task.example().map_or(1, |scenario| job.task.spec.horizon(scenario.recipe()));
    let most = horizon.saturating_mul(HORIZONS);
    for step in 1.. {
        if seen.done {
            break;
        }
        if step > most {
            return Err(Fault::Endless { steps: most });
        }
        let decision = pilot.decide(&seen).await?;
        count(&decision, flown);
        let Decision { action, error, turn } = decision;
        let (next, action, error) = taken(session, action, error, pilot).await?;
        flown.rewards.push(next.reward);
        flown.held += u64::from(error.is_some());
        seen = next;
        tape.push(&Record::Step {
            episode: job.number,
            step,
            action: &action,
            text: &pilot.actions().to_text(&action),
            reward: seen.reward,
            done: seen.done,
            error: error.as_deref(),
            observation: &seen.observation,
            model: turn.as_ref(),
        })?;
    }
    Ok(())
}

fn count(decision: &Decision, flown: &mut Flown) {
    let Some(turn) = &decision.turn else { return };
    let usage = turn.usage();
    flown.invalid += u64::from(turn.invalid);
    flown.calls += turn.completions.len() as u64;
    flown.tokens_in = flown.tokens_in.saturating_add(usage.tokens_in);
    flown.tokens_out = flown.tokens_out.saturating_add(usage.tokens_out);
    flown.waited = flown.waited.saturating_add(usage.latency);
}

/// What an action came to. One that the environment refuses is followed by doing nothing, so that the episode goes on.
async fn taken(
    session: &mut Session,
    action: Value,
    error: Option<String>,
    pilot: &Pilot,
) -> Result<(TimeStep, Value, Option<String>), SessionError> {
    match session.step(&action).await {
        Ok(seen) => Ok((seen, action, error)),
        Err(refused @ SessionError::Refused { .. }) if action != pilot.actions().hold() => {
            let hold = pilot.actions().hold();
            let seen = session.step(&hold).await?;
            Ok((seen, hold, Some(refused.to_string())))
        }
        Err(fault) => Err(fault),
    }
}
