//! Logs, to stderr.

use std::io::IsTerminal;

use anyhow::anyhow;
use clap::ValueEnum;
use tracing_subscriber::EnvFilter;

/// How logs are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum LogFormat {
    /// One line for people.
    Text,
    /// One JSON object a line, for machines.
    Json,
}

/// What is logged, and how. Logs go to stderr.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Logs (to stderr)")]
pub(super) struct Logs {
    /// How logs are written
    #[arg(long, global = true, value_enum, value_name = "FORMAT", default_value = "text")]
    log_format: LogFormat,
    /// What is logged: error, warn, info (default; demo: warn, play: error), debug or trace, or a list as `info,sqlx=warn`
    #[arg(
        short = 'v',
        long = "log",
        global = true,
        value_name = "LEVEL",
        env = "SPARRING_LOG",
        hide_env_values = true,
        value_parser = readable
    )]
    log: Option<String>,
}

impl Logs {
    /// From here on, what the program logs is written; `usual` where nothing else was asked for.
    pub(super) fn start(&self, usual: &str) -> anyhow::Result<()> {
        let filter = EnvFilter::try_new(self.log.as_deref().unwrap_or(usual))?;
        let builder = tracing_subscriber::fmt()
            .with_env_filter(filter)
            .with_writer(std::io::stderr)
            .with_ansi(std::io::stderr().is_terminal());
        match self.log_format {
            LogFormat::Text => builder.try_init(),
            LogFormat::Json => builder.json().try_init(),
        }
        .map_err(|error| anyhow!("logs cannot be started: {error}"))
    }
}

fn readable(filter: &str) -> Result<String, String> {
    EnvFilter::try_new(filter).map(|_| filter.to_owned()).map_err(|error| error.to_string())
}
