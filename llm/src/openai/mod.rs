//! Backend for OpenAI's `chat/completions`, which most servers of language models implement.
//!
//! The backend learns from error responses how an endpoint constrains answers to a schema: it tries `json_schema` first,
//! then `json_object`, then plain text with the schema in the prompt. `wire` has the bodies of requests and responses.

pub(crate) mod wire;

use std::sync::{Mutex, MutexGuard, PoisonError};

use reqwest::header::{AUTHORIZATION, HeaderMap, HeaderValue, RETRY_AFTER};
use reqwest::{Client, Response, StatusCode, Url};
use secrecy::ExposeSecret;

use self::wire::RequestForm;
use crate::{
    ChatBackend, ChatFuture, ChatRequest, ChatResponse, LlmConfig, LlmError, ResponseFormat, retry,
    sanitize_line, tls,
};

/// Words that occur in an error response if it is about the response format.
const FORMAT_WORDS: [&str; 6] =
    ["response_format", "json_schema", "json_object", "schema", "grammar", "structured output"];

/// Endpoint that implements `chat/completions`.
#[derive(Debug)]
pub struct OpenAi {
    config: LlmConfig,
    url: Url,
    client: Client,
    learned: Mutex<LearnedForm>,
}

/// Request form that the endpoint accepts, as learned from its responses.
#[derive(Debug)]
struct LearnedForm {
    format: ResponseFormat,
    /// True if the last request in this format ended in a 500.
    had_server_error: bool,
    /// True if a call ended in a 500 in this format and succeeded in a weaker one.
    is_doubted: bool,
    /// True if the endpoint wants `max_completion_tokens` instead of `max_tokens`.
    renames_max_tokens: bool,
}

/// Failed request, before its cause (the response format or something else) is known.
struct FailedRequest {
    error: LlmError,
    /// Response body without the key.
    body: String,
}

impl From<LlmError> for FailedRequest {
    fn from(error: LlmError) -> Self {
        Self { error, body: String::new() }
    }
}

impl OpenAi {
    /// Creates a backend. Sends nothing yet.
    ///
    /// # Errors
    /// Returns [`LlmError::Config`] if a setting is invalid.
    pub fn new(config: &LlmConfig) -> Result<Self, LlmError> {
        config.validate()?;
        let url = config.completions_url()?;
        let fault = |reason: String| LlmError::Config { field: "base_url", reason };
        let mut headers = HeaderMap::new();
        if let Some(key) = &config.key {
            // The error of the header would show the key.
            let mut value =
                HeaderValue::try_from(format!("Bearer {}", key.expose_secret())).map_err(|_| {
                    LlmError::Config {
                        field: "key",
                        reason: "must contain only characters that a header may have".to_owned(),
                    }
                })?;
            value.set_sensitive(true);
            headers.insert(AUTHORIZATION, value);
        }
        let roots = if url.scheme() == "https" { tls::TrustedRoots::System } else { tls::TrustedRoots::None };
        let client = tls::http_client_builder(roots)
            .map_err(fault)?
            .default_headers(headers)
            .connect_timeout(config.connect_timeout)
            .timeout(config.timeout)
            .build()
            .map_err(|error| fault(error_chain(&error)))?;
        let learned = LearnedForm {
            format: ResponseFormat::JsonSchema,
            had_server_error: false,
            is_doubted: false,
            renames_max_tokens: false,
        };
        Ok(Self { config: config.clone(), url, client, learned: Mutex::new(learned) })
    }

    /// Sends a request, and sends it again in another form if the response says or suggests that the form was the problem.
    async fn send_and_learn(
        &self,
        request: &ChatRequest,
        requests_left: &mut u32,
    ) -> Result<ChatResponse, LlmError> {
        let (mut format, was_doubted) = {
            let learned = self.learned();
            (learned.format, learned.is_doubted)
        };
        // Weakest format that the endpoint's error message suggests; a weaker one is a guess.
        let mut known_format = format;
        let mut is_guess = false;
        // Each turn weakens the format or learns the other name of `max_tokens`, so there are at most four.
        loop {
            let renames_max_tokens = self.learned().renames_max_tokens;
            *requests_left = requests_left.saturating_sub(1);
            let failed = match self.send_once(request, RequestForm { format, renames_max_tokens }).await {
                Ok(response) => {
                    self.learn(format, if was_doubted { format } else { known_format });
                    return Ok(response);
                }
                Err(failed) => failed,
            };
            let LlmError::Refused { status, .. } = failed.error else { return Err(failed.error) };
            let body = failed.body.to_lowercase();
            let weaker = format.weaker();
            if status == 400 && !renames_max_tokens && body.contains("max_completion_tokens") {
                self.learned().renames_max_tokens = true;
            } else if let Some(weaker) = weaker.filter(|_| is_about_format(status, &body)) {
                format = weaker;
                known_format = if is_guess { known_format } else { format };
            } else if status == 500 && is_guess {
                // A weaker format did not help, so the format was not the cause.
                self.learned().is_doubted = false;
                return Err(failed.error);
            } else if let Some(weaker) = weaker.filter(|_| status == 500)
                && self.suspects_format(was_doubted)
            {
                is_guess = true;
                format = weaker;
            } else {
                return Err(failed.error);
            }
            if *requests_left == 0 {
                return Err(failed.error);
            }
        }
    }

