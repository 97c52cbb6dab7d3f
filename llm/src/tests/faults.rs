//! Misbehaving endpoints: each call ends within its time limit, in a typed error.

use super::*;
use std::time::Instant;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpSocket};

/// Error of one call, without retries, to an endpoint with this response.
async fn error_of(response: ResponseTemplate) -> LlmError {
    let server = start_endpoint([response]).await;
    let client = LlmClient::new(LlmConfig { retries: 0, ..test_config(&server.uri()) }).unwrap();
    let error = complete(&client, "r").await.unwrap_err();
    assert_eq!(client.health().last_error.unwrap().message, error.to_string());
    error
}

/// Response with status 200 and this body.
fn body(text: &str) -> ResponseTemplate {
    ResponseTemplate::new(200).set_body_string(text)
}

/// Starts a server that answers each connection with raw bytes: `head`, then `piece` again and again with a pause, for ever.
/// If `piece` is empty, it closes the connection after `head`.
async fn start_raw_endpoint(head: &'static str, piece: Vec<u8>, pause: Duration) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(async move {
        while let Ok((mut stream, _)) = listener.accept().await {
            let piece = piece.clone();
            tokio::spawn(async move {
                let mut request = [0; 65536];
                let _ = stream.read(&mut request).await;
                let _ = stream.write_all(head.as_bytes()).await;
                while !piece.is_empty() && stream.write_all(&piece).await.is_ok() {
                    tokio::time::sleep(pause).await;
                }
            });
        }
    });
    format!("http://{address}")
}

/// Returns a configuration whose timeout is shorter than the responses of slow endpoints.
fn impatient_config(url: &str) -> LlmConfig {
    LlmConfig { timeout: Duration::from_millis(1500), ..test_config(url) }
}

#[tokio::test]
async fn errors_show_status_and_message() {
    let no_key =
        ResponseTemplate::new(401).set_body_string("{\"error\": {\"message\": \"no\\nsuch\\tkey\"}}");
    let errors = [
        error_of(no_key).await,
        error_of(ResponseTemplate::new(404).set_body_string("<html><b>nothing</b> here</html>")).await,
        error_of(ResponseTemplate::new(503).set_body_string("x".repeat(5000))).await,
        error_of(ResponseTemplate::new(429).insert_header("retry-after", "3600")).await,
        error_of(ResponseTemplate::new(429).insert_header("retry-after", "Thu, 01 Jan 2026 00:02:00 GMT"))
            .await,
        error_of(body("{\"error\": {\"message\": \"behind me\", \"code\": 502}}")).await,
        error_of(body("<html>a captive portal</html>")).await,
        error_of(body("{\"choices\": [{\"message\": {\"role\"")).await,
        error_of(body("{\"choices\": []}")).await,
        error_of(body("{\"choices\": [{\"message\": {\"content\": null}}]}")).await,
        error_of(body("{\"choices\": [{\"message\": {\"refusal\": \"I may not\"}}]}")).await,
    ];
    insta::assert_snapshot!(errors.map(|error| format!("{}: {error}", error.kind())).join("\n"));
}

#[tokio::test]
async fn transient_failures_are_retried_a_few_times() {
    let busy = || ResponseTemplate::new(429).insert_header("retry-after", "0");
    let server = start_endpoint([busy(), ResponseTemplate::new(502), answer("well")]).await;
    let client = LlmClient::new(test_config(&server.uri())).unwrap();
    assert_eq!(complete(&client, "r").await.unwrap().text, "well");
    assert_eq!((client.health().retries, client.health().failed), (2, 0));
    let server = start_endpoint([ResponseTemplate::new(503)]).await;
    let client = LlmClient::new(test_config(&server.uri())).unwrap();
    assert_eq!(complete(&client, "r").await.unwrap_err().kind(), "refused");
    assert_eq!(received_bodies(&server).await.len(), 4);
}

#[tokio::test]
async fn silent_endpoint_ends_in_a_timeout() {
    let server = start_endpoint([answer("late").set_delay(Duration::from_secs(300))]).await;
    let client = LlmClient::new(LlmConfig { retries: 0, ..impatient_config(&server.uri()) }).unwrap();
    let error = complete(&client, "r").await.unwrap_err();
    assert_eq!(error, LlmError::Timeout { after: Duration::from_millis(1500) });
}

#[tokio::test]
async fn closed_port_is_a_connection_error() {
    // The socket keeps the port, so that no other process can listen at it.
    let socket = TcpSocket::new_v4().unwrap();
    socket.bind(([127, 0, 0, 1], 0).into()).unwrap();
    let address = socket.local_addr().unwrap();
    let client = LlmClient::new(test_config(&format!("http://{address}"))).unwrap();
    let error = complete(&client, "r").await.unwrap_err();
    assert_eq!((error.kind(), client.health().retries), ("connection", 3));
}

