//! `sparring completions`: prints a completion script for a shell.

use std::process::ExitCode;

use clap_complete::Shell;

use commands::output;

use super::config;

/// Print a completion script for a shell.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  sparring completions bash > \\
      ~/.local/share/bash-completion/completions/sparring
  sparring completions zsh > ~/.zfunc/_sparring
  sparring completions fish > ~/.config/fish/completions/sparring.fish")]
pub struct Args {
    /// Shell of the script
    #[arg(value_enum)]
    shell: Shell,
}

/// Prints the script.
///
/// # Errors
/// Returns an error if stdout cannot be written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut config::definition(), "sparring", &mut script);
    output::print(&String::from_utf8(script)?)?;
    Ok(ExitCode::SUCCESS)
}
