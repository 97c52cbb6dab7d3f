//! Completes the OpenAPI document where the macros cannot: bounds of integers, patterns of ids, and descriptions of
//! responses.

use serde_json::{Map, Value, json};
use utoipa::openapi::OpenApi;

/// Pattern of ids in paths and queries, by the name of the parameter. Numbers in ids have 64 bits. Ids of a server with a shard begin
/// with it.
const ID_PATTERNS: [(&str, &str); 7] = [
    ("run", "^([a-z0-9]{1,16}\\.)?[a-z0-9_-]{1,64}$"),
    ("lease", "^[1-9][0-9]{0,17}-[a-z0-9]{6}$"),
    ("episode", "^ep_[1-9][0-9]{0,17}-[a-z0-9]{6}_(0|[1-9][0-9]{0,17})$"),
    ("layout", "^([a-z0-9]{1,16}\\.)?layout-[1-9][0-9]{0,17}$"),
    ("design", "^([a-z0-9]{1,16}\\.)?layout-[1-9][0-9]{0,17}$"),
    ("request", "^ask-[1-9][0-9]{0,17}$"),
    ("evaluation", "^([a-z0-9]{1,16}\\.)?eval-[1-9][0-9]{0,17}$"),
];

/// Description of a response by its status, if the operation has none.
const RESPONSE_DESCRIPTIONS: [(&str, &str); 17] = [
    ("101", "The connection becomes a WebSocket."),
    ("200", "The request succeeded."),
    ("201", "The resource was created."),
    ("202", "The request was accepted and runs in the background."),
    ("400", "The request cannot be parsed; the detail names the problem."),
    ("401", "The request has no valid token."),
    ("403", "The role of the token does not permit the operation."),
    ("404", "The resource does not exist."),
    ("408", "The body was not received in time."),
    ("409", "The request conflicts with the state of the resource."),
    ("410", "The resource is no longer kept."),
    ("413", "The body is too large."),
    ("415", "The body is neither JSON nor MessagePack, or it has an encoding other than gzip."),
    ("422", "A field is invalid; the problem names it."),
    ("426", "The request must be an upgrade to a WebSocket."),
    ("429", "A limit of the server is reached; retry after `Retry-After`."),
    ("503", "The server cannot respond now; retry after `Retry-After`."),
];

/// Format of an unsigned integer in the OpenAPI document.
#[derive(Clone, Copy)]
struct UnsignedFormat {
    /// Name that `utoipa` writes.
    utoipa_name: &'static str,
    /// Name in the OpenAPI format registry.
    name: &'static str,
    maximum: u64,
}

const UNSIGNED_FORMATS: [UnsignedFormat; 4] = [
    UnsignedFormat { utoipa_name: "u-int8", name: "uint8", maximum: u8::MAX as u64 },
    UnsignedFormat { utoipa_name: "u-int16", name: "uint16", maximum: u16::MAX as u64 },
    UnsignedFormat { utoipa_name: "u-int32", name: "uint32", maximum: u32::MAX as u64 },
    UnsignedFormat { utoipa_name: "u-int64", name: "uint64", maximum: u64::MAX },
];

/// Applies all fixups. A document that cannot be converted to JSON and back stays as it is; a test checks that ours can.
pub(super) fn apply_fixups(document: OpenApi) -> OpenApi {
    let Ok(mut value) = serde_json::to_value(&document) else { return document };
    add_integer_bounds(&mut value);
    if let Some(paths) = value.get_mut("paths").and_then(Value::as_object_mut) {
        for_each_operation(paths, |_, _, operation| {
            describe_responses(operation);
            add_id_patterns(operation);
        });
    }
    match serde_json::from_value(value) {
        Ok(fixed) => fixed,
        Err(error) => {
            tracing::error!(%error, "The OpenAPI document is served without fixups.");
            document
        }
    }
}

/// Calls `visit` with the method, path and content of every operation.
fn for_each_operation(
    paths: &mut Map<String, Value>,
    mut visit: impl FnMut(&str, &str, &mut Map<String, Value>),
) {
    for (path, item) in paths {
        let Some(operations) = item.as_object_mut() else { continue };
        for (method, operation) in operations {
            if let Some(operation) =
                operation.as_object_mut().filter(|fields| fields.contains_key("responses"))
            {
                visit(method, path, operation);
            }
        }
    }
}

/// Adds the maximum of unsigned integers, since few readers know the formats.
fn add_integer_bounds(value: &mut Value) {
    match value {
        Value::Array(items) => items.iter_mut().for_each(add_integer_bounds),
        Value::Object(fields) => {
            let format = fields.get("format").and_then(Value::as_str);
            let known = UNSIGNED_FORMATS.into_iter().find(|known| Some(known.utoipa_name) == format);
            if let Some(UnsignedFormat { name, maximum, .. }) = known {
                fields.insert("format".to_owned(), json!(name));
                fields.entry("maximum").or_insert(json!(maximum));
            }
            fields.values_mut().for_each(add_integer_bounds);
        }
        _ => {}
    }
}

