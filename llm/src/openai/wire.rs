//! Bodies of `chat/completions` requests and responses.

use serde::Serialize;
use serde_json::{Value, json};

use crate::{
    ChatRequest, ChatResponse, LlmConfig, LlmError, Message, OrderedSchema, ResponseFormat, token_details,
};

/// Form of a request: the parts that differ between endpoints.
#[derive(Debug, Clone, Copy)]
pub(super) struct RequestForm {
    pub(super) format: ResponseFormat,
    /// True to send `max_completion_tokens` instead of `max_tokens`.
    pub(super) renames_max_tokens: bool,
}

#[derive(Serialize)]
struct CompletionRequest<'a> {
    model: &'a str,
    messages: &'a [Message],
    #[serde(skip_serializing_if = "Option::is_none")]
    max_tokens: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    max_completion_tokens: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    temperature: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    response_format: Option<FormatConstraint<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    logprobs: Option<bool>,
    #[serde(skip_serializing_if = "Option::is_none")]
    return_token_ids: Option<bool>,
}

#[derive(Serialize)]
struct FormatConstraint<'a> {
    r#type: ResponseFormat,
    #[serde(skip_serializing_if = "Option::is_none")]
    json_schema: Option<NamedSchema<'a>>,
}

#[derive(Serialize)]
struct NamedSchema<'a> {
    name: &'static str,
    strict: bool,
    schema: OrderedSchema<'a>,
}

/// Returns the text that states the schema at the end of the last message; `None` if the endpoint enforces the schema.
///
/// # Errors
/// Returns [`LlmError::Config`] if the schema cannot be serialised.
pub(super) fn appended_schema(
    request: &ChatRequest,
    format: ResponseFormat,
) -> Result<Option<String>, LlmError> {
    if format == ResponseFormat::JsonSchema {
        return Ok(None);
    }
    let schema = serde_json::to_string(&OrderedSchema(&request.schema)).map_err(|e| schema_error(&e))?;
    let instruction =
        "\n\nAnswer with one JSON object and nothing else. The object must match this JSON schema:\n";
    Ok(Some(format!("{instruction}{schema}")))
}

/// Encodes the body of a request.
///
/// # Errors
/// Returns [`LlmError::Config`] if the schema cannot be serialised.
pub(super) fn encode_request(
    config: &LlmConfig,
    request: &ChatRequest,
    form: RequestForm,
    appended_schema: Option<&str>,
) -> Result<Vec<u8>, LlmError> {
    let RequestForm { format, renames_max_tokens } = form;
    let json_schema = (format == ResponseFormat::JsonSchema).then(|| NamedSchema {
        name: request.schema_name,
        strict: true,
        schema: OrderedSchema(&request.schema),
    });
    let mut messages = request.messages.clone();
    if let (Some(last), Some(appended)) = (messages.last_mut(), appended_schema) {
        last.content.push_str(appended);
    }
    let body = CompletionRequest {
        model: &config.model,
        messages: &messages,
        max_tokens: (!renames_max_tokens).then_some(request.max_tokens),
        max_completion_tokens: renames_max_tokens.then_some(request.max_tokens),
        temperature: request.temperature,
        response_format: (format != ResponseFormat::Text)
            .then_some(FormatConstraint { r#type: format, json_schema }),
        logprobs: config.token_details.then_some(true),
        return_token_ids: config.token_details.then_some(true),
    };
    serde_json::to_vec(&body).map_err(|error| schema_error(&error))
}

fn schema_error(error: &serde_json::Error) -> LlmError {
    LlmError::Config { field: "schema", reason: error.to_string() }
}

/// Decodes a chat completion. Only the fields that are needed must be valid; anything else is ignored.
///
/// # Errors
/// Returns [`LlmError::InvalidResponse`] if the body is no chat completion or the model declines, and
/// [`LlmError::Refused`] if the body holds an error: some gateways report errors with status 200.
pub fn decode_response(body: &str) -> Result<ChatResponse, LlmError> {
    let body: Value = serde_json::from_str(body).map_err(|error| LlmError::InvalidResponse {
        reason: format!("it is not a chat completion: {error}"),
        tokens_in: None,
        tokens_out: None,
    })?;
    if let Some(error) = body.get("error").filter(|error| !error.is_null()) {
        let status = error.get("code").and_then(Value::as_u64).and_then(|code| u16::try_from(code).ok());
        return Err(LlmError::Refused {
            status: status.unwrap_or(200),
            body: error_message(&json!({"error": error}).to_string()),
        });
    }
    let tokens_in = body.pointer("/usage/prompt_tokens").and_then(token_count);
    let tokens_out = body.pointer("/usage/completion_tokens").and_then(token_count);
    let invalid = |reason: String| Err(LlmError::InvalidResponse { reason, tokens_in, tokens_out });
    let Some(choice) = body.pointer("/choices/0") else { return invalid("it has no choices".to_owned()) };
    let refusal = choice.pointer("/message/refusal").and_then(Value::as_str);
    if let Some(refusal) = refusal.filter(|refusal| !refusal.is_empty()) {
        return invalid(format!("the model refused to answer: {refusal}"));
    }
    let is_truncated = choice.get("finish_reason").and_then(Value::as_str) == Some("length");
    let text = match choice.pointer("/message/content") {
        // A model that used up its tokens for reasoning has no content.
        None | Some(Value::Null) if is_truncated => String::new(),
        Some(Value::String(text)) => text.clone(),
        Some(Value::Array(parts)) => {
            parts.iter().filter_map(|part| part.get("text").and_then(Value::as_str)).collect()
        }
        _ => return invalid("it has no content".to_owned()),
    };
    Ok(ChatResponse {
        text,
        tokens_in,
        tokens_out,
        is_truncated,
        appended_schema: None,
        token_details: token_details::read(&body),
    })
}

/// Returns a number of tokens; some endpoints write `12.0`.
fn token_count(value: &Value) -> Option<u64> {
    let is_count = |number: &f64| *number >= 0.0 && number.fract() == 0.0;
    // The conversion saturates beyond the range of u64.
    value.as_u64().or_else(|| value.as_f64().filter(is_count).map(|number| number as u64))
}

/// Returns the message of an error body: `error.message` or a similar field, else the whole body. JSON is serialised anew, so
/// that no unnecessary escapes hide the key.
pub(super) fn error_message(body: &str) -> String {
    let Ok(value) = serde_json::from_str::<Value>(body) else { return body.to_owned() };
    let message = ["/error/message", "/message", "/detail", "/error"]
        .iter()
        .find_map(|pointer| value.pointer(pointer)?.as_str());
    message.map_or_else(|| value.to_string(), str::to_owned)
}
