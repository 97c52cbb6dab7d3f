//! Reasons why feeds are not published, as the policies of their runs show them.

use std::collections::BTreeMap;

use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;
use crate::rollouts::settings::SetFeedError;

/// Reasons that the policies of runs show; none if the feed is published. A run without an entry may show that of an earlier
/// process.
#[derive(Debug, Default)]
pub(super) struct FeedErrors(BTreeMap<String, Option<String>>);

impl FeedErrors {
    /// Shows why the feed of a run is not published; without a reason, that it is.
    pub(super) async fn show(
        &mut self,
        writer: &Writer,
        run: &str,
        reason: Option<&str>,
    ) -> Result<(), ServiceError> {
        if self.0.get(run).is_some_and(|shown| shown.as_deref() == reason) {
            return Ok(());
        }
        let reason = reason.map(str::to_owned);
        writer.change(SetFeedError { run: run.to_owned(), reason: reason.clone() }).await?;
        self.0.insert(run.to_owned(), reason);
        Ok(())
    }

    /// Forgets runs whose feeds NATS does not deliver any more, and removes their reasons.
    pub(super) async fn retain(
        &mut self,
        writer: &Writer,
        is_wanted: impl Fn(&str) -> bool,
    ) -> Result<(), ServiceError> {
        let gone: Vec<String> = self.0.keys().filter(|run| !is_wanted(run)).cloned().collect();
        for run in gone {
            self.show(writer, &run, None).await?;
            self.0.remove(&run);
        }
        Ok(())
    }
}
