//! Checks the rules of alerts, and sends their messages to the webhook.

use std::collections::HashSet;
use std::path::PathBuf;
use std::sync::Arc;

use clock::Clock;
use job_queue::JobQueue;
use sqlx::SqlitePool;
use store::alerts;

use crate::alerts::conditions::{AlertKey, ConditionReader, LastingAlerts};
use crate::alerts::update::{RecordAttempt, SendOutcome, UpdateAlerts};
use crate::alerts::{AlertSettings, Webhook, webhook};
use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;
use crate::metrics;
use crate::workers::round_error::ends_worker;

/// Largest number of messages between two checks.
const MAX_MESSAGES: i64 = 8;

/// Worker that checks the rules of alerts.
#[derive(Debug)]
pub(super) struct AlertWorker {
    pub(super) readers: SqlitePool,
    pub(super) writer: Writer,
    pub(super) clock: Clock,
    pub(super) settings: AlertSettings,
    pub(super) queue: Arc<dyn JobQueue>,
    /// Folder of the database.
    pub(super) folder: PathBuf,
}

impl AlertWorker {
    /// Runs until the writer stops.
    pub(super) async fn run(self) {
        let AlertSettings { rules, .. } = self.settings;
        let mut reader = ConditionReader::new(rules, self.folder.clone(), Arc::clone(&self.queue));
        loop {
            match self.run_round(&mut reader).await {
                Ok(()) => {}
                Err(error) if ends_worker(&error, "alerts could not be checked") => return,
                Err(_) => {}
            }
            tokio::time::sleep(self.settings.check_interval).await;
        }
    }

    /// Begins and ends alerts, and sends the messages that are due.
    async fn run_round(&self, reader: &mut ConditionReader) -> Result<(), ServiceError> {
        let mut conn = self.readers.acquire().await?;
        let lasting = alerts::lasting(&mut conn).await?;
        let lasting: LastingAlerts = lasting.iter().map(|row| (AlertKey::of_row(row), row.id)).collect();
        let found = reader.read(&mut conn, &lasting, self.clock.now()).await?;
        drop(conn);
        let keys: HashSet<AlertKey> = found.iter().map(AlertKey::of).collect();
        let ended = lasting.iter().filter(|(key, _)| !keys.contains(key));
        let update = UpdateAlerts {
            end: ended.map(|(_, id)| *id).collect(),
            begin: found.into_iter().filter(|alert| !lasting.contains_key(&AlertKey::of(alert))).collect(),
            has_webhook: self.settings.webhook.is_some(),
        };
        metrics::set_alerts(lasting.keys().map(|key| key.rule));
        if !update.begin.is_empty() || !update.end.is_empty() {
            self.writer.change(update).await?;
        }
        match &self.settings.webhook {
            Some(webhook) => self.send_due(webhook).await,
            None => Ok(()),
        }
    }

    /// Sends the messages that are due. A message is sent again if the server dies before its success is stored.
    async fn send_due(&self, webhook: &Webhook) -> Result<(), ServiceError> {
        let due = alerts::due(&mut *self.readers.acquire().await?, self.clock.now(), MAX_MESSAGES).await?;
        for alert in due {
            let outcome = match webhook.send(&alert).await {
                Ok(()) => SendOutcome::Sent,
                Err(error) => {
                    let next_attempt_at = webhook::next_attempt(&alert, self.clock.now());
                    if alert.attempts == 0 || next_attempt_at.is_none() {
                        let is_given_up = next_attempt_at.is_none();
                        tracing::warn!(
                            alert = alert.id,
                            error,
                            is_given_up,
                            "The webhook could not be told of an alert."
                        );
                    }
                    SendOutcome::Failed { error, next_attempt_at }
                }
            };
            metrics::record_alert_message(matches!(outcome, SendOutcome::Sent));
            self.writer.change(RecordAttempt { alert: alert.id, outcome }).await?;
        }
        Ok(())
    }
}
