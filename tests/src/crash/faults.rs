//! Faults that a crash test injects before it kills a server: a full disk, a failed sync, or a lock of another process.

use std::path::{Path, PathBuf};
use std::time::Duration;

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, SqliteConnection};

use crate::ServerProcess;
#[cfg(target_os = "linux")]
use crate::faults::{ENOSPC, Fault, FaultControl};

/// Servers of a crash test, with faults if the plan asks for them.
pub(super) struct RandomFaults {
    db: PathBuf,
    /// Control of disk faults; `None` without faults.
    #[cfg(target_os = "linux")]
    control: Option<FaultControl>,
    /// Connection that locks the database.
    lock: Option<SqliteConnection>,
    is_enabled: bool,
}

impl RandomFaults {
    /// Prepares the faults of servers on a database.
    ///
    /// # Errors
    /// Returns an error if faults are requested and the control file cannot be created.
    pub(super) fn new(db: &Path, is_enabled: bool) -> anyhow::Result<Self> {
        #[cfg(target_os = "linux")]
        let control = match db.parent().and_then(Path::parent) {
            Some(folder) if is_enabled => Some(FaultControl::create(folder)),
            _ => None,
        };
        anyhow::ensure!(!is_enabled || cfg!(target_os = "linux"), "faults need Linux");
        Ok(Self {
            db: db.to_owned(),
            #[cfg(target_os = "linux")]
            control,
            lock: None,
            is_enabled,
        })
    }

    /// Starts a server at an address with further options.
    pub(super) fn start_server(&self, bind: &str, options: &[String]) -> ServerProcess {
        #[cfg(target_os = "linux")]
        if let Some(control) = &self.control {
            let mut command = control.serve_command(bind, &self.db);
            command.args(options);
            return ServerProcess::spawn(command, std::process::Stdio::null());
        }
        let options: Vec<_> = options.iter().map(String::as_str).collect();
        ServerProcess::start_at(bind, &self.db, &options)
    }

    /// Lets a server live for a time. In the second half of it, a fault begins that depends on the number of the server.
    pub(super) async fn live(&mut self, lifetime: Duration, number: u32) {
        tokio::time::sleep(lifetime / 2).await;
        if self.is_enabled {
            self.begin_fault(number).await;
        }
        tokio::time::sleep(lifetime / 2).await;
    }

    async fn begin_fault(&mut self, number: u32) {
        if number % 4 == 3 {
            let opened = SqliteConnectOptions::new().filename(&self.db).connect().await;
            if let Ok(mut conn) = opened
                && sqlx::query("BEGIN IMMEDIATE").execute(&mut conn).await.is_ok()
            {
                self.lock = Some(conn);
            }
        }
        #[cfg(target_os = "linux")]
        if let Some(control) = &self.control {
            match number % 4 {
                1 => control.set(Fault::Write, ENOSPC),
                2 => control.set(Fault::SyncFailures, 2),
                _ => {}
            }
        }
    }

    /// Ends all faults of the servers.
    pub(super) async fn clear(&mut self) {
        if let Some(mut conn) = self.lock.take() {
            // The transaction ends with the connection too.
            let _ = sqlx::query("ROLLBACK").execute(&mut conn).await;
            let _ = sqlx::Connection::close(conn).await;
        }
        #[cfg(target_os = "linux")]
        if let Some(control) = &self.control {
            control.set(Fault::Write, 0);
            control.set(Fault::SyncFailures, 0);
        }
    }
}
