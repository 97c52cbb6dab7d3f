//! The API that everybody speaks: OpenAI's `chat/completions`. How an endpoint is held to a schema is learned from what
//! it refuses: `json_schema` first, then `json_object`, then plain text with the schema in the prompt.

use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use reqwest::header::{AUTHORIZATION, HeaderMap, HeaderValue, RETRY_AFTER};
use reqwest::{Client, Response, StatusCode, Url};
use secrecy::ExposeSecret;
use serde::Serialize;
use serde_json::{Value, json};

use super::chat::{Ask, Calling, Chat, Message, Reply};
use super::error::one_line;
use super::ordered::Ordered;
use super::tokens;
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
    /// The last request in this mode ended in a 500.
    strained: AtomicBool,
    /// A call ended in a 500 in this mode, and went well in a lower one.
    doubted: AtomicBool,
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
            doubted: AtomicBool::new(false),
            renamed: AtomicBool::new(false),
        })
    }

    async fn asked(&self, ask: &Ask, requests: &mut u32) -> Result<Reply, LlmError> {
        let doubted = self.doubted.load(Ordering::Relaxed);
        let mut mode = self.mode.load(Ordering::Relaxed);
        // As far down as the endpoint's own words lead; what is below is a guess.
        let mut sure = mode;
        let mut guessed = false;
        // Each turn drops a mode or learns the other name of max_tokens, so that there are at most four.
        loop {
            let renamed = self.renamed.load(Ordering::Relaxed);
            *requests = requests.saturating_sub(1);
            let no = match self.once(ask, mode, renamed).await {
                Ok(reply) => {
                    self.learn(mode, if doubted { mode } else { sure });
                    return Ok(reply);
                }
                Err(no) => no,
            };
            let LlmError::Refused { status, .. } = no.error else { return Err(no.error) };
            let said = no.said.to_lowercase();
            if status == 400 && !renamed && said.contains("max_completion_tokens") {
                self.renamed.store(true, Ordering::Relaxed);
            } else if mode < TEXT && about_form(status, &said) {
                mode += 1;
                sure = if guessed { sure } else { mode };
            } else if status == 500 && guessed {
                // A lower form did not help: it was not the form.
                self.doubted.store(false, Ordering::Relaxed);
                return Err(no.error);
            } else if status == 500 && mode < TEXT && (self.strained.swap(true, Ordering::Relaxed) || doubted)
            {
                // The second in a row may be about the form, though it does not say so.
                self.strained.store(false, Ordering::Relaxed);
                guessed = true;
                mode += 1;
            } else {
                return Err(no.error);
            }
            if *requests == 0 {
                return Err(no.error);
            }
        }
    }

    /// A request in this mode went well. What it was dropped to without a word is not yet `sure`: a passing outage must
    /// not cost the better form for good, so that only the second call of that kind in a row does.
    fn learn(&self, mode: u8, sure: u8) {
        self.strained.store(false, Ordering::Relaxed);
        self.doubted.store(sure < mode, Ordering::Relaxed);
        // Another call may have learned more in the meantime; modes are only ever dropped.
        if self.mode.fetch_max(sure, Ordering::Relaxed) < sure {
            tracing::info!(mode = MODES[usize::from(sure)], "the endpoint's way of answering is learned");
        }
    }

    async fn once(&self, ask: &Ask, mode: u8, renamed: bool) -> Result<Reply, No> {
        let appended = appended(ask, mode)?;
        let body = body(&self.config, ask, mode, (renamed, appended.as_deref()))?;
        let request =
            self.client.post(self.url.clone()).header("content-type", "application/json").body(body);
        let mut response = request.send().await.map_err(|error| self.broken(&error, false))?;
        let status = response.status();
        let retry_after = response.headers().get(RETRY_AFTER).and_then(|value| value.to_str().ok());
        let retry_after = retry_after.and_then(|v| retry::retry_after(v, self.config.clock.now_ms()));
        let read = self.read(&mut response).await;
        if status == StatusCode::TOO_MANY_REQUESTS {
            return Err(LlmError::RateLimited { retry_after }.into());
        }
        if !status.is_success() {
            let said = self.config.scrub(&read.unwrap_or_default());
            let body = if status.is_redirection() {
                "it sends elsewhere, and redirects are not followed; give the address it means".to_owned()
            } else {
                self.told(&message(&said))
            };
            return Err(No { error: LlmError::Refused { status: status.as_u16(), body }, said });
        }
        let scrubbed = |reply: Reply| {
            let text = self.config.scrub(&reply.text);
            // Tokens would tell what is crossed out.
            let tokens = reply.tokens.filter(|_| self.config.tokens && text == reply.text);
            Reply { text, tokens, appended, ..reply }
        };
        parse(&read?).map(scrubbed).map_err(|error| match error {
            LlmError::Nonsense { what, tokens_in, tokens_out } => {
                LlmError::Nonsense { what: self.told(&what), tokens_in, tokens_out }.into()
            }
            LlmError::Refused { status, body } => No {
                error: LlmError::Refused { status, body: self.told(&body) },
                said: self.config.scrub(&body),
            },
            other => other.into(),
        })
    }

    /// The body, as far as it may be long.
    async fn read(&self, response: &mut Response) -> Result<String, LlmError> {
        let mut bytes = Vec::new();
        while let Some(piece) = response.chunk().await.map_err(|error| self.broken(&error, true))? {
            if bytes.len() + piece.len() > self.config.max_body {
                let what = format!("it is longer than {} bytes", self.config.max_body);
                return Err(LlmError::Nonsense { what, tokens_in: None, tokens_out: None });
            }
            bytes.extend_from_slice(&piece);
        }
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// What broke, before or while an answer came.
    fn broken(&self, error: &reqwest::Error, answering: bool) -> LlmError {
        if error.is_timeout() && !error.is_connect() {
            return LlmError::Timeout { after: self.config.timeout };
        }
        let reason = self.told(&chain(error));
        if answering { LlmError::Broken { reason } } else { LlmError::Connection { reason } }
    }

    /// What a stranger wrote, for a message: without our key, and only then cut.
    fn told(&self, text: &str) -> String {
        one_line(&self.config.scrub(text))
    }
}

