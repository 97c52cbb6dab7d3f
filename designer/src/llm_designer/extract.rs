//! Extracts designs from the text of an answer.

use llm::{MAX_ANSWER_BYTES, json_values, strip_reasoning};
use serde_json::Value;

use crate::design_language::DesignLanguage;

/// Designs of an answer.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ExtractedDesigns {
    /// Designs, up to the requested maximum.
    pub designs: Vec<Value>,
    /// Number of designs beyond the maximum.
    pub dropped: usize,
    /// True if the answer as a whole is JSON; false if designs were found within other text.
    pub is_pure_json: bool,
}

impl ExtractedDesigns {
    fn new(mut designs: Vec<Value>, max_designs: usize, is_pure_json: bool) -> Self {
        let dropped = designs.len().saturating_sub(max_designs);
        designs.truncate(max_designs);
        Self { designs, dropped, is_pure_json }
    }
}

/// Extracts up to `max_designs` designs of a language.
///
/// # Errors
/// Returns why the answer has no designs, as a sentence that the model can act on.
pub fn extract_designs(
    text: &str,
    language: &dyn DesignLanguage,
    max_designs: usize,
) -> Result<ExtractedDesigns, String> {
    if text.len() > MAX_ANSWER_BYTES {
        return Err(format!("it has {} bytes, more than {MAX_ANSWER_BYTES}", text.len()));
    }
    let text = text.trim();
    if text.is_empty() {
        return Err("it is empty".to_owned());
    }
    let error = match serde_json::from_str(text) {
        Ok(value) => return designs_of_answer(value, max_designs),
        Err(error) => error,
    };
    let answer = strip_reasoning(text);
    if let Ok(value) = serde_json::from_str(answer) {
        return designs_of_answer(value, max_designs);
    }
    match scan(answer, language) {
        found if found.is_empty() => Err(format!("it is not JSON ({error})")),
        found => Ok(ExtractedDesigns::new(found, max_designs, false)),
    }
}

/// Returns the designs of an answer that is JSON as a whole.
fn designs_of_answer(value: Value, max_designs: usize) -> Result<ExtractedDesigns, String> {
    if !value.is_object() && !has_objects(&value) {
        return Err("it is JSON, but neither an object nor a list of objects".to_owned());
    }
    match into_list(value) {
        none if none.is_empty() => Err("it is a list without layouts".to_owned()),
        designs => Ok(ExtractedDesigns::new(designs, max_designs, true)),
    }
}

fn has_objects(value: &Value) -> bool {
    value.as_array().is_some_and(|items| items.iter().any(Value::is_object))
}

/// Returns the entries of the field `layouts`, or of an array, or the value itself.
fn into_list(value: Value) -> Vec<Value> {
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

/// Finds designs within other text. Of an incomplete list, the complete designs are returned. If nothing looks like a design,
/// the first object is returned, so that the gate can name its invalid field.
fn scan(text: &str, language: &dyn DesignLanguage) -> Vec<Value> {
    let mut found = Vec::new();
    let mut first_object = None;
    for value in json_values(text) {
        let is_list = value.get("layouts").is_some_and(Value::is_array) || has_objects(&value);
        if is_list || value.get("aim").is_some() || language.is_design(&value) {
            found.extend(into_list(value));
            // A complete list is the answer; the rest is comment.
            if is_list {
                break;
            }
        } else if value.is_object() {
            first_object.get_or_insert(value);
        }
    }
    if found.is_empty() { first_object.into_iter().collect() } else { found }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn extract(text: &str) -> Result<ExtractedDesigns, String> {
        extract_designs(text, &crate::kessler::KesslerLanguage, 3)
    }

    fn names(text: &str) -> Vec<String> {
        let found = extract(text).unwrap();
        found.designs.iter().map(|d| d["name"].as_str().unwrap_or("?").to_owned()).collect()
    }

    #[test]
    fn designs_are_found_in_any_surrounding() {
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
        assert_eq!(extract(r#"{"answer": 42}"#).unwrap().designs, [json!({"answer": 42})]);
        let many = extract(&format!("[{}]", vec![a; 1000].join(","))).unwrap();
        assert_eq!((many.designs.len(), many.dropped), (3, 997));
    }

    #[test]
    fn answer_without_designs_has_a_reason() {
        let reason = |text: &str| extract(text).unwrap_err();
        let deep = "[".repeat(100_000);
        for hostile in [&deep, &"{\"a\":".repeat(40_000), &"{\"a\":[1,".repeat(30_000)] {
            assert!(reason(hostile).starts_with("it is not JSON"));
        }
        let long = "x".repeat(MAX_ANSWER_BYTES + 1);
        let texts = ["", "42", "[1, 2]", "no", "{\"layouts\": [NaN", &long];
        insta::assert_snapshot!(texts.map(reason).join("\n"), @r"
        it is empty
        it is JSON, but neither an object nor a list of objects
        it is JSON, but neither an object nor a list of objects
        it is not JSON (expected ident at line 1 column 2)
        it is not JSON (expected value at line 1 column 14)
        it has 262145 bytes, more than 262144
        ");
    }
}
