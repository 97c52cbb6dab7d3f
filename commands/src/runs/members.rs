//! `sparring runs members`: shows, adds and removes members of a run.

use std::collections::BTreeSet;

use anyhow::bail;
use api_types::{RunMembersRequest, RunSummary};

use super::tag::listed;
use crate::api::{ApiClient, find_run};
use crate::output::{self, JsonFlag};

/// Show the owner and the members of a run, add members, or remove members.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
A member is a principal: the owner of tokens, which `sparring token list` shows. The members of a run can lease, report results, open \
sessions and pull trajectories. Only the owner of the run and admins can change the run and its members. A run that was created without \
tokens has no owner: every trainer is a member until an admin sets an owner.

Examples:
  sparring runs members baseline
  sparring runs members baseline ppo-cluster notebook
  sparring runs members baseline --remove notebook
  sparring runs members old-run --owner ppo-cluster")]
pub(super) struct Args {
    /// Run whose members to show or change
    #[arg(value_name = "RUN")]
    run: String,
    /// Principals to add to the members of the run
    #[arg(value_name = "NAME")]
    names: Vec<String>,
    /// Principal to remove; repeat the flag for several
    #[arg(long, value_name = "NAME")]
    remove: Vec<String>,
    /// Principal to make the owner of the run; needs a token of an admin
    #[arg(long, value_name = "NAME")]
    owner: Option<String>,
    #[command(flatten)]
    output: JsonFlag,
}

pub(super) async fn run(api: &ApiClient, args: &Args) -> anyhow::Result<()> {
    let mut run = find_run(api, Some(&args.run)).await?;
    if !args.names.is_empty() || !args.remove.is_empty() || args.owner.is_some() {
        let request = RunMembersRequest { members: changed_members(&run, args)?, owner: args.owner.clone() };
        run = api.put(&format!("/v1/runs/{}/members", run.id), &request).await?;
    }
    if args.output.json {
        return output::print_json(&run);
    }
    let owner = run.owner.as_deref().unwrap_or("none");
    output::print(&format!("owner of {}: {owner}\nmembers: {}", run.id, listed(&run.members)))
}

/// Returns the members of a run after the change.
fn changed_members(run: &RunSummary, args: &Args) -> anyhow::Result<Vec<String>> {
    let mut members: BTreeSet<&String> = run.members.iter().chain(&args.names).collect();
    for name in &args.remove {
        if args.names.contains(name) {
            bail!("{name} is both a member to add and a member to remove; name it once");
        }
        if !members.remove(name) {
            bail!("{name} is no member of run {}; its members are: {}", run.id, listed(&run.members));
        }
    }
    Ok(members.into_iter().cloned().collect())
}
