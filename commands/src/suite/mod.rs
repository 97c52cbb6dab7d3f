//! `sparring suite`: builds and verifies frozen sets of held-out scenarios. The format of the files lives in
//! `evaluation::suite`.

pub mod build;
#[cfg(test)]
pub(crate) mod tests;
pub mod verify;

use std::process::ExitCode;

use clap::Subcommand;

/// Build or verify a suite of held-out scenarios.
///
/// A suite is a JSON file of scenarios with seeds that no training run gets. Each has its canonical bytes, its id and its
/// bracket (blind panel, floor, reference). One hash covers all of them, so results on suites with the same hash are
/// comparable.
#[derive(Debug, clap::Args)]
#[command(after_help = AFTER_HELP)]
pub struct Args {
    #[command(subcommand)]
    action: Action,
}

const AFTER_HELP: &str = "\
Examples:
  sparring suite verify
  sparring suite build --name my-suite-v1 --out my-suite-v1.json --levels 4,5,6
  sparring eval --suite my-suite-v1.json --policy heuristic";

#[derive(Debug, Subcommand)]
enum Action {
    Build(build::Args),
    Verify(verify::Args),
}

/// Runs the subcommand.
///
/// # Errors
/// Returns an error if the suite cannot be read or built. A difference found by `verify` gives exit code 1 instead.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    match &args.action {
        Action::Build(args) => build::run(args),
        Action::Verify(args) => verify::run(args),
    }
}
