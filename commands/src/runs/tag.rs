//! `sparring runs tag`: adds tags to a run and removes tags.

use std::collections::BTreeSet;

use anyhow::bail;
use api_types::{RunSummary, RunTagsRequest};

use crate::api::{ApiClient, find_run};
use crate::output::{self, JsonFlag};

/// Add tags to a run, or remove tags, and print the tags of the run.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
A tag has 1 to 64 of a-z, 0-9, _, ., : and -, and begins with a letter or a digit. A run has at most 32 tags.

Examples:
  sparring runs tag baseline paper lr:3e-4
  sparring runs tag baseline --remove draft")]
pub(super) struct Args {
    /// Run whose tags to change
    #[arg(value_name = "RUN")]
    run: String,
    /// Tags to add to the run
    #[arg(value_name = "TAG", required_unless_present = "remove")]
    tags: Vec<String>,
    /// Tag to remove; repeat the flag for several
    #[arg(long, value_name = "TAG")]
    remove: Vec<String>,
    #[command(flatten)]
    output: JsonFlag,
}

pub(super) async fn run(api: &ApiClient, args: &Args) -> anyhow::Result<()> {
    let run = find_run(api, Some(&args.run)).await?;
    let mut tags: BTreeSet<&String> = run.tags.iter().chain(&args.tags).collect();
    for tag in &args.remove {
        if args.tags.contains(tag) {
            bail!("{tag} is both a tag to add and a tag to remove; name it once");
        }
        if !tags.remove(tag) {
            bail!("run {} has no tag {tag}; its tags are: {}", run.id, listed(&run.tags));
        }
    }
    let request = RunTagsRequest { tags: tags.into_iter().cloned().collect() };
    let tagged: RunSummary = api.put(&format!("/v1/runs/{}/tags", run.id), &request).await?;
    if args.output.json {
        return output::print_json(&tagged);
    }
    output::print(&format!("tags of {}: {}", tagged.id, listed(&tagged.tags)))
}

/// Lists names in a sentence.
pub(super) fn listed(names: &[String]) -> String {
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}
