//! The binary `sparring`; the library of this crate is its command line.

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::main()
}
