//! `sparring tail`: prints the events of a run as they happen.

use std::process::ExitCode;

use serde_json::Value;

use crate::api::{Connection, ServerArgs, StartService};
use crate::api::{EventStream, StreamedEvent, find_run};
use crate::output::{self, OutputTarget};

/// Print the events of a run as they happen, until Ctrl-C.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Events: run (created, changed, tagged, paused, resumed, archived, deleted), lease, group (closed), move (of a level), claim \
(of columns), failures, design and warning. If the connection breaks, the command connects again and misses no event. It ends \
when the run is deleted.

Examples:
  sparring tail
  sparring tail baseline --last 100 --kind move,warning
  sparring tail baseline --json | jq -c 'select(.kind == \"move\")'")]
pub struct Args {
    /// Run whose events to print [default: the only run]
    #[arg(value_name = "RUN")]
    run: Option<String>,
    /// Number of past events to begin with, of the kinds of --kind
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(0..=1000))]
    last: u32,
    /// Kinds of events to print, separated by commas [default: all]
    #[arg(long = "kind", value_name = "KIND", value_delimiter = ',',
          value_parser = ["run", "lease", "group", "move", "claim", "failures", "design", "worker", "warning"])]
    kinds: Vec<String>,
    /// Exit after the past events
    #[arg(long)]
    no_follow: bool,
    /// Print one JSON object per line
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    server: ServerArgs,
}

/// Prints events until Ctrl-C, until stdout is closed, or until the run is deleted.
///
/// # Errors
/// Returns an error if the server cannot be reached or the run does not exist.
pub fn run(args: &Args, start: StartService) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    runtime.block_on(async {
        let connection = Connection::open(&args.server, start).await?;
        let done = follow(&connection, args).await;
        connection.close().await;
        done.map(|()| ExitCode::SUCCESS)
    })
}

async fn follow(connection: &Connection, args: &Args) -> anyhow::Result<()> {
    let run = find_run(&connection.api, args.run.as_deref()).await?.id;
    let mut events = EventStream::open(&connection.api, &run, &args.kinds, args.last).await?;
    let format = if args.json { LineFormat::Json } else { LineFormat::Text(OutputTarget::stdout()) };
    let is_piped = format == LineFormat::Text(OutputTarget::Piped);
    if is_piped && !output::print_unless_closed("at\tkind\tevent")? {
        return Ok(());
    }
    // Without a server nothing more will happen.
    let ends = args.no_follow || !connection.is_server();
    loop {
        let Some(event) = (if ends { events.next_past().await? } else { Some(events.next().await?) }) else {
            return Ok(());
        };
        let is_wanted = args.kinds.is_empty() || args.kinds.contains(&event.kind) || event.kind == "gap";
        if is_wanted && !output::print_unless_closed(&format.line(&event))? {
            return Ok(());
        }
        if is_deletion(&event) {
            return Ok(()); // the server closes the stream
        }
    }
}

fn is_deletion(event: &StreamedEvent) -> bool {
    event.kind == "run" && event.data["state"] == "deleted"
}

/// Format of the printed events.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum LineFormat {
    /// One JSON object per line.
    Json,
    /// Sentences that fit a terminal, or tab-separated values for a pipe.
    Text(OutputTarget),
}

impl LineFormat {
    /// Formats an event, without a line end.
    fn line(self, event: &StreamedEvent) -> String {
        let at = event.data["at"].as_str().unwrap_or("–");
        let text = || describe(&event.kind, &event.data).replace(char::is_control, " ");
        match self {
            Self::Json => {
                serde_json::json!({"id": event.id, "kind": event.kind, "data": event.data}).to_string()
            }
            Self::Text(OutputTarget::Piped) => format!("{at}\t{}\t{}", event.kind, text()),
            Self::Text(terminal) => terminal.wrap(&format!("{at}  {:<8}  {}", event.kind, text()), "  "),
        }
    }
}

