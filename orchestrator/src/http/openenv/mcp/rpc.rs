//! JSON-RPC 2.0, with openenv-core's error codes and words.

use serde_json::{Map, Value, json};

use crate::sessions::QuotaExceeded;

/// A request.
pub(super) struct Request {
    pub(super) id: Value,
    pub(super) method: String,
    pub(super) params: Map<String, Value>,
}

/// Why a request failed.
#[derive(Debug)]
pub(super) struct Failure {
    code: i64,
    message: String,
    data: Value,
}

impl Request {
    pub(super) fn read(value: &Value) -> Result<Self, Failure> {
        let Some(fields) = value.as_object() else { return Err(Failure::unread(None)) };
        let mut faults = Vec::new();
        match fields.get("jsonrpc") {
            Some(Value::String(version)) if version == "2.0" => {}
            Some(_) => faults.push("jsonrpc: it must be \"2.0\""),
            None => faults.push("jsonrpc: it is missing"),
        }
        match fields.get("method") {
            Some(Value::String(_)) => {}
            Some(_) => faults.push("method: it must be a string"),
            None => faults.push("method: it is missing"),
        }
        match fields.get("params") {
            None | Some(Value::Null | Value::Object(_)) => {}
            Some(_) => faults.push("params: it must be an object"),
        }
        match fields.get("id") {
            None | Some(Value::Null | Value::String(_) | Value::Number(_)) => {}
            Some(_) => faults.push("id: it must be a string or a number"),
        }
        if !faults.is_empty() {
            return Err(Failure::new(-32600, format!("Invalid request: {}", faults.join("; "))));
        }
        Ok(Self {
            id: fields.get("id").cloned().unwrap_or(Value::Null),
            method: fields.get("method").and_then(Value::as_str).unwrap_or_default().to_owned(),
            params: fields.get("params").and_then(Value::as_object).cloned().unwrap_or_default(),
        })
    }
}

impl Failure {
    fn new(code: i64, message: impl Into<String>) -> Self {
        Self { code, message: message.into(), data: Value::Null }
    }

    /// What came is no JSON object.
    pub(super) fn unread(why: Option<&str>) -> Self {
        Self::new(-32700, why.map_or_else(|| "Parse error".to_owned(), |why| format!("Parse error: {why}")))
    }

    pub(super) fn no_method(method: &str) -> Self {
        let method: String = method.chars().take(60).collect();
        Self::new(-32601, format!("Method not found: {method}"))
    }

    pub(super) fn params(words: &str) -> Self {
        Self::new(-32602, format!("Invalid params - {words}"))
    }

    pub(super) fn no_session(name: &str) -> Self {
        let name: String = name.chars().take(255).collect();
        Self::new(-32602, format!("Unknown session_id: {name}"))
    }

    pub(super) fn internal(words: &str) -> Self {
        Self::new(-32603, words)
    }

    pub(super) fn capacity(full: QuotaExceeded) -> Self {
        let data = json!({"active_sessions": full.active, "max_sessions": full.limit});
        Self { data, ..Self::new(-32000, full.to_string()) }
    }

    /// As openenv-core's `ToolError`.
    pub(super) fn as_tool_error(&self) -> Value {
        let kind = if self.code == -32602 { "invalid_args" } else { "execution_error" };
        json!({"error_type": kind, "message": self.message})
    }
}

pub(super) fn succeeded(id: &Value, result: &Value) -> Value {
    json!({"jsonrpc": "2.0", "id": id, "result": result})
}

pub(super) fn failed(id: &Value, failure: &Failure) -> Value {
    let Failure { code, message, data } = failure;
    json!({"jsonrpc": "2.0", "id": id, "error": {"code": code, "message": message, "data": data}})
}
