//! JSON Schemas in pydantic's form: every property of a plain type with a title made of its name, nested models under `$defs`.

use serde_json::{Map, Value, json};

/// A property of a scalar type: `number`, `integer`, `string`, `boolean`.
pub(crate) fn scalar(kind: &str) -> Value {
    json!({"type": kind})
}

/// A list of models from `$defs`.
pub(crate) fn list_of(model: &str) -> Value {
    json!({"type": "array", "items": {"$ref": format!("#/$defs/{model}")}})
}

/// The same, told.
pub(crate) fn told(mut schema: Value, description: &str) -> Value {
    schema["description"] = description.into();
    schema
}

/// The same, with what stands where it is left out.
pub(crate) fn or(mut schema: Value, default: Value) -> Value {
    schema["default"] = default;
    schema
}

/// An object with these properties, all of them required but the `optional` ones.
pub(crate) fn model(name: &str, properties: &[(&str, Value)], optional: &[&str]) -> Value {
    let required: Vec<_> =
        properties.iter().map(|(name, _)| *name).filter(|n| !optional.contains(n)).collect();
    json!({"title": name, "type": "object", "properties": titled(properties), "required": required})
}

/// An action or observation: one that takes nothing else, with nested models.
pub(crate) fn message(
    name: &str,
    about: &str,
    properties: &[(&str, Value)],
    required: &[&str],
    models: Vec<Value>,
) -> Value {
    let models: Map<String, Value> = models
        .into_iter()
        .filter_map(|model| model["title"].as_str().map(str::to_owned).map(|title| (title, model)))
        .collect();
    let mut schema = json!({
        "title": name,
        "description": about,
        "type": "object",
        "properties": titled(properties),
        "additionalProperties": false,
        "$defs": models,
    });
    if !required.is_empty() {
        schema["required"] = required.into();
    }
    schema
}

/// What openenv-core gives every action.
pub(crate) fn action_metadata() -> (&'static str, Value) {
    (
        "metadata",
        told(json!({"type": "object", "additionalProperties": true}), "Additional metadata for the action"),
    )
}

/// What openenv-core gives every observation.
pub(crate) fn observation_base() -> [(&'static str, Value); 3] {
    let metadata = json!({"type": "object", "additionalProperties": true});
    [
        ("done", or(scalar("boolean"), json!(false))),
        ("reward", or(scalar("number"), json!(0.0))),
        ("metadata", told(metadata, "Additional metadata for the observation")),
    ]
}

fn titled(properties: &[(&str, Value)]) -> Value {
    let titled = properties.iter().map(|(name, schema)| {
        let mut schema = schema.clone();
        // A nested model keeps its own.
        if schema.get("type").is_some() {
            schema["title"] = title(name).into();
        }
        ((*name).to_owned(), schema)
    });
    Value::Object(titled.collect())
}

/// `delta_vx` is "Delta Vx".
fn title(name: &str) -> String {
    let words = name.split('_').map(|word| {
        let (first, rest) = word.split_at(word.len().min(1));
        first.to_ascii_uppercase() + rest
    });
    words.collect::<Vec<_>>().join(" ")
}
