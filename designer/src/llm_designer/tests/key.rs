//! The key is sent in a header of each request and appears nowhere else.

use super::*;
use std::io::Write;
use std::sync::Mutex;

const KEY: &str = "sk-very-secret-1234567890";

/// Collects log output in memory.
#[derive(Clone, Default)]
struct LogBuffer(Arc<Mutex<Vec<u8>>>);

impl Write for LogBuffer {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[tokio::test]
async fn repeated_key_appears_in_no_output() {
    let buffer = LogBuffer::default();
    let writer = buffer.clone();
    let logs =
        tracing_subscriber::fmt().with_max_level(tracing::Level::TRACE).with_writer(move || writer.clone());
    // While one dispatcher exists only, tracing asks the current thread whether a log statement is enabled: a test on
    // another thread, which has no subscriber, would disable it for all threads.
    let _second = tracing::Dispatch::new(tracing_subscriber::registry());
    // Everything runs on this thread, so the buffer gets all logs.
    let _guard = tracing::subscriber::set_default(logs.finish());
    // An endpoint that repeats the key in every way.
    let mut named = good_designs(1).remove(0);
    named["name"] = json!(KEY);
    let mut wrong = named.clone();
    wrong["encounters"][0]["step"] = json!(KEY);
    let server = start_endpoint([
        ResponseTemplate::new(503).set_body_string(format!("busy, {KEY}")),
        answer(KEY),
        answer(&layouts(&[wrong])),
        answer(&layouts(&[named])),
        ResponseTemplate::new(401).set_body_json(json!({"error": {"message": format!("bad key {KEY}")}})),
        ResponseTemplate::new(200).set_body_json(json!({"error": {"message": KEY, "code": 400}})),
        ResponseTemplate::new(200).set_body_json(json!({"choices": [{"message": {"refusal": KEY}}]})),
    ])
    .await;
    let config = LlmConfig { key: Some(KEY.into()), ..test_config(&server.uri()) };
    let mut outputs = vec![format!("{config:?}"), format!("{config:#?}")];
    let client = LlmClient::new(config).unwrap();
    let brief = brief(1);
    let mut designer = LlmDesigner::new(client.clone(), "r");
    let designed = designer.design(&brief, &mut gate(&brief)).await.unwrap();
    assert_eq!((designed.admitted(), designed.usage.rounds), (1, 3));
    outputs.push(format!("{designed:?}"));
    for _ in 0..3 {
        let error = designer.design(&brief, &mut gate(&brief)).await.unwrap_err();
        outputs.extend([error.to_string(), format!("{error:?}")]);
    }
    let health = serde_json::to_string(&client.health()).unwrap();
    outputs.extend([format!("{designer:?}"), format!("{client:?}"), health]);
    let logged = String::from_utf8(buffer.0.lock().unwrap().clone()).unwrap();
    assert!(logged.contains("A call of the language model failed.") && logged.len() > 1000, "{logged}");
    outputs.push(logged);
    for output in outputs {
        assert!(!output.contains(KEY), "{output}");
    }
    for request in server.received_requests().await.unwrap() {
        assert_eq!(request.headers["authorization"], format!("Bearer {KEY}"));
        assert!(!String::from_utf8_lossy(&request.body).contains(KEY) && !request.url.as_str().contains(KEY));
    }
}

/// JSON escapes may hide a key until the text is decoded.
#[tokio::test]
async fn escaped_key_is_redacted_too() {
    const KEY: &str = "sk/very-secret/1234567890";
    let mut design = good_designs(1).remove(0);
    design["encounters"][0]["step"] = json!(KEY);
    design["name"] = json!(KEY);
    design[KEY] = json!(1);
    let slashed = |text: &str| text.replace('/', "\\/");
    let coded = |text: &str| text.replace("sk/", "\\u0073k\\/");
    let error = json!({"error": {"message": format!("bad key {KEY}")}}).to_string();
    let other = json!({"errors": [{"about": KEY}]}).to_string();
    let refusal =
        json!({"choices": [{"message": {"refusal": format!("{}{KEY}", "x".repeat(190))}}]}).to_string();
    let unauthorized = |text: String| ResponseTemplate::new(401).set_body_string(text);
    let responses = [
        answer(&slashed(&layouts(std::slice::from_ref(&design)))),
        answer(&coded(&layouts(std::slice::from_ref(&design)))),
        unauthorized(slashed(&error)),
        unauthorized(coded(&error)),
        unauthorized(slashed(&other)),
        unauthorized(coded(&other)),
        unauthorized(format!("{{\"error\": \"{}", slashed(KEY))),
        ResponseTemplate::new(200).set_body_string(coded(&refusal)),
    ];
    for response in responses {
        let server = start_endpoint([response]).await;
        let config = LlmConfig { key: Some(KEY.into()), ..test_config(&server.uri()) };
        let client = LlmClient::new(config).unwrap();
        let output = match super::design(&client, 1).await {
            Ok(designed) => {
                assert_eq!((designed.judged.len(), designed.admitted()), (4, 0));
                format!("{designed:?}")
            }
            Err(error) => format!("{error:?}"),
        };
        let output = format!("{output}{:?}", client.health());
        // A text that was cut must not show a part of the key.
        assert!(!output.contains("secret") && !output.contains("sk/"), "{output}");
        for request in server.received_requests().await.unwrap() {
            assert!(!String::from_utf8_lossy(&request.body).contains(KEY));
        }
    }
}
