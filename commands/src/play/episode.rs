//! Runs one episode on an OpenEnv server, from its reset to its end.

use std::time::Duration;

use serde_json::{Value, json};
use tokio::sync::watch;

use super::episode_policy::{DecisionError, EpisodePolicy, StepDecision};
use super::openenv_task::{OpenEnvTask, first_word};
use super::session::{ServerAddress, Session, SessionError};
use super::transcript::{TranscriptRecord, TranscriptWriter};
use llm_policy::TimeStep;

/// Resets within which the requested task must appear: the public kessler-env serves its three tasks in turn.
const MAX_RESETS: u32 = 4;
/// Lowest score of a success in the public kessler-env.
const SUCCESS_SCORE: f64 = 0.1;
/// Longest accepted episode, as a multiple of the task's horizon.
const MAX_HORIZONS: u32 = 10;

/// Parameters of one episode to run.
#[derive(Debug, Clone, Copy)]
pub(super) struct EpisodeJob<'a> {
    /// Number of the episode, counted from 1 over all tasks.
    pub(super) number: u64,
    pub(super) task: &'a OpenEnvTask,
    pub(super) environment: &'a str,
    pub(super) model: &'a str,
    /// First word of the task's goal.
    pub(super) mission: &'a str,
    pub(super) seed: Option<u64>,
    pub(super) address: &'a ServerAddress,
    /// Longest time that one response of the environment may take.
    pub(super) timeout: Duration,
}

