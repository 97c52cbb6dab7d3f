//! `--nats…` of `sparring serve`: workers on other machines, and trajectory feeds.

use std::time::Duration;

use anyhow::bail;
use commands::nats_args::NatsAccountArgs;
use orchestrator::service::RemoteWorkersConfig;

/// Share of the workers' results that the server recomputes by default.
const DEFAULT_SHARE: f64 = 0.02;
/// Expected time of the shortest job that goes to a worker by default, in milliseconds.
const DEFAULT_MIN_JOB_MS: u16 = 2;
/// Time after which the server does a job itself by default, in seconds.
const DEFAULT_PATIENCE_S: u16 = 10;

/// Arguments of workers on other machines.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "NATS")]
pub struct RemoteWorkersArgs {
    /// Let workers on other machines (`sparring worker`) do jobs, and publish trajectory feeds, through the NATS server with JetStream
    /// at this URL, such as nats://10.0.0.5:4222; while it is away, or without workers, the server does all jobs itself
    #[arg(long, value_name = "URL", env = "SPARRING_NATS", hide_env_values = true)]
    nats: Option<String>,
    #[command(flatten)]
    account: NatsAccountArgs,
    /// Share of the workers' results that the server recomputes, from 0 to 1; a worker with a wrong result is expelled
    #[arg(long, value_name = "SHARE", default_value_t = DEFAULT_SHARE, value_parser = parse_share)]
    nats_verify: f64,
    /// Expected time of the shortest job that goes to a worker, in milliseconds; shorter ones cost more to send than to do
    #[arg(long, value_name = "MS", default_value_t = DEFAULT_MIN_JOB_MS)]
    nats_min_job: u16,
    /// Time after which the server does a job itself that no worker works on, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = DEFAULT_PATIENCE_S, value_parser = clap::value_parser!(u16).range(1..=3600))]
    nats_patience: u16,
}

fn parse_share(text: &str) -> Result<f64, String> {
    let share: f64 = text.parse().map_err(|_| format!("{text:?} is not a number"))?;
    if (0.0..=1.0).contains(&share) {
        Ok(share)
    } else {
        Err(format!("must be between 0 and 1, got {share}"))
    }
}

impl RemoteWorkersArgs {
    /// Returns the first option of NATS that differs from its default.
    fn first_option(&self) -> Option<&'static str> {
        let options = [
            ("--nats-verify", self.nats_verify.to_bits() != DEFAULT_SHARE.to_bits()),
            ("--nats-min-job", self.nats_min_job != DEFAULT_MIN_JOB_MS),
            ("--nats-patience", self.nats_patience != DEFAULT_PATIENCE_S),
        ];
        let own = options.into_iter().find(|(_, is_set)| *is_set).map(|(option, _)| option);
        self.account.first_option().or(own)
    }

    /// Returns the configuration; `None` if the server does all jobs itself.
    ///
    /// # Errors
    /// Returns an error if the URL or the file of an option cannot be used, or if an option needs `--nats`.
    pub fn config(&self) -> anyhow::Result<Option<RemoteWorkersConfig>> {
        let Some(url) = &self.nats else {
            // The configuration file can have --nats and these options, so that the parser of the command line cannot check it.
            return match self.first_option() {
                Some(option) => bail!("{option} needs --nats URL"),
                None => Ok(None),
            };
        };
        Ok(Some(RemoteWorkersConfig {
            nats: self.account.config(url)?,
            verified_share: self.nats_verify,
            min_job: Duration::from_millis(self.nats_min_job.into()),
            patience: Duration::from_secs(self.nats_patience.into()),
        }))
    }
}
