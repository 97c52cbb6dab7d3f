//! The key is sent to the endpoint and is nowhere else.

use super::*;
use std::io::Write;

const KEY: &str = "sk-very-secret-1234567890";

#[derive(Clone, Default)]
struct Heard(Arc<Mutex<Vec<u8>>>);

impl Write for Heard {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.lock().unwrap().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[tokio::test]
async fn the_key_is_nowhere() {
    let heard = Heard::default();
    let writer = heard.clone();
    let logs =
        tracing_subscriber::fmt().with_max_level(tracing::Level::TRACE).with_writer(move || writer.clone());
    // Everything runs on this thread, so that all that is logged is heard.
    let _guard = tracing::subscriber::set_default(logs.finish());
    // An endpoint that repeats the key wherever it can.
    let mut named = good(1).remove(0);
    named["name"] = json!(KEY);
    let mut wrong = named.clone();
    wrong["encounters"][0]["step"] = json!(KEY);
    let server = endpoint([
        ResponseTemplate::new(503).set_body_string(format!("busy, {KEY}")),
        says(KEY),
        says(&list(&[wrong])),
        says(&list(&[named])),
        ResponseTemplate::new(401).set_body_json(json!({"error": {"message": format!("bad key {KEY}")}})),
        ResponseTemplate::new(200).set_body_json(json!({"error": {"message": KEY, "code": 400}})),
        ResponseTemplate::new(200).set_body_json(json!({"choices": [{"message": {"refusal": KEY}}]})),
    ])
    .await;
    let config = LlmConfig { key: Some(KEY.into()), ..config(&server.uri()) };
    let mut seen = vec![format!("{config:?}"), format!("{config:#?}")];
    let llm = Llm::new(config).unwrap();
    let brief = brief(1);
    let mut designer = llm.designer("r");
    let designed = designer.design(&brief, &mut gate(&brief)).await.unwrap();
    assert_eq!((designed.admitted(), designed.usage.rounds), (1, 3));
    seen.push(format!("{designed:?}"));
    for _ in 0..3 {
        let error = designer.design(&brief, &mut gate(&brief)).await.unwrap_err();
        seen.extend([error.to_string(), format!("{error:?}")]);
    }
    seen.extend([format!("{designer:?}"), format!("{llm:?}"), serde_json::to_string(&llm.health()).unwrap()]);
    let logged = String::from_utf8(heard.0.lock().unwrap().clone()).unwrap();
    assert!(logged.contains("a call of the language model failed") && logged.len() > 1000, "{logged}");
    seen.push(logged);
    for text in seen {
        assert!(!text.contains(KEY), "{text}");
    }
    // It was sent, in its header and nowhere else.
    for request in server.received_requests().await.unwrap() {
        assert_eq!(request.headers["authorization"], format!("Bearer {KEY}"));
        assert!(!String::from_utf8_lossy(&request.body).contains(KEY) && !request.url.as_str().contains(KEY));
    }
}

/// JSON may write a key so that it is none until it is read.
#[tokio::test]
async fn a_key_that_comes_with_escapes_is_found_too() {
    const KEY: &str = "sk/very-secret/1234567890";
    let mut design = good(1).remove(0);
    design["encounters"][0]["step"] = json!(KEY);
    design["name"] = json!(KEY);
    design[KEY] = json!(1);
    let slashed = |text: &str| text.replace('/', "\\/");
    let coded = |text: &str| text.replace("sk/", "\\u0073k\\/");
    let error = json!({"error": {"message": format!("bad key {KEY}")}}).to_string();
    let other = json!({"errors": [{"about": KEY}]}).to_string();
    let refusal =
        json!({"choices": [{"message": {"refusal": format!("{}{KEY}", "x".repeat(190))}}]}).to_string();
    let body = |text: String| ResponseTemplate::new(401).set_body_string(text);
    let answers = [
        says(&slashed(&list(std::slice::from_ref(&design)))),
        says(&coded(&list(std::slice::from_ref(&design)))),
        body(slashed(&error)),
        body(coded(&error)),
        body(slashed(&other)),
        body(coded(&other)),
        body(format!("{{\"error\": \"{}", slashed(KEY))),
        ResponseTemplate::new(200).set_body_string(coded(&refusal)),
    ];
    for answer in answers {
        let server = endpoint([answer]).await;
        let config = LlmConfig { key: Some(KEY.into()), ..config(&server.uri()) };
        let llm = Llm::new(config).unwrap();
        let told = match super::design(&llm, 1).await {
            Ok(designed) => {
                assert_eq!((designed.judged.len(), designed.admitted()), (4, 0));
                format!("{designed:?}")
            }
            Err(error) => format!("{error:?}"),
        };
        let told = format!("{told}{:?}", llm.health());
        // Nor a part of it, where what was said is cut.
        assert!(!told.contains("secret") && !told.contains("sk/"), "{told}");
        for request in server.received_requests().await.unwrap() {
            assert!(!String::from_utf8_lossy(&request.body).contains(KEY));
        }
    }
}