/// Reason why an episode did not reach its end.
#[derive(Debug, thiserror::Error)]
pub(super) enum PlayError {
    #[error(transparent)]
    Session(#[from] SessionError),
    #[error(transparent)]
    Policy(#[from] DecisionError),
    #[error("the environment does not offer {wanted}: in {MAX_RESETS} resets its goals were {goals}")]
    OtherTask { wanted: String, goals: String },
    #[error("the episode has not ended after {steps} steps")]
    Endless { steps: u32 },
    #[error("it was stopped")]
    Stopped,
    #[error(transparent)]
    Transcript(#[from] anyhow::Error),
}

/// Result of an episode, possibly incomplete.
#[derive(Debug, Default)]
pub(super) struct EpisodeResult {
    pub(super) rewards: Vec<f64>,
    pub(super) score: f64,
    pub(super) fault: Option<PlayError>,
    /// Number of model responses that were no valid action.
    pub(super) invalid: u64,
    /// Number of steps that were replaced by holding.
    pub(super) held: u64,
    pub(super) calls: u64,
    pub(super) tokens_in: u64,
    pub(super) tokens_out: u64,
    pub(super) waited: Duration,
}

/// Runs one episode and writes its transcript.
pub(super) async fn run_episode(
    job: &EpisodeJob<'_>,
    mut policy: EpisodePolicy,
    writer: &mut TranscriptWriter<'_>,
    stop: &mut watch::Receiver<bool>,
) -> EpisodeResult {
    let mut result = EpisodeResult::default();
    let begun = tokio::select! {
        begun = begin(job) => begun,
        () = stopped(stop) => Err(PlayError::Stopped),
    };
    let ended = match begun {
        Ok((mut session, seen)) => {
            let ended = tokio::select! {
                ended = roll_out_steps(job, &mut session, seen, &mut policy, writer, &mut result) => ended,
                () = stopped(stop) => Err(PlayError::Stopped),
            };
            session.close().await;
            ended
        }
        Err(fault) => {
            result.fault = Some(fault);
            return result;
        }
    };
    let range = job.task.spec.score_range();
    result.score = result.rewards.iter().sum::<f64>().clamp(range.min, range.max);
    result.fault = ended.err();
    let words = result.fault.as_ref().map(ToString::to_string);
    let written = writer.push(&TranscriptRecord::End {
        episode: job.number,
        success: result.fault.is_none() && result.score >= SUCCESS_SCORE,
        steps: result.rewards.len(),
        score: result.score,
        rewards: &result.rewards,
        fault: words.as_deref(),
    });
    if let Err(error) = written.and_then(|()| writer.flush()) {
        result.fault.get_or_insert(PlayError::Transcript(error));
    }
    result
}

/// Waits for the stop signal.
async fn stopped(stop: &mut watch::Receiver<bool>) {
    if stop.wait_for(|stop| *stop).await.is_err() {
        std::future::pending::<()>().await; // the sender is gone, so no signal can arrive
    }
}

/// Opens a session and resets it until the requested task begins.
async fn begin(job: &EpisodeJob<'_>) -> Result<(Session, TimeStep), PlayError> {
    let mut data = json!({"task": job.task.spec.id()});
    if let Some(seed) = job.seed {
        data["seed"] = seed.into();
    }
    let (mut session, mut seen) = Session::begin(job.address, &data, job.timeout).await?;
    let mut goals: Vec<String> = Vec::new();
    for _ in 1..MAX_RESETS {
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
    Err(PlayError::OtherTask { wanted: job.task.spec.id().to_owned(), goals: goals.join(", ") })
}

fn goal(seen: &TimeStep) -> String {
    let goal = seen.observation["mission_objective"].as_str().unwrap_or("not said");
    llm::sanitize_line(first_word(goal))
}

async fn roll_out_steps(
    job: &EpisodeJob<'_>,
    session: &mut Session,
    mut seen: TimeStep,
    policy: &mut EpisodePolicy,
    writer: &mut TranscriptWriter<'_>,
    result: &mut EpisodeResult,
) -> Result<(), PlayError> {
    writer.push(&TranscriptRecord::Start {
        episode: job.number,
        task: &job.task.name,
        env: job.environment,
        model: job.model,
        prompt: policy.prompt_version(),
        seed: job.seed,
        observation: &seen.observation,
    })?;
    let horizon = job.task.example().map_or(1, |scenario| job.task.spec.horizon(scenario.recipe()));
    let most = horizon.saturating_mul(MAX_HORIZONS);
    for step in 1.. {
        if seen.done {
            break;
        }
        if step > most {
            return Err(PlayError::Endless { steps: most });
        }
        let decision = policy.decide(&seen).await?;
        add_usage(&decision, result);
        let StepDecision { action, error, turn } = decision;
        let (next, action, error) = step_or_hold(session, action, error, policy).await?;
        result.rewards.push(next.reward);
        result.held += u64::from(error.is_some());
        seen = next;
        writer.push(&TranscriptRecord::Step {
            episode: job.number,
            step,
            action: &action,
            text: &policy.codec().to_text(&action),
            reward: seen.reward,
            done: seen.done,
            error: error.as_deref(),
            observation: &seen.observation,
            model: turn.as_ref(),
        })?;
    }
    Ok(())
}

fn add_usage(decision: &StepDecision, result: &mut EpisodeResult) {
    let Some(turn) = &decision.turn else { return };
    let usage = turn.usage();
    result.invalid += u64::from(turn.invalid);
    result.calls += turn.completions.len() as u64;
    result.tokens_in = result.tokens_in.saturating_add(usage.tokens_in);
    result.tokens_out = result.tokens_out.saturating_add(usage.tokens_out);
    result.waited = result.waited.saturating_add(usage.latency);
}

/// Steps the environment. If it refuses the action, steps it again with the hold action, so that the episode continues.
async fn step_or_hold(
    session: &mut Session,
    action: Value,
    error: Option<String>,
    policy: &EpisodePolicy,
) -> Result<(TimeStep, Value, Option<String>), SessionError> {
    match session.step(&action).await {
        Ok(seen) => Ok((seen, action, error)),
        Err(refused @ SessionError::Refused { .. }) if action != policy.codec().hold() => {
            let hold = policy.codec().hold();
            let seen = session.step(&hold).await?;
            Ok((seen, hold, Some(refused.to_string())))
        }
        Err(fault) => Err(fault),
    }
}
