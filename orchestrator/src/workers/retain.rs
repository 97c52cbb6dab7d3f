//! Folds what runs keep whole no longer.

use std::collections::HashMap;
use std::time::Duration;

use futures_util::future::try_join_all;
use sqlx::SqlitePool;

use crate::store::retention::{self, Whole};
use crate::store::{from_json, sweep};
use crate::training::retain::{Fold, FoldLeases, Sweep};
use crate::training::settings::Retention;
use crate::training::{RunSettings, TrainingError, Writer};

/// How often it looks.
const EVERY: Duration = Duration::from_secs(2);
/// Changes that wait for the writer at once where a run keeps twice what it should, and fewer where it is less: what comes in
/// waits behind them, so that it does not come in faster than it is folded.
const AT_ONCE: i64 = 8;
/// Changes in a row before proposals and events are swept and what is kept is looked at again.
const ROUND: i64 = 64;

/// Works until the writer is gone.
pub async fn run(readers: SqlitePool, writer: Writer) {
    let mut keeper = Keeper { readers, writer, looked_at: HashMap::new() };
    loop {
        match keeper.round().await {
            Ok(true) => continue, // there is more
            Ok(false) => {}
            Err(TrainingError::Stopping) => return,
            // A queue that is full says that others have more to do.
            Err(TrainingError::Busy) => {}
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
}

impl Keeper {
    /// Folds some leases of each run that keeps more than it should; whether there may be more.
    async fn round(&mut self) -> Result<bool, TrainingError> {
        let runs = retention::whole(&mut *self.readers.acquire().await?).await?;
        let mut more = false;
        for Whole { run, settings, episodes, claimed } in runs {
            let settings: RunSettings = from_json("a run's settings", &settings)?;
            let Retention { episodes: most, claimed: most_claimed } = settings.retention;
            let kept =
                [(Fold::Groups, episodes, most.limit()), (Fold::Columns, claimed, most_claimed.limit())];
            let mut folded = false;
            for (which, kept, most) in kept {
                folded |= self.fold(&run, which, kept.saturating_sub(most), most).await?;
            }
            if folded {
                self.sweep(&run).await?;
                self.look_again(&run).await?;
                more = true;
            }
        }
        Ok(more)
    }

    /// Folds so many episodes at least, or what can be, of a run that may keep `most`; whether anything was.
    async fn fold(&self, run: &str, which: Fold, over: i64, most: i64) -> Result<bool, TrainingError> {
        let (mut left, mut changes) = (over, 0);
        while left > 0 && changes < ROUND {
            let at_once = (1 + AT_ONCE * left / most.max(1)).min(AT_ONCE);
            let fold = || self.writer.change(FoldLeases { run: run.to_owned(), which });
            let folded = try_join_all((0..at_once).map(|_| fold())).await?;
            if folded.iter().any(|folded| folded.episodes == 0) {
                return Ok(changes > 0 || folded.iter().any(|folded| folded.episodes > 0));
            }
            left -= folded.iter().map(|folded| folded.episodes).sum::<i64>();
            changes += at_once;
        }
        Ok(left < over)
    }

    async fn sweep(&self, run: &str) -> Result<(), TrainingError> {
        let before = sweep::unwanted_before(&mut *self.readers.acquire().await?, run).await?;
        let Some(before) = before else { return Ok(()) };
        while self.writer.change(Sweep { run: run.to_owned(), before }).await? {}
        Ok(())
    }

    /// Looks again whether what stayed of some folded leases must stay.
    async fn look_again(&mut self, run: &str) -> Result<(), TrainingError> {
        let after = self.looked_at.get(run).copied().unwrap_or(0);
        let which = Fold::Kept { after };
        let folded = self.writer.change(FoldLeases { run: run.to_owned(), which }).await?;
        self.looked_at.insert(run.to_owned(), folded.last.unwrap_or(0)); // from the beginning, at the end
        Ok(())
    }
}
