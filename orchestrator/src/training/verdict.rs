//! Keeping what a judge said.

use super::{Change, TrainingError, Work};
use crate::store::verdicts::{self, VerdictRow};

/// Keeps a model's verdict on a step.
#[derive(Debug)]
pub struct KeepVerdict(pub VerdictRow);

impl Change for KeepVerdict {
    type Answer = ();
    const BULK: bool = true;

    async fn apply(self, work: &mut Work) -> Result<(), TrainingError> {
        Ok(verdicts::insert(&mut work.conn, &self.0, work.now).await?)
    }
}
