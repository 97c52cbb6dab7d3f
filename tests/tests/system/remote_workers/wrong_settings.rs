//! Settings of NATS that cannot work: the commands say so and end, or the server says what NATS rejects.

use std::process::{Child, Command, Stdio};

use system_tests::nats_server::NatsServer;
use system_tests::{ServerProcess, TlsFiles, sparring_binary, wait_until};

use super::secure_nats::{SecureNats, as_strs};

/// Runs a command until it ends, and returns its exit code and what it printed to stderr.
fn run(command: &str, options: &[&str]) -> (Option<i32>, String) {
    let output = Command::new(sparring_binary()).arg(command).args(options).output().unwrap();
    (
        output.status.code(),
        String::from_utf8_lossy(&output.stderr).split_whitespace().collect::<Vec<_>>().join(" "),
    )
}

/// Reason why a server does not use NATS.
async fn reason(server: &ServerProcess) -> String {
    server.api().get("/v1/workers").await.expect(200)["degraded"].as_str().unwrap_or_default().to_owned()
}

#[test]
fn invalid_settings_of_nats_end_the_commands() {
    let folder = tempfile::tempdir().unwrap();
    let garbage = folder.path().join("garbage");
    std::fs::write(&garbage, "no credentials and no certificate").unwrap();
    let garbage = garbage.to_str().unwrap();
    let url = "nats://127.0.0.1:4222";
    for (options, reason) in [
        (&["--nats", "http://127.0.0.1:4222"][..], "the scheme must be nats or tls, got \"http\""),
        (&["--nats", ""], "a URL is missing"),
        (&["--nats", "nats://"], "such as nats://10.0.0.5:4222"),
        (&["--nats", "nats://127.0.0.1:99999"], "invalid port number"),
        (
            &["--nats", url, "--nats-creds", "/nowhere/seed"],
            "the file /nowhere/seed cannot be used: No such file",
        ),
        (&["--nats", url, "--nats-creds", garbage], "cannot be used"),
        (&["--nats", url, "--nats-ca", "/nowhere/ca.pem"], "--nats-ca /nowhere/ca.pem: No such file"),
        (&["--nats", url, "--nats-ca", garbage], "the file has no certificate in PEM"),
    ] {
        let own: [(&str, &[&str]); 2] = [("worker", &[]), ("serve", &["--temporary", "--port", "0"])];
        for (command, more) in own {
            let (code, stderr) = run(command, &[options, more].concat());
            assert_eq!(code, Some(2), "{command} {options:?}: {stderr}");
            assert!(stderr.contains(reason), "{command} {options:?}: {stderr}");
        }
    }
    for (options, reason) in [
        (&["--nats", url, "--host", ""][..], "1 to 64 characters"),
        (&["--nats", url, "--host", "two\nlines"], "none of them a control character"),
        (&["--nats", url, "--jobs", "golf"], "the kinds are design, rollout, prepare, audit"),
    ] {
        let (code, stderr) = run("worker", options);
        assert_eq!(code, Some(2), "{options:?}: {stderr}");
        assert!(stderr.contains(reason), "{options:?}: {stderr}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn rejected_credentials_are_named() {
    let Some(nats) = SecureNats::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let seed = folder.path().join("seed");
    std::fs::write(&seed, nkeys::KeyPair::new_user().seed().unwrap()).unwrap();
    let mut options = nats.options("SERVER");
    *options.last_mut().unwrap() = seed.display().to_string();
    let server = ServerProcess::start_with_options(&folder.path().join("db.sqlite3"), &as_strs(&options));
    wait_until("the server names the credentials", async || {
        let reason = reason(&server).await;
        reason.contains("cannot be used: NATS rejects this program") && reason.contains("--nats-creds")
    })
    .await;
    let (code, stderr) = run("worker", &as_strs(&options));
    assert_eq!(code, Some(2), "{stderr}");
    assert!(stderr.contains("NATS rejects this program") && stderr.contains("--nats-creds"), "{stderr}");
}

#[tokio::test(flavor = "multi_thread")]
async fn certificate_authorities_require_tls() {
    let Some(nats) = NatsServer::start() else { return };
    let tls = TlsFiles::create();
    let ca = tls.path("ca.pem").display().to_string();
    let folder = tempfile::tempdir().unwrap();
    let options = ["--nats", &nats.url(), "--nats-ca", &ca];
    let server = ServerProcess::start_with_options(&folder.path().join("db.sqlite3"), &options);
    wait_until("the server refuses a connection without TLS", async || {
        reason(&server).await.contains("cannot be reached by TLS")
    })
    .await;
}

/// A child process that is killed at the end of the test.
struct Killed(Child);

impl Drop for Killed {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[cfg(unix)]
#[tokio::test(flavor = "multi_thread")]
async fn worker_that_starts_can_be_stopped() {
    use std::io::{BufRead, BufReader};

    let mut command = Command::new(sparring_binary());
    command.args(["worker", "--nats", "nats://127.0.0.1:1"]).stdout(Stdio::null()).stderr(Stdio::piped());
    let mut worker = Killed(command.spawn().unwrap());
    let mut lines = BufReader::new(worker.0.stderr.take().unwrap()).lines();
    let first = lines.next().unwrap().unwrap();
    assert!(first.contains("computes the version of its worlds"), "{first}");
    let sent = Command::new("kill").args(["-s", "TERM", &worker.0.id().to_string()]).status().unwrap();
    assert!(sent.success(), "the worker exited before SIGTERM");
    assert_eq!(worker.0.wait().unwrap().code(), Some(0));
    let rest: Vec<String> = lines.map_while(Result::ok).collect();
    assert!(!rest.iter().any(|line| line.contains("The worker started")), "{rest:?}");
}
