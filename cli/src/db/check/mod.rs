//! `sparring db check`: checks that a database is intact and consistent.
//!
//! [`run`] does the checks that read rows once. `replay` replays action logs, `refold` examines the events of curricula, and
//! `findings` formats the result.

mod findings;
mod refold;
mod replay;

use std::path::Path;
use std::process::ExitCode;

use sqlx::SqliteConnection;
use store::columns::ClaimState;
use store::episodes::EpisodeState;
use store::integrity::{self, CountedTwice, FinishedEpisodes};
use store::keys::EpisodeKey;
use store::{OpenError, compacted_leases, logged_episodes};

use self::findings::{FindingKind, Findings};
use self::replay::EpisodeReplayer;
use super::open_readers;
use commands::output;
use orchestrator::engine::run_state::RunState;

/// Episodes that are read at a time.
const PAGE: i64 = 500;

/// Check that a database is intact and consistent.
///
/// Checks the pages of the file, the references between rows, that the curriculum of each run can be restored and has all of its
/// events, that counters and level moves agree with the episodes, and that recorded actions replay to their scores.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Prints one line for each kind of problem, with the first problems; the exit code is 1 if there is one. The check reads the whole \
database, which takes some seconds per GiB. --deep takes as long as all episodes took to replay when they were reported.

Old events of runs with compacted leases are deleted. --deep then folds from the oldest snapshot.")]
pub(super) struct Args {
    /// Number of randomly chosen episodes to replay
    #[arg(long, default_value_t = 100, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    replay: u32,
    /// Replay all recorded actions, and fold all events of every run again
    #[arg(long, conflicts_with = "replay")]
    deep: bool,
}

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
    let mut findings = Findings::default();
    match integrity::check_pages(conn).await {
        Err(error) if error.is_damage() => findings.add(FindingKind::Pages, damaged()),
        found => findings.extend(FindingKind::Pages, found?),
    }
    if findings.is_empty() {
        findings.extend(FindingKind::References, integrity::check_references(conn).await?);
    }
    let mut replayed = 0;
    if findings.is_empty() {
        findings.extend(FindingKind::Logs, integrity::check_logs(conn).await?);
        findings.extend(FindingKind::Groups, integrity::check_groups(conn).await?);
        for run in integrity::runs(conn).await? {
            check_run(conn, &run.run, &mut findings).await?;
            if args.deep {
                refold::check_fold(conn, &run.run, &mut findings).await?;
            }
        }
        replayed = match args.deep {
            true => replay_all(conn, &mut findings).await?,
            false => replay_sample(conn, args.replay, &mut findings).await?,
        };
    }
    if findings.is_empty() {
        output::print(&format!("{} is intact; {replayed} episodes were replayed", db.display()))?;
        return Ok(ExitCode::SUCCESS);
    }
    output::print(&findings.lines().join("\n"))?;
    Ok(ExitCode::FAILURE)
}

/// Checks that a run can be loaded, has its events and moves, that its compacted leases can be read, and that its counters agree.
async fn check_run(conn: &mut SqliteConnection, run: &str, findings: &mut Findings) -> anyhow::Result<()> {
    match RunState::load(conn, run).await {
        Ok(state) => refold::check_moves(conn, &state, findings).await?,
        Err(error) => findings.add(FindingKind::Runs, format!("run {run} cannot be loaded: {error}")),
    }
    let CountedTwice { counters: claimed, rows: mut claims } = integrity::claimed_episodes(conn, run).await?;
    let CountedTwice { counters, rows: mut finished } = integrity::finished_episodes(conn, run).await?;
    let mut is_compacted = false;
    let compacted = compacted_leases::each(conn, run, |lease| {
        is_compacted = true;
        let accepted = lease.claim.as_ref().is_none_or(|claim| claim.state == ClaimState::Accepted);
        if let Some(claim) = &lease.claim {
            claims.add(claim.state, claim.episodes, claim.failed);
        }
        for (_, episode) in lease.episodes() {
            if accepted && episode.state == EpisodeState::Finished {
                finished.episodes += 1;
                finished.successes += i64::from(episode.success == Some(true));
            }
        }
    });
    let compacted = compacted.await;
    refold::check_events(conn, run, is_compacted || compacted.is_err(), findings).await?;
    if let Err(error) = compacted {
        let found = format!("the compacted leases of run {run} cannot be read: {error}");
        findings.add(FindingKind::CompactedLeases, found);
        return Ok(());
    }
    compare_counters(run, counters, finished, findings);
    if claimed != claims {
        let found = format!("run {run} counts claims as {claimed:?}, but has {claims:?}");
        findings.add(FindingKind::ClaimCounters, found);
    }
    Ok(())
}

fn compare_counters(run: &str, counters: FinishedEpisodes, rows: FinishedEpisodes, findings: &mut Findings) {
    for (counted, stored, what) in [
        (counters.episodes, rows.episodes, "finished episodes"),
        (counters.successes, rows.successes, "successes"),
    ] {
        if counted != stored {
            let found = format!("run {run} counts {counted} {what}, but has {stored}");
            findings.add(FindingKind::EpisodeCounters, found);
        }
    }
}

/// Replays a random sample of episodes. Returns their number.
async fn replay_sample(
    conn: &mut SqliteConnection,
    count: u32,
    findings: &mut Findings,
) -> anyhow::Result<usize> {
    let mut replayer = EpisodeReplayer::default();
    let sample = logged_episodes::sample(conn, i64::from(count)).await?;
    for episode in &sample {
        replayer.check(conn, episode, findings).await;
    }
    Ok(sample.len())
}

/// Replays all episodes, with progress on stderr. Returns their number.
async fn replay_all(conn: &mut SqliteConnection, findings: &mut Findings) -> anyhow::Result<usize> {
    let count = usize::try_from(logged_episodes::count(conn).await?)?;
    let bar = output::progress_bar(count, "replays")?;
    let (mut replayer, mut after) = (EpisodeReplayer::default(), EpisodeKey { lease: 0, number: -1 });
    loop {
        let page = logged_episodes::after(conn, after, PAGE).await?;
        let Some(last) = page.last() else { break };
        after = last.key();
        for episode in &page {
            replayer.check(conn, episode, findings).await;
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    Ok(count)
}
