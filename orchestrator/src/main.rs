//! `sparring`: the service and its command line, which live in the library.

use std::process::ExitCode;

fn main() -> ExitCode {
    orchestrator::cli::main()
}
