//! `sparring play`: runs episodes on an OpenEnv server with a language model or a built-in policy.
//!
//! [`runner`] runs several episodes concurrently and [`episode`] runs one; start reading there. [`session`] is the WebSocket
//! client, [`episode_policy`] chooses actions, [`transcript`] writes the output. The chat policy itself lives in
//! `llm_policy`.

mod episode;
mod episode_policy;
mod model;
mod openenv_task;
mod runner;
pub(crate) mod session;
mod summary;
mod transcript;

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, bail};
use clap::ValueEnum;
use clap::builder::PossibleValuesParser;
use env_core::{SEED_REQUIREMENT, Seed};
use secrecy::ExposeSecret;
use tokio::sync::watch;

use self::episode::{EpisodeJob, EpisodeResult};
use self::episode_policy::PolicySource;
use self::openenv_task::OpenEnvTask;
use self::runner::PlannedEpisode;
use self::session::ServerAddress;
use self::transcript::{Transcript, TranscriptFormat};
use super::api::CaArgs;
use super::interrupt::StopSignal;
use super::{llm_args, worlds};
use llm_policy::{ActionCodec, ChatSettings, ObservationFormat};

/// Run a language model as the policy on an OpenEnv server: this project's or the public kessler-env.
///
/// The model is reached over any OpenAI-compatible API, and is held to the JSON schema of the action where the API supports it.
/// In every step the model receives the observation and answers with an action. An invalid answer gets one repair attempt;
/// if that fails too, the agent does nothing in that step. With --policy a built-in policy runs instead of a model.
///
/// The task is requested from the server where it supports that. The public kessler-env cycles through its three tasks, so the
/// command resets it until the wanted task comes up. The lines on stdout are those of that project; all else goes to stderr.
#[derive(Debug, clap::Args)]
#[command(after_help = after_help())]
pub struct Args {
    /// Base URL of the OpenEnv server
    #[arg(
        long,
        value_name = "URL",
        env = "ENV_URL",
        hide_env_values = true,
        default_value = "http://127.0.0.1:8700"
    )]
    env_url: String,
    #[command(flatten)]
    ca: CaArgs,
    /// Environment variable with the token of the OpenEnv server; a token itself is never an argument [default: no token]
    #[arg(long, value_name = "VARIABLE")]
    env_token_env: Option<String>,
    /// Task to run: survival, eco_station, rendezvous, or an id such as docking/single; repeat the flag for several
    /// [default: those three]
    #[arg(long = "task", value_name = "TASK", value_parser = OpenEnvTask::parse)]
    tasks: Vec<OpenEnvTask>,
    /// Number of episodes of each task
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=100_000))]
    episodes: u64,
    /// Largest number of concurrent episodes; the lines of one episode stay together
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=256))]
    concurrency: u16,
    /// Seed of the first episode of each task; each further episode adds 1 [default: the server draws the seeds]
    #[arg(long, value_name = "SEED", value_parser = clap::value_parser!(u64).range(..1 << 51))]
    seed: Option<u64>,
    /// Run this built-in policy instead of a model
    #[arg(long, value_name = "POLICY", value_parser = PossibleValuesParser::new(worlds::policy_names()))]
    policy: Option<String>,
    /// Timeout of one response of the model or the server in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 120, value_parser = clap::value_parser!(u64).range(1..=3600))]
    timeout: u64,
    /// Print one JSON object per line instead of the lines of the public kessler-env
    #[arg(long)]
    json: bool,
    /// Write the complete transcript to this file, one JSON object per line
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Base URL of the model's API, such as http://127.0.0.1:8080/v1
    #[arg(
        long,
        value_name = "URL",
        env = "API_BASE_URL",
        hide_env_values = true,
        help_heading = "Language model"
    )]
    api_base_url: Option<String>,
    /// Name of the model at that API
    #[arg(
        long,
        value_name = "NAME",
        env = "MODEL_NAME",
        hide_env_values = true,
        help_heading = "Language model"
    )]
    model: Option<String>,
    /// Environment variable with the API key; a key itself is never an argument [default: HF_TOKEN, or else API_KEY]
    #[arg(long, value_name = "VARIABLE", help_heading = "Language model")]
    key_env: Option<String>,
    /// Sampling temperature, from 0 to 5 [default: that of the API]
    #[arg(long, value_name = "T", value_parser = llm_args::parse_temperature, help_heading = "Language model")]
    temperature: Option<f64>,
    /// Largest number of tokens of one response
    #[arg(long, value_name = "N", default_value_t = 1024, help_heading = "Language model",
          value_parser = clap::value_parser!(u32).range(16..=131_072))]
    max_tokens: u32,
    /// Number of retries after a transient failure
    #[arg(long, value_name = "N", default_value_t = 3, help_heading = "Language model",
          value_parser = clap::value_parser!(u32).range(0..=10))]
    retries: u32,
    /// Number of earlier steps that each prompt repeats
    #[arg(long, value_name = "N", default_value_t = 2, help_heading = "Language model",
          value_parser = clap::value_parser!(u16).range(0..=1000))]
    history: u16,
    /// Set the format of the observations in the prompt
    #[arg(long, value_enum, default_value = "compact", help_heading = "Language model")]
    telemetry: TelemetryFormat,
}

