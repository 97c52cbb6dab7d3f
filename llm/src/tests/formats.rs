//! Learning which request form an endpoint accepts.

use super::*;

const SCHEMA: &str = "json_schema";
const OBJECT: &str = "json_object";

fn bad_request(message: &str) -> ResponseTemplate {
    ResponseTemplate::new(400).set_body_json(json!({"error": {"message": message}}))
}

fn server_error() -> ResponseTemplate {
    ResponseTemplate::new(500)
}

/// Response formats of requests, in order.
fn formats(requests: &[Value]) -> Vec<&str> {
    requests
        .iter()
        .map(|r| r.pointer("/response_format/type").and_then(Value::as_str).unwrap_or("text"))
        .collect()
}

#[tokio::test]
async fn rejected_formats_are_remembered() {
    let server = start_endpoint([
        bad_request("response_format type `json_schema` is unavailable now"),
        bad_request("'response_format.type' must be 'text'"),
        answer("a"),
        answer("b"),
    ])
    .await;
    let client = LlmClient::new(test_config(&server.uri())).unwrap();
    assert_eq!(client.health().response_format, ResponseFormat::JsonSchema);
    assert_eq!(complete(&client, "r").await.unwrap().text, "a");
    assert_eq!(complete(&client, "r").await.unwrap().text, "b");
    assert_eq!((client.health().response_format, client.health().failed), (ResponseFormat::Text, 0));
    let requests = received_bodies(&server).await;
    assert_eq!(formats(&requests), [SCHEMA, OBJECT, "text", "text"]);
    // If the endpoint does not enforce the schema, the prompt states it.
    let prompt = |at: usize| requests[at]["messages"][0]["content"].as_str().unwrap().to_owned();
    assert_eq!(prompt(0), "a question");
    assert!(prompt(1).contains("must match this JSON schema:\n{\"type\":\"object\"}"), "{}", prompt(1));
    assert_eq!(prompt(1), prompt(3));
}

#[tokio::test]
async fn repeated_500s_weaken_the_format() {
    let responses = [server_error(), server_error(), answer("a"), server_error(), answer("b"), answer("c")];
    let server = start_endpoint(responses).await;
    let client = LlmClient::new(test_config(&server.uri())).unwrap();
    let mut modes = Vec::new();
    for _ in 0..3 {
        complete(&client, "r").await.unwrap();
        modes.push(client.health().response_format);
    }
    assert_eq!(modes, [ResponseFormat::JsonSchema, ResponseFormat::JsonObject, ResponseFormat::JsonObject]);
    assert_eq!(formats(&received_bodies(&server).await), [SCHEMA, SCHEMA, OBJECT, SCHEMA, OBJECT, OBJECT]);
}

#[tokio::test]
async fn passing_outage_keeps_the_stronger_format() {
    // The outage ended by chance with the weaker format; the next call succeeds with the stronger one.
    let responses = [server_error(), server_error(), answer("a"), answer("b"), server_error(), answer("c")];
    let server = start_endpoint(responses).await;
    let client = LlmClient::new(test_config(&server.uri())).unwrap();
    for _ in 0..3 {
        complete(&client, "r").await.unwrap();
    }
    assert_eq!(formats(&received_bodies(&server).await), [SCHEMA, SCHEMA, OBJECT, SCHEMA, SCHEMA, SCHEMA]);
    assert_eq!(client.health().response_format, ResponseFormat::JsonSchema);
    // If no format helps, the format was not the cause.
    let responses = [server_error(), server_error(), server_error(), server_error(), answer("a")];
    let server = start_endpoint(responses).await;
    let client = LlmClient::new(test_config(&server.uri())).unwrap();
    complete(&client, "r").await.unwrap();
    assert_eq!(formats(&received_bodies(&server).await), [SCHEMA, SCHEMA, OBJECT, SCHEMA, SCHEMA]);
    assert_eq!(client.health().response_format, ResponseFormat::JsonSchema);
}

#[tokio::test]
async fn failing_endpoint_gets_few_extra_requests() {
    let explained = || ResponseTemplate::new(500).set_body_string("failed to parse grammar");
    let cases = [(server_error(), 0, 1), (server_error(), 2, 4), (server_error(), 6, 8), (explained(), 3, 5)];
    for (response, retries, max) in cases {
        let server = start_endpoint([response]).await;
        let client = LlmClient::new(LlmConfig { retries, ..test_config(&server.uri()) }).unwrap();
        assert_eq!(complete(&client, "r").await.unwrap_err().kind(), "refused");
        let requests = received_bodies(&server).await.len();
        assert!(requests > retries as usize && requests <= max, "{requests} for {retries} retries");
    }
}

#[tokio::test]
async fn unrelated_400_is_not_about_the_format() {
    let server = start_endpoint([bad_request("the context is too long")]).await;
    let client = LlmClient::new(test_config(&server.uri())).unwrap();
    assert_eq!(complete(&client, "r").await.unwrap_err().kind(), "refused");
    assert_eq!(received_bodies(&server).await.len(), 1);
}

#[tokio::test]
async fn max_completion_tokens_is_learned() {
    let message = "Unsupported parameter: 'max_tokens'. Use 'max_completion_tokens' instead.";
    let server = start_endpoint([bad_request(message), answer("a"), answer("b")]).await;
    let client = LlmClient::new(test_config(&server.uri())).unwrap();
    complete(&client, "r").await.unwrap();
    complete(&client, "r").await.unwrap();
    let names = |request: &Value| {
        (request.get("max_tokens").is_some(), request.get("max_completion_tokens").is_some())
    };
    assert_eq!(
        received_bodies(&server).await.iter().map(names).collect::<Vec<_>>(),
        [(true, false), (false, true), (false, true)]
    );
}
