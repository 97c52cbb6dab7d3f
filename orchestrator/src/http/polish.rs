//! What the API's document needs that its parts cannot say each for itself: bounds of whole numbers, forms of ids, names that are told apart,
//! a word for every answer.

use std::collections::BTreeMap;

use serde_json::{Map, Value, json};
use utoipa::openapi::OpenApi;

/// Forms of ids in paths and queries, by the name of the parameter. Numbers in them have 64 bits.
const IDS: [(&str, &str); 7] = [
    ("run", "^[a-z0-9_-]{1,64}$"),
    ("lease", "^[1-9][0-9]{0,17}-[a-z0-9]{6}$"),
    ("episode", "^ep_[1-9][0-9]{0,17}-[a-z0-9]{6}_(0|[1-9][0-9]{0,17})$"),
    ("layout", "^layout-[1-9][0-9]{0,17}$"),
    ("design", "^layout-[1-9][0-9]{0,17}$"),
    ("ask", "^ask-[1-9][0-9]{0,17}$"),
    ("evaluation", "^eval-[1-9][0-9]{0,17}$"),
];

/// What answers are, where an operation has no words of its own for one.
const ANSWERS: [(&str, &str); 17] = [
    ("101", "The WebSocket is open."),
    ("200", "What was asked for."),
    ("201", "It is made."),
    ("202", "It will be done."),
    ("400", "It cannot be read: the detail says what."),
    ("401", "No token, or one that is worth nothing."),
    ("403", "The token's role may not do this."),
    ("404", "There is no such thing."),
    ("408", "The body did not come in time."),
    ("409", "It contradicts what is there."),
    ("410", "It is kept no longer."),
    ("413", "The body is too large."),
    ("415", "The body is neither JSON nor MessagePack."),
    ("422", "A field cannot be: it is named."),
    ("426", "It must be asked for as a WebSocket."),
    ("429", "Too many or too often: come again after Retry-After."),
    ("503", "Not now: come again after Retry-After."),
];

/// Formats of whole numbers without a sign, as they are called and as they should be, with the largest.
const WHOLE: [(&str, &str, u64); 4] = [
    ("u-int8", "uint8", u8::MAX as u64),
    ("u-int16", "uint16", u16::MAX as u64),
    ("u-int32", "uint32", u32::MAX as u64),
    ("u-int64", "uint64", u64::MAX),
];

/// Says what is missing. A document that cannot be taken apart, which none is, stays as it was.
pub(super) fn polished(document: OpenApi) -> OpenApi {
    let Ok(mut value) = serde_json::to_value(&document) else { return document };
    bound(&mut value);
    if let Some(paths) = value.get_mut("paths").and_then(Value::as_object_mut) {
        each(paths, |_, _, operation| {
            answers(operation);
            ids(operation);
        });
        names(paths);
    }
    match serde_json::from_value(value) {
        Ok(polished) => polished,
        Err(error) => {
            tracing::error!(%error, "the API's document is served as it was");
            document
        }
    }
}

/// Every operation, with its method and path.
fn each(paths: &mut Map<String, Value>, mut see: impl FnMut(&str, &str, &mut Map<String, Value>)) {
    for (path, item) in paths {
        let Some(operations) = item.as_object_mut() else { continue };
        for (method, operation) in operations {
            if let Some(operation) = operation.as_object_mut().filter(|of| of.contains_key("responses")) {
                see(method, path, operation);
            }
        }
    }
}

/// Bounds of whole numbers: a format alone says little to most readers.
fn bound(value: &mut Value) {
    match value {
        Value::Array(items) => items.iter_mut().for_each(bound),
        Value::Object(fields) => {
            let format = fields.get("format").and_then(Value::as_str);
            if let Some((_, name, most)) = WHOLE.into_iter().find(|(known, ..)| Some(*known) == format) {
                fields.insert("format".to_owned(), json!(name));
                fields.entry("maximum").or_insert(json!(most));
            }
            fields.values_mut().for_each(bound);
        }
        _ => {}
    }
}