impl Chat for OpenAi {
    fn ask<'a>(&'a self, ask: &'a Ask, requests: &'a mut u32) -> Calling<'a> {
        Box::pin(self.asked(ask, requests))
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
    temperature: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    response_format: Option<Format<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    logprobs: Option<bool>,
    #[serde(skip_serializing_if = "Option::is_none")]
    return_token_ids: Option<bool>,
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

fn fault(error: &serde_json::Error) -> LlmError {
    LlmError::Config { field: "schema", reason: error.to_string() }
}

/// What is put to the end of the last message: the schema, where the endpoint is not held to it otherwise.
fn appended(ask: &Ask, mode: u8) -> Result<Option<String>, LlmError> {
    if mode == SCHEMA {
        return Ok(None);
    }
    let schema = serde_json::to_string(&Ordered(&ask.schema)).map_err(|error| fault(&error))?;
    let words = "\n\nAnswer with one JSON object and nothing else. It keeps to this JSON schema:\n";
    Ok(Some(format!("{words}{schema}")))
}

fn body(
    config: &LlmConfig,
    ask: &Ask,
    mode: u8,
    (renamed, appended): (bool, Option<&str>),
) -> Result<Vec<u8>, LlmError> {
    let json_schema =
        (mode == SCHEMA).then(|| Named { name: ask.name, strict: true, schema: Ordered(&ask.schema) });
    let mut messages = ask.messages.clone();
    if let (Some(last), Some(appended)) = (messages.last_mut(), appended) {
        last.content.push_str(appended);
    }
    let request = Request {
        model: &config.model,
        messages: &messages,
        max_tokens: (!renamed).then_some(ask.max_tokens),
        max_completion_tokens: renamed.then_some(ask.max_tokens),
        temperature: ask.temperature,
        response_format: (mode < TEXT).then(|| Format { r#type: MODES[usize::from(mode)], json_schema }),
        logprobs: config.tokens.then_some(true),
        return_token_ids: config.tokens.then_some(true),
    };
    serde_json::to_vec(&request).map_err(|error| fault(&error))
}

/// A chat completion. Only what is needed must be as it should be: nothing else in it is a reason to lose an answer.
fn parse(text: &str) -> Result<Reply, LlmError> {
    let answer: Value = serde_json::from_str(text).map_err(|error| LlmError::Nonsense {
        what: format!("it is no chat completion: {error}"),
        tokens_in: None,
        tokens_out: None,
    })?;
    if let Some(error) = answer.get("error").filter(|error| !error.is_null()) {
        // Some gateways report what went wrong behind them with status 200.
        let status = error.get("code").and_then(Value::as_u64).and_then(|code| u16::try_from(code).ok());
        return Err(LlmError::Refused {
            status: status.unwrap_or(200),
            body: message(&json!({"error": error}).to_string()),
        });
    }
    let tokens_in = answer.pointer("/usage/prompt_tokens").and_then(count);
    let tokens_out = answer.pointer("/usage/completion_tokens").and_then(count);
    let nonsense = |what: String| Err(LlmError::Nonsense { what, tokens_in, tokens_out });
    let Some(choice) = answer.pointer("/choices/0") else { return nonsense("it has no choices".to_owned()) };
    let refusal = choice.pointer("/message/refusal").and_then(Value::as_str);
    if let Some(refusal) = refusal.filter(|refusal| !refusal.is_empty()) {
        return nonsense(format!("the model refuses: {refusal}"));
    }
    let cut = choice.get("finish_reason").and_then(Value::as_str) == Some("length");
    let text = match choice.pointer("/message/content") {
        // A model that thought until it had no tokens left has said nothing.
        None | Some(Value::Null) if cut => String::new(),
        Some(Value::String(text)) => text.clone(),
        Some(Value::Array(parts)) => {
            parts.iter().filter_map(|part| part.get("text").and_then(Value::as_str)).collect()
        }
        _ => return nonsense("it has no content".to_owned()),
    };
    Ok(Reply { text, tokens_in, tokens_out, cut, appended: None, tokens: tokens::read(&answer) })
}

/// A number of tokens: some endpoints say 12.0.
fn count(value: &Value) -> Option<u64> {
    let whole = |number: &f64| *number >= 0.0 && number.fract() == 0.0;
    // Beyond what a u64 holds `as` stops at its end.
    value.as_u64().or_else(|| value.as_f64().filter(whole).map(|number| number as u64))
}

/// Whether a refusal is about the form of answers: it says so.
fn about_form(status: u16, said: &str) -> bool {
    matches!(status, 400 | 404 | 415 | 422 | 500 | 501) && ABOUT_FORM.iter().any(|word| said.contains(word))
}

/// What an error's body says: its `error.message` where it has one, else all of it. JSON is written anew, so that it has
/// no escapes but those that are needed.
fn message(body: &str) -> String {
    let Ok(value) = serde_json::from_str::<Value>(body) else { return body.to_owned() };
    let said =
        ["/error/message", "/message", "/detail", "/error"].iter().find_map(|at| value.pointer(at)?.as_str());
    said.map_or_else(|| value.to_string(), str::to_owned)
}
