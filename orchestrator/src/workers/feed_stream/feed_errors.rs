//! Reasons why feeds are not published, as the policies of their runs show them.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;
use crate::rollouts::settings::SetFeedError;

/// Time after which a reason is shown again: a rollout may have shown another error meanwhile.
const REPEAT_INTERVAL: Duration = Duration::from_secs(10);

/// State of each feed that the policy of its run shows. A run without an entry may show the reason of an earlier process.
#[derive(Debug, Default)]
pub(super) struct FeedErrors(BTreeMap<String, ShownState>);

/// State of a feed that a policy shows.
#[derive(Debug)]
enum ShownState {
    /// The feed is published.
    Published,
    /// The feed is not published.
    Failed { reason: String, shown_at: Instant },
}

impl FeedErrors {
    /// Shows why the feed of a run is not published. It is called again and again while the feed fails.
    pub(super) async fn show(
        &mut self,
        writer: &Writer,
        run: &str,
        reason: &str,
    ) -> Result<(), ServiceError> {
        if let Some(ShownState::Failed { reason: shown, shown_at }) = self.0.get(run)
            && shown == reason
            && shown_at.elapsed() < REPEAT_INTERVAL
        {
            return Ok(());
        }
        // Before the change, which may be committed although its caller stops waiting.
        let state = ShownState::Failed { reason: reason.to_owned(), shown_at: Instant::now() };
        self.0.insert(run.to_owned(), state);
        writer.change(SetFeedError { run: run.to_owned(), reason: Some(reason.to_owned()) }).await
    }

    /// Shows that the feed of a run is published.
    pub(super) async fn clear(&mut self, writer: &Writer, run: &str) -> Result<(), ServiceError> {
        if matches!(self.0.get(run), Some(ShownState::Published)) {
            return Ok(());
        }
        writer.change(SetFeedError { run: run.to_owned(), reason: None }).await?;
        self.0.insert(run.to_owned(), ShownState::Published);
        Ok(())
    }

    /// Forgets runs whose feeds NATS does not deliver any more, and removes their reasons.
    pub(super) async fn retain(
        &mut self,
        writer: &Writer,
        is_wanted: impl Fn(&str) -> bool,
    ) -> Result<(), ServiceError> {
        let unwanted: Vec<String> = self.0.keys().filter(|run| !is_wanted(run)).cloned().collect();
        for run in unwanted {
            self.clear(writer, &run).await?;
            self.0.remove(&run);
        }
        Ok(())
    }
}
