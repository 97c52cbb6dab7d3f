//! Settings of NATS that cannot work: the commands say so and end, or the server says what NATS rejects.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

use system_tests::nats_server::NatsServer;
use system_tests::worker_cluster::WorkerProcess;
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
    for option in ["--nats-creds", "--nats-ca", "--nats-name"] {
        let (code, stderr) = run("serve", &["--temporary", option, "name"]);
        assert_eq!(code, Some(2), "{stderr}");
        assert!(stderr.contains("needs --nats URL"), "{stderr}");
    }
    let (code, stderr) = run("worker", &["--nats", "nats://team:s%40cret@host"]);
    assert!(code == Some(2) && !stderr.contains("cret"), "{stderr}");
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
async fn options_on_the_command_line_fit_a_url_in_the_file() {
    let Some(nats) = NatsServer::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("sparring.toml");
    std::fs::write(&file, format!("nats = {:?}\n", nats.url())).unwrap();
    let options = [
        "--config",
        file.to_str().unwrap(),
        "--nats-name",
        "team",
        "--nats-verify",
        "0.5",
        "--nats-patience",
        "3",
    ];
    let server = ServerProcess::start_with_options(&folder.path().join("db.sqlite3"), &options);
    wait_until("the server waits for workers", async || reason(&server).await.contains("worker")).await;
    let context = async_nats::jetstream::new(async_nats::connect(nats.url()).await.unwrap());
    let _ = context.get_stream("SPARRING_team_JOBS").await.unwrap();
    drop(server);
    std::fs::write(&file, "nats-creds = \"seed\"\n").unwrap();
    let (code, stderr) = run("serve", &["--temporary", "--config", file.to_str().unwrap()]);
    assert_eq!(code, Some(2), "{stderr}");
    assert!(stderr.contains("--nats-creds needs --nats URL"), "{stderr}");
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
        reason.contains("cannot be used: NATS rejects this user") && reason.contains("--nats-creds")
    })
    .await;
    let (code, stderr) = run("worker", &as_strs(&options));
    assert_eq!(code, Some(2), "{stderr}");
    assert!(stderr.contains("NATS rejects this user") && stderr.contains("--nats-creds"), "{stderr}");
}

#[tokio::test(flavor = "multi_thread")]
async fn keys_without_permissions_are_named() {
    let Some(nats) = SecureNats::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let start = |name: &str, user: &str| {
        ServerProcess::start_with_options(&folder.path().join(name), &as_strs(&nats.options(user)))
    };
    let _server = start("db.sqlite3", "SERVER");
    // A worker without --jobs takes jobs that a key for designs may not take; a trainer may not even send heartbeats.
    for (user, denied) in [("DESIGN_WORKER", "SPARRING_default_JOBS."), ("TRAINER", "sparring.default.")] {
        let (code, stderr) = run("worker", &as_strs(&nats.options(user)));
        assert_eq!(code, Some(2), "{user}: {stderr}");
        assert!(
            stderr.contains("NATS does not permit this user") && stderr.contains(denied),
            "{user}: {stderr}"
        );
    }
    let other = start("other.sqlite3", "WORKER");
    wait_until("the server names its permissions", async || {
        reason(&other).await.contains("cannot be used: NATS does not permit this user")
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn user_and_password_of_a_url_are_used() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("nats.conf");
    std::fs::write(&config, "authorization { user: team, password: secret }").unwrap();
    let Some(nats) = NatsServer::start_with(Some(config), Vec::new()) else { return };
    let url = |user: &str| nats.url().replace("//", &format!("//{user}@"));
    let server = ServerProcess::start_with_options(
        &folder.path().join("db.sqlite3"),
        &["--nats", &url("team:secret")],
    );
    let _worker = WorkerProcess::start_with_options(&["--nats", &url("team:secret")]);
    wait_until("the worker joins", async || {
        server.api().get("/v1/workers").await.expect(200)["workers"][0]["state"] == "active"
    })
    .await;
    let (code, stderr) = run("worker", &["--nats", &url("team:wrong")]);
    assert_eq!(code, Some(2), "{stderr}");
    assert!(stderr.contains("NATS rejects this user") && !stderr.contains("wrong"), "{stderr}");
}

/// Containers start in any order: NATS may be away when a worker tries to connect first.
#[tokio::test(flavor = "multi_thread")]
async fn worker_that_waited_for_nats_names_a_wrong_password() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("nats.conf");
    std::fs::write(&config, "authorization { user: team, password: secret }").unwrap();
    let Some(mut nats) = NatsServer::start_with(Some(config), Vec::new()) else { return };
    let url = nats.url().replace("//", "//team:wrong@");
    nats.kill();
    let mut command = Command::new(sparring_binary());
    command.args(["worker", "--nats", &url]).stdout(Stdio::null()).stderr(Stdio::piped());
    let mut worker = Killed(command.spawn().unwrap());
    let mut lines = BufReader::new(worker.0.stderr.take().unwrap()).lines().map_while(Result::ok);
    assert!(lines.any(|line| line.contains("NATS is away")));
    nats.resume();
    let rest: Vec<String> = lines.collect();
    assert_eq!(worker.0.wait().unwrap().code(), Some(2), "{rest:?}");
    assert!(rest.iter().any(|line| line.contains("NATS rejects this user")), "{rest:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn errors_of_tls_say_what_to_set() {
    let (Some(plain), Some(secure)) = (NatsServer::start(), SecureNats::start()) else { return };
    let other = TlsFiles::create();
    let ca = other.path("ca.pem").display().to_string();
    let tls_url = plain.url().replace("nats://", "tls://");
    let mut wrong_authority = secure.options("SERVER");
    let place = wrong_authority.iter().position(|option| option == "--nats-ca").unwrap() + 1;
    wrong_authority[place].clone_from(&ca);
    for (options, reason) in [
        (vec!["--nats", &plain.url(), "--nats-ca", &ca], "the NATS server has no TLS"),
        (vec!["--nats", &tls_url], "the NATS server has no TLS"),
        (as_strs(&wrong_authority), "set --nats-ca to the authority"),
    ] {
        let (code, stderr) = run("worker", &options);
        assert_eq!(code, Some(2), "{options:?}: {stderr}");
        assert!(stderr.contains(reason), "{options:?}: {stderr}");
    }
    let folder = tempfile::tempdir().unwrap();
    let options = ["--nats", &plain.url(), "--nats-ca", &ca];
    let server = ServerProcess::start_with_options(&folder.path().join("db.sqlite3"), &options);
    wait_until("the server refuses a connection without TLS", async || {
        reason(&server).await.contains("cannot be used: the NATS server has no TLS")
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
