//! Configuration of an endpoint: address, model, limits, prices and budgets.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use reqwest::Url;
use secrecy::{ExposeSecret, SecretString};
use serde_json::Value;

use crate::LlmError;

/// Shortest key that is redacted, in characters. Local servers accept any word as a key: a key such as `x` is no secret, and
/// redacting it would damage the text of a model.
const MIN_SECRET_CHARS: usize = 8;

/// Replacement of a redacted key.
const REDACTED_KEY: &str = "[key]";

/// Clock of the service. It decides to which day a cost belongs and when a `Retry-After` date is reached; durations are
/// measured with tokio's clock.
#[derive(Clone)]
pub struct WallClock(Arc<dyn Fn() -> i64 + Send + Sync>);

impl WallClock {
    /// Creates a clock from a function that returns milliseconds since 1970 UTC.
    pub fn new(now_ms: impl Fn() -> i64 + Send + Sync + 'static) -> Self {
        Self(Arc::new(now_ms))
    }

    /// Returns the time in milliseconds since 1970 UTC.
    #[must_use]
    pub fn now_ms(&self) -> i64 {
        (self.0)()
    }

    /// Returns the day, in days since 1970 UTC.
    #[must_use]
    pub fn day(&self) -> i64 {
        self.now_ms().div_euclid(86_400_000)
    }
}

impl fmt::Debug for WallClock {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("WallClock")
    }
}

/// Endpoint, model, limits and budgets of a client.
#[derive(Debug, Clone)]
pub struct LlmConfig {
    /// Base URL of the API, such as `https://api.example.com/v1`; `/chat/completions` is appended.
    pub base_url: String,
    /// Name of the model at the endpoint.
    pub model: String,
    /// API key, if the endpoint needs one. It is sent to the endpoint and shown nowhere.
    pub key: Option<SecretString>,
    /// Time limit for connecting.
    pub connect_timeout: Duration,
    /// Time limit of one attempt, up to the last byte of the response.
    pub timeout: Duration,
    /// Maximum number of concurrent calls; at least 1.
    pub concurrency: usize,
    /// Maximum number of retries of a transient failure: 429, most 5xx, connection errors.
    pub retries: u32,
    /// Pause before the first retry; it doubles with each retry, up to 60 s.
    pub backoff: Duration,
    /// Token limit of an answer, as assumed by the budget; at least 1.
    pub max_tokens: u32,
    /// Length limit of a response body, in bytes. A longer one is an error.
    pub max_body_bytes: usize,
    /// Token limit of each run; `None` is unlimited.
    pub tokens_per_run: Option<u64>,
    /// Token limit of all runs per day (UTC); `None` is unlimited.
    pub tokens_per_day: Option<u64>,
    /// Cost limit of all runs per day (UTC), in the currency of the prices; `None` is unlimited.
    pub cost_per_day: Option<f64>,
    /// Price of a million prompt tokens.
    pub price_in: f64,
    /// Price of a million completion tokens.
    pub price_out: f64,
    /// True to request token ids and log-probabilities by vLLM's parameters (`return_token_ids`, `logprobs`). Other endpoints
    /// may reject these parameters.
    pub token_details: bool,
    /// Clock of the service.
    pub clock: WallClock,
}

impl LlmConfig {
    /// Creates a configuration without key, prices and budgets. Its limits suit a large remote model.
    #[must_use]
    pub fn new(base_url: impl Into<String>, model: impl Into<String>, clock: WallClock) -> Self {
        Self {
            base_url: base_url.into(),
            model: model.into(),
            key: None,
            connect_timeout: Duration::from_secs(10),
            timeout: Duration::from_secs(120),
            concurrency: 2,
            retries: 3,
            backoff: Duration::from_millis(500),
            max_tokens: 4_096,
            max_body_bytes: 1024 * 1024,
            tokens_per_run: None,
            tokens_per_day: None,
            cost_per_day: None,
            price_in: 0.0,
            price_out: 0.0,
            token_details: false,
            clock,
        }
    }

    /// Returns the cost of these numbers of tokens.
    #[must_use]
    pub fn cost(&self, tokens_in: u64, tokens_out: u64) -> f64 {
        (tokens_in as f64 * self.price_in + tokens_out as f64 * self.price_out) / 1e6
    }

