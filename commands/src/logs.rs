//! Arguments and setup of logging to stderr.

use std::io::IsTerminal;

use anyhow::anyhow;
use clap::ValueEnum;
use tracing::{Level, Metadata};
use tracing_subscriber::filter::{FilterExt, Filtered, LevelFilter, filter_fn};
use tracing_subscriber::layer::{Filter, Layered, SubscriberExt};
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer, Registry};

/// Format of the logs on stderr.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum LogFormat {
    /// One line for people.
    Text,
    /// One JSON object a line, for machines.
    Json,
}

/// Arguments that set the format and the level of the logs.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Logs (to stderr)")]
pub struct LogArgs {
    /// Set the log format
    #[arg(long, global = true, value_enum, value_name = "FORMAT", default_value = "text")]
    log_format: LogFormat,
    /// Set the log level: error, warn, info, debug or trace, or a list such as `info,sqlx=warn` [default: info; demo: warn;
    /// play: error]
    #[arg(
        short = 'v',
        long = "log",
        global = true,
        value_name = "LEVEL",
        env = "SPARRING_LOG",
        hide_env_values = true,
        value_parser = parse_log_filter
    )]
    log: Option<String>,
}

impl LogArgs {
    /// Starts logging at the level of the arguments, or at `default_level`. Logging ends when the guard is dropped.
    ///
    /// # Errors
    /// Returns an error if the filter is invalid or logging has been started before.
    pub fn start(&self, default_level: &str) -> anyhow::Result<LogGuard> {
        let filter = line_filter(self.log.as_deref().unwrap_or(default_level))?;
        let lines = tracing_subscriber::fmt::layer()
            .with_writer(std::io::stderr)
            .with_ansi(std::io::stderr().is_terminal());
        let lines = match self.log_format {
            LogFormat::Text => lines.boxed(),
            LogFormat::Json => lines.json().boxed(),
        };
        let (started, spans) = LogGuard::begin()?;
        tracing_subscriber::registry()
            .with(lines.with_filter(filter))
            .with(spans)
            .try_init()
            .map_err(|error| anyhow!("logs cannot be started: {error}"))?;
        Ok(started)
    }
}

/// Layer that exports spans, if a collector is configured.
type SpanLayer = Option<Box<dyn Layer<LogRegistry> + Send + Sync>>;
/// Subscriber with the layer of log lines.
type LogRegistry = Layered<Filtered<Box<dyn Layer<Registry> + Send + Sync>, LogFilter, Registry>, Registry>;
/// Filter of the log lines.
type LogFilter = Box<dyn Filter<Registry> + Send + Sync>;

/// Guard of the logging setup; dropping it flushes the exported spans.
#[derive(Debug, Default)]
pub struct LogGuard {
    #[cfg(feature = "otlp")]
    tracer: Option<opentelemetry_sdk::trace::SdkTracerProvider>,
}

#[cfg(not(feature = "otlp"))]
impl LogGuard {
    fn begin() -> anyhow::Result<(Self, SpanLayer)> {
        Ok((Self::default(), None))
    }
}

#[cfg(feature = "otlp")]
impl LogGuard {
    /// Creates the exporter to the collector that OpenTelemetry's environment variables name, if they name one.
    fn begin() -> anyhow::Result<(Self, SpanLayer)> {
        use opentelemetry::trace::TracerProvider;
        use opentelemetry_otlp::{
            OTEL_EXPORTER_OTLP_ENDPOINT, OTEL_EXPORTER_OTLP_TRACES_ENDPOINT, SpanExporter,
        };
        use opentelemetry_sdk::Resource;
        use opentelemetry_sdk::trace::SdkTracerProvider;

        let named = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
        if !named(OTEL_EXPORTER_OTLP_ENDPOINT) && !named(OTEL_EXPORTER_OTLP_TRACES_ENDPOINT) {
            return Ok((Self::default(), None));
        }
        // An error means that a provider is installed already, which is fine.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let exporter = SpanExporter::builder().with_http().build()?;
        let resource = Resource::builder().with_service_name("sparring").build();
        let tracer =
            SdkTracerProvider::builder().with_resource(resource).with_batch_exporter(exporter).build();
        let level = LevelFilter::INFO;
        let spans = tracing_opentelemetry::layer().with_tracer(tracer.tracer("sparring")).with_filter(level);
        Ok((Self { tracer: Some(tracer) }, Some(spans.boxed())))
    }
}

#[cfg(feature = "otlp")]
impl Drop for LogGuard {
    fn drop(&mut self) {
        if let Some(tracer) = &self.tracer
            && let Err(error) = tracer.shutdown()
        {
            tracing::warn!(error = %error, "The last spans did not reach their collector.");
        }
    }
}

/// Creates the filter of the log lines.
///
/// Its most verbose level is that of `levels`: without one, every disabled line of every package would be filtered anew.
fn line_filter(levels: &str) -> anyhow::Result<LogFilter> {
    // The client of NATS logs each attempt to connect; Sparring itself logs that NATS is away, and why.
    let levels = if levels == "info" { "info,async_nats=warn,async_nats::connector=off" } else { levels };
    let without_frames = filter_fn(|line| !is_frames(line)).with_max_level_hint(LevelFilter::TRACE);
    Ok(EnvFilter::try_new(levels)?.and(without_frames).boxed())
}

/// Returns true for whole WebSocket frames, which tungstenite logs at `trace`: they hold the keys of sessions.
fn is_frames(line: &Metadata<'_>) -> bool {
    *line.level() == Level::TRACE && line.target().starts_with("tungstenite")
}

pub(crate) fn parse_log_filter(filter: &str) -> Result<String, String> {
    // A bare word may name a target, which would log everything of it and nothing else: this is hardly ever intended.
    let has_level = |part: &&str| part.contains(['=', '[']) || part.trim().parse::<LevelFilter>().is_ok();
    if let Some(part) = filter.split(',').find(|part| !has_level(part)) {
        let part: String = part.chars().take(60).collect();
        return Err(format!(
            "{part:?} is no level: say off, error, warn, info, debug or trace, or a part of the program with one, as hyper=debug"
        ));
    }
    // The parser of tracing-subscriber panics at some characters of several bytes.
    if let Some(c) = filter.chars().find(|c| !c.is_ascii()) {
        return Err(format!("{c:?} is not ASCII: write a filter such as info,hyper=debug"));
    }
    EnvFilter::try_new(filter).map(|_| filter.to_owned()).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filter_with_any_character_is_parsed_or_rejected() {
        assert_eq!(parse_log_filter("info,hyper=debug"), Ok("info,hyper=debug".to_owned()));
        assert!(parse_log_filter("\nconta!cct\u{202e}=swept").unwrap_err().contains("ASCII"));
        assert!(parse_log_filter("shout").unwrap_err().contains("is no level"));
    }

    #[test]
    fn filter_has_the_most_verbose_of_its_levels() {
        for (levels, most_verbose) in [("info", LevelFilter::INFO), ("warn,hyper=debug", LevelFilter::DEBUG)]
        {
            assert_eq!(line_filter(levels).unwrap().max_level_hint(), Some(most_verbose));
        }
    }
}
