//! Folds what runs keep whole no longer.

use std::collections::{HashMap, HashSet};
use std::time::{Duration, Instant};

use futures_util::future::try_join_all;
use sqlx::SqlitePool;

use crate::store::retention::{self, RetainedEpisodes};
use crate::store::{from_json, gc};
use crate::retention::forget_minutes::ForgetMinutes;
use crate::retention::compact_leases::{CompactionGoal, CompactLeases, CollectGarbage};
use crate::runs::settings::Retention;
use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;
use crate::runs::settings::RunSettings;

/// How often it looks.
const EVERY: Duration = Duration::from_secs(2);
/// Changes that wait for the writer at once where a run keeps twice what it should, and fewer where it is less: what comes in
/// waits behind them, so that it does not come in faster than it is folded.
const AT_ONCE: i64 = 8;
/// Changes in a row before proposals and events are swept and what is kept is looked at again.
const ROUND: i64 = 64;
/// How often old minutes are forgotten.
const FORGET_EVERY: Duration = Duration::from_secs(3600);

/// Works until the writer is gone.
pub async fn run(readers: SqlitePool, writer: Writer) {
    let mut keeper =
        Keeper { readers, writer, looked_at: HashMap::new(), unseen: HashSet::new(), forgot: None };
    loop {
        match keeper.round().await {
            Ok(true) => continue, // there is more
            Ok(false) => {}
            Err(ServiceError::Stopping) => return,
            // A queue that is full says that others have more to do.
            Err(ServiceError::Busy) => {}
            Err(error) => {
                tracing::error!(error = %error, "Old leases could not be folded; trying again soon.");
            }
        }
        tokio::time::sleep(EVERY).await;
    }
}

struct Keeper {
    readers: SqlitePool,
    writer: Writer,
    /// By run, up to which lease it was looked at whether something of it must still stay.
    looked_at: HashMap<String, i64>,
    /// Runs that were folded since all of what stayed of them was looked at.
    unseen: HashSet<String>,
    /// When old minutes were forgotten.
    forgot: Option<Instant>,
}

impl Keeper {
    /// Folds some leases of each run that keeps more than it should; whether there may be more. A run that cannot be folded keeps no
    /// other from it.
    async fn round(&mut self) -> Result<bool, ServiceError> {
        let runs = retention::retained(&mut *self.readers.acquire().await?).await?;
        if self.forgot.is_none_or(|last| last.elapsed() >= FORGET_EVERY) {
            for whole in &runs {
                while self.writer.change(ForgetMinutes { run: whole.run.clone() }).await? {}
            }
            self.forgot = Some(Instant::now());
        }
        let mut more = false;
        for whole in runs {
            match self.of_run(&whole).await {
                Ok(folded) => more |= folded,
                Err(error @ (ServiceError::Stopping | ServiceError::Busy)) => return Err(error),
                Err(error) => {
                    // What of it fails is left behind for now.
                    let after = self.looked_at.get(&whole.run).copied().unwrap_or(0);
                    self.looked_at.insert(whole.run.clone(), after + 1);
                    let run = whole.run;
                    tracing::error!(run, error = %error, "Old leases could not be folded; trying again soon.");
                }
            }
        }
        Ok(more)
    }

    /// The same of one run.
    async fn of_run(&mut self, whole: &RetainedEpisodes) -> Result<bool, ServiceError> {
        let RetainedEpisodes { run, settings, episodes, claimed } = whole;
        let settings: RunSettings = from_json("a run's settings", settings)?;
        let Retention { episodes: most, claimed: most_claimed } = settings.retention;
        let kept = [(CompactionGoal::Groups, episodes, most.limit()), (CompactionGoal::Columns, claimed, most_claimed.limit())];
        let mut changes = 0;
        for (which, kept, most) in kept {
            changes += self.fold(run, which, kept.saturating_sub(most), most).await?;
        }
        if changes > 0 {
            self.sweep(run).await?;
            self.unseen.insert(run.clone());
        }
        if self.unseen.contains(run) {
            self.look_again(run, changes.max(1)).await?;
        }
        Ok(changes > 0 || self.unseen.contains(run))
    }

    /// Folds so many episodes at least, or what can be, of a run that may keep `most`; by how many changes.
    async fn fold(&self, run: &str, which: CompactionGoal, over: i64, most: i64) -> Result<i64, ServiceError> {
        let (mut left, mut changes) = (over, 0);
        while left > 0 && changes < ROUND {
            let at_once = (1 + AT_ONCE * left / most.max(1)).min(AT_ONCE);
            let fold = || self.writer.change(CompactLeases { run: run.to_owned(), which });
            let folded = try_join_all((0..at_once).map(|_| fold())).await?;
            left -= folded.iter().map(|folded| folded.episodes).sum::<i64>();
            let made = folded.iter().filter(|folded| folded.episodes > 0).count() as i64;
            changes += made;
            if made < at_once {
                break; // there is nothing more that can be
            }
        }
        Ok(changes)
    }

    async fn sweep(&self, run: &str) -> Result<(), ServiceError> {
        let before = gc::oldest_needed_proposal(&mut *self.readers.acquire().await?, run).await?;
        let Some(before) = before else { return Ok(()) };
        while self.writer.change(CollectGarbage { run: run.to_owned(), before }).await? {}
        Ok(())
    }

    /// Looks again whether what stayed of folded leases must stay: by as many changes as there were folded, so that what is no
    /// example any more does not stay for long.
    async fn look_again(&mut self, run: &str, changes: i64) -> Result<(), ServiceError> {
        for _ in 0..changes {
            let after = self.looked_at.get(run).copied().unwrap_or(0);
            let which = CompactionGoal::Kept { after };
            let folded = self.writer.change(CompactLeases { run: run.to_owned(), which }).await?;
            self.looked_at.insert(run.to_owned(), folded.last.unwrap_or(0)); // from the beginning, at the end
            if folded.last.is_none() {
                self.unseen.remove(run);
                break;
            }
        }
        Ok(())
    }
}
