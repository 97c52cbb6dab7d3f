//! `sparring db vacuum`: returns the free space of the file to the disk.

use std::path::Path;
use std::process::ExitCode;

use store::DatabaseLock;

use super::{format_bytes, open_readers};
use commands::output;

/// Return free pages of the database file to the file system.
///
/// No server may use the database meanwhile. The disk needs free space for a second copy of the database.
#[derive(Debug, clap::Args)]
pub(super) struct Args {}

pub(super) async fn run(db: &Path, _: &Args) -> anyhow::Result<ExitCode> {
    open_readers(db).await?.close().await;
    let lock = DatabaseLock::acquire(db)?;
    let before = std::fs::metadata(db)?.len();
    store::vacuum(db).await?;
    let after = std::fs::metadata(db)?.len();
    drop(lock);
    let [before, after] = [before, after].map(|bytes| format_bytes(bytes.cast_signed()));
    output::print(&format!("{} has {after}, before {before}", db.display()))?;
    Ok(ExitCode::SUCCESS)
}
