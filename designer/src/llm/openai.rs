//! The API that everybody speaks: OpenAI's `chat/completions`. How an endpoint is held to a schema is learned from what
//! it refuses: `json_schema` first, then `json_object`, then plain text with the schema in the prompt.

use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use reqwest::header::{AUTHORIZATION, HeaderMap, HeaderValue, RETRY_AFTER};
use reqwest::{Client, Response, StatusCode, Url};
use secrecy::{ExposeSecret, SecretString};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::chat::{Ask, Calling, Chat, Message, Reply};
use super::error::one_line;
use super::ordered::Ordered;
use super::{LlmConfig, LlmError, retry, tls};

/// How answers are held to a schema, the best first.
const MODES: [&str; 3] = ["json_schema", "json_object", "text"];
const SCHEMA: u8 = 0;
const TEXT: u8 = 2;

/// What a refusal speaks of when it is about the form of answers.
const ABOUT_FORM: [&str; 6] =
    ["response_format", "json_schema", "json_object", "schema", "grammar", "structured output"];

/// An endpoint that speaks `chat/completions`.
#[derive(Debug)]
pub struct OpenAi {
    config: LlmConfig,
    url: Url,
    client: Client,
    mode: AtomicU8,
    /// The last call in this mode ended in a 500.
    strained: AtomicBool,
    /// It wants `max_completion_tokens` instead of `max_tokens`.
    renamed: AtomicBool,
}

/// A refusal, before it is known whether it is about the form.
struct No {
    error: LlmError,
    said: String,
}

impl From<LlmError> for No {
    fn from(error: LlmError) -> Self {
        Self { error, said: String::new() }
    }
}

impl OpenAi {
    /// An endpoint. Nothing is sent yet.
    ///
    /// # Errors
    /// A setting that cannot be.
    pub fn new(config: &LlmConfig) -> Result<Self, LlmError> {
        config.check()?;
        let url = config.endpoint()?;
        let fault = |reason: String| LlmError::Config { field: "base_url", reason };
        let mut headers = HeaderMap::new();
        if let Some(key) = &config.key {
            // The header's own error would show the key.
            let mut value =
                HeaderValue::try_from(format!("Bearer {}", key.expose_secret())).map_err(|_| {
                    LlmError::Config {
                        field: "key",
                        reason: "it holds characters that no header can".to_owned(),
                    }
                })?;
            value.set_sensitive(true);
            headers.insert(AUTHORIZATION, value);
        }
        let client = tls::http_client(url.scheme() == "https")
            .map_err(fault)?
            .default_headers(headers)
            .connect_timeout(config.connect_timeout)
            .timeout(config.timeout)
            .build()
            .map_err(|error| fault(chain(&error)))?;
        Ok(Self {
            config: config.clone(),
            url,
            client,
            mode: AtomicU8::new(SCHEMA),
            strained: AtomicBool::new(false),
            renamed: AtomicBool::new(false),
        })
    }

    async fn asked(&self, ask: &Ask) -> Result<Reply, LlmError> {
        let mut mode = self.mode.load(Ordering::Relaxed);
        // Each turn drops a mode or learns the other name of max_tokens, so that there are at most four.
        loop {
            let renamed = self.renamed.load(Ordering::Relaxed);
            let no = match self.once(ask, mode, renamed).await {
                Ok(reply) => {
                    self.strained.store(false, Ordering::Relaxed);
                    // Another call may have learned more in the meantime; modes are only ever dropped.
                    if self.mode.fetch_max(mode, Ordering::Relaxed) < mode {
                        tracing::info!(
                            mode = MODES[usize::from(mode)],
                            "the endpoint's way of answering is learned"
                        );
                    }
                    return Ok(reply);
                }
                Err(no) => no,
            };
            let LlmError::Refused { status, .. } = no.error else { return Err(no.error) };
            let said = no.said.to_lowercase();
            if status == 400 && !renamed && said.contains("max_completion_tokens") {
                self.renamed.store(true, Ordering::Relaxed);
            } else if mode < TEXT && self.about_form(status, &said) {
                mode += 1;
            } else {
                return Err(no.error);
            }
        }
    }

