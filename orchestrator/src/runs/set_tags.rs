//! Replaces the tags of a run.

use std::collections::BTreeSet;

use store::ids::RunId;
use store::run_tags::{self, RunTag};
use store::runs::{self, RunRow};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::write_tx::WriteTx;

/// Maximum number of tags of a run.
const MAX_TAGS: usize = 32;

/// Replaces the tags of a run.
#[derive(Debug)]
pub struct SetTags {
    run: RunId,
    tags: BTreeSet<RunTag>,
}

impl SetTags {
    /// Checks a request.
    ///
    /// # Errors
    /// Returns an error that names the first invalid tag.
    pub fn from_request(run: RunId, tags: &[String]) -> Result<Self, ServiceError> {
        Ok(Self { run, tags: parse_tags(tags)? })
    }
}

impl Change for SetTags {
    type Output = RunRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<RunRow, ServiceError> {
        let id = self.run.as_str();
        let mut run = tx.run(id).await?;
        run_tags::replace(run.conn, id, &self.tags).await?;
        run.emit(&RunEvent::Run { state: "tagged" })?;
        runs::get(run.conn, id).await?.ok_or_else(|| ServiceError::UnknownRun(id.to_owned()))
    }
}

/// Parses the tags of a request. A repeated tag counts once.
///
/// # Errors
/// Returns an error that names the first invalid tag, or the field `tags` if there are too many.
pub(super) fn parse_tags(tags: &[String]) -> Result<BTreeSet<RunTag>, ServiceError> {
    let parse = |(at, text): (usize, &String)| {
        let tag = text.parse::<RunTag>();
        tag.map_err(|error| ServiceError::invalid(format!("tags.{at}"), error.to_string()))
    };
    let parsed: BTreeSet<RunTag> = tags.iter().enumerate().map(parse).collect::<Result<_, _>>()?;
    if parsed.len() > MAX_TAGS {
        let reason = format!("must have at most {MAX_TAGS} tags, got {}", parsed.len());
        return Err(ServiceError::invalid("tags", reason));
    }
    Ok(parsed)
}
