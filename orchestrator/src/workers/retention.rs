//! Compacts the leases that runs no longer keep whole, and deletes what nothing refers to.

use std::collections::{HashMap, HashSet};
use std::time::{Duration, Instant};

use futures_util::future::try_join_all;
use sqlx::SqlitePool;
use store::retention::{self, RetainedEpisodes};
use store::{from_json, gc};

use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;
use crate::retention::collect_garbage::CollectGarbage;
use crate::retention::compact_leases::{CompactLeases, CompactionGoal};
use crate::retention::delete_old_minutes::DeleteOldMinutes;
use crate::runs::settings::RunSettings;
use crate::workers::round_error::ends_worker;

/// Interval between two checks.
const POLL_INTERVAL: Duration = Duration::from_secs(2);
/// Maximum number of concurrent compactions, reached when a run keeps twice its limit. Other changes wait behind them, so that
/// results do not arrive faster than they are compacted.
const MAX_CONCURRENT_CHANGES: i64 = 8;
/// Maximum number of compactions in a row, before garbage is collected and the limits are checked again.
const MAX_CHANGES_PER_ROUND: i64 = 64;
/// Interval between two deletions of old minutes.
const DELETE_MINUTES_INTERVAL: Duration = Duration::from_secs(3600);

/// Runs until the writer stops.
pub(super) async fn run(readers: SqlitePool, writer: Writer) {
    let mut worker = RetentionWorker {
        readers,
        writer,
        examined: HashMap::new(),
        to_examine: HashSet::new(),
        minutes_deleted_at: None,
    };
    loop {
        match worker.run_round().await {
            Ok(true) => continue, // more is left
            Ok(false) => {}
            Err(error) if ends_worker(&error, "old leases could not be compacted") => return,
            Err(_) => {}
        }
        tokio::time::sleep(POLL_INTERVAL).await;
    }
}

struct RetentionWorker {
    readers: SqlitePool,
    writer: Writer,
    /// By run, the last partly compacted lease whose rest was examined.
    examined: HashMap<String, i64>,
    /// Runs with compactions since all of their partly compacted leases were examined.
    to_examine: HashSet<String>,
    /// When old minutes were last deleted.
    minutes_deleted_at: Option<Instant>,
}

impl RetentionWorker {
    /// Compacts some leases of each run that exceeds its limits. Returns true if more may be left. A run that fails does not delay
    /// the others.
    async fn run_round(&mut self) -> Result<bool, ServiceError> {
        let runs = retention::retained(&mut *self.readers.acquire().await?).await?;
        if self.minutes_deleted_at.is_none_or(|last| last.elapsed() >= DELETE_MINUTES_INTERVAL) {
            for retained in &runs {
                while self.writer.change(DeleteOldMinutes { run: retained.run.clone() }).await? {}
            }
            self.minutes_deleted_at = Some(Instant::now());
        }
        let mut has_more = false;
        for retained in runs {
            match self.compact_run(&retained).await {
                Ok(more) => has_more |= more,
                Err(error @ (ServiceError::Stopping | ServiceError::Busy)) => return Err(error),
                Err(ServiceError::UnknownRun(_)) => {} // it was deleted meanwhile
                Err(error) => {
                    // The partly compacted lease that may have failed is skipped for now.
                    let after = self.examined.get(&retained.run).copied().unwrap_or(0);
                    self.examined.insert(retained.run.clone(), after + 1);
                    let run = retained.run;
                    tracing::error!(run, error = %error, "Old leases could not be compacted; the server retries.");
                }
            }
        }
        Ok(has_more)
    }

    /// Compacts some leases of a run, collects garbage, and examines partly compacted leases. Returns true if more may be left.
    async fn compact_run(&mut self, retained: &RetainedEpisodes) -> Result<bool, ServiceError> {
        let RetainedEpisodes { run, settings, episodes, claimed } = retained;
        let settings: RunSettings = from_json("a run's settings", settings)?;
        let limits = settings.retention;
        let mut changes =
            self.compact(run, CompactionGoal::Groups, *episodes, limits.episodes.limit()).await?;
        changes += self.compact(run, CompactionGoal::Columns, *claimed, limits.claimed.limit()).await?;
        if changes > 0 {
            self.collect_garbage(run).await?;
            self.to_examine.insert(run.clone());
        }
        if self.to_examine.contains(run) {
            self.examine_partly_compacted(run, changes.max(1)).await?;
        }
        Ok(changes > 0 || self.to_examine.contains(run))
    }

    /// Compacts leases of a run that keeps `kept` episodes until `limit` are left, or nothing more can be compacted. Returns the
    /// number of changes.
    async fn compact(
        &self,
        run: &str,
        goal: CompactionGoal,
        kept: i64,
        limit: i64,
    ) -> Result<i64, ServiceError> {
        let (mut excess, mut changes) = (kept.saturating_sub(limit), 0);
        while excess > 0 && changes < MAX_CHANGES_PER_ROUND {
            let concurrent = (1 + MAX_CONCURRENT_CHANGES * excess / limit.max(1)).min(MAX_CONCURRENT_CHANGES);
            let compact = || self.writer.change(CompactLeases { run: run.to_owned(), goal });
            let results = try_join_all((0..concurrent).map(|_| compact())).await?;
            excess -= results.iter().map(|result| result.episodes).sum::<i64>();
            let effective = results.iter().filter(|result| result.episodes > 0).count() as i64;
            changes += effective;
            if effective < concurrent {
                break; // nothing more can be compacted
            }
        }
        Ok(changes)
    }

    async fn collect_garbage(&self, run: &str) -> Result<(), ServiceError> {
        let before = gc::oldest_needed_proposal(&mut *self.readers.acquire().await?, run).await?;
        let Some(before) = before else { return Ok(()) };
        while self.writer.change(CollectGarbage { run: run.to_owned(), before }).await? {}
        Ok(())
    }

    /// Examines whether the rest of partly compacted leases is still needed, by at most `changes` changes: as many as compacted
    /// leases, so that episodes that are no examples any more are deleted soon.
    async fn examine_partly_compacted(&mut self, run: &str, changes: i64) -> Result<(), ServiceError> {
        for _ in 0..changes {
            let after = self.examined.get(run).copied().unwrap_or(0);
            let goal = CompactionGoal::Kept { after };
            let result = self.writer.change(CompactLeases { run: run.to_owned(), goal }).await?;
            // After the last lease the next round starts over.
            self.examined.insert(run.to_owned(), result.last_lease.unwrap_or(0));
            if result.last_lease.is_none() {
                self.to_examine.remove(run);
                break;
            }
        }
        Ok(())
    }
}
