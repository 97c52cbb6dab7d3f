//! Logs, to stderr.

use std::io::IsTerminal;

use anyhow::anyhow;
use clap::ValueEnum;
use tracing::{Level, Metadata};
use tracing_subscriber::filter::{FilterExt, Filtered, LevelFilter, filter_fn};
use tracing_subscriber::layer::{Filter, Layered, SubscriberExt};
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer, Registry};

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
    pub(super) fn start(&self, usual: &str) -> anyhow::Result<Started> {
        let filter = EnvFilter::try_new(self.log.as_deref().unwrap_or(usual))?;
        let filter = filter.and(filter_fn(|line| !is_frames(line))).boxed();
        let lines = tracing_subscriber::fmt::layer()
            .with_writer(std::io::stderr)
            .with_ansi(std::io::stderr().is_terminal());
        let lines = match self.log_format {
            LogFormat::Text => lines.boxed(),
            LogFormat::Json => lines.json().boxed(),
        };
        let (started, spans) = Started::begin()?;
        tracing_subscriber::registry()
            .with(lines.with_filter(filter))
            .with(spans)
            .try_init()
            .map_err(|error| anyhow!("logs cannot be started: {error}"))?;
        Ok(started)
    }
}

/// Where spans go beside the log.
type Spans = Option<Box<dyn Layer<Lines> + Send + Sync>>;
/// What they are laid on.
type Lines = Layered<Filtered<Box<dyn Layer<Registry> + Send + Sync>, Sieve, Registry>, Registry>;
/// What lets lines through.
type Sieve = Box<dyn Filter<Registry> + Send + Sync>;

/// Logs are written as long as this lives.
#[derive(Debug, Default)]
pub(super) struct Started {
    #[cfg(feature = "otlp")]
    tracer: Option<opentelemetry_sdk::trace::SdkTracerProvider>,
}

#[cfg(not(feature = "otlp"))]
impl Started {
    fn begin() -> anyhow::Result<(Self, Spans)> {
        Ok((Self::default(), None))
    }
}

#[cfg(feature = "otlp")]
impl Started {
    /// Spans go to the collector that OpenTelemetry's own variables name; nowhere where none does.
    fn begin() -> anyhow::Result<(Self, Spans)> {
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
        // Whoever has installed one already is fine.
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
impl Drop for Started {
    fn drop(&mut self) {
        if let Some(tracer) = &self.tracer
            && let Err(error) = tracer.shutdown()
        {
            tracing::warn!(error = %error, "The last spans did not reach their collector.");
        }
    }
}

/// Whole WebSocket frames, which tungstenite writes at `trace`: with them the keys of sessions.
fn is_frames(line: &Metadata<'_>) -> bool {
    *line.level() == Level::TRACE && line.target().starts_with("tungstenite")
}

fn readable(filter: &str) -> Result<String, String> {
    // A word alone may be a part of the program, of which then everything is written, and of the others nothing: hardly ever meant.
    let level = |part: &&str| part.contains(['=', '[']) || part.trim().parse::<LevelFilter>().is_ok();
    if let Some(part) = filter.split(',').find(|part| !level(part)) {
        let part: String = part.chars().take(60).collect();
        return Err(format!(
            "{part:?} is no level: say off, error, warn, info, debug or trace, or a part of the program with one, as hyper=debug"
        ));
    }
    EnvFilter::try_new(filter).map(|_| filter.to_owned()).map_err(|error| error.to_string())
}
