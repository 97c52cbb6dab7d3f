//! Every way an endpoint can misbehave: each ends in time, in a typed error or a trouble, and the next brief goes on.

use super::*;
use std::time::Instant;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;

/// What asking an endpoint once comes to.
async fn once(answer: ResponseTemplate) -> LlmError {
    let server = endpoint([answer]).await;
    let llm = Llm::new(LlmConfig { retries: 0, ..config(&server.uri()) }).unwrap();
    let error = design(&llm, 1).await.unwrap_err();
    assert_eq!(llm.health().last_error.unwrap().words, error.to_string());
    error
}

/// A server that speaks as it likes: what it is given to say for each connection, piece by piece, with pauses.
async fn raw(head: &'static str, piece: Vec<u8>, pause: Duration) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(async move {
        while let Ok((mut stream, _)) = listener.accept().await {
            let piece = piece.clone();
            tokio::spawn(async move {
                let mut heard = [0; 65536];
                let _ = stream.read(&mut heard).await;
                let _ = stream.write_all(head.as_bytes()).await;
                while !piece.is_empty() && stream.write_all(&piece).await.is_ok() {
                    tokio::time::sleep(pause).await;
                }
            });
        }
    });
    format!("http://{address}")
}

#[tokio::test]
async fn refusals_are_told_with_status_and_words() {
    let told = [
        once(ResponseTemplate::new(401).set_body_string("{\"error\": {\"message\": \"no\\nsuch\\tkey\"}}"))
            .await,
        once(ResponseTemplate::new(404).set_body_string("<html><b>nothing</b> here</html>")).await,
        once(ResponseTemplate::new(503).set_body_string("x".repeat(5000))).await,
        once(ResponseTemplate::new(429).insert_header("retry-after", "3600")).await,
        once(ResponseTemplate::new(429).insert_header("retry-after", "Thu, 01 Jan 2026 00:02:00 GMT")).await,
        once(
            ResponseTemplate::new(200)
                .set_body_string("{\"error\": {\"message\": \"behind me\", \"code\": 502}}"),
        )
        .await,
        once(ResponseTemplate::new(200).set_body_string("<html>a captive portal</html>")).await,
        once(ResponseTemplate::new(200).set_body_string("{\"choices\": [{\"message\": {\"role\"")).await,
        once(ResponseTemplate::new(200).set_body_string("{\"choices\": []}")).await,
        once(
            ResponseTemplate::new(200).set_body_string("{\"choices\": [{\"message\": {\"content\": null}}]}"),
        )
        .await,
        once(
            ResponseTemplate::new(200)
                .set_body_string("{\"choices\": [{\"message\": {\"refusal\": \"I may not\"}}]}"),
        )
        .await,
    ];
    insta::assert_snapshot!(told.map(|error| format!("{}: {error}", error.word())).join("\n"));
}

#[tokio::test]
async fn failures_in_passing_are_tried_again() {
    let good = good(1);
    let busy = || ResponseTemplate::new(429).insert_header("retry-after", "0");
    let server = endpoint([busy(), ResponseTemplate::new(502), says(&list(&good))]).await;
    let llm = Llm::new(config(&server.uri())).unwrap();
    let designed = design(&llm, 1).await.unwrap();
    assert_eq!((designed.admitted(), designed.usage.rounds), (1, 1));
    assert_eq!((llm.health().retries, llm.health().failed), (2, 0));
    // And not for ever.
    let server = endpoint([ResponseTemplate::new(503)]).await;
    let llm = Llm::new(config(&server.uri())).unwrap();
    assert_eq!(design(&llm, 1).await.unwrap_err().word(), "refused");
    assert_eq!(sent(&server).await.len(), 4);
}

#[tokio::test]
async fn silence_ends_by_the_timeout() {
    let error = once(says("late").set_delay(Duration::from_secs(30))).await;
    assert_eq!(error, LlmError::Timeout { after: Duration::from_millis(1500) });
}

#[tokio::test]
async fn nobody_there_is_a_connection_error() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    drop(listener);
    let llm = Llm::new(config(&format!("http://{address}"))).unwrap();
    let error = design(&llm, 1).await.unwrap_err();
    assert_eq!((error.word(), llm.health().retries), ("connection", 3));
}

