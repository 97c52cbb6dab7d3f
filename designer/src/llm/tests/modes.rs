//! How an endpoint is held to a schema is learned once.

use super::*;

fn refuses(words: &str) -> ResponseTemplate {
    ResponseTemplate::new(400).set_body_json(json!({"error": {"message": words}}))
}

fn formats(requests: &[Value]) -> Vec<&str> {
    requests
        .iter()
        .map(|r| r.pointer("/response_format/type").and_then(Value::as_str).unwrap_or("text"))
        .collect()
}

#[tokio::test]
async fn what_an_endpoint_takes_is_learned_from_its_refusals_and_remembered() {
    let server = endpoint([
        refuses("response_format type `json_schema` is unavailable now"),
        refuses("'response_format.type' must be 'text'"),
        says("a"),
        says("b"),
    ])
    .await;
    let llm = Llm::new(config(&server.uri())).unwrap();
    assert_eq!(llm.health().mode, "json_schema");
    assert_eq!(asks(&llm, "r").await.unwrap().text, "a");
    assert_eq!(asks(&llm, "r").await.unwrap().text, "b");
    assert_eq!((llm.health().mode, llm.health().failed), ("text", 0));
    let requests = sent(&server).await;
    assert_eq!(formats(&requests), ["json_schema", "json_object", "text", "text"]);
    // Where the endpoint does not hold the model to the schema, the prompt does.
    let said = |at: usize| requests[at]["messages"][0]["content"].as_str().unwrap().to_owned();
    assert_eq!(said(0), "a question");
    assert!(said(1).contains("keeps to this JSON schema:\n{\"type\":\"object\"}"), "{}", said(1));
    assert_eq!(said(1), said(3));
}

fn down() -> ResponseTemplate {
    ResponseTemplate::new(500)
}

#[tokio::test]
async fn a_500_that_comes_back_with_the_next_call_is_about_the_schema() {
    let answers = [down(), down(), says("a"), down(), says("b"), says("c")];
    let server = endpoint(answers).await;
    let llm = Llm::new(config(&server.uri())).unwrap();
    let mut modes = Vec::new();
    for _ in 0..3 {
        asks(&llm, "r").await.unwrap();
        modes.push(llm.health().mode);
    }
    assert_eq!(modes, ["json_schema", "json_object", "json_object"]);
    let (schema, object) = ("json_schema", "json_object");
    assert_eq!(formats(&sent(&server).await), [schema, schema, object, schema, object, object]);
}

#[tokio::test]
async fn an_outage_that_passes_leaves_the_better_form() {
    let (schema, object) = ("json_schema", "json_object");
    // The lower form came when the outage was over; so did the better one with the next call.
    let server = endpoint([down(), down(), says("a"), says("b"), down(), says("c")]).await;
    let llm = Llm::new(config(&server.uri())).unwrap();
    for _ in 0..3 {
        asks(&llm, "r").await.unwrap();
    }
    assert_eq!(formats(&sent(&server).await), [schema, schema, object, schema, schema, schema]);
    assert_eq!(llm.health().mode, schema);
    // Where no form helps it was not the form.
    let server = endpoint([down(), down(), down(), down(), says("a")]).await;
    let llm = Llm::new(config(&server.uri())).unwrap();
    asks(&llm, "r").await.unwrap();
    assert_eq!(formats(&sent(&server).await), [schema, schema, object, schema, schema]);
    assert_eq!(llm.health().mode, schema);
}

#[tokio::test]
async fn who_is_down_is_not_asked_more_for_it() {
    let spoken = || ResponseTemplate::new(500).set_body_string("failed to parse grammar");
    for (answer, retries, most) in [(down(), 0, 1), (down(), 2, 4), (down(), 6, 8), (spoken(), 3, 5)] {
        let server = endpoint([answer]).await;
        let llm = Llm::new(LlmConfig { retries, ..config(&server.uri()) }).unwrap();
        assert_eq!(asks(&llm, "r").await.unwrap_err().word(), "refused");
        let requests = sent(&server).await.len();
        assert!(requests > retries as usize && requests <= most, "{requests} for {retries} retries");
    }
}

#[tokio::test]
async fn other_refusals_are_not_about_the_form() {
    let server = endpoint([refuses("the context is too long")]).await;
    let llm = Llm::new(config(&server.uri())).unwrap();
    assert_eq!(asks(&llm, "r").await.unwrap_err().word(), "refused");
    assert_eq!(sent(&server).await.len(), 1);
}

#[tokio::test]
async fn the_other_name_of_max_tokens_is_learned() {
    let words = "Unsupported parameter: 'max_tokens'. Use 'max_completion_tokens' instead.";
    let server = endpoint([refuses(words), says("a"), says("b")]).await;
    let llm = Llm::new(config(&server.uri())).unwrap();
    asks(&llm, "r").await.unwrap();
    asks(&llm, "r").await.unwrap();
    let named = |request: &Value| {
        (request.get("max_tokens").is_some(), request.get("max_completion_tokens").is_some())
    };
    assert_eq!(
        sent(&server).await.iter().map(named).collect::<Vec<_>>(),
        [(true, false), (false, true), (false, true)]
    );
}

/// A grammar makes a model say fields in the order of the schema's properties: the aim comes first.
#[tokio::test]
async fn the_schema_is_sent_in_the_order_it_is_meant() {
    let server = endpoint([says(&list(&good(1)))]).await;
    design(&Llm::new(config(&server.uri())).unwrap(), 1).await.unwrap();
    let requests = server.received_requests().await.unwrap();
    let text = String::from_utf8(requests[0].body.clone()).unwrap();
    let schema = text.split_once("\"schema\":").unwrap().1;
    let at =
        |name: &str| schema.find(&format!("\"{name}\":{{")).unwrap_or_else(|| panic!("{name}: {schema}"));
    let order = [
        "layouts",
        "aim",
        "mode",
        "frame",
        "params",
        "encounters",
        "kind",
        "satellite",
        "step",
        "miss_distance",
        "name",
    ];
    let places = order.map(at);
    assert!(places.is_sorted(), "{places:?} {schema}");
    let sent: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(sent.pointer("/response_format/json_schema/strict"), Some(&json!(true)));
    strict(sent.pointer("/response_format/json_schema/schema").unwrap());
}

/// As strict endpoints want it: every object closed, every property required.
fn strict(schema: &Value) {
    if let Some(properties) = schema.get("properties").and_then(Value::as_object) {
        assert_eq!(schema["additionalProperties"], json!(false));
        assert_eq!(schema["required"].as_array().unwrap().len(), properties.len());
    }
    match schema {
        Value::Object(fields) => fields.values().for_each(strict),
        Value::Array(items) => items.iter().for_each(strict),
        _ => {}
    }
}