    /// Whether a refusal is, or may be, about the form of answers: it says so, or it is the second 500 in a row.
    fn about_form(&self, status: u16, said: &str) -> bool {
        match status {
            400 | 404 | 415 | 422 | 501 => ABOUT_FORM.iter().any(|word| said.contains(word)),
            500 => self.strained.swap(true, Ordering::Relaxed),
            _ => false,
        }
    }

    async fn once(&self, ask: &Ask, mode: u8, renamed: bool) -> Result<Reply, No> {
        let body = body(&self.config.model, ask, mode, renamed)?;
        let request =
            self.client.post(self.url.clone()).header("content-type", "application/json").body(body);
        let mut response = request.send().await.map_err(|error| self.broken(&error))?;
        let status = response.status();
        let retry_after = response.headers().get(RETRY_AFTER).and_then(|value| value.to_str().ok());
        let retry_after = retry_after.and_then(|v| retry::retry_after(v, self.config.clock.now_ms()));
        let read = self.read(&mut response).await;
        if status == StatusCode::TOO_MANY_REQUESTS {
            return Err(LlmError::RateLimited { retry_after }.into());
        }
        if !status.is_success() {
            let said = self.scrub(&read.unwrap_or_default());
            let body = if status.is_redirection() {
                "it sends elsewhere, and redirects are not followed; give the address it means".to_owned()
            } else {
                one_line(&message(&said))
            };
            return Err(No { error: LlmError::Refused { status: status.as_u16(), body }, said });
        }
        parse(&read?).map(|reply| Reply { text: self.scrub(&reply.text), ..reply }).map_err(|error| {
            match error {
                LlmError::Nonsense { what } => LlmError::Nonsense { what: self.scrub(&what) }.into(),
                LlmError::Refused { status, body } => {
                    let said = self.scrub(&body);
                    No { error: LlmError::Refused { status, body: one_line(&said) }, said }
                }
                other => other.into(),
            }
        })
    }

    /// The body, as far as it may be long.
    async fn read(&self, response: &mut Response) -> Result<String, LlmError> {
        let mut bytes = Vec::new();
        while let Some(piece) = response.chunk().await.map_err(|error| self.broken(&error))? {
            if bytes.len() + piece.len() > self.config.max_body {
                let what = format!("it is longer than {} bytes", self.config.max_body);
                return Err(LlmError::Nonsense { what });
            }
            bytes.extend_from_slice(&piece);
        }
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    fn broken(&self, error: &reqwest::Error) -> LlmError {
        if error.is_timeout() && !error.is_connect() {
            return LlmError::Timeout { after: self.config.timeout };
        }
        LlmError::Connection { reason: one_line(&self.scrub(&chain(error))) }
    }

    /// What a stranger wrote, without our key: some endpoints repeat it.
    fn scrub(&self, text: &str) -> String {
        match self.config.key.as_ref().map(SecretString::expose_secret).filter(|key| !key.is_empty()) {
            Some(key) if text.contains(key) => text.replace(key, "[key]"),
            _ => text.to_owned(),
        }
    }
}

impl Chat for OpenAi {
    fn ask<'a>(&'a self, ask: &'a Ask) -> Calling<'a> {
        Box::pin(self.asked(ask))
    }

    fn mode(&self) -> &'static str {
        MODES[usize::from(self.mode.load(Ordering::Relaxed).min(TEXT))]
    }
}

/// An error and what it comes from. Only the outermost of reqwest's shows the address, which may hold more than a host.
fn chain(error: &reqwest::Error) -> String {
    let mut source = std::error::Error::source(error);
    if source.is_none() {
        return "the connection failed".to_owned();
    }
    let mut words = Vec::new();
    while let Some(error) = source {
        words.push(error.to_string());
        source = error.source();
    }
    words.dedup();
    words.join(": ")
}

#[derive(Serialize)]
struct Request<'a> {
    model: &'a str,
    messages: &'a [Message],
    #[serde(skip_serializing_if = "Option::is_none")]
    max_tokens: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    max_completion_tokens: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    response_format: Option<Format<'a>>,
}