fn answers(operation: &mut Map<String, Value>) {
    let Some(answers) = operation.get_mut("responses").and_then(Value::as_object_mut) else { return };
    for (status, answer) in answers {
        let Some(answer) = answer.as_object_mut() else { continue };
        let words =
            ANSWERS.iter().find(|(known, _)| known == status).map_or("An answer.", |(_, words)| words);
        if answer.get("description").and_then(Value::as_str).is_none_or(str::is_empty) {
            answer.insert("description".to_owned(), json!(words));
        }
        if matches!(status.as_str(), "429" | "503") {
            let seconds = json!({"description": "Seconds after which to come again.", "schema": {"type": "integer", "minimum": 0}});
            answer.entry("headers").or_insert(json!({"Retry-After": seconds}));
        }
    }
}

fn ids(operation: &mut Map<String, Value>) {
    let Some(parameters) = operation.get_mut("parameters").and_then(Value::as_array_mut) else { return };
    for parameter in parameters.iter_mut() {
        let form = IDS.iter().find(|(name, _)| parameter["name"] == *name);
        if let (Some((_, form)), Some(schema)) = (form, parameter["schema"].as_object_mut()) {
            schema.insert("pattern".to_owned(), json!(form));
        }
    }
}

/// Operations of one name get what they are about behind it: generators of clients make functions of them.
fn names(paths: &mut Map<String, Value>) {
    let name = |operation: &Map<String, Value>| {
        operation.get("operationId").and_then(Value::as_str).map(str::to_owned)
    };
    let mut count = BTreeMap::<String, usize>::new();
    each(paths, |_, _, operation| {
        if let Some(name) = name(operation) {
            *count.entry(name).or_default() += 1;
        }
    });
    each(paths, |_, path, operation| {
        let Some(name) = name(operation).filter(|name| count.get(name).is_some_and(|count| *count > 1))
        else {
            return;
        };
        // `show` of …/leases/{lease} is of a lease, `list` of …/leases of leases.
        let about = path.rsplit('/').next().unwrap_or_default().trim_matches(['{', '}']);
        operation.insert("operationId".to_owned(), json!(format!("{name}_{about}")));
    });
}

#[cfg(test)]
mod tests {
    use utoipa::openapi::{RefOr, Schema};

    use super::*;

    #[test]
    fn the_document_is_whole() {
        let document = serde_json::to_value(crate::http::openapi()).expect("a document");
        // A schema that says nothing is written and cannot be read: the document would be served unpolished.
        assert_eq!(unreadable("", &document), Vec::<String>::new());
        let mut names = Vec::new();
        let mut paths = document["paths"].as_object().expect("paths").clone();
        each(&mut paths, |method, path, operation| {
            names.push(operation["operationId"].to_string());
            for (status, answer) in operation["responses"].as_object().expect("answers") {
                assert!(
                    answer["description"].as_str().is_some_and(|words| words.len() > 5),
                    "{method} {path} {status}"
                );
            }
        });
        names.sort();
        let all = names.len();
        names.dedup();
        assert_eq!((names.len(), all > 50), (all, true), "each operation has a name of its own");
        assert!(!document.to_string().contains("u-int"));
    }

    fn unreadable(at: &str, value: &Value) -> Vec<String> {
        let Some(fields) = value.as_object() else { return Vec::new() };
        let of = |(name, inner): (&String, &Value)| {
            let path = format!("{at}/{name}");
            let schema = at.ends_with("/schemas") || at.ends_with("/properties");
            let found = unreadable(&path, inner);
            let bad = schema && serde_json::from_value::<RefOr<Schema>>(inner.clone()).is_err();
            if bad && found.is_empty() { vec![path] } else { found }
        };
        fields.iter().flat_map(of).collect()
    }

    /// Two types of one name would be one schema: whoever is written last.
    #[test]
    fn schemas_have_names_of_their_own() {
        let source = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
        let mut found = BTreeMap::<String, Vec<String>>::new();
        let mut folders = vec![source];
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
