//! `sparring db backup`: copies a database while it is in use.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::bail;
use store::backup_list;

use super::{format_bytes, open_readers};
use commands::files;
use commands::output;

/// Copy a database to a new file, also while a server uses it.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The copy is a consistent snapshot and appears atomically: it is written to a temporary file beside its path, synced, and then \
renamed. It contains no free pages, so it is often smaller than the database. The file DATABASE.backups lists the copies, so that \
the server can name the newest one if the database is damaged.")]
pub(super) struct Args {
    /// Path of the copy; the file must not exist
    #[arg(value_name = "COPY")]
    to: PathBuf,
}

pub(super) async fn run(db: &Path, args: &Args) -> anyhow::Result<ExitCode> {
    let to = &args.to;
    if to.exists() {
        bail!("{} already exists; choose another file, or move it away", to.display());
    }
    open_readers(db).await?.close().await;
    files::check_writable(to)?;
    let mut conn = store::open_maintenance(db).await?;
    store::copy(&mut conn, to)
        .await
        .map_err(|reason| anyhow::anyhow!("the copy {} could not be written: {reason}", to.display()))?;
    if let Err(error) = backup_list::record(db, to) {
        // If stderr is closed, the copy is complete all the same.
        let _ =
            writeln!(std::io::stderr(), "sparring: {}.backups could not be written: {error}", db.display());
    }
    let bytes = std::fs::metadata(to).map_err(|error| files::read_fault(to, &error))?.len();
    output::print(&format!(
        "{} is a copy of {}, {}",
        to.display(),
        db.display(),
        format_bytes(bytes.cast_signed())
    ))?;
    Ok(ExitCode::SUCCESS)
}