/// Format of the observations in the model's prompt.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum TelemetryFormat {
    /// Tables of the relevant values: of debris, only the bodies that come near a satellite
    Compact,
    /// JSON as the server returns it
    Raw,
}

fn after_help() -> String {
    format!(
        "Policies:\n{}\nreference is not available here: it needs the scenario itself.\n\n{AFTER_HELP}",
        worlds::describe_policies(&worlds::policy_names())
    )
}

const AFTER_HELP: &str = "\
Lines on stdout; rewards lists those of all steps, and success means a score of at least 0.1:
  [START] task=survival env=kessler-env model=name
  [STEP] step=1 action={\"burns\":[]} reward=0.02 done=false error=null
  [END] success=true steps=50 score=0.998 rewards=0.02,0.02,...

error says why the model's answer was replaced by no action, or what the server refused. A model that times out or returns \
invalid answers takes no action in those steps. If all retries fail because the endpoint is unreachable, refuses requests or \
limits their rate, the episode is aborted: [END] then has the rewards so far and success=false.

Transcript (--json, --out FILE): objects with type start {episode, task, env, model, prompt, seed, observation}, \
step {episode, step, action, reward, done, error, observation, model} and end {episode, success, steps, score, rewards, \
fault}. model is {step, action, error, invalid, completions}, null for a built-in policy; each of completions is {messages, text, \
truncated, error, tokens_in, tokens_out, latency_ms, tokens}, with the exact text of the prompt and the response; tokens is there \
only if the API returns token ids or log-probabilities. prompt is the version of the prompt.

Ctrl-C (or SIGTERM) aborts the running episodes; [END] and the summary are still printed. If stdout is closed, no further \
episode starts, unless --out is given. On a server with a judge, rewards and score are the judge's.

Exit codes: 0 all episodes were run to their end; 1 some were not; 2 bad input or an unreachable server, with one sentence on \
stderr.

Examples:
  sparring play --policy heuristic
  sparring play --env-url http://localhost:8000 --task survival \\
      --api-base-url http://127.0.0.1:8080/v1 --model qwen
  API_BASE_URL=https://llm.example.com/v1 MODEL_NAME=name HF_TOKEN=... \\
      sparring play --episodes 8 --concurrency 8 --seed 1
  sparring play --task docking/single --policy heuristic --json
  sparring play --api-base-url http://127.0.0.1:8080/v1 --model qwen \\
      --telemetry raw --history 0 --out raw.jsonl";

/// Runs the episodes and prints a summary.
///
/// # Errors
/// Returns an error if the settings are invalid, an address cannot be reached, or the server does not have a task.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let code = runtime.block_on(play(args));
    runtime.shutdown_background();
    code
}

