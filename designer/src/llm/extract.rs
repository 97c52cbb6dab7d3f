//! Designs out of whatever a model said.

use serde_json::Value;

use super::values::{MAX_TEXT, meant, values};

/// What was found.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Found {
    /// The designs, at most as many as asked for.
    pub(super) designs: Vec<Value>,
    /// Designs that were left out, beyond those.
    pub(super) more: usize,
    /// The answer as a whole was JSON: what stands in `designs` is all of it.
    pub(super) whole: bool,
}

/// The designs of an answer.
///
/// # Errors
/// Why there are none, in a sentence the model can act on.
pub(super) fn designs(text: &str, most: usize) -> Result<Found, String> {
    if text.len() > MAX_TEXT {
        return Err(format!("it is {} bytes long; at most {MAX_TEXT} are read", text.len()));
    }
    let text = text.trim();
    if text.is_empty() {
        return Err("it is empty".to_owned());
    }
    let whole = |value: Value| {
        if !value.is_object() && !holds_objects(&value) {
            return Err("it is JSON, but neither an object nor a list of objects".to_owned());
        }
        match listed(value) {
            none if none.is_empty() => Err("it is a list without layouts".to_owned()),
            designs => Ok(capped(designs, most, true)),
        }
    };
    let error = match serde_json::from_str(text) {
        Ok(value) => return whole(value),
        Err(error) => error,
    };
    let meant = meant(text);
    if let Ok(value) = serde_json::from_str(meant) {
        return whole(value);
    }
    match scan(meant) {
        found if found.is_empty() => Err(format!("it is no JSON ({error})")),
        found => Ok(capped(found, most, false)),
    }
}

fn capped(mut designs: Vec<Value>, most: usize, whole: bool) -> Found {
    let more = designs.len().saturating_sub(most);
    designs.truncate(most);
    Found { designs, more, whole }
}

fn holds_objects(value: &Value) -> bool {
    value.as_array().is_some_and(|items| items.iter().any(Value::is_object))
}

fn is_design(value: &Value) -> bool {
    value.get("encounters").is_some() || value.get("aim").is_some()
}

/// The designs of a value: those of its list, those of a list, or itself.
fn listed(value: Value) -> Vec<Value> {
    match value {
        Value::Object(mut fields) if fields.get("layouts").is_some_and(Value::is_array) => {
            match fields.remove("layouts") {
                Some(Value::Array(items)) => items,
                _ => Vec::new(),
            }
        }
        Value::Array(items) => items,
        other => vec![other],
    }
}

/// Designs within text that is not JSON as a whole. Of a list that is not finished, the designs that are; where nothing
/// looks like a design, the first object there is, so that what is wrong with it can be said.
fn scan(text: &str) -> Vec<Value> {
    let mut found = Vec::new();
    let mut other = None;
    for value in values(text) {
        let is_list = value.get("layouts").is_some_and(Value::is_array) || holds_objects(&value);
        if is_list || is_design(&value) {
            found.extend(listed(value));
            // A whole list is the answer; what follows is talk.
            if is_list {
                break;
            }
        } else if value.is_object() {
            other.get_or_insert(value);
        }
    }
    if found.is_empty() { other.into_iter().collect() } else { found }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn names(text: &str) -> Vec<String> {
        let found = designs(text, 3).unwrap();
        found.designs.iter().map(|d| d["name"].as_str().unwrap_or("?").to_owned()).collect()
    }

    #[test]
    fn designs_are_found_wherever_they_are() {
        let a = r#"{"name":"a","aim":{},"encounters":[{"step":3}]}"#;
        let b = r#"{"name":"b","aim":{},"encounters":[]}"#;
        for text in [
            format!(r#"{{"layouts":[{a},{b}]}}"#),
            format!("[{a},{b}]"),
            format!(
                "Here you are, within [0, 90] and {{so}}:\n```json\n{{\"layouts\": [{a},{b}]}}\n```\nEnjoy {{it}}!"
            ),
            format!("First:\n{a}\nand then\n{b}"),
            format!(r#"{{"layouts":[{a},{b},{{"name":"c","aim":{{"mode":"colli"#),
            format!(r#"<think>{{"layouts":[{b}]}} no…</think> {{"layouts":[{a},{b}]}}"#),
            format!(r#"{{"layouts":[{a},{b},{{"name":"n","aim":{{}},"encounters":[{{"step":NaN}}]}}]}}"#),
        ] {
            assert_eq!(names(&text), ["a", "b"], "{text}");
        }
        assert_eq!(names(a), ["a"]);
        assert_eq!(designs(r#"{"answer": 42}"#, 3).unwrap().designs, [json!({"answer": 42})]);
        let many = designs(&format!("[{}]", vec![a; 1000].join(",")), 3).unwrap();
        assert_eq!((many.designs.len(), many.more), (3, 997));
    }

    #[test]
    fn what_holds_none_says_why() {
        let of = |text: &str| designs(text, 3).unwrap_err();
        let deep = "[".repeat(100_000);
        for hostile in [&deep, &"{\"a\":".repeat(40_000), &"{\"a\":[1,".repeat(30_000)] {
            assert!(of(hostile).starts_with("it is no JSON"));
        }
        insta::assert_snapshot!([of(""), of("42"), of("[1, 2]"), of("no"), of("{\"layouts\": [NaN"), of(&"x".repeat(MAX_TEXT + 1))].join("\n"), @r"
        it is empty
        it is JSON, but neither an object nor a list of objects
        it is JSON, but neither an object nor a list of objects
        it is no JSON (expected ident at line 1 column 2)
        it is no JSON (expected value at line 1 column 14)
        it is 262145 bytes long; at most 262144 are read
        ");
    }
}