#[derive(Serialize)]
struct Format<'a> {
    r#type: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    json_schema: Option<Named<'a>>,
}

#[derive(Serialize)]
struct Named<'a> {
    name: &'static str,
    strict: bool,
    schema: Ordered<'a>,
}

fn body(model: &str, ask: &Ask, mode: u8, renamed: bool) -> Result<Vec<u8>, LlmError> {
    let fault = |error: serde_json::Error| LlmError::Config { field: "schema", reason: error.to_string() };
    let json_schema =
        (mode == SCHEMA).then(|| Named { name: "layouts", strict: true, schema: Ordered(&ask.schema) });
    let mut messages = ask.messages.clone();
    if mode != SCHEMA {
        let schema = serde_json::to_string(&Ordered(&ask.schema)).map_err(fault)?;
        if let Some(last) = messages.last_mut() {
            last.content.push_str(
                "\n\nAnswer with one JSON object and nothing else. It keeps to this JSON schema:\n",
            );
            last.content.push_str(&schema);
        }
    }
    let request = Request {
        model,
        messages: &messages,
        max_tokens: (!renamed).then_some(ask.max_tokens),
        max_completion_tokens: renamed.then_some(ask.max_tokens),
        response_format: (mode < TEXT).then(|| Format { r#type: MODES[usize::from(mode)], json_schema }),
    };
    serde_json::to_vec(&request).map_err(fault)
}

#[derive(Deserialize)]
struct Answer {
    #[serde(default)]
    choices: Vec<Choice>,
    #[serde(default)]
    usage: Option<UsageForm>,
    #[serde(default)]
    error: Option<Value>,
}

#[derive(Deserialize)]
struct Choice {
    message: Said,
    #[serde(default)]
    finish_reason: Option<String>,
}

#[derive(Deserialize)]
struct Said {
    #[serde(default)]
    content: Option<Value>,
    #[serde(default)]
    refusal: Option<String>,
}

#[derive(Deserialize)]
struct UsageForm {
    #[serde(default)]
    prompt_tokens: Option<u64>,
    #[serde(default)]
    completion_tokens: Option<u64>,
}

fn parse(text: &str) -> Result<Reply, LlmError> {
    let nonsense = |what: String| LlmError::Nonsense { what };
    let answer: Answer =
        serde_json::from_str(text).map_err(|error| nonsense(format!("it is no chat completion: {error}")))?;
    if let Some(error) = answer.error.filter(|error| !error.is_null()) {
        // Some gateways report what went wrong behind them with status 200.
        let status = error.get("code").and_then(Value::as_u64).and_then(|code| u16::try_from(code).ok());
        return Err(LlmError::Refused {
            status: status.unwrap_or(200),
            body: message(&json!({"error": error}).to_string()),
        });
    }
    let choice = answer.choices.into_iter().next().ok_or_else(|| nonsense("it has no choices".to_owned()))?;
    if let Some(refusal) = choice.message.refusal.filter(|refusal| !refusal.is_empty()) {
        return Err(nonsense(format!("the model refuses: {}", one_line(&refusal))));
    }
    let text = match choice.message.content {
        Some(Value::String(text)) => text,
        Some(Value::Array(parts)) => {
            parts.iter().filter_map(|part| part.get("text").and_then(Value::as_str)).collect()
        }
        _ => return Err(nonsense("it has no content".to_owned())),
    };
    let usage = answer.usage;
    Ok(Reply {
        text,
        tokens_in: usage.as_ref().and_then(|usage| usage.prompt_tokens),
        tokens_out: usage.as_ref().and_then(|usage| usage.completion_tokens),
        cut: choice.finish_reason.as_deref() == Some("length"),
    })
}

/// What an error's body says: its `error.message` where it has one, else all of it.
fn message(body: &str) -> String {
    let value: Value = serde_json::from_str(body).unwrap_or_default();
    let said =
        ["/error/message", "/message", "/detail", "/error"].iter().find_map(|at| value.pointer(at)?.as_str());
    said.map_or_else(|| body.to_owned(), str::to_owned)
}
