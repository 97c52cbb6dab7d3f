//! Free space on a disk.

use std::path::Path;

/// Returns the number of free bytes on the disk of a folder; `None` if the system does not say.
#[cfg(target_os = "linux")]
#[must_use]
pub fn free_bytes(folder: &Path) -> Option<u64> {
    let found = rustix::fs::statvfs(folder).ok()?;
    Some(found.f_bavail.saturating_mul(found.f_frsize))
}

/// Returns `None`: the free space is known on Linux only.
#[cfg(not(target_os = "linux"))]
#[must_use]
pub fn free_bytes(_: &Path) -> Option<u64> {
    None
}
