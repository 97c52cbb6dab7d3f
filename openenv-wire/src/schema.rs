//! Builders of JSON Schemas in pydantic's form: each property of a plain type has a title made from its name, and nested
//! models are under `$defs`.

use serde_json::{Map, Value, json};

/// Schema of a scalar type: `number`, `integer`, `string` or `boolean`.
pub(crate) fn scalar(kind: &str) -> Value {
    json!({"type": kind})
}

/// Schema of a list of models from `$defs`.
pub(crate) fn list_of(model: &str) -> Value {
    json!({"type": "array", "items": {"$ref": format!("#/$defs/{model}")}})
}

/// Adds a description to a schema.
pub(crate) fn described(mut schema: Value, description: &str) -> Value {
    schema["description"] = description.into();
    schema
}

/// Adds a default value to a schema.
pub(crate) fn with_default(mut schema: Value, default: Value) -> Value {
    schema["default"] = default;
    schema
}

/// Schema of a number with the default 0.
pub(crate) fn number(description: &str) -> Value {
    with_default(described(scalar("number"), description), json!(0.0))
}

/// Schema of a text that is empty by default.
pub(crate) fn text(description: &str) -> Value {
    with_default(described(scalar("string"), description), json!(""))
}

/// Schema of a list of texts.
pub(crate) fn texts(description: &str) -> Value {
    described(json!({"type": "array", "items": scalar("string")}), description)
}

/// The goal of the episode, a property of every observation.
pub(crate) fn mission_objective() -> (&'static str, Value) {
    ("mission_objective", text("The goal for the current episode"))
}

/// Schema of an object with these properties; all are required except the `optional` ones.
pub(crate) fn model(name: &str, properties: &[(&str, Value)], optional: &[&str]) -> Value {
    let required: Vec<_> =
        properties.iter().map(|(name, _)| *name).filter(|n| !optional.contains(n)).collect();
    json!({"title": name, "type": "object", "properties": with_titles(properties), "required": required})
}

/// Schema of an action or observation: an object without extra fields, with nested models.
pub(crate) fn message(
    name: &str,
    description: &str,
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
        "description": description,
        "type": "object",
        "properties": with_titles(properties),
        "additionalProperties": false,
        "$defs": models,
    });
    if !required.is_empty() {
        schema["required"] = required.into();
    }
    schema
}

/// The property that openenv-core adds to every action.
pub(crate) fn action_metadata() -> (&'static str, Value) {
    (
        "metadata",
        described(
            json!({"type": "object", "additionalProperties": true}),
            "Additional metadata for the action",
        ),
    )
}

/// The properties that openenv-core adds to every observation.
pub(crate) fn observation_base() -> [(&'static str, Value); 3] {
    let metadata = json!({"type": "object", "additionalProperties": true});
    [
        ("done", with_default(scalar("boolean"), json!(false))),
        ("reward", with_default(scalar("number"), json!(0.0))),
        ("metadata", described(metadata, "Additional metadata for the observation")),
    ]
}

fn with_titles(properties: &[(&str, Value)]) -> Value {
    let titled = properties.iter().map(|(name, schema)| {
        let mut schema = schema.clone();
        // A nested model keeps its own title.
        if schema.get("type").is_some() {
            schema["title"] = title(name).into();
        }
        ((*name).to_owned(), schema)
    });
    Value::Object(titled.collect())
}

/// The title of a property: `delta_vx` becomes "Delta Vx".
fn title(name: &str) -> String {
    let words = name.split('_').map(|word| {
        let (first, rest) = word.split_at(word.len().min(1));
        first.to_ascii_uppercase() + rest
    });
    words.collect::<Vec<_>>().join(" ")
}
