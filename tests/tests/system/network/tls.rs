//! The server with TLS, under a certificate authority of the test.

use std::io::{Read, Write};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use futures_util::{SinkExt, StreamExt};
use llm::{TrustedRoots, http_client_builder, tls_config};
use rcgen::KeyPair;
use rustls::pki_types::ServerName;
use serde_json::{Value, json};
use system_tests::{ServerProcess, TlsFiles, sparring_binary, wait_until};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_tungstenite::connect_async_tls_with_config;
use tokio_tungstenite::tungstenite::Message;

use super::exchange;

/// Command that serves a database in the folder of the certificate.
fn serve_command(files: &TlsFiles) -> Command {
    let mut command = Command::new(sparring_binary());
    command.args(["serve", "--bind", "127.0.0.1:0", "--db"]).arg(files.path("db.sqlite3"));
    command.args(files.serve_options());
    command
}

/// Starts a server whose log is in the folder of the certificate.
fn start(files: &TlsFiles) -> ServerProcess {
    let log = std::fs::File::create(files.path("log")).unwrap();
    ServerProcess::spawn(serve_command(files), Stdio::from(log))
}

/// Connects with these protocols; returns the protocol that the server selects and its certificate.
async fn handshake(address: &str, ca: &Path, protocols: &[&[u8]]) -> std::io::Result<(Vec<u8>, Vec<u8>)> {
    let mut config = tls_config(TrustedRoots::File(ca)).unwrap();
    config.alpn_protocols = protocols.iter().map(|name| name.to_vec()).collect();
    let stream = TcpStream::connect(address).await.unwrap();
    let name = ServerName::try_from("localhost").unwrap();
    let stream = TlsConnector::from(Arc::new(config)).connect(name, stream).await?;
    let connection = stream.get_ref().1;
    let certificate = connection.peer_certificates().unwrap()[0].to_vec();
    Ok((connection.alpn_protocol().unwrap_or_default().to_vec(), certificate))
}

#[tokio::test(flavor = "multi_thread")]
async fn requests_and_websockets_use_tls() {
    let files = TlsFiles::create();
    let server = start(&files);
    assert!(server.url().starts_with("https://127.0.0.1:"), "{}", server.url());
    let api = files.api(server.url());
    let _ = api.post("/v1/runs", json!({"id": "run"})).await.expect(201);
    let stranger = http_client_builder(TrustedRoots::System).unwrap().build().unwrap();
    assert!(
        stranger.get(format!("{}/livez", server.url())).send().await.is_err(),
        "the authority is unknown"
    );

    let (mut socket, _) =
        connect_async_tls_with_config(api.websocket_url("/ws"), None, true, api.connector()).await.unwrap();
    let reset = json!({"type": "reset", "data": {"seed": 1}}).to_string();
    socket.send(Message::text(reset)).await.unwrap();
    let reply: Value =
        serde_json::from_str(socket.next().await.unwrap().unwrap().to_text().unwrap()).unwrap();
    assert_eq!(reply["type"], "observation", "{reply}");
    assert_eq!(server.terminate(), Some(0), "an open WebSocket does not keep the server");
}

