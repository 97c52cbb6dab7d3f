//! Changes of stored alerts: beginnings and ends, and the outcomes of messages.

use clock::Millis;
use store::alerts::{self, NewAlert};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;

/// Stores alerts that begin and ends those that do not last.
#[derive(Debug)]
pub struct UpdateAlerts {
    /// Alerts that begin now.
    pub begin: Vec<NewAlert>,
    /// Numbers of the alerts that end.
    pub end: Vec<i64>,
    /// True if the server has a webhook for messages.
    pub has_webhook: bool,
}

impl Change for UpdateAlerts {
    type Output = ();

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        for id in self.end {
            alerts::end(&mut tx.conn, id, tx.now).await?;
        }
        for alert in &self.begin {
            alerts::begin(&mut tx.conn, alert, self.has_webhook, tx.now).await?;
        }
        Ok(())
    }
}

/// Outcome of an attempt to send a message.
#[derive(Debug)]
pub enum SendOutcome {
    /// The webhook took the message.
    Sent,
    /// The attempt has failed.
    Failed {
        /// Reason as a part of a sentence.
        error: String,
        /// Time of the next attempt; none if the message is given up.
        next_attempt_at: Option<Millis>,
    },
}

/// Stores the outcome of an attempt to send the message of an alert.
#[derive(Debug)]
pub struct RecordAttempt {
    /// Number of the alert.
    pub alert: i64,
    /// Outcome of the attempt.
    pub outcome: SendOutcome,
}

impl Change for RecordAttempt {
    type Output = ();

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        match self.outcome {
            SendOutcome::Sent => alerts::record_sent(&mut tx.conn, self.alert, tx.now).await?,
            SendOutcome::Failed { error, next_attempt_at } => {
                alerts::record_failure(&mut tx.conn, self.alert, &error, next_attempt_at).await?;
            }
        }
        Ok(())
    }
}
