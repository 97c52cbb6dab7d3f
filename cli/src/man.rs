//! `sparring man`: prints or writes the manual pages.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;

use commands::files;
use commands::output;

use super::config;

/// Print the manual page, or write those of all subcommands to a folder.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  sparring man | man -l -
  sparring man --out ~/.local/share/man/man1 && man sparring-serve")]
pub struct Args {
    /// Write sparring.1 and one page per subcommand to this folder
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Prints or writes the pages.
///
/// # Errors
/// Returns an error if stdout or the folder cannot be written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    match &args.out {
        Some(folder) => {
            files::create_folder(folder).context("--out")?;
            clap_mangen::generate_to(config::definition(), folder)
                .map_err(|error| files::write_fault(folder, &error))
                .context("--out")?;
        }
        None => {
            let mut page = Vec::new();
            clap_mangen::Man::new(config::definition()).render(&mut page)?;
            output::print(&String::from_utf8(page)?)?;
        }
    }
    Ok(ExitCode::SUCCESS)
}
