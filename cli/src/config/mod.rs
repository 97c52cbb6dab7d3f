//! `sparring config` and the configuration file, which sets flags of all subcommands.
//!
//! A flag takes its value from the command line, else from its environment variable, else from the configuration file, else its
//! default. [`file`] finds and reads the file, [`apply`] turns its values into defaults of the command line's definition, and
//! [`show`] prints the settings with their sources.

mod apply;
mod environment;
mod file;
mod show;
#[cfg(test)]
mod tests;

use std::error::Error as _;
use std::ffi::OsString;
use std::process::ExitCode;

use anyhow::anyhow;
use clap::error::{ContextKind, ErrorKind};
use clap::{Command, CommandFactory, FromArgMatches, Subcommand};

pub use self::file::ConfigFile;
use super::Cli;

/// Show settings and where each comes from.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Precedence: flag, environment variable, configuration file, default. The file is the one of --config (or SPARRING_CONFIG), \
else ./sparring.toml, else sparring/sparring.toml in the user's configuration folder ($XDG_CONFIG_HOME or ~/.config). Only one \
file is read.

A key is the name of a flag. At the top level it applies to all subcommands with that flag; in a table named after a subcommand \
only to that one:

  db = \"training.sqlite3\"

  [serve]
  bind = \"0.0.0.0:8700\"
  llm-url = \"https://llm.example.com/v1\"
  llm-model = \"name\"

  [token.create]
  expires = \"30d\"

Examples:
  sparring config show
  sparring config show serve
  sparring --config cluster.toml config show serve --json")]
pub struct Args {
    #[command(subcommand)]
    command: ConfigCommand,
}

#[derive(Debug, Subcommand)]
enum ConfigCommand {
    Show(show::Args),
}

/// Runs the subcommand.
///
/// # Errors
/// Returns an error if the configuration file cannot be read or stdout cannot be written.
pub fn run(args: &Args, file: &ConfigFile) -> anyhow::Result<ExitCode> {
    match &args.command {
        ConfigCommand::Show(args) => show::run(args, file),
    }
}

/// Returns the definition of the command line, with the environment variables that are derived from flags.
pub(super) fn definition() -> Command {
    allow_negative_numbers(environment::add_variables(Cli::command()))
}

/// Makes `--seed -1` an invalid value of `--seed` instead of an unknown flag, in all subcommands.
fn allow_negative_numbers(command: Command) -> Command {
    command.allow_negative_numbers(true).mut_subcommands(allow_negative_numbers)
}

/// Parses a command line under the configuration file that it or the environment names. `--help` and usage errors end the
/// process, as clap does.
///
/// # Errors
/// Returns an error if the configuration file cannot be read, or has an unknown key or an invalid value.
pub(super) fn parse(line: Vec<OsString>) -> anyhow::Result<(Cli, ConfigFile)> {
    let file = ConfigFile::find(&line)?;
    let configured = apply::apply(definition(), &file)?;
    let matched = configured.clone().try_get_matches_from(line.clone());
    let parsed = matched.and_then(|matches| {
        let mut cli = Cli::from_arg_matches(&matches)?;
        cli.apply_precedence(&matches);
        Ok(cli)
    });
    match parsed.map_err(|error| in_plain_words(error, configured)) {
        Ok(cli) => Ok((cli, file)),
        Err(error) if is_fault_of_file(&error, &file, line) => {
            let reason = error.render().to_string();
            let reason = reason.lines().next().unwrap_or_default().trim_start_matches("error: ").to_owned();
            Err(anyhow!("{}: {reason}", file.name()))
        }
        Err(error) => error.exit(),
    }
}

/// Replaces the messages of the standard library's number parsers by a sentence for users.
fn in_plain_words(error: clap::Error, mut command: Command) -> clap::Error {
    let reason = error.source().map(ToString::to_string).unwrap_or_default();
    let rule = match reason.as_str() {
        "invalid digit found in string" | "cannot parse integer from empty string" => {
            "must be a whole number"
        }
        "number too large to fit in target type" => "is too large",
        "number too small to fit in target type" => "is too small",
        "invalid float literal" | "cannot parse float from empty string" => "must be a number",
        _ => return error,
    };
    let word = |kind| error.get(kind).map(ToString::to_string).unwrap_or_default();
    let is_negative = word(ContextKind::InvalidValue).parse::<i64>().is_ok_and(|number| number < 0);
    let rule = if is_negative { "must not be negative" } else { rule };
    let message =
        format!("{} {rule}, got {:?}", word(ContextKind::InvalidArg), word(ContextKind::InvalidValue));
    command.error(error.kind(), message)
}

/// Returns true if the command line is valid without the file.
fn is_fault_of_file(error: &clap::Error, file: &ConfigFile, line: Vec<OsString>) -> bool {
    matches!(error.kind(), ErrorKind::ValueValidation | ErrorKind::InvalidValue)
        && file.exists()
        && definition().try_get_matches_from(line).is_ok()
}
