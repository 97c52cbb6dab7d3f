//! Where the model is, and how much of it may be used.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use reqwest::Url;
use secrecy::{ExposeSecret, SecretString};
use serde_json::Value;

use super::LlmError;

/// Characters of the shortest key that is taken for a secret.
const SHORTEST_SECRET: usize = 8;

/// Milliseconds since 1970 UTC, as the service's clock says. It decides which day a cost belongs to, and how long it is
/// until a date; whatever is measured is measured by tokio's own clock.
#[derive(Clone)]
pub struct WallClock(Arc<dyn Fn() -> i64 + Send + Sync>);

impl WallClock {
    /// A clock that reads this.
    pub fn new(read: impl Fn() -> i64 + Send + Sync + 'static) -> Self {
        Self(Arc::new(read))
    }

    /// Now, milliseconds since 1970 UTC.
    #[must_use]
    pub fn now_ms(&self) -> i64 {
        (self.0)()
    }

    /// Today, days since 1970 UTC.
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

/// An endpoint, its model, and what may be spent on it.
#[derive(Debug, Clone)]
pub struct LlmConfig {
    /// The API's base, as `https://api.example.com/v1`: `/chat/completions` is appended.
    pub base_url: String,
    /// The model's name there.
    pub model: String,
    /// The key, where one is needed. It is sent to the endpoint and shown nowhere.
    pub key: Option<SecretString>,
    /// How long connecting may take.
    pub connect_timeout: Duration,
    /// How long one call may take, to the last byte of its answer.
    pub timeout: Duration,
    /// Calls under way at once, at most.
    pub concurrency: usize,
    /// Further tries of a call that failed in passing: 429, 5xx, connections.
    pub retries: u32,
    /// The pause before the first further try; it doubles with every other.
    pub backoff: Duration,
    /// Tokens of an answer, at most.
    pub max_tokens: u32,
    /// Bytes of an answer, at most: the rest is not read.
    pub max_body: usize,
    /// Tokens that one run may use in all.
    pub tokens_per_run: Option<u64>,
    /// Tokens that all runs may use in a day (UTC).
    pub tokens_per_day: Option<u64>,
    /// What all runs may cost in a day (UTC), in the currency of the prices.
    pub cost_per_day: Option<f64>,
    /// Price of a million tokens in.
    pub price_in: f64,
    /// Price of a million tokens out.
    pub price_out: f64,
    /// Whether token ids and log-probabilities are asked for, by the names that vLLM has for it (`return_token_ids`,
    /// `logprobs`): other endpoints may refuse what they do not know.
    pub tokens: bool,
    /// The time of day.
    pub clock: WallClock,
}

impl LlmConfig {
    /// An endpoint with no key, no prices and no budget, and limits as they suit a large model far away.
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
            max_body: 1024 * 1024,
            tokens_per_run: None,
            tokens_per_day: None,
            cost_per_day: None,
            price_in: 0.0,
            price_out: 0.0,
            tokens: false,
            clock,
        }
    }

    /// What these tokens cost.
    #[must_use]
    pub fn cost(&self, tokens_in: u64, tokens_out: u64) -> f64 {
        (tokens_in as f64 * self.price_in + tokens_out as f64 * self.price_out) / 1e6
    }

    /// Where calls go.
    ///
    /// # Errors
    /// An address that is none, or that carries what may be secret: addresses are shown, keys are not.
    pub(super) fn endpoint(&self) -> Result<Url, LlmError> {
        let fault = |reason: &str| LlmError::Config { field: "base_url", reason: reason.to_owned() };
        let mut url = Url::parse(&self.base_url).map_err(|error| fault(&error.to_string()))?;
        if !matches!(url.scheme(), "http" | "https") || url.host_str().is_none() {
            return Err(fault("an address that begins with http:// or https:// is wanted"));
        }
        if !url.username().is_empty() || url.password().is_some() {
            return Err(fault("it carries a user or a password; give the key by its environment variable"));
        }
        if url.query().is_some() || url.fragment().is_some() {
            return Err(fault(
                "it carries a query (?...) or a fragment (#...), where a key may hide; give the address without, and the \
                 key by its environment variable",
            ));
        }
        let path = format!("{}/chat/completions", url.path().trim_end_matches('/'));
        url.set_path(&path);
        Ok(url)
    }

    /// What a stranger wrote, without our key, be it plain or as JSON has it: some endpoints repeat it.
    pub(super) fn scrub(&self, text: &str) -> String {
        let mut text = text.to_owned();
        // Servers on one's own machine take any word for a key: one as short as `x` is no secret, and would be crossed out
        // in the middle of what a model says.
        let secret = |key: &&str| key.chars().count() >= SHORTEST_SECRET;
        let Some(key) = self.key.as_ref().map(SecretString::expose_secret).filter(secret) else {
            return text;
        };
        let quoted = Value::from(key).to_string();
        let escaped = quoted.trim_matches('"');
        for form in [key, escaped, &escaped.replace('/', "\\/")] {
            if text.contains(form) {
                text = text.replace(form, "[key]");
            }
        }
        text
    }

    /// The same of all text in a value: decoding may have put together what was written in pieces.
    pub fn scrub_value(&self, value: &mut Value) {
        match value {
            Value::String(text) => *text = self.scrub(text),
            Value::Array(items) => items.iter_mut().for_each(|item| self.scrub_value(item)),
            Value::Object(fields) => {
                let given = std::mem::take(fields).into_iter();
                fields.extend(given.map(|(name, mut value)| {
                    self.scrub_value(&mut value);
                    (self.scrub(&name), value)
                }));
            }
            _ => {}
        }
    }

    /// Refuses what cannot be.
    ///
    /// # Errors
    /// The field at fault.
    pub(super) fn check(&self) -> Result<(), LlmError> {
        self.endpoint()?;
        let fault = |field, reason: &str| Err(LlmError::Config { field, reason: reason.to_owned() });
        if self.model.trim().is_empty() {
            return fault("model", "the name of a model is wanted");
        }
        for (field, value) in [("price_in", self.price_in), ("price_out", self.price_out)] {
            if !(value.is_finite() && value >= 0.0) {
                return fault(field, "a number of at least 0 is wanted");
            }
        }
        if self.cost_per_day.is_some_and(|cost| !(cost.is_finite() && cost >= 0.0)) {
            return fault("cost_per_day", "a number of at least 0 is wanted");
        }
        if self.cost_per_day.is_some() && self.price_in + self.price_out <= 0.0 {
            return fault(
                "cost_per_day",
                "without prices nothing costs anything; give price_in and price_out",
            );
        }
        if self.concurrency == 0 {
            return fault("concurrency", "at least 1 is wanted");
        }
        if self.max_tokens == 0 {
            return fault("max_tokens", "at least 1 is wanted");
        }
        if self.timeout.is_zero() {
            return fault("timeout", "more than nothing is wanted");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    /// A secret is crossed out, in names too; a word that is too short to be one leaves what is said as it was.
    #[test]
    fn what_is_too_short_for_a_secret_is_not_crossed_out() {
        let said = || json!({"burns": [{"delta_vx": 0.1, "why": "12345678 and 1234567x"}], "12345678": 1});
        let scrubbed = |key: &str| {
            let mut config = LlmConfig::new("http://h/v1", "m", WallClock::new(|| 0));
            config.key = Some(key.to_owned().into());
            let mut value = said();
            config.scrub_value(&mut value);
            assert_eq!(config.scrub(&said().to_string()), value.to_string(), "text and value alike");
            value
        };
        for short in ["x", "0", "1234567"] {
            assert_eq!(scrubbed(short), said(), "{short}");
        }
        let crossed = json!({"burns": [{"delta_vx": 0.1, "why": "[key] and 1234567x"}], "[key]": 1});
        assert_eq!(scrubbed("12345678"), crossed);
    }
}
