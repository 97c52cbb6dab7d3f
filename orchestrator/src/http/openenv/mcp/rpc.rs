//! JSON-RPC 2.0 messages with openenv-core's error codes and texts.

use serde_json::{Map, Value, json};

use crate::limits::QuotaExceeded;

/// Validated request of JSON-RPC.
pub(in crate::http) struct RpcRequest {
    pub(in crate::http) id: Value,
    pub(in crate::http) method: String,
    pub(in crate::http) params: Map<String, Value>,
}

/// Error of a request.
#[derive(Debug)]
pub(in crate::http) struct RpcError {
    code: i64,
    message: String,
    data: Value,
}

impl RpcRequest {
    /// Validates the fields of a request.
    pub(in crate::http) fn parse(value: &Value) -> Result<Self, RpcError> {
        let Some(fields) = value.as_object() else { return Err(RpcError::parse_error(None)) };
        let mut errors = Vec::new();
        match fields.get("jsonrpc") {
            Some(Value::String(version)) if version == "2.0" => {}
            Some(_) => errors.push("jsonrpc: must be \"2.0\""),
            None => errors.push("jsonrpc: is required"),
        }
        match fields.get("method") {
            Some(Value::String(_)) => {}
            Some(_) => errors.push("method: must be a string"),
            None => errors.push("method: is required"),
        }
        match fields.get("params") {
            None | Some(Value::Null | Value::Object(_)) => {}
            Some(_) => errors.push("params: must be an object"),
        }
        match fields.get("id") {
            None | Some(Value::Null | Value::String(_) | Value::Number(_)) => {}
            Some(_) => errors.push("id: must be a string or a number"),
        }
        if !errors.is_empty() {
            return Err(RpcError::invalid(errors.join("; ")));
        }
        Ok(Self {
            id: fields.get("id").cloned().unwrap_or(Value::Null),
            method: fields.get("method").and_then(Value::as_str).unwrap_or_default().to_owned(),
            params: fields.get("params").and_then(Value::as_object).cloned().unwrap_or_default(),
        })
    }
}

impl RpcError {
    fn new(code: i64, message: impl Into<String>) -> Self {
        Self { code, message: message.into(), data: Value::Null }
    }

    /// Returns the error of a message that is not a JSON object.
    pub(super) fn parse_error(reason: Option<&str>) -> Self {
        Self::new(
            -32700,
            reason.map_or_else(|| "Parse error".to_owned(), |reason| format!("Parse error: {reason}")),
        )
    }

    /// Returns the error of a message that is not a valid request.
    pub(super) fn invalid(reason: impl std::fmt::Display) -> Self {
        Self::new(-32600, format!("Invalid request: {reason}"))
    }

    pub(super) fn no_method(method: &str) -> Self {
        let method: String = method.chars().take(60).collect();
        Self::new(-32601, format!("Method not found: {method}"))
    }

    pub(super) fn params(reason: &str) -> Self {
        Self::new(-32602, format!("Invalid params - {reason}"))
    }

    pub(super) fn no_session(name: &str) -> Self {
        let name: String = name.chars().take(255).collect();
        Self::new(-32602, format!("Unknown session_id: {name}"))
    }

    pub(super) fn internal(message: &str) -> Self {
        Self::new(-32603, message)
    }

    pub(super) fn capacity(full: QuotaExceeded) -> Self {
        let data = json!({"active_sessions": full.active, "max_sessions": full.limit});
        Self { data, ..Self::new(-32000, full.to_string()) }
    }

    pub(super) fn message(&self) -> &str {
        &self.message
    }

    /// Returns the error of a request in a version of the protocol that the server does not speak.
    pub(super) fn unsupported_version(requested: &str, supported: &[&str]) -> Self {
        let requested: String = requested.chars().take(60).collect();
        let message =
            format!("MCP-Protocol-Version: must be one of {}, got {requested:?}", supported.join(", "));
        Self { data: json!({"supported": supported, "requested": requested}), ..Self::new(-32022, message) }
    }

    /// Returns the error in the format of openenv-core's `ToolError`.
    pub(super) fn as_tool_error(&self) -> Value {
        let kind = if self.code == -32602 { "invalid_args" } else { "execution_error" };
        json!({"error_type": kind, "message": self.message})
    }
}

/// Returns the response with a result.
pub(super) fn result_response(id: &Value, result: &Value) -> Value {
    json!({"jsonrpc": "2.0", "id": id, "result": result})
}

/// Returns the response with an error.
pub(super) fn error_response(id: &Value, error: &RpcError) -> Value {
    let RpcError { code, message, data } = error;
    json!({"jsonrpc": "2.0", "id": id, "error": {"code": code, "message": message, "data": data}})
}
