//! `sparring runs note`: sets the note of a run.

use api_types::{RunNoteRequest, RunSummary};

use crate::api::{ApiClient, find_run};
use crate::output::{self, JsonFlag};

/// Set the note of a run and print it.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
An empty text removes the note. A note has at most 2 000 characters.

Example:
  sparring runs note baseline 'first run with the new encoder'")]
pub(super) struct Args {
    /// Run whose note to set
    #[arg(value_name = "RUN")]
    run: String,
    /// Text of the note
    #[arg(value_name = "TEXT")]
    text: String,
    #[command(flatten)]
    output: JsonFlag,
}

pub(super) async fn run(api: &ApiClient, args: &Args) -> anyhow::Result<()> {
    let run = find_run(api, Some(&args.run)).await?;
    let request = RunNoteRequest { note: args.text.clone() };
    let changed: RunSummary = api.put(&format!("/v1/runs/{}/note", run.id), &request).await?;
    if args.output.json {
        return output::print_json(&changed);
    }
    let note = if changed.note.is_empty() { "none" } else { &changed.note };
    output::print(&format!("note of {}: {note}", changed.id))
}
