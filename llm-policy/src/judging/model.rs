//! A language model as a judge: one call for each step, with a deadline, and a cache of its verdicts.

use std::sync::{Arc, LazyLock};
use std::time::Duration;

use env_core::format_shortest;
use llm::{
    ChatCall, ChatRequest, LlmClient, LlmConfig, LlmError, Message, Role, TokenUsage, json_values,
    strip_reasoning,
};
use moka::future::Cache;
use serde_json::{Value, json};
use tokio::time::Instant;

use super::verdict::StepVerdict;
use super::{JudgedStep, prompt};
use crate::TimeStep;

/// Maximum number of cached verdicts.
const MAX_CACHED_VERDICTS: u64 = 10_000;
/// Time between the timeout of a call and the deadline of its verdict.
const DEADLINE_MARGIN: Duration = Duration::from_millis(250);
/// Maximum number of tokens of a reply.
const MAX_TOKENS: u32 = 300;
/// Maximum length of a stored reasoning, in characters.
const MAX_REASONING_CHARS: usize = 1000;
/// Budget account of verdicts on episodes that belong to no run.
const NO_RUN_ACCOUNT: &str = "openenv";

static SCHEMA: LazyLock<Arc<Value>> = LazyLock::new(|| {
    Arc::new(json!({
        "type": "object",
        "additionalProperties": false,
        "required": ["reasoning", "score"],
        "properties": {
            "reasoning": {"type": "string"},
            "score": {"type": "number", "minimum": -1, "maximum": 1},
        },
    }))
});

/// Language model that judges steps. Clones share its connections and its cache.
#[derive(Clone)]
pub struct ModelJudge {
    llm: LlmClient,
    /// Maximum duration of one verdict.
    timeout: Duration,
    /// Verdicts by the hash of both messages.
    cache: Cache<[u8; 32], StepVerdict>,
}

/// Result of one question to the model.
#[derive(Debug, Clone)]
pub struct ModelVerdict {
    /// The verdict, or the reason why there is none.
    pub result: Result<StepVerdict, String>,
    /// True if the verdict came from the cache or from a simultaneous call with the same messages.
    pub is_cached: bool,
    /// Tokens and cost of the call.
    pub usage: TokenUsage,
    /// Time until the result.
    pub latency: Duration,
    /// Name of the model.
    pub model: String,
    /// Version of the prompt.
    pub prompt_version: &'static str,
}

/// Reason why a call gave no verdict.
#[derive(Debug)]
struct NoVerdict(String);

impl std::fmt::Debug for ModelJudge {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ModelJudge").field("llm", &self.llm).field("timeout", &self.timeout).finish()
    }
}

impl ModelJudge {
    /// Creates a judge. A verdict may take as long as one call of the client, and 250 ms more, so that the
    /// client sees the timeout of a slow endpoint and its circuit breaker counts it.
    #[must_use]
    pub fn new(llm: LlmClient) -> Self {
        let timeout = llm.config().timeout + DEADLINE_MARGIN;
        Self { llm, timeout, cache: Cache::new(MAX_CACHED_VERDICTS) }
    }

    /// Returns the client of the endpoint.
    #[must_use]
    pub const fn llm(&self) -> &LlmClient {
        &self.llm
    }

    /// Returns the name under which verdicts are charged to the budget: the run's id, or `openenv` without a run.
    #[must_use]
    pub fn budget_account(run: Option<&str>) -> &str {
        run.unwrap_or(NO_RUN_ACCOUNT)
    }

