//! `sparring serve` as a command: which address applies, and the exit code after a signal.

use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

use system_tests::{ServerProcess, sparring_binary};

#[test]
fn exit_code_tells_ctrl_c_from_sigterm() {
    let folder = tempfile::tempdir().unwrap();
    let db = folder.path().join("db.sqlite3");
    assert_eq!(ServerProcess::start(&db).interrupt(), Some(130));
    assert_eq!(ServerProcess::start(&db).terminate(), Some(0));
}

#[test]
fn port_of_a_flag_has_precedence_over_a_variable() {
    let address = |flags: &[&str]| {
        let mut command = Command::new(sparring_binary());
        command.args(["serve", "--temporary"]).args(flags).env("SPARRING_PORT", "0");
        let mut server = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(server.stdout.take().unwrap()).read_line(&mut line).unwrap();
        server.kill().unwrap();
        server.wait().unwrap();
        line.trim().rsplit(':').next().unwrap_or_default().parse::<u16>().unwrap()
    };
    let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    assert_eq!(address(&["--bind", &format!("127.0.0.1:{free}")]), free);
    assert_ne!(address(&["--bind", "127.0.0.1"]), 8700, "the flag has no port, the variable has one");
}