/// Describes the content of an event.
fn describe(kind: &str, data: &Value) -> String {
    let text = |name: &str| data[name].as_str().unwrap_or_default().to_owned();
    let number = |name: &str| data[name].as_i64().unwrap_or_default();
    let reason = |name: &str| data[name].as_str().map_or_else(String::new, |why| format!(": {why}"));
    match kind {
        "run" => text("state"),
        "lease" => format!(
            "{} {}: {} groups of {} ({}, {})",
            text("lease"),
            text("state"),
            number("groups"),
            number("group_size"),
            text("purpose"),
            text("form")
        ),
        "group" if number("finished") == 0 => format!(
            "{} group {} of {}: closed without a finished episode",
            text("lease"),
            number("group"),
            text("task")
        ),
        "group" => format!(
            "{} group {} of {}: {} of {} episodes succeeded",
            text("lease"),
            number("group"),
            text("task"),
            number("successes"),
            number("finished")
        ),
        "move" => {
            let from = data["from"].as_i64().map_or_else(String::new, |from| format!(" from level {from}"));
            let evidence = data["evidence"]["sentence"].as_str();
            let evidence = evidence.map_or_else(String::new, |sentence| format!(": {sentence}"));
            format!("{}{from} to level {}{evidence}", text("task"), number("to"))
        }
        "claim" => format!(
            "{}: {} episodes in columns {}{}",
            text("lease"),
            number("episodes"),
            text("state"),
            reason("reason")
        ),
        "failures" => format!(
            "{}: failure analysis of {} episodes finished{}",
            text("task"),
            number("criticised"),
            counts(&data["modes"])
        ),
        "design" => format!(
            "{}: the designer {} finished request {}: {} layouts admitted, {} refused{}",
            text("task"),
            text("designer"),
            text("request"),
            number("admitted"),
            number("refused"),
            reason("error")
        ),
        "worker" | "warning" | "gap" => text("message"),
        _ => fields(data),
    }
}

/// Lists counts by failure mode, as " (6 collision, 2 wasted fuel)"; nothing if there are none.
fn counts(modes: &Value) -> String {
    let modes = modes.as_object().into_iter().flatten();
    let words: Vec<String> =
        modes.map(|(mode, count)| format!("{count} {}", mode.replace('_', " "))).collect();
    if words.is_empty() { String::new() } else { format!(" ({})", words.join(", ")) }
}

/// Lists the fields of an event, as "task kessler/survival, admitted 3".
fn fields(data: &Value) -> String {
    let fields = data.as_object().into_iter().flatten().filter(|(name, _)| *name != "at");
    let words = fields.map(|(name, value)| match value {
        Value::String(text) => format!("{name} {text}"),
        value => format!("{name} {value}"),
    });
    words.collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn events_are_one_line_each() {
        let event = |kind: &str, data: Value| {
            let event = StreamedEvent { id: "7".to_owned(), kind: kind.to_owned(), data };
            LineFormat::Text(OutputTarget::Terminal(80)).line(&event)
        };
        let at = "2026-11-26T10:00:00Z";
        insta::assert_snapshot!([
            event("run", json!({"at": at, "state": "created"})),
            event("lease", json!({"at": at, "lease": "lease_1-a", "state": "created", "purpose": "train", "form": "groups",
                "groups": 8, "group_size": 4})),
            event("group", json!({"at": at, "lease": "lease_1-a", "group": 2, "task": "kessler/survival", "successes": 3,
                "finished": 4})),
            event("move", json!({"at": at, "task": "kessler/survival", "from": 2, "to": 3,
                "evidence": {"sentence": "Two blocks passed."}})),
            event("move", json!({"at": at, "task": "kessler/survival", "from": null, "to": 3, "evidence": {}})),
            event("failures", json!({"at": at, "task": "kessler/survival", "criticised": 8, "modes": {"collision": 2}})),
            event("claim", json!({"at": at, "lease": "lease_1-a", "state": "refused", "episodes": 64, "reason": "scores differ"})),
            event("design", json!({"at": at, "task": "kessler/survival", "request": "design_1", "designer": "procedural",
                "admitted": 3, "refused": 1})),
            event("gap", json!({"message": "events are missing"})),
        ].join("\n"));
    }
}