#[tokio::test]
async fn a_body_that_trickles_ends_by_the_timeout() {
    let head = "HTTP/1.1 200 OK\r\ncontent-length: 100000\r\n\r\n";
    let url = raw(head, b" ".to_vec(), Duration::from_millis(20)).await;
    let begun = Instant::now();
    let llm = Llm::new(config(&url)).unwrap();
    assert_eq!(design(&llm, 1).await.unwrap_err().word(), "timeout");
    // The timeout is 1.5 s; a machine that is busy may be late, and the body would take half an hour.
    assert!(begun.elapsed() < Duration::from_secs(10));
    // Headers that trickle likewise.
    let url = raw("HTTP/1.1 200 OK\r\n", b"a: b\r\n".to_vec(), Duration::from_millis(100)).await;
    let llm = Llm::new(config(&url)).unwrap();
    assert_eq!(design(&llm, 1).await.unwrap_err().word(), "timeout");
}

#[tokio::test]
async fn a_body_without_end_is_not_read_to_the_end() {
    let head = "HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\n";
    let piece = [b"10000\r\n".to_vec(), vec![b' '; 65536], b"\r\n".to_vec()].concat();
    let url = raw(head, piece, Duration::ZERO).await;
    let llm = Llm::new(config(&url)).unwrap();
    let error = design(&llm, 1).await.unwrap_err().to_string();
    assert_eq!(error, "the model's answer makes no sense: it is longer than 1048576 bytes");
}

#[tokio::test]
async fn a_connection_that_breaks_off_is_tried_again() {
    let url = raw("HTTP/1.1 200 OK\r\ncontent-length: 100000\r\n\r\n{", Vec::new(), Duration::ZERO).await;
    let llm = Llm::new(LlmConfig { retries: 1, ..config(&url) }).unwrap();
    let error = asks(&llm, "r").await.unwrap_err();
    assert!(matches!(error, LlmError::Broken { .. }), "{error}");
    // It may have cost: the prompt of both tries, 12 tokens each.
    assert_eq!((error.word(), llm.health().retries, llm.spent("r").tokens), ("connection", 1, 24));
}

#[tokio::test]
async fn redirects_are_not_followed() {
    let elsewhere = endpoint([says(&list(&good(1)))]).await;
    let to = format!("{}/v1/chat/completions", elsewhere.uri());
    for status in [301, 302, 307, 308] {
        let error = once(ResponseTemplate::new(status).insert_header("location", to.as_str())).await;
        assert!(matches!(error, LlmError::Refused { status: s, .. } if s == status), "{error}");
    }
    assert!(sent(&elsewhere).await.is_empty());
}

#[tokio::test]
async fn a_breaker_that_is_open_makes_no_calls() {
    let server = endpoint([ResponseTemplate::new(403)]).await;
    let llm = Llm::new(config(&server.uri())).unwrap();
    for _ in 0..5 {
        design(&llm, 1).await.unwrap_err();
    }
    assert_eq!((sent(&server).await.len(), llm.health().breaker), (3, "open"));
    assert_eq!(design(&llm, 1).await.unwrap_err().word(), "open");
}

#[tokio::test]
async fn a_budget_that_is_exhausted_makes_no_calls() {
    let server = endpoint([says("no")]).await;
    let llm = Llm::new(LlmConfig { tokens_per_day: Some(1000), ..config(&server.uri()) }).unwrap();
    assert_eq!(design(&llm, 1).await.unwrap_err().word(), "budget");
    assert!(sent(&server).await.is_empty());
}

#[test]
fn settings_that_cannot_be_are_refused() {
    let refuse = |change: fn(&mut LlmConfig)| {
        let mut config = config("http://127.0.0.1:1");
        change(&mut config);
        Llm::new(config).unwrap_err().to_string()
    };
    insta::assert_snapshot!(
        [
            refuse(|c| c.base_url = "localhost:8000".to_owned()),
            refuse(|c| c.base_url = "api".to_owned()),
            refuse(|c| c.base_url = "https://me:secret@host/v1".to_owned()),
            refuse(|c| c.base_url = "https://host/v1?key=secret".to_owned()),
            refuse(|c| c.base_url = "https://host/v1#secret".to_owned()),
            refuse(|c| c.model = " ".to_owned()),
            refuse(|c| c.cost_per_day = Some(5.0)),
            refuse(|c| c.price_in = f64::NAN),
            refuse(|c| c.concurrency = 0),
            refuse(|c| c.max_tokens = 0),
            refuse(|c| c.timeout = Duration::ZERO),
            refuse(|c| c.key = Some("a\nb".into())),
        ]
        .join("\n")
    );
    // https has all it needs.
    Llm::new(LlmConfig::new("https://api.example.com/v1/", "m", WallClock::new(|| 0))).unwrap();
}
