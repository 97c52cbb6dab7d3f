//! Judges of single steps, from −1 to 1: the deterministic one, and a language model. What they say changes what a client is
//! told (reward, score so far, an alert); what is stored of an episode, and what the curriculum learns from it, is what the
//! world says.

pub mod agreement;
mod model;
mod prompt;

use std::sync::Arc;

use env_core::critique::Judged;
use env_core::{ActionLog, Scenario};
use serde::{Deserialize, Serialize};
use tokio::sync::Semaphore;
use utoipa::ToSchema;

pub use self::model::{ModelJudge, Said, Sentence};
use crate::policy::Seen;

/// The share of the wire's reward that a judge moves, either way: reward/1.2·(1 + 0.2·score), as the public kessler-env has it.
const WEIGHT: f64 = 0.2;
/// Characters of a judge's words in an alert.
const ALERT: usize = 300;

/// Who judges the steps of sessions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Judge {
    /// Nobody.
    #[default]
    Off,
    /// Rules: what the step was worth if nobody acted after it.
    Deterministic,
    /// A language model, with the rules beside it.
    Llm,
}

impl Judge {
    /// Reads a word: `off`, `deterministic`, `llm`, or, as `ENABLE_JUDGE` of the public kessler-env, a truth value.
    ///
    /// # Errors
    /// Another word.
    pub fn parse(word: &str) -> Result<Self, String> {
        match word.trim().to_ascii_lowercase().as_str() {
            "off" | "false" | "0" | "no" | "" => Ok(Self::Off),
            "deterministic" => Ok(Self::Deterministic),
            "llm" | "true" | "1" | "yes" | "on" => Ok(Self::Llm),
            _ => Err("off, deterministic or llm is wanted (true is llm, false is off)".to_owned()),
        }
    }
}

/// A step that was taken.
#[derive(Debug, Clone, Copy)]
pub struct Step<'a> {
    /// The run, where it is flown for one.
    pub run: Option<&'a str>,
    /// What the episode is called.
    pub episode: &'a str,
    /// What is flown.
    pub scenario: &'a Scenario,
    /// What was done until now, this step the last.
    pub log: &'a ActionLog,
    /// What was seen before; none unless a model judges.
    pub before: Option<&'a Seen>,
    /// What is seen now; none unless a model judges.
    pub after: Option<&'a Seen>,
}

/// A judge's word on a step.
#[derive(Debug, Clone, PartialEq)]
pub struct Word {
    /// From −1 to 1.
    pub score: f64,
    /// Why, in words.
    pub reasoning: String,
}

impl Word {
    /// The reward that a client is told.
    #[must_use]
    pub fn reward(&self, reward: f64) -> f64 {
        reward / (1.0 + WEIGHT) * (1.0 + WEIGHT * self.score)
    }

    /// The alert that a client is told.
    #[must_use]
    pub fn alert(&self) -> String {
        let said: String = self.reasoning.split_whitespace().collect::<Vec<_>>().join(" ");
        let short: String = said.chars().take(ALERT).collect();
        let more = if short.len() < said.len() { "…" } else { "" };
        format!("[JUDGE]: {short}{more} (Score: {:.2})", self.score)
    }
}

/// Both judges' words on a step.
#[derive(Debug, Clone)]
pub struct Words {
    /// The model's; none where none was asked.
    pub model: Option<Said>,
    /// The rules'; none where a single step counts for nothing.
    pub rules: Option<Judged>,
}

impl Words {
    /// The word that counts.
    #[must_use]
    pub fn word(&self) -> Option<Word> {
        match &self.model {
            Some(said) => {
                said.answer.as_ref().ok().map(|s| Word { score: s.score, reasoning: s.reasoning.clone() })
            }
            None => self.rules.as_ref().map(|j| Word { score: j.value, reasoning: j.words.clone() }),
        }
    }
}

/// The judges of a service.
#[derive(Debug, Clone)]
pub struct Judges {
    usual: Judge,
    model: Option<ModelJudge>,
    /// The rules fly each step's episode to its end: not more at once than there are processors.
    turns: Arc<Semaphore>,
}

impl Default for Judges {
    fn default() -> Self {
        Self::new(Judge::Off, None)
    }
}

impl Judges {
    /// Judges; `usual` is for whoever says nothing, and nobody where it is a model that is not there.
    #[must_use]
    pub fn new(usual: Judge, model: Option<ModelJudge>) -> Self {
        let processors = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        Self { usual, model, turns: Arc::new(Semaphore::new(processors)) }
    }

    /// Whether there is a model.
    #[must_use]
    pub const fn has_model(&self) -> bool {
        self.model.is_some()
    }

    /// The model.
    #[must_use]
    pub const fn model(&self) -> Option<&ModelJudge> {
        self.model.as_ref()
    }

    /// Who judges where this is said; the rules where a model is meant that is not there.
    #[must_use]
    pub fn meant(&self, said: Option<Judge>) -> Judge {
        match said.unwrap_or(self.usual) {
            Judge::Llm if self.model.is_none() => Judge::Deterministic,
            judge => judge,
        }
    }

    /// What the judges say of a step.
    pub async fn judge(&self, judge: Judge, step: Step<'_>) -> Words {
        let model = async {
            match (judge, &self.model, step.before, step.after) {
                (Judge::Llm, Some(model), Some(before), Some(after)) => {
                    Some(model.judge(&step, before, after).await)
                }
                _ => None,
            }
        };
        let rules = async {
            if judge == Judge::Off {
                return None;
            }
            self.by_rules(step.scenario.clone(), step.log.clone()).await
        };
        let (model, rules) = tokio::join!(model, rules);
        Words { model, rules }
    }

    async fn by_rules(&self, scenario: Scenario, log: ActionLog) -> Option<Judged> {
        // Never closed; were it, more at once is all that follows.
        let _turn = self.turns.acquire().await.ok();
        let judged = tokio::task::spawn_blocking(move || scenario.task().judge_step(&scenario, &log)).await;
        match judged {
            Ok(Ok(judged)) => judged,
            Ok(Err(error)) => {
                tracing::warn!(%error, "A step could not be judged.");
                None
            }
            Err(error) => {
                tracing::error!(%error, "A judge failed.");
                None
            }
        }
    }
}

/// The last action of a log in the wire form.
fn action(scenario: &Scenario, log: &ActionLog) -> String {
    scenario.task().wire().write_action(log.step(log.len().saturating_sub(1)))
}

#[cfg(test)]
mod tests;
