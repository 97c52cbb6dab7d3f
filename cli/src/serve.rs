//! `sparring serve`: runs the service until a signal stops it.

use std::net::{Ipv4Addr, Ipv6Addr};
use std::num::NonZeroU32;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use clock::Clock;
use commands::interrupt::StopSignal;
use commands::llm_args::LlmArgs;
use commands::output;
use commands::policy_args::PolicyArgs;
use llm::LlmClient;
use orchestrator::designs::{BuiltInDesigners, Designers, DesignersWithModel};
use orchestrator::limits::ClientLimits;
use orchestrator::retention::archived::ArchivedRetention;
use orchestrator::service::{Config, Service};
use orchestrator::sessions::SessionLimits;

use super::alert_args::AlertArgs;
use super::bind_args::BindArgs;
use super::judge::JudgeArgs;
use super::remote_workers_args::RemoteWorkersArgs;
use super::shard_args::ShardArgs;
use super::tls_args::{ReloadSignal, TlsArgs};

/// Serve the curriculum over HTTP: trainers lease scenarios, run them and report the actions.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Ctrl-C (or SIGTERM) stops the server. It finishes running requests, loses no acknowledged result, and aborts calls of a \
designer. The same command continues where the server stopped. The server prints its URLs; /docs documents the API.

Examples:
  sparring serve
  sparring serve --db training.sqlite3 --port 9000
  sparring serve --bind 0.0.0.0:8000 --openenv-public
  sparring serve --bind 0.0.0.0:8700 --tls-cert fullchain.pem --tls-key key.pem
  sparring serve --nats nats://10.0.0.5:4222
  sparring serve --shard east --peers west=http://10.0.0.6:8700
  sparring serve --policy-url http://127.0.0.1:8000/v1 --policy-model name
  SPARRING_LLM_KEY=... sparring serve --judge llm \\
      --llm-url https://llm.example.com/v1 --llm-model name
  sparring runs create --name first")]
pub struct Args {
    #[command(flatten)]
    bind: BindArgs,
    /// Path of the SQLite database; it is created if it does not exist
    #[arg(long, default_value = "sparring.sqlite3", value_name = "PATH", env = "SPARRING_DB")]
    db: PathBuf,
    /// Use a temporary database that is deleted when the server stops; overrides --db
    #[arg(long)]
    temporary: bool,
    /// Serve the OpenEnv routes without a token, at any --bind address; they do not touch any run. All other routes need a
    /// token, and are disabled if no token exists when the server starts
    #[arg(long)]
    openenv_public: bool,
    /// Largest number of concurrent sessions (of /v1/sessions and OpenEnv, over WebSockets and HTTP requests)
    #[arg(long, default_value_t = 256, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    sessions: u32,
    /// Idle time after which a session is closed, in seconds; 0 means never
    #[arg(long, default_value_t = 900, value_name = "SECONDS")]
    session_idle: u32,
    /// How long a disconnected session of /v1/sessions can be resumed, in seconds
    #[arg(long, default_value_t = 60, value_name = "SECONDS", value_parser = clap::value_parser!(u32).range(0..=86_400))]
    session_resume: u32,
    /// Memory limit of the environments of all vector sessions of /v1/sessions together, in MiB
    #[arg(long, default_value_t = 1024, value_name = "MIB", value_parser = clap::value_parser!(u32).range(1..=1_048_576))]
    session_memory: u32,
    /// Delete archived runs with all of their data after this many days; without it they are kept
    #[arg(long, value_name = "DAYS", env = "SPARRING_DELETE_ARCHIVED_AFTER", value_parser = clap::value_parser!(u32).range(1..=36_500))]
    delete_archived_after: Option<u32>,
    /// Also stop when standard input is closed, for example because the parent process ended
    #[arg(long)]
    while_stdin: bool,
    #[command(flatten)]
    tls: TlsArgs,
    #[command(flatten)]
    each: ClientLimitArgs,
    #[command(flatten)]
    llm: LlmArgs,
    #[command(flatten)]
    judge: JudgeArgs,
    #[command(flatten)]
    policy: PolicyArgs,
    #[command(flatten)]
    alerts: AlertArgs,
    #[command(flatten)]
    remote_workers: RemoteWorkersArgs,
    #[command(flatten)]
    shards: ShardArgs,
}

/// Limits of each client.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Limits of each token (applied if tokens exist)")]
struct ClientLimitArgs {
    /// Largest request rate of a token per second; bursts of twice as many are accepted
    #[arg(long, default_value_t = ClientLimits::default().requests, value_name = "N")]
    requests_each: NonZeroU32,
    /// Largest request rate of an address without a token, per second
    #[arg(long, default_value_t = ClientLimits::default().anonymous, value_name = "N")]
    requests_anonymous: NonZeroU32,
    /// Largest number of concurrent sessions of a token, within --sessions
    #[arg(long, default_value_t = 64, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    sessions_each: u32,
    /// Largest number of active leases of a principal, with all of its tokens
    #[arg(long, default_value_t = ClientLimits::default().leases, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    leases_each: u32,
    /// Largest number of runs that a principal may own
    #[arg(long, default_value_t = ClientLimits::default().runs, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    runs_each: u32,
}

