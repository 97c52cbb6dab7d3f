//! `sparring worker`: does jobs of servers on this machine.

use std::collections::BTreeSet;
use std::process::ExitCode;
use std::str::FromStr;

use anyhow::{Context, bail};
use clock::Clock;
use job_queue::nats::worker::{WorkerConfig, WorkerDesigners, run as run_worker};
use jobs::JobKind;
use jobs::kind::UnknownJobKind;
use llm::LlmClient;
use rollout::PolicySources;
use tokio::sync::watch;

use crate::interrupt::StopSignal;
use crate::llm_args::LlmArgs;
use crate::nats_args::NatsArgs;
use crate::policy_args::PolicyArgs;

/// Largest number of characters of a machine's name.
const MAX_HOST_CHARS: usize = 64;

/// Do jobs of a server on this machine: prepare scenarios, replay results, criticise episodes, design layouts, roll out policies.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The worker needs no database and no access to the server: both connect to NATS, where the server was started with `sparring serve \
--nats`. A worker keeps nothing, so it can be started and killed at any time; its jobs go to other workers, or the server does them. \
It must be of the same version as the server, which refuses it otherwise. Ctrl-C (or SIGTERM) ends it after its running jobs.

The kind `rollout` stands for all policies that the worker has: built-in ones, the files of --policy-folder, and the language model of \
--policy-url. The kinds rollout_built_in, rollout_file and rollout_chat name one of them. The kind `design` stands for both designers: \
the procedural one, and the language model of --llm-url if it is set. The kinds design_procedural and design_llm name one of them.

Examples:
  sparring worker --nats nats://10.0.0.5:4222
  sparring worker --nats nats://10.0.0.5:4222 --jobs audit --concurrency 4
  sparring worker --nats nats://10.0.0.5:4222 --jobs rollout \\
      --policy-url http://127.0.0.1:8000/v1 --policy-model name
  sparring worker --nats nats://10.0.0.5:4222 --jobs design \\
      --llm-url https://llm.example.com/v1 --llm-model name")]
pub struct Args {
    /// Kinds of jobs to do, with commas between them: prepare, audit, critique, design, rollout
    #[arg(long, value_name = "KINDS", value_delimiter = ',', default_value = "prepare,audit,critique", value_parser = clap::value_parser!(JobChoice))]
    jobs: Vec<JobChoice>,
    /// Number of jobs to do at once [default: the number of cores]; --policy-concurrency limits conversations, and --llm-concurrency
    /// requests to the model that designs
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    concurrency: Option<u16>,
    /// Name of this machine in the list of workers [default: its host name]
    #[arg(long, value_name = "NAME", value_parser = parse_host)]
    host: Option<String>,
    #[command(flatten)]
    nats: NatsArgs,
    #[command(flatten)]
    policy: PolicyArgs,
    #[command(flatten)]
    llm: LlmArgs,
}

/// Kinds that a word of `--jobs` names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum JobChoice {
    /// One kind of jobs.
    Kind(JobKind),
    /// Designs of all designers that the worker has.
    Design,
    /// Rollouts of all policies that the worker has.
    Rollout,
}

impl FromStr for JobChoice {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        match word {
            "design" => Ok(Self::Design),
            "rollout" => Ok(Self::Rollout),
            _ => word.parse().map(Self::Kind).map_err(|_: UnknownJobKind| {
                let kinds = JobKind::ALL.map(JobKind::as_str).join(", ");
                format!("the kinds are design, rollout, {kinds}")
            }),
        }
    }
}

/// Parses the name of a machine.
fn parse_host(name: &str) -> Result<String, String> {
    if (1..=MAX_HOST_CHARS).contains(&name.chars().count()) && !name.chars().any(char::is_control) {
        Ok(name.to_owned())
    } else {
        Err(format!("the name must have 1 to {MAX_HOST_CHARS} characters, none of them a control character"))
    }
}

/// Returns the kinds of jobs that a worker with these policies and designers takes.
///
/// # Errors
/// Returns an error if it lacks the policy or the designer of a kind that is named.
fn kinds(
    choices: &[JobChoice],
    policies: &PolicySources,
    designers: &WorkerDesigners,
) -> anyhow::Result<BTreeSet<JobKind>> {
    let (has_files, has_model) = (policies.folder.is_configured(), policies.endpoint.is_some());
    let mut kinds = BTreeSet::new();
    for choice in choices {
        match choice {
            JobChoice::Kind(JobKind::RolloutFile) if !has_files => {
                bail!("--jobs rollout_file needs --policy-folder")
            }
            JobChoice::Kind(JobKind::RolloutChat) if !has_model => {
                bail!("--jobs rollout_chat needs --policy-url and --policy-model")
            }
            JobChoice::Kind(JobKind::DesignLlm) if designers.llm.is_none() => {
                bail!("--jobs design_llm needs --llm-url and --llm-model")
            }
            JobChoice::Kind(kind) => drop(kinds.insert(*kind)),
            JobChoice::Design => {
                kinds.insert(JobKind::DesignProcedural);
                kinds.extend(designers.llm.is_some().then_some(JobKind::DesignLlm));
            }
            JobChoice::Rollout => {
                kinds.insert(JobKind::RolloutBuiltIn);
                kinds.extend(has_files.then_some(JobKind::RolloutFile));
                kinds.extend(has_model.then_some(JobKind::RolloutChat));
            }
        }
    }
    Ok(kinds)
}

/// Runs a worker until a signal stops it.
///
/// # Errors
/// Returns an error if the arguments of its policies or its language model are invalid, if the server refuses or expels the
/// worker, or if the system has no threads left.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let cores = || std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let clock = Clock::system();
    let policies = args.policy.sources(&args.llm.limits, &clock)?;
    let llm = args.llm.config(&clock)?.map(LlmClient::new).transpose().context("--llm")?;
    let designers = WorkerDesigners { llm };
    let config = WorkerConfig {
        nats: args.nats.config()?,
        host: args.host.clone().unwrap_or_else(job_queue::host_name),
        kinds: kinds(&args.jobs, &policies, &designers)?,
        concurrency: args.concurrency.map_or_else(cores, usize::from),
        policies,
        designers,
    };
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let ended = runtime.block_on(async {
        let mut signal = StopSignal::install()?;
        let (stop, stopped) = watch::channel(false);
        let waiting = tokio::spawn(async move {
            let request = signal.received().await;
            tracing::info!("The worker is stopping.");
            stop.send_replace(true);
            request
        });
        run_worker(config, stopped).await?;
        Ok(waiting.await??.exit_code())
    });
    // A worker that is stopped while it starts does not wait for the version of its worlds.
    runtime.shutdown_background();
    ended
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_follow_from_the_policies_and_designers_of_a_worker() {
        let parse =
            |words: &str| words.split(',').map(|word| word.parse().unwrap()).collect::<Vec<JobChoice>>();
        let none = PolicySources::default();
        let files = PolicySources { folder: policy_files::PolicyFolder::new(".".into()), ..none.clone() };
        let of = |words: &str, policies: &PolicySources| {
            kinds(&parse(words), policies, &WorkerDesigners::default())
                .map(|kinds| kinds.iter().map(ToString::to_string).collect::<Vec<_>>().join(","))
        };
        assert_eq!(of("rollout,audit", &none).unwrap(), "audit,rollout_built_in");
        assert_eq!(of("rollout", &files).unwrap(), "rollout_built_in,rollout_file");
        assert_eq!(of("rollout_file", &files).unwrap(), "rollout_file");
        for (words, missing) in [("rollout_file", "--policy-folder"), ("rollout_chat", "--policy-url")] {
            assert!(of(words, &none).unwrap_err().to_string().contains(missing));
        }
        assert_eq!(of("design", &none).unwrap(), "design_procedural");
        let config =
            llm::LlmConfig::new("http://h/v1", "m", crate::llm_args::wall_clock(&Clock::manual(5).clock));
        let designers = WorkerDesigners { llm: Some(LlmClient::new(config).unwrap()) };
        assert!(kinds(&parse("design"), &none, &designers).unwrap().contains(&JobKind::DesignLlm));
        assert!(of("design_llm", &none).unwrap_err().to_string().contains("--llm-url"));
        assert!("golf".parse::<JobChoice>().is_err());
    }
}