    /// Judges a step, from the cache if possible.
    pub(super) async fn judge(
        &self,
        step: &JudgedStep<'_>,
        before: &TimeStep,
        after: &TimeStep,
    ) -> ModelVerdict {
        let (system, user) = (prompt::system(step), prompt::user(step, before, after));
        let key = cache_key(&system, &user);
        let started = Instant::now();
        let mut usage = TokenUsage::default();
        let call = async {
            let messages = vec![Message::new(Role::System, system), Message::new(Role::User, user)];
            self.call(Self::budget_account(step.run), messages, started + self.timeout, &mut usage).await
        };
        // Simultaneous calls with the same messages share one reply.
        let entry = self.cache.entry(key).or_try_insert_with(call);
        let entry = match tokio::time::timeout(self.timeout, entry).await {
            Ok(entry) => entry.map_err(|error| error.0.clone()),
            Err(_) => Err(format!("the model returned no verdict within {} s", self.timeout.as_secs_f64())),
        };
        if let Err(reason) = &entry {
            tracing::warn!(run = step.run, episode = step.episode, reason, "The judge returned no verdict.");
        }
        ModelVerdict {
            is_cached: entry.as_ref().is_ok_and(|entry| !entry.is_fresh()),
            result: entry.map(moka::Entry::into_value),
            usage,
            latency: started.elapsed(),
            model: self.llm.config().model.clone(),
            prompt_version: prompt::JUDGE_PROMPT_VERSION,
        }
    }

    async fn call(
        &self,
        run: &str,
        messages: Vec<Message>,
        deadline: Instant,
        usage: &mut TokenUsage,
    ) -> Result<StepVerdict, NoVerdict> {
        let request = ChatRequest {
            messages,
            schema: Arc::clone(&SCHEMA),
            schema_name: "verdict",
            max_tokens: MAX_TOKENS.min(self.llm.config().max_tokens),
            temperature: Some(0.0),
        };
        let call = ChatCall { run, request: &request, deadline: Some(deadline) };
        let response = self.llm.complete(&call, usage).await;
        let response = response.map_err(|error: LlmError| NoVerdict(error.to_string()))?;
        parse_verdict(&response.text, self.llm.config())
            .map_err(|reason| NoVerdict(format!("the reply has no valid verdict: {reason}")))
    }
}

/// Hashes both messages of a question.
fn cache_key(system: &str, user: &str) -> [u8; 32] {
    *blake3::Hasher::new_derive_key("sparring 2026 judge")
        .update(&(system.len() as u64).to_le_bytes())
        .update(system.as_bytes())
        .update(user.as_bytes())
        .finalize()
        .as_bytes()
}

/// Parses the last verdict in a reply.
///
/// # Errors
/// Returns the reason why the reply has no valid verdict.
pub fn parse_verdict(text: &str, config: &LlmConfig) -> Result<StepVerdict, String> {
    if text.len() > llm::MAX_ANSWER_BYTES {
        return Err(format!("it has {} bytes, more than the maximum", text.len()));
    }
    let verdicts = json_values(strip_reasoning(text.trim())).filter(|value| value.get("score").is_some());
    let mut verdict = verdicts.last().ok_or("it has no JSON object with the field `score`")?;
    // Some endpoints repeat the API key.
    config.redact_key_in(&mut verdict);
    let score = verdict["score"].as_f64().filter(|score| score.is_finite());
    let score = score.ok_or_else(|| {
        format!("`score` must be a number, got {}", llm::sanitize_line(&verdict["score"].to_string()))
    })?;
    if !(-1.0..=1.0).contains(&score) {
        return Err(format!("`score` must be from -1 to 1, got {}", format_shortest(score)));
    }
    // Control characters could steer a terminal. Removing them may assemble a key.
    let reasoning: Option<String> = verdict["reasoning"]
        .as_str()
        .map(|text| text.chars().filter(|c| !c.is_control() || *c == '\n').collect());
    let reasoning = reasoning.map(|text| config.redact_key(&text));
    let reasoning = reasoning.as_deref().map(str::trim).filter(|text| !text.is_empty());
    let reasoning = reasoning.ok_or("`reasoning` is empty")?;
    Ok(StepVerdict { score, reasoning: reasoning.chars().take(MAX_REASONING_CHARS).collect() })
}
