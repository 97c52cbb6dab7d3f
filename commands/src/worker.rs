//! `sparring worker`: does jobs of servers on this machine.

use std::collections::BTreeSet;
use std::process::ExitCode;

use job_queue::nats::worker::{WorkerConfig, run as run_worker};
use jobs::JobKind;
use tokio::sync::watch;

use crate::interrupt::StopSignal;
use crate::nats_args::NatsArgs;

/// Do jobs of a server on this machine: prepare scenarios, replay results, criticise episodes.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The worker needs no database and no access to the server: both connect to NATS, where the server was started with `sparring serve \
--nats`. A worker keeps nothing, so it can be started and killed at any time; its jobs go to other workers, or the server does them. \
It must be of the same version as the server, which refuses it otherwise. Ctrl-C (or SIGTERM) ends it after its running jobs.

Examples:
  sparring worker --nats nats://10.0.0.5:4222
  sparring worker --nats nats://10.0.0.5:4222 --jobs audit --concurrency 4")]
pub struct Args {
    /// Kinds of jobs to do, with commas between them
    #[arg(long, value_name = "KINDS", value_delimiter = ',', default_value = "prepare,audit,critique", value_parser = clap::value_parser!(JobKind))]
    jobs: Vec<JobKind>,
    /// Number of jobs to do at once [default: the number of cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    concurrency: Option<u16>,
    /// Name of this machine in the list of workers [default: its host name]
    #[arg(long, value_name = "NAME")]
    host: Option<String>,
    #[command(flatten)]
    nats: NatsArgs,
}

/// Runs a worker until a signal stops it.
///
/// # Errors
/// Returns an error if the server refuses or expels the worker, or if the system has no threads left.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let cores = || std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let config = WorkerConfig {
        nats: args.nats.config(),
        host: args.host.clone().unwrap_or_else(job_queue::host_name),
        kinds: args.jobs.iter().copied().collect::<BTreeSet<_>>(),
        concurrency: args.concurrency.map_or_else(cores, usize::from),
    };
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    runtime.block_on(async {
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
    })
}
