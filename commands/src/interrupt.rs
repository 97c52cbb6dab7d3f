//! Signals that stop the process: at once, with the terminal restored, or after the subcommand has finished its work.

use std::io::{IsTerminal, Write};
use std::process::ExitCode;

use anyhow::Context;

/// Exit code after an interrupt: 128 + SIGINT, as shells report it.
pub const INTERRUPTED: u8 = 130;

/// Makes Ctrl-C end the process with [`INTERRUPTED`], without a half-drawn progress bar or a hidden cursor.
///
/// # Errors
/// Returns an error if the handler cannot be installed.
pub fn exit_on_ctrl_c() -> anyhow::Result<()> {
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

/// Ctrl-C and SIGTERM, which ask the process to stop.
#[derive(Debug)]
pub struct StopSignal {
    #[cfg(unix)]
    interrupt: tokio::signal::unix::Signal,
    #[cfg(unix)]
    terminate: tokio::signal::unix::Signal,
}

impl StopSignal {
    /// Installs the handlers: from now on the signals do not end the process.
    ///
    /// # Errors
    /// Returns an error if the handlers cannot be installed.
    pub fn install() -> std::io::Result<Self> {
        #[cfg(unix)]
        {
            use tokio::signal::unix::{SignalKind, signal};
            Ok(Self {
                interrupt: signal(SignalKind::interrupt())?,
                terminate: signal(SignalKind::terminate())?,
            })
        }
        #[cfg(not(unix))]
        Ok(Self {})
    }

    /// Waits for a signal.
    ///
    /// # Errors
    /// Returns an error if signals cannot be received.
    pub async fn received(&mut self) -> std::io::Result<StopRequest> {
        #[cfg(unix)]
        tokio::select! {
            _ = self.interrupt.recv() => Ok(StopRequest::Interrupt),
            _ = self.terminate.recv() => Ok(StopRequest::Terminate),
        }
        #[cfg(not(unix))]
        tokio::signal::ctrl_c().await.map(|()| StopRequest::Interrupt)
    }
}

/// Signal that asked the process to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopRequest {
    /// SIGINT, which Ctrl-C sends.
    Interrupt,
    /// SIGTERM, with which service managers stop a process.
    Terminate,
}

impl StopRequest {
    /// Exit code of a process that stopped in good order: [`INTERRUPTED`] after Ctrl-C, 0 after SIGTERM.
    #[must_use]
    pub fn exit_code(self) -> ExitCode {
        match self {
            Self::Interrupt => ExitCode::from(INTERRUPTED),
            Self::Terminate => ExitCode::SUCCESS,
        }
    }
}
