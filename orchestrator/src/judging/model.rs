//! A language model as a judge: asked once a step, for no longer than its patience, never twice for the same.

use std::sync::{Arc, LazyLock};
use std::time::Duration;

use designer::llm::{Ask, Bill, Call, Llm, LlmConfig, LlmError, Message, Role, meant, values};
use moka::future::Cache;
use serde_json::{Value, json};
use tokio::time::Instant;

use super::{Step, prompt};
use crate::policy::Seen;

/// Verdicts that are remembered.
const REMEMBERED: u64 = 10_000;
/// Between the end of a call and the end of patience.
const MOMENT: Duration = Duration::from_millis(250);
/// Tokens of an answer.
const MOST_TOKENS: u32 = 300;
/// Characters of a reasoning that are kept.
const KEPT: usize = 1000;
/// Whose tokens those are that nobody flies a run for.
const NOBODY: &str = "openenv";

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

/// A model that judges. Clones share it.
#[derive(Clone)]
pub struct ModelJudge {
    llm: Llm,
    patience: Duration,
    /// By all that it is told.
    cache: Cache<[u8; 32], Sentence>,
}

/// What a model says of a step.
#[derive(Debug, Clone, PartialEq)]
pub struct Sentence {
    /// From −1 to 1.
    pub score: f64,
    /// Why.
    pub reasoning: String,
}

/// What came of asking.
#[derive(Debug, Clone)]
pub struct Said {
    /// What it says, or why it says nothing.
    pub answer: Result<Sentence, String>,
    /// The same was asked before.
    pub cached: bool,
    /// What the call came to.
    pub bill: Bill,
    /// How long that took.
    pub latency: Duration,
    /// The model.
    pub model: String,
    /// The version of the words it was told.
    pub prompt: &'static str,
}

/// A call without a verdict.
#[derive(Debug)]
struct Failed(String);

impl std::fmt::Debug for ModelJudge {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ModelJudge").field("llm", &self.llm).field("patience", &self.patience).finish()
    }
}

impl ModelJudge {
    /// A judge that has as long for each verdict as one call of the model may take, and a moment more: an endpoint that is
    /// late is then seen to be, and one that is late in a row is left alone.
    #[must_use]
    pub fn new(llm: Llm) -> Self {
        let patience = llm.config().timeout + MOMENT;
        Self { llm, patience, cache: Cache::new(REMEMBERED) }
    }

    /// The endpoint.
    #[must_use]
    pub const fn llm(&self) -> &Llm {
        &self.llm
    }

    /// Whose budget verdicts on episodes of this run are of.
    #[must_use]
    pub fn payer(run: Option<&str>) -> &str {
        run.unwrap_or(NOBODY)
    }

    /// What it says of a step.
    pub(super) async fn judge(&self, step: &Step<'_>, before: &Seen, after: &Seen) -> Said {
        let (system, user) = (prompt::system(step), prompt::user(step, before, after));
        let key = *blake3::Hasher::new_derive_key("sparring 2026 judge")
            .update(&(system.len() as u64).to_le_bytes())
            .update(system.as_bytes())
            .update(user.as_bytes())
            .finalize()
            .as_bytes();
        let begun = Instant::now();
        let mut bill = Bill::default();
        let asking = async {
            let messages = vec![Message::new(Role::System, system), Message::new(Role::User, user)];
            self.ask(Self::payer(step.run), messages, begun + self.patience, &mut bill).await
        };
        // Who asks the same at the same time waits for the one answer.
        let entry = self.cache.entry(key).or_try_insert_with(asking);
        let entry = match tokio::time::timeout(self.patience, entry).await {
            Ok(entry) => entry.map_err(|failed| failed.0.clone()),
            Err(_) => Err(format!("there was no verdict within {} s", self.patience.as_secs_f64())),
        };
        if let Err(why) = &entry {
            tracing::warn!(run = step.run, episode = step.episode, why, "The judge gave no verdict.");
        }
        Said {
            cached: entry.as_ref().is_ok_and(|entry| !entry.is_fresh()),
            answer: entry.map(moka::Entry::into_value),
            bill,
            latency: begun.elapsed(),
            model: self.llm.config().model.clone(),
            prompt: prompt::VERSION,
        }
    }

    async fn ask(
        &self,
        run: &str,
        messages: Vec<Message>,
        until: Instant,
        bill: &mut Bill,
    ) -> Result<Sentence, Failed> {
        let ask = Ask {
            messages,
            schema: Arc::clone(&SCHEMA),
            name: "verdict",
            max_tokens: MOST_TOKENS.min(self.llm.config().max_tokens),
            temperature: Some(0.0),
        };
        let call = Call { run, ask: &ask, until: Some(until) };
        let reply = self.llm.ask(&call, bill).await.map_err(|error: LlmError| Failed(error.to_string()))?;
        read(&reply.text, self.llm.config())
            .map_err(|reason| Failed(format!("its answer is no verdict: {reason}")))
    }
}

/// The verdict of an answer: the last one there is.
///
/// # Errors
/// Why there is none.
pub(super) fn read(text: &str, config: &LlmConfig) -> Result<Sentence, String> {
    if text.len() > designer::llm::MAX_TEXT {
        return Err(format!("it is {} bytes long", text.len()));
    }
    let said = values(meant(text.trim())).filter(|value| value.get("score").is_some()).last();
    let mut said = said.ok_or("it holds no JSON object with a score")?;
    // Some endpoints repeat our key.
    config.scrub_value(&mut said);
    let score = said["score"].as_f64().filter(|score| score.is_finite());
    let score = score.ok_or_else(|| {
        format!("its score is no number: {}", designer::llm::one_line(&said["score"].to_string()))
    })?;
    if !(-1.0..=1.0).contains(&score) {
        return Err(format!("its score is {score}, outside -1 to 1"));
    }
    // What could steer a terminal is no reason.
    let words: Option<String> = said["reasoning"]
        .as_str()
        .map(|words| words.chars().filter(|c| !c.is_control() || *c == '\n').collect());
    let reasoning = words.as_deref().map(str::trim).filter(|words| !words.is_empty());
    let reasoning = reasoning.ok_or("it says no reason")?;
    Ok(Sentence { score, reasoning: reasoning.chars().take(KEPT).collect() })
}