async fn play(args: &Args) -> anyhow::Result<ExitCode> {
    let address = server_address(args)?;
    let mut tasks: Vec<OpenEnvTask> = Vec::new();
    for task in if args.tasks.is_empty() { OpenEnvTask::default_tasks() } else { args.tasks.clone() } {
        if !tasks.iter().any(|known| known.spec.id() == task.spec.id()) {
            tasks.push(task);
        }
    }
    let last = args.seed.map(|seed| seed.saturating_add(args.episodes.saturating_sub(1)));
    if let Some(last) = last
        && Seed::user(last).is_err()
    {
        bail!(
            "--seed: the last of {} episodes would have the seed {last}; it must be {SEED_REQUIREMENT}",
            args.episodes
        );
    }
    let policy_source = policy_source(args)?;
    for task in &tasks {
        policy_source.check(task)?;
    }
    let timeout = Duration::from_secs(args.timeout);
    let contexts: Vec<TaskContext> = tasks.iter().map(TaskContext::new).collect::<anyhow::Result<_>>()?;
    let output = Transcript::new(
        if args.json { TranscriptFormat::Jsonl } else { TranscriptFormat::Lines },
        args.out.as_deref(),
        args.concurrency == 1,
    )?;
    let name = policy_source.name();
    let mut planned = Vec::new();
    for (task, context) in tasks.iter().zip(&contexts) {
        for episode in 0..args.episodes {
            let job = EpisodeJob {
                number: planned.len() as u64 + 1,
                task,
                environment: &context.environment,
                model: &name,
                mission: &context.mission,
                seed: args.seed.map(|seed| seed.saturating_add(episode)),
                address: &address,
                timeout,
            };
            planned.push(PlannedEpisode { job, actions: &context.actions });
        }
    }
    let (stop_sender, stop) = watch::channel(false);
    let mut stop_signal = StopSignal::install()?;
    tokio::spawn(async move {
        if stop_signal.received().await.is_ok() {
            stop_sender.send_replace(true);
        }
        std::future::pending::<()>().await; // receivers would see a dropped sender as a change
    });
    let results =
        runner::run_episodes(&planned, &policy_source, &output, args.concurrency.into(), &stop).await?;
    finish(&tasks, &planned, results, matches!(policy_source, PolicySource::Model { .. }))
}

/// Returns the address of the server, with the token if the arguments name its variable.
fn server_address(args: &Args) -> anyhow::Result<ServerAddress> {
    let address = ServerAddress::parse(&args.env_url, &args.ca).context("--env-url")?;
    let Some(variable) = &args.env_token_env else { return Ok(address) };
    let Some(token) = llm_args::read_key(&[variable], |name| std::env::var(name))? else {
        bail!("--env-token-env {variable}: the variable is not set or is empty");
    };
    address.with_token(token.expose_secret()).context("--env-token-env")
}

/// Returns the policy that the arguments select.
fn policy_source(args: &Args) -> anyhow::Result<PolicySource> {
    if let Some(name) = &args.policy {
        return Ok(PolicySource::BuiltIn { name: name.clone(), seed: args.seed.unwrap_or(0) });
    }
    let settings = ChatSettings {
        run: "play".to_owned(),
        history: args.history.into(),
        temperature: args.temperature,
        max_tokens: args.max_tokens,
    };
    let telemetry = match args.telemetry {
        TelemetryFormat::Compact => ObservationFormat::Compact,
        TelemetryFormat::Raw => ObservationFormat::Raw,
    };
    Ok(PolicySource::Model { llm: model::endpoint(args)?, settings, telemetry, answered: Arc::default() })
}

/// Properties of a task that are known before its first episode.
struct TaskContext {
    environment: String,
    mission: String,
    actions: ActionCodec,
}

impl TaskContext {
    fn new(task: &OpenEnvTask) -> anyhow::Result<Self> {
        Ok(Self {
            environment: task.environment(),
            mission: task.mission()?,
            actions: ActionCodec::new(task.spec),
        })
    }
}

/// Prints the summary and returns the exit code. If no episode took a step, the first fault is returned as an error.
fn finish(
    tasks: &[OpenEnvTask],
    planned: &[PlannedEpisode<'_>],
    mut results: Vec<Option<EpisodeResult>>,
    model: bool,
) -> anyhow::Result<ExitCode> {
    let no_steps = results.iter().flatten().all(|result| result.rewards.is_empty());
    let first = results.iter_mut().flatten().find(|result| result.fault.is_some());
    if no_steps && let Some(fault) = first.and_then(|result| result.fault.take()) {
        return Err(fault.into());
    }
    // A closed stderr is no failure: the episodes are finished.
    let text = summary::text(tasks, planned, &results, model);
    let _ = write!(std::io::stderr().lock(), "{text}");
    let all = results.iter().all(|result| result.as_ref().is_some_and(|result| result.fault.is_none()));
    Ok(if all { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
