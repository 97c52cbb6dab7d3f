//! The `sparring` binary, and servers in their own process.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;

use crate::{ApiClient, child_group};

/// Path of the `sparring` binary: the value of `SPARRING_BINARY`, or a binary that this function builds.
///
/// # Panics
/// Panics if the binary does not build.
#[must_use]
pub fn sparring_binary() -> &'static Path {
    static BINARY: OnceLock<PathBuf> = OnceLock::new();
    BINARY.get_or_init(|| {
        if let Some(built) = std::env::var_os("SPARRING_BINARY") {
            return built.into();
        }
        cargo_build(&["-p", "cli", "--bin", "sparring"])
            .join(format!("sparring{}", std::env::consts::EXE_SUFFIX))
    })
}

/// Path of the native module that `import sparring` loads.
///
/// The module is expected beside `SPARRING_BINARY`; this function builds it if that variable is not set.
///
/// # Panics
/// Panics if the module does not build.
#[must_use]
pub fn native_module() -> PathBuf {
    let folder = match std::env::var_os("SPARRING_BINARY") {
        Some(binary) => Path::new(&binary).parent().expect("a folder").to_owned(),
        None => cargo_build(&["-p", "sparring-python", "--lib"]),
    };
    folder.join(format!("{}_native{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX))
}

/// Runs `cargo build` with `args` in the profile of the tests and returns the folder of the artifacts.
fn cargo_build(args: &[&str]) -> PathBuf {
    // Test executables are in target/<profile>/deps; binaries are one folder up.
    let executable = std::env::current_exe().expect("the path of the test executable");
    let folder = executable.parent().expect("the folder of the test executable");
    let folder = if folder.ends_with("deps") { folder.parent().expect("target/<profile>") } else { folder };
    let profile = match folder.file_name().and_then(|n| n.to_str()) {
        Some("debug") | None => "dev", // the folder of the profile `dev` has another name
        Some(profile) => profile,
    };
    let status = Command::new(env!("CARGO"))
        .args(["build", "--quiet", "--profile", profile])
        .args(args)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .status()
        .expect("cargo runs");
    assert!(status.success(), "cargo build {args:?} failed");
    folder.to_owned()
}

/// Server in its own process, which a test can kill. Dropping it kills the process.
#[derive(Debug)]
pub struct ServerProcess {
    child: Child,
    url: String,
}

impl ServerProcess {
    /// Starts `sparring serve` on a free port of the loopback interface.
    ///
    /// # Panics
    /// Panics if the server does not start.
    #[must_use]
    pub fn start(db: &Path) -> Self {
        Self::start_with_options(db, &[])
    }

    /// Starts `sparring serve` on a free port with further options.
    ///
    /// # Panics
    /// Panics if the server does not start.
    #[must_use]
    pub fn start_with_options(db: &Path, options: &[&str]) -> Self {
        Self::start_at("127.0.0.1:0", db, options)
    }

    /// Starts `sparring serve` at the address `bind`, for clients that reconnect to a restarted server.
    ///
    /// # Panics
    /// Panics if the server does not start.
    #[must_use]
    pub fn start_at(bind: &str, db: &Path, options: &[&str]) -> Self {
        let mut command = Command::new(sparring_binary());
        command.args(["serve", "--bind", bind, "--db"]).arg(db).args(options);
        Self::spawn(command, Stdio::null())
    }

    /// Runs a complete `sparring serve` command and sends its log to `log`.
    ///
    /// # Panics
    /// Panics if the server does not start.
    #[must_use]
    pub fn spawn(mut command: Command, log: Stdio) -> Self {
        child_group::join(&mut command);
        let mut child = command.stdout(Stdio::piped()).stderr(log).spawn().expect("the server starts");
        let mut line = String::new();
        let stdout = child.stdout.take().expect("stdout is piped");
        BufReader::new(stdout).read_line(&mut line).expect("the server prints its URL");
        let url = line.trim().rsplit(' ').next().expect("a URL").to_owned();
        assert!(url.contains("://127.0.0.1:"), "{line}");
        Self { child, url }
    }

    /// URL of the server.
    #[must_use]
    pub fn url(&self) -> &str {
        &self.url
    }

    /// Process id of the server.
    #[must_use]
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Memory that the server holds, in MiB.
    ///
    /// # Panics
    /// Panics if the process has exited.
    #[cfg(target_os = "linux")]
    #[must_use]
    pub fn resident_mib(&self) -> u64 {
        self.memory_mib("VmRSS:")
    }

    /// Largest memory that the server has held so far, in MiB.
    ///
    /// # Panics
    /// Panics if the process has exited.
    #[cfg(target_os = "linux")]
    #[must_use]
    pub fn peak_resident_mib(&self) -> u64 {
        self.memory_mib("VmHWM:")
    }

    #[cfg(target_os = "linux")]
    fn memory_mib(&self, field: &str) -> u64 {
        let status =
            std::fs::read_to_string(format!("/proc/{}/status", self.pid())).expect("the server runs");
        let value = status.lines().find_map(|line| line.strip_prefix(field)).expect("Linux reports memory");
        value.trim().trim_end_matches(" kB").parse::<u64>().expect("a number") / 1024
    }

    /// Address and port of the server, in the form that `start_at` takes.
    #[must_use]
    pub fn address(&self) -> &str {
        self.url.split_once("://").map_or(&self.url, |(_, address)| address)
    }

    /// Creates a client of this server.
    #[must_use]
    pub fn api(&self) -> ApiClient {
        ApiClient::new(&self.url)
    }

    /// Sends SIGTERM, as service managers do, waits for the end and returns the exit code.
    ///
    /// # Panics
    /// Panics if the signal cannot be sent.
    #[cfg(unix)]
    #[must_use]
    pub fn terminate(self) -> Option<i32> {
        self.signal("TERM")
    }

    /// Sends SIGINT, as Ctrl-C does, and returns the exit code.
    ///
    /// # Panics
    /// Panics if the process has already exited.
    #[cfg(unix)]
    #[must_use]
    pub fn interrupt(self) -> Option<i32> {
        self.signal("INT")
    }

    #[cfg(unix)]
    fn send_signal(&self, name: &str) {
        let mut kill = Command::new("kill");
        let sent = kill.args(["-s", name, &self.child.id().to_string()]).status().expect("kill runs");
        assert!(sent.success(), "the server exited before SIG{name}");
    }

    #[cfg(unix)]
    fn signal(mut self, name: &str) -> Option<i32> {
        self.send_signal(name);
        self.child.wait().expect("the server exits").code()
    }

    /// Sends SIGHUP.
    ///
    /// # Panics
    /// Panics if the process has already exited.
    #[cfg(unix)]
    pub fn hang_up(&self) {
        self.send_signal("HUP");
    }

    /// Kills the process with SIGKILL.
    pub fn kill(mut self) {
        self.kill_and_wait();
    }

    fn kill_and_wait(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for ServerProcess {
    fn drop(&mut self) {
        self.kill_and_wait();
    }
}
