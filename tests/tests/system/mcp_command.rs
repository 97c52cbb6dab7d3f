//! `sparring mcp`: the Model Context Protocol on stdin and stdout.

use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};

use serde_json::{Value, json};
use system_tests::{ServerProcess, sparring_binary, wait_until};

/// Starts `sparring mcp` with a folder for temporary files.
fn start(temporary: &Path, args: &[&str]) -> Child {
    let mut command = Command::new(sparring_binary());
    command.arg("mcp").args(args).env("TMPDIR", temporary).env_remove("SPARRING_TOKEN");
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Sends a line and returns the answer.
fn ask(program: &mut Child, line: &str) -> Value {
    writeln!(program.stdin.as_mut().unwrap(), "{line}").unwrap();
    let mut answer = String::new();
    BufReader::new(program.stdout.as_mut().unwrap()).read_line(&mut answer).unwrap();
    serde_json::from_str(&answer).unwrap()
}

/// Sends a signal and waits for the end of the program.
fn stop(mut program: Child, signal: &str) -> ExitStatus {
    assert!(Command::new("kill").arg(signal).arg(program.id().to_string()).status().unwrap().success());
    program.wait().unwrap()
}

fn call(id: u32, tool: &str) -> String {
    json!({"jsonrpc": "2.0", "id": id, "method": "tools/call", "params": {"name": tool}}).to_string()
}

#[test]
fn signals_and_end_of_input_leave_no_files() {
    let folder = tempfile::tempdir().unwrap();
    for signal in [Some("-TERM"), Some("-INT"), None] {
        let mut program = start(folder.path(), &["--task", "rendezvous", "--seed", "5"]);
        let seen = ask(&mut program, &call(1, "telemetry"));
        assert_eq!(seen["result"]["structuredContent"]["step"], 0, "{seen}");
        assert!(std::fs::read_dir(folder.path()).unwrap().count() > 0, "the database is temporary");
        let status = if let Some(signal) = signal {
            stop(program, signal)
        } else {
            drop(program.stdin.take());
            program.wait().unwrap()
        };
        assert_eq!(status.code(), Some(0), "{signal:?}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "{signal:?}");
    }
}

#[tokio::test]
async fn signal_closes_the_session_on_a_server() {
    let folder = tempfile::tempdir().unwrap();
    let server = ServerProcess::start(&folder.path().join("db.sqlite3"));
    let api = server.api();
    let mut program = start(folder.path(), &["--url", api.base()]);
    let _ = ask(&mut program, &call(1, "telemetry"));
    let sessions = async || {
        let metrics = api.get("/metrics").await;
        let metrics = metrics.body.as_str().unwrap_or_default();
        metrics.lines().find_map(|line| line.strip_prefix("sparring_sessions ")).map(str::to_owned)
    };
    assert_eq!(sessions().await.as_deref(), Some("1"));
    assert_eq!(stop(program, "-TERM").code(), Some(0));
    wait_until("the session is closed", async || sessions().await.as_deref() == Some("0")).await;
}

#[test]
fn lines_that_are_no_requests_have_errors_or_no_answer() {
    let folder = tempfile::tempdir().unwrap();
    let mut program = start(folder.path(), &[]);
    assert_eq!(ask(&mut program, "nonsense")["error"]["code"], -32700);
    // A notification has no answer; the next line has the next answer.
    let notification = json!({"jsonrpc": "2.0", "method": "notifications/initialized"});
    writeln!(program.stdin.as_mut().unwrap(), "{notification}\n").unwrap();
    let refused = ask(
        &mut program,
        &json!({"jsonrpc": "2.0", "id": 7, "method": "tools/call", "params": []}).to_string(),
    );
    assert_eq!((&refused["id"], &refused["error"]["code"]), (&json!(7), &json!(-32600)));
    let unknown = ask(&mut program, &call(8, "fly"));
    assert_eq!(unknown["result"]["isError"], true, "{unknown}");
    assert_eq!(stop(program, "-TERM").code(), Some(0));
}
