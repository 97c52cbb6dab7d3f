//! Process group of the processes that tests and benchmarks start. It ends with this process, also after SIGKILL: a guard, which leads
//! the group, reads from a pipe until its writing end closes, and then kills the group. The library of the system tests includes this
//! file.

use std::process::Command;

/// Lets the process of a command join the group. On Windows this does nothing.
///
/// # Panics
/// Panics if there is no shell for the guard.
pub(crate) fn join(command: &mut Command) {
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(command, unix::group());
    #[cfg(not(unix))]
    let _ = command;
}

#[cfg(unix)]
mod unix {
    use std::os::unix::process::CommandExt;
    use std::process::{Child, Command, Stdio};
    use std::sync::LazyLock;

    /// The guard, with the only writing end of its pipe: other processes do not inherit it.
    static GUARD: LazyLock<Child> = LazyLock::new(|| {
        let mut command = Command::new("sh");
        command.args(["-c", "read -r line; kill -KILL 0"]).process_group(0);
        command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        command.spawn().expect("a shell starts")
    });

    /// Id of the group, which is that of its guard.
    pub(super) fn group() -> i32 {
        i32::try_from(GUARD.id()).expect("a process id")
    }
}