    /// Replaces the key in all names and strings of a JSON value. Decoding may have assembled a key that the raw text held in
    /// escaped form.
    pub fn redact_key_in(&self, value: &mut Value) {
        match value {
            Value::String(text) => *text = self.redact_key(text),
            Value::Array(items) => items.iter_mut().for_each(|item| self.redact_key_in(item)),
            Value::Object(fields) => {
                let unredacted = std::mem::take(fields).into_iter();
                fields.extend(unredacted.map(|(name, mut value)| {
                    self.redact_key_in(&mut value);
                    (self.redact_key(&name), value)
                }));
            }
            _ => {}
        }
    }

    /// Replaces the key in untrusted text, in plain and in JSON form: some endpoints repeat it.
    #[must_use]
    pub fn redact_key(&self, text: &str) -> String {
        let mut text = text.to_owned();
        let is_secret = |key: &&str| key.chars().count() >= MIN_SECRET_CHARS;
        let Some(key) = self.key.as_ref().map(SecretString::expose_secret).filter(is_secret) else {
            return text;
        };
        let quoted = Value::from(key).to_string();
        let escaped = quoted.trim_matches('"');
        for form in [key, escaped, &escaped.replace('/', "\\/")] {
            if text.contains(form) {
                text = text.replace(form, REDACTED_KEY);
            }
        }
        text
    }

    /// Returns the URL that requests are sent to.
    ///
    /// # Errors
    /// Returns [`LlmError::Config`] if the base URL is invalid, or holds a part that may be secret: URLs are logged, keys are
    /// not.
    pub(crate) fn completions_url(&self) -> Result<Url, LlmError> {
        let fault = |reason: &str| LlmError::Config { field: "base_url", reason: reason.to_owned() };
        let mut url = Url::parse(&self.base_url).map_err(|error| fault(&error.to_string()))?;
        if !matches!(url.scheme(), "http" | "https") || url.host_str().is_none() {
            return Err(fault("must begin with http:// or https:// and name a host"));
        }
        if !url.username().is_empty() || url.password().is_some() {
            return Err(fault(
                "must not contain a user or a password; pass the key by its environment variable",
            ));
        }
        if url.query().is_some() || url.fragment().is_some() {
            return Err(fault(
                "must not contain a query (?...) or a fragment (#...), which may hold a key; pass the key by its \
                 environment variable",
            ));
        }
        let path = format!("{}/chat/completions", url.path().trim_end_matches('/'));
        url.set_path(&path);
        Ok(url)
    }

    /// Checks that all settings are valid.
    ///
    /// # Errors
    /// Returns [`LlmError::Config`] with the first invalid setting.
    pub(crate) fn validate(&self) -> Result<(), LlmError> {
        self.completions_url()?;
        let fault = |field, reason: &str| Err(LlmError::Config { field, reason: reason.to_owned() });
        if self.model.trim().is_empty() {
            return fault("model", "must not be empty");
        }
        for (field, price) in [("price_in", self.price_in), ("price_out", self.price_out)] {
            if !(price.is_finite() && price >= 0.0) {
                return fault(field, "must be a number of at least 0");
            }
        }
        if self.cost_per_day.is_some_and(|cost| !(cost.is_finite() && cost >= 0.0)) {
            return fault("cost_per_day", "must be a number of at least 0");
        }
        if self.cost_per_day.is_some() && self.price_in + self.price_out <= 0.0 {
            return fault("cost_per_day", "has no effect without prices; set price_in and price_out");
        }
        if self.concurrency == 0 {
            return fault("concurrency", "must be at least 1");
        }
        if self.max_tokens == 0 {
            return fault("max_tokens", "must be at least 1");
        }
        if self.timeout.is_zero() {
            return fault("timeout", "must be above 0");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn only_keys_of_at_least_8_characters_are_redacted() {
        let original =
            || json!({"burns": [{"delta_vx": 0.1, "why": "12345678 and 1234567x"}], "12345678": 1});
        let redacted = |key: &str| {
            let mut config = LlmConfig::new("http://h/v1", "m", WallClock::new(|| 0));
            config.key = Some(key.to_owned().into());
            let mut value = original();
            config.redact_key_in(&mut value);
            assert_eq!(config.redact_key(&original().to_string()), value.to_string(), "text and value agree");
            value
        };
        for short in ["x", "0", "1234567"] {
            assert_eq!(redacted(short), original(), "{short}");
        }
        let expected = json!({"burns": [{"delta_vx": 0.1, "why": "[key] and 1234567x"}], "[key]": 1});
        assert_eq!(redacted("12345678"), expected);
    }
}
