//! What is written down of who comes in.

use super::{Change, TrainingError, Work};
use crate::store::tokens::{self, AuditRow};

/// Notes that a token was used.
#[derive(Debug)]
pub struct Used(pub i64);

impl Change for Used {
    type Answer = ();
    const BULK: bool = true;

    async fn apply(self, work: &mut Work) -> Result<(), TrainingError> {
        Ok(tokens::used(&mut work.conn, self.0, work.now).await?)
    }
}

/// Writes a line of the audit log.
#[derive(Debug, Clone)]
pub struct Note {
    /// The line.
    pub line: AuditRow,
    /// Whether it is of somebody who was kept out.
    pub denied: bool,
}

impl Change for Note {
    type Answer = ();

    async fn apply(self, work: &mut Work) -> Result<(), TrainingError> {
        match self.denied {
            true => tokens::deny(&mut work.conn, &self.line).await?,
            false => tokens::audit(&mut work.conn, &self.line).await?,
        }
        Ok(())
    }
}
