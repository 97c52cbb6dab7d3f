//! The program in a process of its own.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;

use crate::Api;

/// The `sparring` binary: the one that `SPARRING_BINARY` names, else built if need be.
///
/// # Panics
/// Where it cannot be built.
#[must_use]
pub fn binary() -> &'static Path {
    static BINARY: OnceLock<PathBuf> = OnceLock::new();
    BINARY.get_or_init(|| {
        if let Some(built) = std::env::var_os("SPARRING_BINARY") {
            return built.into();
        }
        built(&["-p", "orchestrator", "--bin", "sparring"])
            .join(format!("sparring{}", std::env::consts::EXE_SUFFIX))
    })
}

/// What `import sparring` loads: beside the binary that is named, built otherwise.
///
/// # Panics
/// Where it does not build.
#[must_use]
pub fn native() -> PathBuf {
    let folder = match std::env::var_os("SPARRING_BINARY") {
        Some(binary) => Path::new(&binary).parent().expect("a folder").to_owned(),
        None => built(&["-p", "sparring-python", "--lib"]),
    };
    folder.join(format!("{}_native{}", std::env::consts::DLL_PREFIX, std::env::consts::DLL_SUFFIX))
}

/// Builds something; the folder in which it is then.
fn built(what: &[&str]) -> PathBuf {
    // Tests live in target/<profile>/deps, programs and the binary one folder up.
    let here = std::env::current_exe().expect("a path");
    let folder = here.parent().expect("a folder");
    let folder = if folder.ends_with("deps") { folder.parent().expect("target/<profile>") } else { folder };
    let profile = match folder.file_name().and_then(|n| n.to_str()) {
        Some("release") => "release",
        _ => "dev",
    };
    let built = Command::new(env!("CARGO"))
        .args(["build", "--quiet", "--profile", profile])
        .args(what)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .status()
        .expect("cargo runs");
    assert!(built.success(), "{what:?} does not build");
    folder.to_owned()
}

/// A server in a process of its own, that can be killed.
#[derive(Debug)]
pub struct Process {
    child: Child,
    url: String,
}

impl Process {
    /// Starts `sparring serve` on a free port.
    ///
    /// # Panics
    /// Where it does not start.
    #[must_use]
    pub fn start(db: &Path) -> Self {
        Self::start_with(db, &[])
    }

    /// Starts one with further options.
    ///
    /// # Panics
    /// Where it does not start.
    #[must_use]
    pub fn start_with(db: &Path, options: &[&str]) -> Self {
        Self::start_at("127.0.0.1:0", db, options)
    }

    /// Starts one at this address, where clients expect one that is started anew.
    ///
    /// # Panics
    /// Where it does not start.
    #[must_use]
    pub fn start_at(bind: &str, db: &Path, options: &[&str]) -> Self {
        let mut command = Command::new(binary());
        command.args(["serve", "--bind", bind, "--db"]).arg(db).args(options);
        Self::run(command, Stdio::null())
    }

    /// Runs `sparring serve` as a command that has all else; where its log goes.
    ///
    /// # Panics
    /// Where it does not start.
    #[must_use]
    pub fn run(mut command: Command, log: Stdio) -> Self {
        let mut child = command.stdout(Stdio::piped()).stderr(log).spawn().expect("the server starts");
        let mut line = String::new();
        let stdout = child.stdout.take().expect("its output");
        BufReader::new(stdout).read_line(&mut line).expect("its first line");
        let url = line.trim().rsplit(' ').next().expect("a URL").to_owned();
        assert!(url.starts_with("http://127.0.0.1:"), "{line}");
        Self { child, url }
    }

    /// Its number.
    #[must_use]
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Where it listens, as an address to be bound again.
    #[must_use]
    pub fn address(&self) -> &str {
        self.url.strip_prefix("http://").unwrap_or(&self.url)
    }

    /// A client of it.
    #[must_use]
    pub fn api(&self) -> Api {
        Api::new(&self.url)
    }

    /// Asks it to stop, as `kill` and service managers do; its exit code.
    ///
    /// # Panics
    /// Where it cannot be asked.
    #[cfg(unix)]
    #[must_use]
    pub fn terminate(mut self) -> Option<i32> {
        let asked = Command::new("kill").arg(self.child.id().to_string()).status().expect("kill runs");
        assert!(asked.success(), "the server is gone");
        self.child.wait().expect("its end").code()
    }

    /// Kills it without warning.
    pub fn kill(mut self) {
        self.end();
    }

    fn end(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.end();
    }
}
