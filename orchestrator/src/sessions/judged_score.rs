//! Reward, score and alerts of an episode as a judge changes them for the client. The stored episode does not change.

use api_types::Judge;
use env_core::task::Episode;
use serde_json::Value;
use store::step_verdicts::StepVerdictRow;
use store::to_i64;

use llm_policy::TimeStep;
use llm_policy::judging::{JudgedStep, StepVerdicts};

/// Reward and score of an episode under a judge.
#[derive(Debug, Clone, PartialEq)]
pub struct JudgedScore {
    judge: Judge,
    /// Judged reward of the last step.
    reward: f64,
    /// Sum of the judged rewards.
    total: f64,
    /// Alert of the last step.
    alert: Option<String>,
}

impl JudgedScore {
    /// Creates the score of an episode that begins.
    pub(super) const fn new(judge: Judge) -> Self {
        Self { judge, reward: 0.0, total: 0.0, alert: None }
    }

    /// Returns the kind of the judge.
    #[must_use]
    pub const fn judge(&self) -> Judge {
        self.judge
    }

    /// Returns the judged reward of the last step.
    #[must_use]
    pub const fn reward(&self) -> f64 {
        self.reward
    }

    /// Captures what a model judge needs of the episode now; `None` if no model judges.
    pub(super) fn capture(&self, episode: &dyn Episode) -> Option<TimeStep> {
        (self.judge == Judge::Llm).then(|| TimeStep {
            observation: observation_without_reward(episode),
            reward: episode.last_reward(),
            done: episode.done(),
        })
    }

    /// Adds a step with its verdicts. Without a verdict the reward of the world counts.
    pub(super) fn add_step(&mut self, reward: f64, verdicts: &StepVerdicts) {
        let verdict = verdicts.effective();
        self.reward = verdict.as_ref().map_or(reward, |verdict| verdict.weighted_reward(reward));
        self.total += self.reward;
        self.alert = verdict.map(|verdict| verdict.alert());
    }

    /// Replaces the score in an observation and adds the alert.
    pub(super) fn amend(&self, observation: &mut Value) {
        let Some(fields) = observation.as_object_mut() else { return };
        if let Some(total) = fields.get_mut("total_score") {
            *total = self.total.into();
        }
        if let (Some(alert), Some(Value::Array(alerts))) = (&self.alert, fields.get_mut("critical_alerts")) {
            alerts.push(alert.as_str().into());
        }
    }
}

/// Returns the observation without the fields `reward` and `done`.
pub(super) fn observation_without_reward(episode: &dyn Episode) -> Value {
    let mut observation = episode.telemetry();
    if let Some(fields) = observation.as_object_mut() {
        fields.remove("reward");
        fields.remove("done");
    }
    observation
}

/// Creates the row of a model's verdict; `None` if no model was asked.
pub(super) fn verdict_row(step: &JudgedStep<'_>, verdicts: &StepVerdicts) -> Option<StepVerdictRow> {
    let model = verdicts.model.as_ref()?;
    let (score, reasoning, error) = match &model.result {
        Ok(verdict) => (Some(verdict.score), Some(verdict.reasoning.clone()), None),
        Err(reason) => (None, None, Some(reason.clone())),
    };
    let rules = verdicts.rules.as_ref();
    Some(StepVerdictRow {
        run: step.run.map(str::to_owned),
        episode: step.episode.to_owned(),
        scenario: step.scenario.id().0.to_vec(),
        task: step.scenario.task().id().to_owned(),
        step: i64::try_from(step.log.len()).unwrap_or(i64::MAX),
        model: model.model.clone(),
        prompt_version: model.prompt_version.to_owned(),
        score,
        reasoning,
        error,
        rule_score: rules.map(|rules| rules.value),
        rule_case: rules.map(|rules| rules.case.to_owned()),
        is_cached: model.is_cached,
        tokens_in: to_i64(model.usage.tokens_in),
        tokens_out: to_i64(model.usage.tokens_out),
        cost: model.usage.cost,
        latency_ms: i64::try_from(model.latency.as_millis()).unwrap_or(i64::MAX),
    })
}
