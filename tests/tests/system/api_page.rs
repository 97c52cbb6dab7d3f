//! `docs/reference/api.md` lists the operations of the OpenAPI document.

use std::fmt::Write as _;

use serde_json::Value;

const START: &str = "<!-- operations -->\n";
const END: &str = "<!-- end operations -->";

/// Compares the page with the OpenAPI document. `SPARRING_DOCS=write` updates the page.
#[test]
fn reference_has_every_operation_of_the_api() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/reference/api.md");
    let page = std::fs::read_to_string(path).unwrap();
    let (before, rest) = page.split_once(START).unwrap();
    let (found, after) = rest.split_once(END).unwrap();
    let wanted = operations(&serde_json::to_value(orchestrator::http::openapi()).unwrap());
    if std::env::var("SPARRING_DOCS").is_ok_and(|mode| mode == "write") {
        std::fs::write(path, format!("{before}{START}{wanted}{END}{after}")).unwrap();
    } else {
        assert!(found == wanted, "docs/reference/api.md: run this test with SPARRING_DOCS=write");
    }
}

/// Formats the operations of `/v1` and of health, with a heading for each tag.
fn operations(document: &Value) -> String {
    let mut page = String::new();
    for tag in document["tags"].as_array().unwrap() {
        if tag["name"] == "openenv" {
            continue;
        }
        let name = tag["name"].as_str().unwrap();
        write!(page, "\n## {}{}\n\n", name[..1].to_uppercase(), &name[1..]).unwrap();
        page.push_str(&wrap(tag["description"].as_str().unwrap(), ""));
        for (path, methods) in document["paths"].as_object().unwrap() {
            for (method, operation) in methods.as_object().unwrap() {
                if operation["tags"][0] == tag["name"] {
                    page.push_str(&operation_section(path, method, operation));
                }
            }
        }
    }
    page.push('\n');
    page
}

fn operation_section(path: &str, method: &str, operation: &Value) -> String {
    let mut section = format!("\n### `{} {path}`\n\n", method.to_uppercase());
    for key in ["summary", "description"] {
        if let Some(text) = operation[key].as_str() {
            for paragraph in text.split("\n\n") {
                let text = paragraph.split_whitespace().collect::<Vec<_>>().join(" ");
                section.push_str(&wrap(&text, ""));
                section.push('\n');
            }
        }
    }
    let scopes = operation["security"][0]["token"].as_array();
    let scopes: Vec<&str> = scopes.into_iter().flatten().filter_map(Value::as_str).collect();
    let role = if scopes.is_empty() { "none".to_owned() } else { scopes.join(", ") };
    section.push_str(&wrap(&format!("- Operation `{}`, role: {role}", id(operation)), "  "));
    let query: Vec<String> = operation["parameters"]
        .as_array()
        .into_iter()
        .flatten()
        .filter(|parameter| parameter["in"] == "query")
        .map(|parameter| format!("`{}`", parameter["name"].as_str().unwrap()))
        .collect();
    if !query.is_empty() {
        section.push_str(&wrap(&format!("- Query: {}", query.join(", ")), "  "));
    }
    if let Some(schema) = schema(&operation["requestBody"]) {
        section.push_str(&format!("- Request: `{schema}`\n"));
    }
    for (status, response) in operation["responses"].as_object().unwrap() {
        if status.starts_with('2') {
            let body = schema(response).map_or_else(|| "no JSON body".to_owned(), |name| format!("`{name}`"));
            section.push_str(&format!("- Response: {status}, {body}\n"));
        }
    }
    section
}

fn id(operation: &Value) -> &str {
    operation["operationId"].as_str().unwrap()
}

/// Returns the name of the JSON schema of a body.
fn schema(body: &Value) -> Option<&str> {
    let schema = &body["content"]["application/json"]["schema"];
    let name = schema["$ref"].as_str().or_else(|| schema["items"]["$ref"].as_str())?;
    name.rsplit('/').next()
}

/// Wraps a paragraph at the width of documentation.
fn wrap(text: &str, indent: &str) -> String {
    let options = textwrap::Options::new(100)
        .subsequent_indent(indent)
        .word_separator(textwrap::WordSeparator::AsciiSpace)
        .word_splitter(textwrap::WordSplitter::NoHyphenation)
        .break_words(false);
    textwrap::fill(text, options) + "\n"
}
