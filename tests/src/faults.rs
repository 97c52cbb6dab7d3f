//! Faults of disk and clock in a real server, whose system calls fixtures/faults.c makes to fail on demand.

use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use crate::sparring_binary;

/// Errno of a full disk.
pub const ENOSPC: i64 = 28;
/// Errno of a failing disk.
pub const EIO: i64 = 5;
/// Errno of a read-only file system.
pub const EROFS: i64 = 30;

/// Index of a fault in the control file of faults.c.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// Errno of every write; 0 for none.
    Write = 0,
    /// Errno of every sync; 0 for none.
    Sync = 1,
    /// Delay of every sync, in milliseconds.
    SlowSyncMs = 2,
    /// Offset of the system clock, in milliseconds.
    ClockMs = 3,
    /// Errno of every read; 0 for none.
    Read = 4,
    /// Number of the next syncs that fail.
    SyncFailures = 5,
}

/// Number of faults in the control file.
const FAULTS: usize = 6;

/// Control of the faults of servers. The control file outlives a server, so that a restarted one has the same faults.
#[derive(Debug)]
pub struct FaultControl {
    file: std::fs::File,
    path: PathBuf,
}

impl FaultControl {
    /// Creates a control file without faults in a folder.
    ///
    /// # Panics
    /// Panics if the file cannot be created.
    #[must_use]
    pub fn create(folder: &Path) -> Self {
        let path = folder.join("faults");
        std::fs::write(&path, [0; FAULTS * 8]).expect("the folder is writable");
        let file = std::fs::File::options().read(true).write(true).open(&path).expect("the file exists");
        Self { file, path }
    }

    /// Sets a fault of the servers that run, and of later ones.
    ///
    /// # Panics
    /// Panics if the control file cannot be written.
    pub fn set(&self, fault: Fault, value: i64) {
        self.file.write_all_at(&value.to_ne_bytes(), fault as u64 * 8).expect("the file is writable");
    }

    /// Reads the current value of a fault.
    ///
    /// # Panics
    /// Panics if the control file cannot be read.
    #[must_use]
    pub fn get(&self, fault: Fault) -> i64 {
        let mut bytes = [0; 8];
        self.file.read_exact_at(&mut bytes, fault as u64 * 8).expect("the file is readable");
        i64::from_ne_bytes(bytes)
    }

    /// Command `sparring serve` whose faults concern the files in the folder of the database.
    ///
    /// # Panics
    /// Panics if the folder does not exist, or if there is no C compiler.
    #[must_use]
    pub fn serve_command(&self, bind: &str, db: &Path) -> Command {
        let mut command = Command::new(sparring_binary());
        // The canonical path, because a temporary folder may be a symbolic link.
        let folder = db.parent().and_then(|folder| folder.canonicalize().ok()).expect("the folder exists");
        command.env("LD_PRELOAD", fault_library()).env("FAULTS", &self.path).env("FAULTS_UNDER", folder);
        command.args(["serve", "--bind", bind, "--db"]).arg(db);
        command
    }
}

/// Builds the library that makes system calls fail.
fn fault_library() -> &'static Path {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| {
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/faults.c");
        let folder = std::env::current_exe().expect("the path of the test executable");
        let built = folder.with_file_name(format!("faults-{}.so", std::process::id()));
        let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".to_owned());
        let done = Command::new(compiler)
            .args(["-shared", "-fPIC", "-O1", "-Wall", "-Wextra", "-Werror", "-o"])
            .args([&built, &source])
            .arg("-ldl")
            .status();
        assert!(done.is_ok_and(|done| done.success()), "a C compiler is needed, as for SQLite");
        // Tests may build it at the same time.
        let library = built.with_file_name("faults.so");
        std::fs::rename(built, &library).expect("the folder is writable");
        library
    })
}