impl ClientLimitArgs {
    const fn client_limits(&self) -> ClientLimits {
        ClientLimits {
            requests: self.requests_each,
            anonymous: self.requests_anonymous,
            runs: self.runs_each,
            leases: self.leases_each,
        }
    }
}

impl Args {
    /// Settles which of two flags applies, by the sources of their values.
    pub(super) fn apply_precedence(&mut self, matches: &clap::ArgMatches) {
        self.bind.apply_precedence(matches);
    }
}

/// Runs the service until a signal, the end of stdin, or a failure of the writer stops it.
///
/// # Errors
/// Returns an error if the database or address cannot be used, or the writer fails.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let served = runtime.block_on(async {
        let clock = Clock::system();
        let designers = designers(&args.llm, &clock)?;
        let judges = args.judge.judges(&args.llm, &clock)?;
        let endpoint = args.policy.endpoint(&args.llm.limits, &clock)?;
        let idle_timeout = (args.session_idle > 0).then(|| Duration::from_secs(args.session_idle.into()));
        let sessions = SessionLimits {
            max_sessions: args.sessions as usize,
            max_per_client: args.each.sessions_each as usize,
            idle_timeout,
            resume_timeout: Duration::from_secs(args.session_resume.into()),
            memory_mib: args.session_memory,
            ..SessionLimits::default()
        };
        let bind = args.bind.address();
        let forgotten = args.temporary.then(|| tempfile::Builder::new().prefix("sparring-").tempdir()).transpose()?;
        let db = forgotten.as_ref().map_or_else(|| args.db.clone(), |folder| folder.path().join("sparring.sqlite3"));
        let config = Config { db: db.clone(), bind, tls: args.tls.files()?, clock, designers, sessions, judges, endpoint, policy_folder: args.policy.policy_folder()?, openenv_public: args.openenv_public, client_limits: args.each.client_limits(), archived_retention: args.delete_archived_after.map(ArchivedRetention::of_days), alerts: args.alerts.settings()?, remote_workers: args.remote_workers.config()?, shard: args.shards.shard.clone(), peers: args.shards.peers.clone(), process_token: None };
        let mut service = Service::start(config).await?;
        // A program that reads the URL may stop the server at once.
        let mut stop = StopSignal::install()?;
        let mut reload = ReloadSignal::install(service.tls())?;
        // Programs that start a server read the first line to learn its port.
        output::print(&url_lines(&service, args.openenv_public))?;
        tracing::info!(db = %db.display(), url = %service.url(), "The server started; Ctrl-C stops it.");
        let exit_code = tokio::select! {
            signal = stop.received() => signal?.exit_code(),
            never = reload.reload_forever() => match never {},
            () = stdin_ends(), if args.while_stdin => ExitCode::SUCCESS,
            () = service.writer_failed() => anyhow::bail!("the database writer failed, so the server stopped; the log has the reason"),
        };
        tracing::info!("The server is stopping.");
        service.stop().await;
        tracing::info!("The server stopped.");
        Ok(exit_code)
    });
    // Scenarios in preparation are dropped; the next start prepares them again.
    runtime.shutdown_background();
    served
}

/// Creates the designers of a service, with a language model if one is configured.
///
/// # Errors
/// Returns an error if the settings of the endpoint are invalid.
pub(super) fn designers(llm: &LlmArgs, clock: &Clock) -> anyhow::Result<Arc<dyn Designers>> {
    Ok(match llm.config(clock)? {
        Some(config) => Arc::new(DesignersWithModel(LlmClient::new(config).context("--llm")?)),
        None => Arc::new(BuiltInDesigners),
    })
}

/// Returns the line with the server's URL, and the URLs that people open.
fn url_lines(service: &Service, openenv_public: bool) -> String {
    let url = service.url();
    let mut address = service.address();
    if address.ip().is_unspecified() {
        // A browser on this machine reaches a server that listens on all addresses at the loopback address.
        address.set_ip(if address.is_ipv6() {
            Ipv6Addr::LOCALHOST.into()
        } else {
            Ipv4Addr::LOCALHOST.into()
        });
    }
    let scheme = if service.tls().is_some() { "https" } else { "http" };
    let openenv = format!("  OpenEnv    {url}  (form: {scheme}://{address}/web/)");
    if openenv_public {
        return format!("Sparring serves at {url}\n{openenv}");
    }
    format!(
        "Sparring serves at {url}\n  Dashboard  {scheme}://{address}/dashboard/\n  API        {scheme}://{address}/docs\n{openenv}"
    )
}

/// Waits for the end of standard input.
async fn stdin_ends() {
    let (done, ended) = tokio::sync::oneshot::channel();
    // A thread of the runtime would delay its shutdown, so this is a separate thread.
    std::thread::spawn(move || {
        let _ = std::io::copy(&mut std::io::stdin().lock(), &mut std::io::sink());
        let _ = done.send(());
    });
    let _ = ended.await; // an error means that the thread is gone, which counts as the end too
}