/// Adds missing descriptions of responses, and the `Retry-After` header.
fn describe_responses(operation: &mut Map<String, Value>) {
    let Some(responses) = operation.get_mut("responses").and_then(Value::as_object_mut) else { return };
    for (status, response) in responses {
        let Some(response) = response.as_object_mut() else { continue };
        let words = RESPONSE_DESCRIPTIONS
            .iter()
            .find(|(known, _)| known == status)
            .map_or("Response of the server.", |(_, words)| words);
        if response.get("description").and_then(Value::as_str).is_none_or(str::is_empty) {
            response.insert("description".to_owned(), json!(words));
        }
        if matches!(status.as_str(), "429" | "503") {
            let seconds = json!({"description": "Time after which to retry, seconds.", "schema": {"type": "integer", "minimum": 0}});
            response.entry("headers").or_insert(json!({"Retry-After": seconds}));
        }
    }
}

/// Adds the patterns of ids to parameters.
fn add_id_patterns(operation: &mut Map<String, Value>) {
    let Some(parameters) = operation.get_mut("parameters").and_then(Value::as_array_mut) else { return };
    for parameter in parameters.iter_mut() {
        let pattern = ID_PATTERNS.iter().find(|(name, _)| parameter["name"] == *name);
        if let (Some((_, pattern)), Some(schema)) = (pattern, parameter["schema"].as_object_mut()) {
            schema.insert("pattern".to_owned(), json!(pattern));
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use utoipa::openapi::{RefOr, Schema};

    use super::*;

    #[test]
    fn every_operation_has_a_unique_id_and_descriptions() {
        let document = serde_json::to_value(crate::http::openapi()).expect("a document");
        // An empty schema can be serialized but not parsed; the document would then be served without fixups.
        assert_eq!(unparsable_schemas("", &document), Vec::<String>::new());
        let mut ids = Vec::new();
        let mut paths = document["paths"].as_object().expect("paths").clone();
        for_each_operation(&mut paths, |method, path, operation| {
            ids.push(operation["operationId"].to_string());
            for (status, response) in operation["responses"].as_object().expect("responses") {
                assert!(
                    response["description"].as_str().is_some_and(|words| words.len() > 5),
                    "{method} {path} {status}"
                );
            }
        });
        ids.sort();
        let total = ids.len();
        ids.dedup();
        assert_eq!((ids.len(), total > 50), (total, true), "each operation has a unique id");
        assert!(!document.to_string().contains("u-int"));
    }

    fn unparsable_schemas(at: &str, value: &Value) -> Vec<String> {
        let Some(fields) = value.as_object() else { return Vec::new() };
        let check = |(name, inner): (&String, &Value)| {
            let path = format!("{at}/{name}");
            let schema = at.ends_with("/schemas") || at.ends_with("/properties");
            let found = unparsable_schemas(&path, inner);
            let bad = schema && serde_json::from_value::<RefOr<Schema>>(inner.clone()).is_err();
            if bad && found.is_empty() { vec![path] } else { found }
        };
        fields.iter().flat_map(check).collect()
    }

    /// Two types with one name would share a schema: the one that is registered last.
    #[test]
    fn schema_names_are_unique() {
        let crate_folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR"));
        let mut found = BTreeMap::<String, Vec<String>>::new();
        let mut folders = vec![crate_folder.join("src"), crate_folder.join("../api-types/src")];
        while let Some(folder) = folders.pop() {
            for file in
                std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path())
            {
                if file.is_dir() {
                    folders.push(file);
                } else if file.extension().is_some_and(|kind| kind == "rs") {
                    let text = std::fs::read_to_string(&file).expect("a source");
                    let mut of_schema = false;
                    for line in text.lines().map(str::trim) {
                        of_schema |= line.starts_with("#[derive(") && line.contains("ToSchema");
                        let words: Vec<&str> = line.split([' ', '<', '(', '{', ';']).collect();
                        let at = words.iter().position(|word| matches!(*word, "struct" | "enum"));
                        if let (true, Some(at)) = (of_schema, at) {
                            found
                                .entry(words[at + 1].to_owned())
                                .or_default()
                                .push(file.display().to_string());
                            of_schema = false;
                        }
                    }
                }
            }
        }
        assert!(found.len() > 90, "{}", found.len());
        let twice: Vec<_> = found.iter().filter(|(_, files)| files.len() > 1).collect();
        assert!(twice.is_empty(), "{twice:?}");
    }
}