#[tokio::test(flavor = "multi_thread")]
async fn handshakes_offer_http1_only_and_end_in_time() {
    let files = TlsFiles::create();
    let server = start(&files);
    let (address, ca) = (server.address().to_owned(), files.path("ca.pem"));
    let both = handshake(&address, &ca, &[b"h2", b"http/1.1"]).await.unwrap();
    assert_eq!(both.0, b"http/1.1");
    assert!(handshake(&address, &ca, &[b"h2"]).await.is_err(), "HTTP/2 is off");
    let plain = {
        let address = address.clone();
        tokio::task::spawn_blocking(move || exchange(&address, "GET /livez HTTP/1.1\r\nhost: h\r\n\r\n"))
    };
    let plain = plain.await.unwrap();
    assert!(
        plain.starts_with("HTTP/1.1 400 ") && plain.ends_with("send the request to an https URL.\n"),
        "{plain}"
    );
    // A connection without a handshake, and one with the first bytes of a handshake that never goes on.
    let unfinished = [&[][..], &[22, 3, 1, 2, 0, 1]].map(|first| {
        let address = address.clone();
        tokio::task::spawn_blocking(move || {
            let mut stream = std::net::TcpStream::connect(address).unwrap();
            stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
            stream.write_all(first).unwrap();
            let start = Instant::now();
            let _ = stream.read_to_end(&mut Vec::new());
            start.elapsed()
        })
    });
    for unfinished in unfinished {
        let took = unfinished.await.unwrap();
        assert!((9..50).contains(&took.as_secs()), "the server closed the connection after {took:?}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn hangup_reads_the_certificate_again() {
    let files = TlsFiles::create();
    let server = start(&files);
    let certificate = async || {
        let ca = files.path("ca.pem");
        handshake(server.address(), &ca, &[b"http/1.1"]).await.map(|(_, certificate)| certificate)
    };
    let first = certificate().await.unwrap();
    files.issue();
    assert_eq!(certificate().await.unwrap(), first, "new files need a signal");
    server.hang_up();
    wait_until("the server has the new certificate", async || certificate().await.unwrap() != first).await;
    let second = certificate().await.unwrap();
    // A key that does not fit, and a certificate that is none.
    for (name, text) in
        [("key.pem", KeyPair::generate().unwrap().serialize_pem()), ("cert.pem", "none".to_owned())]
    {
        std::fs::write(files.path("log"), "").unwrap();
        std::fs::write(files.path(name), text).unwrap();
        server.hang_up();
        wait_until("the server logs the error", async || {
            std::fs::read_to_string(files.path("log")).unwrap().contains("The new certificate is not used")
        })
        .await;
        assert_eq!(certificate().await.unwrap(), second, "{name}: the server keeps the old certificate");
    }
}

fn sparring(args: &[&str], ca: Option<&Path>) -> Output {
    let mut command = Command::new(sparring_binary());
    command.args(args).env_remove("SPARRING_CA_FILE");
    if let Some(ca) = ca {
        command.env("SPARRING_CA_FILE", ca);
    }
    command.output().unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn subcommands_reach_a_server_with_tls() {
    let files = TlsFiles::create();
    let server = start(&files);
    let (url, ca, db) = (server.url().to_owned(), files.path("ca.pem"), files.path("db.sqlite3"));
    let outputs = tokio::task::spawn_blocking(move || {
        let by_url = ["runs", "list", "--url", &url];
        let by_db = ["runs", "list", "--db", db.to_str().unwrap()];
        let by_flag = ["runs", "list", "--url", &url, "--ca", ca.to_str().unwrap()];
        let play = ["play", "--env-url", &url, "--policy", "hold", "--task", "survival", "--episodes", "1"];
        [
            sparring(&by_url, None),
            sparring(&by_flag, None),
            sparring(&by_url, Some(&ca)),
            sparring(&by_db, Some(&ca)),
            sparring(&play, Some(&ca)),
            sparring(&by_url, Some(Path::new("/none"))),
        ]
    });
    let [without_ca, trusted @ .., unreadable] = outputs.await.unwrap();
    let error = String::from_utf8_lossy(&without_ca.stderr).into_owned();
    assert!(
        !without_ca.status.success() && error.contains("is not accepted") && error.contains("--ca"),
        "{error}"
    );
    for output in trusted {
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    let error = String::from_utf8_lossy(&unreadable.stderr).into_owned();
    assert!(error.contains("the file /none cannot be used"), "{error}");
}

#[test]
fn unusable_certificates_are_rejected_at_the_start() {
    let files = TlsFiles::create();
    let error_of = |command: &mut Command| {
        let output = command.output().unwrap();
        assert!(!output.status.success());
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let mut command = Command::new(sparring_binary());
    command.args(["serve", "--port", "0", "--temporary", "--tls-cert"]).arg(files.path("cert.pem"));
    let error = error_of(&mut command);
    assert!(error.contains("--tls-cert needs a private key; set --tls-key"), "{error}");
    std::fs::write(files.path("key.pem"), KeyPair::generate().unwrap().serialize_pem()).unwrap();
    let error = error_of(&mut serve_command(&files));
    assert!(error.contains("does not fit the certificate"), "{error}");
    std::fs::remove_file(files.path("key.pem")).unwrap();
    let error = error_of(&mut serve_command(&files));
    assert!(error.contains("--tls-key: the file") && error.contains("cannot be used"), "{error}");
    assert!(!files.path("db.sqlite3").exists(), "a rejected start creates no file");
}
