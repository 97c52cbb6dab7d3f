//! A file system that Linux remounts read-only under the server, as ext4 does after an error of the disk.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use system_tests::{ServerProcess, sparring_binary, wait_until};

use super::{report, start_run, stored_episodes};

/// Size of the file system.
const DISK_BYTES: u64 = 96 << 20;

/// File system in a file, mounted in a temporary folder. Only root can mount it.
struct LoopDisk {
    folder: tempfile::TempDir,
}

impl LoopDisk {
    /// Creates the file system. Returns the reason if this machine has none of what it needs.
    fn create() -> Result<Self, String> {
        let disk = Self { folder: tempfile::tempdir().unwrap() };
        std::fs::create_dir(disk.mount_point()).unwrap();
        std::fs::File::create(disk.image()).unwrap().set_len(DISK_BYTES).unwrap();
        run(Command::new("mkfs.ext4").arg("-q").arg(disk.image()))?;
        disk.mount()?;
        Ok(disk)
    }

    fn image(&self) -> PathBuf {
        self.folder.path().join("image")
    }

    fn mount_point(&self) -> PathBuf {
        self.folder.path().join("mounted")
    }

    fn db(&self) -> PathBuf {
        self.mount_point().join("db.sqlite3")
    }

    fn mount(&self) -> Result<(), String> {
        let options = "loop,errors=remount-ro";
        run(Command::new("mount").args(["-o", options]).arg(self.image()).arg(self.mount_point())).map(drop)
    }

    /// Reports an error to the file system, which is then mounted read-only although files are open for writing.
    fn fail(&self) {
        let device = run(Command::new("findmnt").args(["-no", "SOURCE"]).arg(self.mount_point())).unwrap();
        let name = Path::new(device.trim()).file_name().unwrap().to_owned();
        let trigger = Path::new("/sys/fs/ext4").join(name).join("trigger_fs_error");
        std::fs::write(trigger, "test").unwrap();
    }

    /// Unmounts, repairs and mounts the file system again.
    fn repair(&self) {
        run(Command::new("umount").arg(self.mount_point())).unwrap();
        // Exit status 1 means that errors were corrected.
        let repair = Command::new("e2fsck").arg("-fy").arg(self.image()).output().unwrap();
        assert!(matches!(repair.status.code(), Some(0 | 1)), "{repair:?}");
        self.mount().unwrap();
    }
}

impl Drop for LoopDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(self.mount_point()).stderr(Stdio::null()).status();
    }
}

/// Runs a command; returns its output, or its error.
fn run(command: &mut Command) -> Result<String, String> {
    let name = command.get_program().display().to_string();
    let output = command.output().map_err(|error| format!("{name}: {error}"))?;
    let stderr = String::from_utf8_lossy(&output.stderr);
    match output.status.success() {
        true => Ok(String::from_utf8_lossy(&output.stdout).into_owned()),
        false => Err(format!("{name}: {stderr}")),
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn server_survives_a_remount_as_read_only() {
    let disk = match LoopDisk::create() {
        Ok(disk) => disk,
        Err(reason) => {
            // Without the rights to mount, `read_only_file_system_is_reported_and_recovered` injects the same error.
            eprintln!("not checked with a real file system: {reason}");
            return;
        }
    };
    let server = ServerProcess::start(&disk.db());
    let api = server.api();
    let (results, _) = start_run(&api).await;
    let _ = report(&api, &results[..3]).await.expect(200);
    disk.fail();
    for _ in 0..3 {
        let rejected = report(&api, &results[3..]).await.expect(503);
        assert!(rejected["detail"].as_str().unwrap().contains("mounted read-only"), "{rejected}");
    }
    let ready = api.get("/readyz").await.expect(503);
    assert!(ready["detail"].as_str().unwrap().contains("mounted read-only"), "{ready}");
    assert_eq!(api.get("/livez").await.status, 200);
    assert_eq!(stored_episodes(&api).await, 3, "reads go on");

    let stopped = tokio::task::spawn_blocking(move || server.terminate());
    assert!(stopped.await.unwrap().is_some(), "SIGTERM ends the server");
    disk.repair();
    let server = ServerProcess::start(&disk.db());
    let api = server.api();
    wait_until("the server is ready", async || api.get("/readyz").await.status == 200).await;
    let receipts = report(&api, &results).await.expect(200);
    let statuses: Vec<&str> =
        receipts["results"].as_array().unwrap().iter().map(|r| r["status"].as_str().unwrap()).collect();
    assert_eq!(statuses[..4], ["duplicate", "duplicate", "duplicate", "counted"]);
    assert_eq!(server.terminate(), Some(0));
    let check =
        Command::new(sparring_binary()).args(["db", "check", "--deep", "--db"]).arg(disk.db()).output();
    let check = check.unwrap();
    assert_eq!(check.status.code(), Some(0), "{}", String::from_utf8_lossy(&check.stdout));
}
