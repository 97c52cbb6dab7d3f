//! Whether the database can be used, as far as the server knows: what `/readyz` and the metrics report without waiting for the writer.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use clock::rfc3339;
use parking_lot::Mutex;
use store::Outage;
use store::backup_list::{self, Backup};

/// Time after a failed read for which changes are refused: a disk that cannot be read may not keep what it is given.
const READ_FAILURE_HOLD: Duration = Duration::from_secs(10);

/// Knowledge of the server about the state of its database. Clones share it.
///
/// The writer and the readers report outages. A write probe of the writer ends an outage, but damage lasts until the server is
/// restarted.
#[derive(Debug, Clone, Default)]
pub struct StorageHealth(Arc<Mutex<HealthState>>);

#[derive(Debug, Default)]
struct HealthState {
    outage: Option<Outage>,
    /// When a read failed last.
    read_failed_at: Option<Instant>,
    /// Path of the database; `None` in tests without a file of their own.
    database: Option<PathBuf>,
    /// Newest backup, looked up when the database is found to be damaged.
    newest_backup: Option<Backup>,
}

impl StorageHealth {
    /// The health of a database that was just opened.
    pub(crate) fn new(database: Option<PathBuf>) -> Self {
        Self(Arc::new(Mutex::new(HealthState { database, ..HealthState::default() })))
    }

    /// Returns the outage that lasts, if there is one.
    #[must_use]
    pub fn outage(&self) -> Option<Outage> {
        self.0.lock().outage
    }

    /// Returns why changes are refused without an attempt: the database is damaged, or a read failed a moment ago.
    pub(crate) fn refusal(&self) -> Option<Outage> {
        let state = self.0.lock();
        let is_held = state.read_failed_at.is_some_and(|at| at.elapsed() < READ_FAILURE_HOLD);
        state.outage.filter(|outage| *outage == Outage::Damaged || is_held)
    }

    /// Describes the outage and its remedy in sentences, without paths of this machine.
    #[must_use]
    pub fn reason(&self) -> Option<String> {
        let state = self.0.lock();
        let outage = state.outage?;
        let reason = format!("The database cannot be used: {outage}.");
        let backup = match &state.newest_backup {
            _ if outage != Outage::Damaged => return Some(reason),
            Some(Backup { path, at }) => {
                let name = path.file_name().unwrap_or_default().display();
                format!("The newest backup is {name} of {}; the server's log has its path.", rfc3339(*at))
            }
            None => "No backup by `sparring db backup` was found.".to_owned(),
        };
        Some(format!("{reason} {backup}"))
    }

    /// Records that a change could not be stored.
    pub(crate) fn report_failed_change(&self, outage: Outage) {
        self.report(outage);
    }

    /// Records that the database could not be read. A reader that waits too long for a lock or for temporary space is no outage.
    pub(crate) fn report_failed_read(&self, outage: Outage) {
        if matches!(outage, Outage::Damaged | Outage::Disk) {
            self.0.lock().read_failed_at = Some(Instant::now());
            self.report(outage);
        }
    }

    /// Ends an outage, because a write probe was committed. Damage stays.
    pub(crate) fn recover(&self) {
        let mut state = self.0.lock();
        if state.outage.take_if(|outage| *outage != Outage::Damaged).is_some() {
            state.read_failed_at = None;
            tracing::info!("The database can be written again.");
        }
    }

    fn report(&self, outage: Outage) {
        let mut state = self.0.lock();
        if state.outage == Some(outage) || state.outage == Some(Outage::Damaged) {
            return;
        }
        state.outage = Some(outage);
        if outage == Outage::Damaged {
            state.newest_backup = state.database.as_deref().and_then(backup_list::newest);
            let backup = state.newest_backup.as_ref().map(|backup| backup.path.display().to_string());
            tracing::error!(newest_backup = backup, "The database cannot be used: {outage}.");
        } else {
            tracing::error!("The database cannot be used: {outage}.");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damage_lasts_and_other_outages_end() {
        let health = StorageHealth::new(None);
        health.report_failed_change(Outage::Locked);
        assert_eq!((health.outage(), health.refusal()), (Some(Outage::Locked), None));
        health.recover();
        assert_eq!(health.outage(), None);
        health.report_failed_read(Outage::Locked);
        assert_eq!(health.outage(), None, "the writer may be able to work");
        health.report_failed_read(Outage::Disk);
        assert_eq!(health.refusal(), Some(Outage::Disk));
        health.recover();
        health.report_failed_read(Outage::Damaged);
        health.report_failed_change(Outage::Full);
        health.recover();
        assert_eq!(health.refusal(), Some(Outage::Damaged));
        assert!(health.reason().is_some_and(|reason| reason.contains("No backup")));
    }
}
