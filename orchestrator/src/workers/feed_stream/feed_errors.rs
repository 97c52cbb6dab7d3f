//! Reasons why feeds are not published, as the policies of their runs show them.

use std::collections::BTreeMap;

use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;
use crate::rollouts::settings::SetFeedError;

/// For each run: true if its policy may show that its feed is not published. A run without an entry may show it since an earlier
/// process.
#[derive(Debug, Default)]
pub(super) struct FeedErrors(BTreeMap<String, bool>);

impl FeedErrors {
    /// Shows why the feed of a run is not published. It is called again while the feed fails, since a rollout may show another error.
    pub(super) async fn show(
        &mut self,
        writer: &Writer,
        run: &str,
        reason: &str,
    ) -> Result<(), ServiceError> {
        // Before the change, which may be committed although its caller stops waiting.
        self.0.insert(run.to_owned(), true);
        writer.change(SetFeedError { run: run.to_owned(), reason: Some(reason.to_owned()) }).await
    }

    /// Shows that the feed of a run is published.
    pub(super) async fn clear(&mut self, writer: &Writer, run: &str) -> Result<(), ServiceError> {
        if self.0.get(run) == Some(&false) {
            return Ok(());
        }
        writer.change(SetFeedError { run: run.to_owned(), reason: None }).await?;
        self.0.insert(run.to_owned(), false);
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