#[tokio::test]
async fn trickling_response_ends_in_a_timeout() {
    let head = "HTTP/1.1 200 OK\r\ncontent-length: 100000\r\n\r\n";
    let url = start_raw_endpoint(head, b" ".to_vec(), Duration::from_millis(20)).await;
    let started = Instant::now();
    let client = LlmClient::new(impatient_config(&url)).unwrap();
    assert_eq!(complete(&client, "r").await.unwrap_err().kind(), "timeout");
    // The timeout is 1.5 s; a busy machine may be late. The whole body would take half an hour.
    assert!(started.elapsed() < Duration::from_secs(120));
    // The same for headers.
    let url =
        start_raw_endpoint("HTTP/1.1 200 OK\r\n", b"a: b\r\n".to_vec(), Duration::from_millis(100)).await;
    let client = LlmClient::new(impatient_config(&url)).unwrap();
    assert_eq!(complete(&client, "r").await.unwrap_err().kind(), "timeout");
}

#[tokio::test]
async fn endless_body_is_rejected_at_its_limit() {
    let head = "HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\n";
    let piece = [b"10000\r\n".to_vec(), vec![b' '; 65536], b"\r\n".to_vec()].concat();
    let url = start_raw_endpoint(head, piece, Duration::ZERO).await;
    let client = LlmClient::new(test_config(&url)).unwrap();
    let error = complete(&client, "r").await.unwrap_err().to_string();
    assert_eq!(error, "the model's response is invalid: it has more than 1048576 bytes");
}

#[tokio::test]
async fn broken_connection_is_retried() {
    let head = "HTTP/1.1 200 OK\r\ncontent-length: 100000\r\n\r\n{";
    let url = start_raw_endpoint(head, Vec::new(), Duration::ZERO).await;
    let client = LlmClient::new(LlmConfig { retries: 1, ..test_config(&url) }).unwrap();
    let error = complete(&client, "r").await.unwrap_err();
    assert!(matches!(error, LlmError::ConnectionLost { .. }), "{error}");
    // The endpoint may bill both attempts: 12 prompt tokens each.
    assert_eq!((error.kind(), client.health().retries, client.spending("r").tokens), ("connection", 1, 24));
}

#[tokio::test]
async fn redirects_are_not_followed() {
    let elsewhere = start_endpoint([answer("well")]).await;
    let to = format!("{}/v1/chat/completions", elsewhere.uri());
    for status in [301, 302, 307, 308] {
        let error = error_of(ResponseTemplate::new(status).insert_header("location", to.as_str())).await;
        assert!(matches!(error, LlmError::Refused { status: s, .. } if s == status), "{error}");
    }
    assert!(received_bodies(&elsewhere).await.is_empty());
}

#[tokio::test]
async fn open_breaker_sends_no_requests() {
    let server = start_endpoint([ResponseTemplate::new(403)]).await;
    let client = LlmClient::new(test_config(&server.uri())).unwrap();
    for _ in 0..5 {
        complete(&client, "r").await.unwrap_err();
    }
    assert_eq!((received_bodies(&server).await.len(), client.health().breaker), (3, BreakerState::Open));
    assert_eq!(complete(&client, "r").await.unwrap_err().kind(), "open");
}

#[tokio::test]
async fn exhausted_budget_sends_no_requests() {
    let server = start_endpoint([answer("no")]).await;
    let config = LlmConfig { tokens_per_day: Some(1000), ..test_config(&server.uri()) };
    let client = LlmClient::new(config).unwrap();
    assert_eq!(complete(&client, "r").await.unwrap_err().kind(), "budget");
    assert!(received_bodies(&server).await.is_empty());
}

#[test]
fn invalid_settings_are_rejected() {
    let error_of = |change: fn(&mut LlmConfig)| {
        let mut config = test_config(NO_ENDPOINT);
        change(&mut config);
        LlmClient::new(config).unwrap_err().to_string()
    };
    insta::assert_snapshot!(
        [
            error_of(|c| c.base_url = "localhost:8000".to_owned()),
            error_of(|c| c.base_url = "api".to_owned()),
            error_of(|c| c.base_url = "https://me:secret@host/v1".to_owned()),
            error_of(|c| c.base_url = "https://host/v1?key=secret".to_owned()),
            error_of(|c| c.base_url = "https://host/v1#secret".to_owned()),
            error_of(|c| c.model = " ".to_owned()),
            error_of(|c| c.cost_per_day = Some(5.0)),
            error_of(|c| c.price_in = f64::NAN),
            error_of(|c| c.concurrency = 0),
            error_of(|c| c.max_tokens = 0),
            error_of(|c| c.timeout = Duration::ZERO),
            error_of(|c| c.key = Some("a\nb".into())),
        ]
        .join("\n")
    );
    // An https endpoint is valid too.
    LlmClient::new(LlmConfig::new("https://api.example.com/v1/", "m", WallClock::new(|| 0))).unwrap();
}
