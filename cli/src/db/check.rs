//! `sparring db check`: checks that a database is intact and consistent.

use std::path::Path;
use std::process::ExitCode;

use env_core::rollout::replay;
use sqlx::SqliteConnection;
use store::columns::ClaimState;
use store::episodes::{self, EpisodeState};
use store::integrity::{self, CountedTwice, ScoredEpisode};
use store::keys::EpisodeKey;
use store::scenarios::ScenarioLoader;
use store::{OpenError, compacted_leases, groups, leases};

use super::open_readers;
use commands::output;
use orchestrator::engine::run_state::RunState;

/// Check that a database is intact and consistent.
///
/// Checks the pages of the file, the references between rows, that the curriculum of each run can be restored, that counters
/// agree with the episodes, and that recorded actions replay to their scores.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Prints one sentence per problem; the exit code is 1 if there is one. The check reads the whole database, which takes some \
seconds per GiB.")]
pub(super) struct Args {
    /// Number of randomly chosen episodes to replay
    #[arg(long, default_value_t = 100, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    replay: u32,
}

/// Accepted difference between a stored and a replayed score: both must be equal to the last bit.
const SCORE_TOLERANCE: f64 = 0.0;

pub(super) async fn run(db: &Path, args: &Args) -> anyhow::Result<ExitCode> {
    let damaged = || OpenError::damaged(db).to_string();
    let open_readers = match open_readers(db).await {
        Err(error) if matches!(error.downcast_ref(), Some(OpenError::Damaged { .. })) => {
            output::print(&damaged())?;
            return Ok(ExitCode::FAILURE);
        }
        open_readers => open_readers?,
    };
    // One read transaction sees one moment, even if a server writes meanwhile.
    let mut moment = open_readers.begin().await?;
    let conn = &mut *moment;
    let mut found = match integrity::check_file(conn).await {
        Err(error) if error.is_damage() => vec![damaged()],
        found => found?,
    };
    if found.is_empty() {
        found.extend(integrity::check_rows(conn).await?);
        for run in integrity::runs(conn).await? {
            found.extend(check_run(conn, &run.run).await?);
        }
        found.extend(check_scores(conn, args.replay).await?);
    }
    if found.is_empty() {
        output::print(&format!("{} is intact; up to {} episodes were replayed", db.display(), args.replay))?;
        return Ok(ExitCode::SUCCESS);
    }
    output::print(&found.join("\n"))?;
    Ok(ExitCode::FAILURE)
}

/// Checks that a run can be loaded, its compacted leases can be read, and its counters agree. Returns one sentence per finding.
async fn check_run(conn: &mut SqliteConnection, run: &str) -> anyhow::Result<Vec<String>> {
    let mut found = Vec::new();
    if let Err(error) = RunState::load(conn, run).await {
        found.push(format!("run {run} cannot be loaded: {error}"));
    }
    let CountedTwice { counters: claimed, rows: mut claims } = integrity::claimed_episodes(conn, run).await?;
    let mut counted = 0;
    let compacted = compacted_leases::each(conn, run, |lease| {
        let accepted = lease.claim.as_ref().is_none_or(|claim| claim.state == ClaimState::Accepted);
        if let Some(claim) = &lease.claim {
            claims.add(claim.state, claim.episodes, claim.failed);
        }
        let finished = lease.episodes().filter(|(_, episode)| episode.state == EpisodeState::Finished);
        counted += if accepted { finished.count() as i64 } else { 0 };
    });
    if let Err(error) = compacted.await {
        found.push(format!("the compacted leases of run {run} cannot be read: {error}"));
        return Ok(found);
    }
    let CountedTwice { counters: summed, rows: whole } = integrity::finished_episodes(conn, run).await?;
    if summed != whole + counted {
        found.push(format!("run {run} counts {summed} finished episodes, but has {}", whole + counted));
    }
    if claimed != claims {
        found.push(format!("run {run} counts claims as {claimed:?}, but has {claims:?}"));
    }
    Ok(found)
}

/// Replays a random sample of episodes and compares their scores. Returns one sentence per finding.
async fn check_scores(conn: &mut SqliteConnection, count: u32) -> anyhow::Result<Vec<String>> {
    let (mut found, mut loader) = (Vec::new(), ScenarioLoader::default());
    for ScoredEpisode { key, score: stored } in integrity::sample(conn, i64::from(count)).await? {
        let EpisodeKey { lease, number } = key;
        let score = replay_score(conn, &mut loader, key).await;
        match score {
            Ok(score) if (score - stored).abs() <= SCORE_TOLERANCE => {}
            Ok(score) => {
                found.push(format!("episode {number} of lease {lease} replays to {score}, not {stored}"));
            }
            Err(error) => {
                found.push(format!("episode {number} of lease {lease} cannot be replayed: {error}"));
            }
        }
    }
    Ok(found)
}

async fn replay_score(
    conn: &mut SqliteConnection,
    loader: &mut ScenarioLoader,
    EpisodeKey { lease, number }: EpisodeKey,
) -> anyhow::Result<f64> {
    let row = leases::get(conn, lease).await?.ok_or_else(|| anyhow::anyhow!("its lease does not exist"))?;
    let group = groups::get(conn, lease, number / row.group_size.max(1)).await?;
    let group = group.ok_or_else(|| anyhow::anyhow!("its group does not exist"))?;
    let scenario = loader.get(conn, &group.scenario).await?;
    let log = episodes::log(conn, lease, number).await?;
    let log = log.ok_or_else(|| anyhow::anyhow!("its actions are not stored"))?;
    Ok(replay(&scenario, &log)?.score)
}