    /// Records a 500 without an explanation. Returns true if the format may be the cause: on the second 500 in a row, or if
    /// the format was doubted before.
    fn suspects_format(&self, was_doubted: bool) -> bool {
        let mut learned = self.learned();
        let suspects = learned.had_server_error || was_doubted;
        learned.had_server_error = !suspects;
        suspects
    }

    /// Records that a request in `format` succeeded. `known_format` is the format to use from now on: a guessed one is only
    /// adopted after the second such call in a row, so that a passing outage does not lose the stronger format for good.
    fn learn(&self, format: ResponseFormat, known_format: ResponseFormat) {
        let mut learned = self.learned();
        learned.had_server_error = false;
        learned.is_doubted = known_format < format;
        // A concurrent call may have learned more; formats only ever get weaker.
        if learned.format < known_format {
            learned.format = known_format;
            tracing::info!(mode = known_format.name(), "The response format of the endpoint was detected.");
        }
    }

    fn learned(&self) -> MutexGuard<'_, LearnedForm> {
        self.learned.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sends one HTTP request and reads its response.
    async fn send_once(
        &self,
        request: &ChatRequest,
        form: RequestForm,
    ) -> Result<ChatResponse, FailedRequest> {
        let appended_schema = wire::appended_schema(request, form.format)?;
        let body = wire::encode_request(&self.config, request, form, appended_schema.as_deref())?;
        let http_request =
            self.client.post(self.url.clone()).header("content-type", "application/json").body(body);
        let mut response = http_request.send().await.map_err(|error| self.transport_error(&error, false))?;
        let status = response.status();
        let retry_after = response.headers().get(RETRY_AFTER).and_then(|value| value.to_str().ok());
        let retry_after =
            retry_after.and_then(|value| retry::parse_retry_after(value, self.config.clock.now_ms()));
        let body = self.read_body(&mut response).await;
        if status == StatusCode::TOO_MANY_REQUESTS {
            return Err(LlmError::RateLimited { retry_after }.into());
        }
        if !status.is_success() {
            return Err(self.refusal(status, &body.unwrap_or_default()));
        }
        match wire::decode_response(&body?) {
            Ok(response) => {
                let text = self.config.redact_key(&response.text);
                // Token ids would reveal a redacted key.
                let token_details =
                    response.token_details.filter(|_| self.config.token_details && text == response.text);
                Ok(ChatResponse { text, token_details, appended_schema, ..response })
            }
            Err(LlmError::InvalidResponse { reason, tokens_in, tokens_out }) => {
                let reason = self.sanitize(&reason);
                Err(LlmError::InvalidResponse { reason, tokens_in, tokens_out }.into())
            }
            Err(LlmError::Refused { status, body }) => Err(FailedRequest {
                error: LlmError::Refused { status, body: self.sanitize(&body) },
                body: self.config.redact_key(&body),
            }),
            Err(other) => Err(other.into()),
        }
    }

    /// Returns the error of an HTTP status other than 2xx and 429.
    fn refusal(&self, status: StatusCode, body: &str) -> FailedRequest {
        let body = self.config.redact_key(body);
        let message = if status.is_redirection() {
            "the endpoint redirects, which is not supported; set base_url to the final address".to_owned()
        } else {
            self.sanitize(&wire::error_message(&body))
        };
        FailedRequest { error: LlmError::Refused { status: status.as_u16(), body: message }, body }
    }

    /// Reads the body up to the length limit.
    async fn read_body(&self, response: &mut Response) -> Result<String, LlmError> {
        let mut bytes = Vec::new();
        while let Some(chunk) = response.chunk().await.map_err(|error| self.transport_error(&error, true))? {
            if bytes.len() + chunk.len() > self.config.max_body_bytes {
                let reason = format!("it has more than {} bytes", self.config.max_body_bytes);
                return Err(LlmError::InvalidResponse { reason, tokens_in: None, tokens_out: None });
            }
            bytes.extend_from_slice(&chunk);
        }
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// Converts a transport error. `has_response` is true if the response had begun.
    fn transport_error(&self, error: &reqwest::Error, has_response: bool) -> LlmError {
        if error.is_timeout() && !error.is_connect() {
            return LlmError::Timeout { after: self.config.timeout };
        }
        let reason = self.sanitize(&error_chain(error));
        if has_response { LlmError::ConnectionLost { reason } } else { LlmError::Connection { reason } }
    }

    /// Makes untrusted text fit for a message. The key is redacted before the text is cut.
    fn sanitize(&self, text: &str) -> String {
        sanitize_line(&self.config.redact_key(text))
    }
}

impl ChatBackend for OpenAi {
    fn send<'a>(&'a self, request: &'a ChatRequest, requests_left: &'a mut u32) -> ChatFuture<'a> {
        Box::pin(self.send_and_learn(request, requests_left))
    }

    fn response_format(&self) -> ResponseFormat {
        self.learned().format
    }
}

/// Returns true if an error response names the response format as the problem. `body` is in lower case.
fn is_about_format(status: u16, body: &str) -> bool {
    matches!(status, 400 | 404 | 415 | 422 | 500 | 501) && FORMAT_WORDS.iter().any(|word| body.contains(word))
}

/// Returns the messages of an error's sources. The outermost error of reqwest is left out: it shows the URL, which may hold
/// more than a host.
fn error_chain(error: &reqwest::Error) -> String {
    let mut source = std::error::Error::source(error);
    if source.is_none() {
        return "the connection failed".to_owned();
    }
    let mut messages = Vec::new();
    while let Some(error) = source {
        messages.push(error.to_string());
        source = error.source();
    }
    messages.dedup();
    messages.join(": ")
}
