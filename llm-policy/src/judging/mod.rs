//! Judges of single steps: the world's deterministic rules, and a language model. Scores range from −1 to 1.
//!
//! A verdict changes what a client of a session receives (reward, score so far, an alert). It never changes what is stored
//! of an episode or what the curriculum learns from it. Start reading at [`Judges::judge`]; [`agreement`] compares both
//! judges on the same steps.

pub mod agreement;
pub(crate) mod model;
mod prompt;
#[cfg(test)]
mod tests;
mod verdict;

use std::sync::Arc;

use api_types::Judge;
use env_core::critique::Judgement;
use env_core::{ActionLog, Scenario};
use openenv_wire::wire_format;
use tokio::sync::Semaphore;

pub use self::model::{ModelJudge, ModelVerdict};
pub use self::verdict::StepVerdict;
use crate::TimeStep;

/// Parses `off`, `deterministic`, `llm`, or a truth value as in `ENABLE_JUDGE` of the public kessler-env.
///
/// # Errors
/// Returns a message with the accepted words for any other word.
pub fn parse_judge(word: &str) -> Result<Judge, String> {
    match word.trim().to_ascii_lowercase().as_str() {
        "off" | "false" | "0" | "no" | "" => Ok(Judge::Off),
        "deterministic" => Ok(Judge::Deterministic),
        "llm" | "true" | "1" | "yes" | "on" => Ok(Judge::Llm),
        _ => Err("must be off, deterministic or llm (true means llm, false means off)".to_owned()),
    }
}

/// A step to be judged.
#[derive(Debug, Clone, Copy)]
pub struct JudgedStep<'a> {
    /// Id of the run that the episode belongs to, if any.
    pub run: Option<&'a str>,
    /// Id of the episode.
    pub episode: &'a str,
    /// Scenario of the episode.
    pub scenario: &'a Scenario,
    /// Actions of the episode; the judged step is the last one.
    pub log: &'a ActionLog,
    /// Observation before the step; `None` unless a model judges.
    pub before: Option<&'a TimeStep>,
    /// Observation after the step; `None` unless a model judges.
    pub after: Option<&'a TimeStep>,
}

impl JudgedStep<'_> {
    /// Returns the action of the step in its wire form.
    fn action_text(&self) -> String {
        let action = self.log.step(self.log.len().saturating_sub(1));
        wire_format(self.scenario.task()).write_action(action)
    }
}

/// Verdicts of both judges on one step.
#[derive(Debug, Clone)]
pub struct StepVerdicts {
    /// Verdict of the model; `None` if no model was asked.
    pub model: Option<ModelVerdict>,
    /// Verdict of the rules; `None` if the world does not value single steps.
    pub rules: Option<Judgement>,
}

impl StepVerdicts {
    /// Returns the verdict that counts: the model's if a model was asked, the rules' otherwise.
    #[must_use]
    pub fn effective(&self) -> Option<StepVerdict> {
        match &self.model {
            Some(model) => model.result.as_ref().ok().cloned(),
            None => self
                .rules
                .as_ref()
                .map(|rules| StepVerdict { score: rules.value, reasoning: rules.explanation.clone() }),
        }
    }
}

/// Judges of a server.
#[derive(Debug, Clone)]
pub struct Judges {
    default_judge: Judge,
    model: Option<ModelJudge>,
    /// Limits how many judgements by the rules run at once: each one simulates the rest of an episode.
    rule_slots: Arc<Semaphore>,
}

impl Default for Judges {
    fn default() -> Self {
        Self::new(Judge::Off, None)
    }
}

impl Judges {
    /// Creates the judges of a server. Sessions without a setting of their own use `default_judge`.
    #[must_use]
    pub fn new(default_judge: Judge, model: Option<ModelJudge>) -> Self {
        let processors = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        Self { default_judge, model, rule_slots: Arc::new(Semaphore::new(processors)) }
    }

    /// Returns true if a model can judge.
    #[must_use]
    pub const fn has_model(&self) -> bool {
        self.model.is_some()
    }

    /// Returns the model that judges, if there is one.
    #[must_use]
    pub const fn model(&self) -> Option<&ModelJudge> {
        self.model.as_ref()
    }

    /// Returns the judge of a session: the requested one or the default, and the rules instead of a missing model.
    #[must_use]
    pub fn resolve(&self, requested: Option<Judge>) -> Judge {
        match requested.unwrap_or(self.default_judge) {
            Judge::Llm if self.model.is_none() => Judge::Deterministic,
            judge => judge,
        }
    }

    /// Judges a step by the rules and, for [`Judge::Llm`], by the model at the same time.
    pub async fn judge(&self, judge: Judge, step: JudgedStep<'_>) -> StepVerdicts {
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
            self.judge_by_rules(step.scenario.clone(), step.log.clone()).await
        };
        let (model, rules) = tokio::join!(model, rules);
        StepVerdicts { model, rules }
    }

    async fn judge_by_rules(&self, scenario: Scenario, log: ActionLog) -> Option<Judgement> {
        // The semaphore is never closed; if it were, only the limit would be lost.
        let _slot = self.rule_slots.acquire().await.ok();
        let judged = tokio::task::spawn_blocking(move || scenario.task().judge_step(&scenario, &log)).await;
        match judged {
            Ok(Ok(judged)) => judged,
            Ok(Err(error)) => {
                tracing::warn!(%error, "The judge failed on a step.");
                None
            }
            Err(error) => {
                tracing::error!(%error, "The judge panicked on a step.");
                None
            }
        }
    }
}
