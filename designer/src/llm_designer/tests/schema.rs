//! JSON schema that a model receives.

use super::*;

/// Grammars make a model write fields in the order of the schema's properties, so the aim must come first.
#[tokio::test]
async fn schema_lists_properties_in_their_intended_order() {
    let server = start_endpoint([answer(&layouts(&good_designs(1)))]).await;
    design(&LlmClient::new(test_config(&server.uri())).unwrap(), 1).await.unwrap();
    let requests = server.received_requests().await.unwrap();
    let text = String::from_utf8(requests[0].body.clone()).unwrap();
    let schema = text.split_once("\"schema\":").unwrap().1;
    let position =
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
    let positions = order.map(position);
    assert!(positions.is_sorted(), "{positions:?} {schema}");
    let sent: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(sent.pointer("/response_format/json_schema/strict"), Some(&json!(true)));
    assert_strict(sent.pointer("/response_format/json_schema/schema").unwrap());
}

/// Asserts what strict endpoints need: every object is closed and requires all its properties.
fn assert_strict(schema: &Value) {
    if let Some(properties) = schema.get("properties").and_then(Value::as_object) {
        assert_eq!(schema["additionalProperties"], json!(false));
        assert_eq!(schema["required"].as_array().unwrap().len(), properties.len());
    }
    match schema {
        Value::Object(fields) => fields.values().for_each(assert_strict),
        Value::Array(items) => items.iter().for_each(assert_strict),
        _ => {}
    }
}
