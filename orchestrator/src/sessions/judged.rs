//! What a judge changes of a session: reward, score so far, and an alert. What is stored of the episode stays as it was.

use env_core::task::Episode;
use serde_json::Value;

use crate::judging::{Judge, Step, Words};
use crate::policy::Seen;
use crate::store::signed;
use crate::store::verdicts::VerdictRow;

/// An episode as its judge has it.
#[derive(Debug, Clone, PartialEq)]
pub struct Standard {
    judge: Judge,
    reward: f64,
    total: f64,
    alert: Option<String>,
}

impl Standard {
    pub(super) const fn new(judge: Judge) -> Self {
        Self { judge, reward: 0.0, total: 0.0, alert: None }
    }

    /// Who judges.
    #[must_use]
    pub const fn judge(&self) -> Judge {
        self.judge
    }

    /// The reward of the last step.
    #[must_use]
    pub const fn reward(&self) -> f64 {
        self.reward
    }

    /// What a model is shown of the episode; none where no model judges.
    pub(super) fn look(&self, episode: &dyn Episode) -> Option<Seen> {
        (self.judge == Judge::Llm).then(|| Seen {
            observation: plain(episode),
            reward: episode.last_reward(),
            done: episode.done(),
        })
    }

    /// Counts a step. Where nobody could judge it, its reward is the world's.
    pub(super) fn count(&mut self, reward: f64, words: &Words) {
        let word = words.word();
        self.reward = word.as_ref().map_or(reward, |word| word.reward(reward));
        self.total += self.reward;
        self.alert = word.map(|word| word.alert());
    }

    /// Puts it into an observation.
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

/// What the agents see, without reward and end.
pub(super) fn plain(episode: &dyn Episode) -> Value {
    let mut observation = episode.telemetry();
    if let Some(fields) = observation.as_object_mut() {
        fields.remove("reward");
        fields.remove("done");
    }
    observation
}

/// What is kept of a model's verdict; none where no model was asked.
pub(super) fn row(step: &Step<'_>, words: &Words) -> Option<VerdictRow> {
    let said = words.model.as_ref()?;
    let (score, reasoning, error) = match &said.answer {
        Ok(sentence) => (Some(sentence.score), Some(sentence.reasoning.clone()), None),
        Err(why) => (None, None, Some(why.clone())),
    };
    let rules = words.rules.as_ref();
    Some(VerdictRow {
        run: step.run.map(str::to_owned),
        episode: step.episode.to_owned(),
        scenario: step.scenario.id().0.to_vec(),
        task: step.scenario.task().id().to_owned(),
        step: i64::try_from(step.log.len()).unwrap_or(i64::MAX),
        model: said.model.clone(),
        prompt: said.prompt.to_owned(),
        score,
        reasoning,
        error,
        rule_score: rules.map(|judged| judged.value),
        rule_case: rules.map(|judged| judged.case.to_owned()),
        cached: said.cached,
        tokens_in: signed(said.bill.tokens_in),
        tokens_out: signed(said.bill.tokens_out),
        cost: said.bill.cost,
        latency_ms: i64::try_from(said.latency.as_millis()).unwrap_or(i64::MAX),
    })
}
