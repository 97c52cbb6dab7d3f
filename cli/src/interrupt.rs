//! Ctrl-C during work that has nothing to finish: the terminal is restored and the process exits.

use std::io::{IsTerminal, Write};

use anyhow::Context;

/// Exit code after an interrupt: 128 + SIGINT, as shells report it.
pub(super) const INTERRUPTED: u8 = 130;

/// Makes Ctrl-C end the process with [`INTERRUPTED`], without a half-drawn progress bar or a hidden cursor.
///
/// # Errors
/// Returns an error if the handler cannot be installed.
pub(super) fn exit_on_ctrl_c() -> anyhow::Result<()> {
    ctrlc::set_handler(|| {
        let mut stderr = std::io::stderr();
        if stderr.is_terminal() {
            // Clear the line of the progress bar and show the cursor. A closed terminal needs neither.
            let _ = stderr.write_all(b"\r\x1b[2K\x1b[?25h");
        }
        let _ = stderr.write_all(b"sparring: interrupted\n");
        std::process::exit(INTERRUPTED.into());
    })
    .context("the handler of Ctrl-C cannot be installed")
}
