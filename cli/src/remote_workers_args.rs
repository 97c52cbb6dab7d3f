//! `--nats…` of `sparring serve`: workers on other machines, and trajectory feeds.

use std::time::Duration;

use commands::nats_args::{NatsAccountArgs, NatsUrl};
use orchestrator::service::RemoteWorkersConfig;

/// Arguments of workers on other machines.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "NATS")]
pub struct RemoteWorkersArgs {
    /// Let workers on other machines (`sparring worker`) do jobs, and publish trajectory feeds, through the NATS server with JetStream
    /// at this URL, such as nats://10.0.0.5:4222; while it is away, or without workers, the server does all jobs itself
    #[arg(long, value_name = "URL", env = "SPARRING_NATS", hide_env_values = true)]
    nats: Option<NatsUrl>,
    #[command(flatten)]
    account: NatsAccountArgs,
    /// Share of the workers' results that the server recomputes, from 0 to 1; a worker with a wrong result is expelled
    #[arg(long, value_name = "SHARE", default_value_t = 0.02, value_parser = parse_share, requires = "nats")]
    nats_verify: f64,
    /// Expected time of the shortest job that goes to a worker, in milliseconds; shorter ones cost more to send than to do
    #[arg(long, value_name = "MS", default_value_t = 2, requires = "nats")]
    nats_min_job: u16,
    /// Time after which the server does a job itself that no worker works on, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 10, requires = "nats", value_parser = clap::value_parser!(u16).range(1..=3600))]
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
    /// Returns the configuration; `None` if the server does all jobs itself.
    ///
    /// # Errors
    /// Returns an error if the file of an option cannot be used.
    pub fn config(&self) -> anyhow::Result<Option<RemoteWorkersConfig>> {
        let Some(url) = &self.nats else { return Ok(None) };
        Ok(Some(RemoteWorkersConfig {
            nats: self.account.config(url)?,
            verified_share: self.nats_verify,
            min_job: Duration::from_millis(self.nats_min_job.into()),
            patience: Duration::from_secs(self.nats_patience.into()),
        }))
    }
}
