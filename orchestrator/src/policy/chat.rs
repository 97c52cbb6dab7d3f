//! The policy: an observation in, an action out, by asking a model.

use std::time::Duration;

use designer::llm::{Ask, Bill, Call, Llm, LlmError, Message, Role, Tokens};
use serde::Serialize;
use serde_json::Value;
use tokio::time::Instant;

use super::answer;
use super::history::History;
use super::prompt::Briefing;

/// Characters of a bad answer that the model is shown again.
const SHOWN_AGAIN: usize = 400;

/// How a model is asked.
#[derive(Debug, Clone)]
pub struct ChatSettings {
    /// Whose budget the tokens are of.
    pub run: String,
    /// Exchanges that the model is told again, at most.
    pub history: usize,
    /// How freely the model chooses its words; where nothing is said, the endpoint decides.
    pub temperature: Option<f64>,
    /// Tokens of one answer, at most.
    pub max_tokens: u32,
}

/// What is seen.
#[derive(Debug, Clone, PartialEq)]
pub struct Seen {
    /// The observation in the wire form, with or without reward and end.
    pub observation: Value,
    /// The reward of the last step.
    pub reward: f64,
    /// The episode is over.
    pub done: bool,
}

impl Seen {
    /// The observation with reward and end in it.
    #[must_use]
    pub fn whole(&self) -> Value {
        let mut whole = self.observation.clone();
        if let Some(fields) = whole.as_object_mut() {
            fields.insert("reward".to_owned(), self.reward.into());
            fields.insert("done".to_owned(), self.done.into());
        }
        whole
    }
}

/// One call of the model, as it was.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Completion {
    /// The conversation it was asked with.
    pub messages: Vec<Message>,
    /// What it said, to the letter; none where it said nothing.
    pub text: Option<String>,
    /// It was cut off at the most tokens it may have.
    pub cut: bool,
    /// What was wrong with it.
    pub error: Option<String>,
    /// Tokens read.
    pub tokens_in: u64,
    /// Tokens written.
    pub tokens_out: u64,
    /// How long it took, further tries included.
    pub latency_ms: u64,
    /// Its tokens, where the endpoint was asked for them and tells.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tokens: Option<Tokens>,
}

/// Why a model gave no action.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lack {
    /// What it said is none, even when asked again.
    NoAction,
    /// The same, and the last answer was cut off for its length.
    CutOff,
    /// Its answer did not come in time.
    Late,
    /// The endpoint's answer was no chat completion.
    Nonsense,
}

/// One step: what was decided, and how that came about.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Turn {
    /// Which, counted from 1.
    pub step: u32,
    /// The action; doing nothing where the model gave none.
    pub action: Value,
    /// Why the model gave none.
    pub error: Option<String>,
    /// The same as a word; none where it gave one.
    #[serde(skip)]
    pub lack: Option<Lack>,
    /// How many of its answers were no action.
    pub invalid: u32,
    /// The calls: one, or two where the first answer was repaired.
    pub completions: Vec<Completion>,
}

impl Turn {
    /// What its calls came to: tokens in, tokens out, time.
    #[must_use]
    pub fn came_to(&self) -> (u64, u64, Duration) {
        let sum = |of: fn(&Completion) -> u64| self.completions.iter().map(of).fold(0, u64::saturating_add);
        (sum(|c| c.tokens_in), sum(|c| c.tokens_out), Duration::from_millis(sum(|c| c.latency_ms)))
    }
}

/// A model that flies one episode.
#[derive(Debug)]
pub struct ChatPolicy {
    llm: Llm,
    settings: ChatSettings,
    briefing: Briefing,
    history: History,
    steps: u32,
}

impl ChatPolicy {
    /// A model at the start of an episode.
    #[must_use]
    pub fn new(llm: Llm, briefing: Briefing, settings: ChatSettings) -> Self {
        let history = History::new(settings.history);
        Self { llm, settings, briefing, history, steps: 0 }
    }

    /// What the model is told of the task.
    #[must_use]
    pub const fn briefing(&self) -> &Briefing {
        &self.briefing
    }

    /// Decides a step. An answer that is no action is repaired once; a model that gives none even then, is too late, or
    /// whose answer makes no sense, does nothing, and the turn says why: that is the agent's doing.
    ///
    /// # Errors
    /// An endpoint that cannot be used: the episode cannot be flown by it.
    pub async fn act(&mut self, seen: &Seen) -> Result<Turn, LlmError> {
        let step = self.steps + 1;
        let asked = self.briefing.user(step, seen);
        let mut messages = vec![Message::new(Role::System, self.briefing.system())];
        messages.extend(self.history.messages());
        messages.push(Message::new(Role::User, &asked));
        let mut turn =
            Turn { step, action: Value::Null, error: None, lack: None, invalid: 0, completions: Vec::new() };
        let action = match self.decide(messages, &mut turn).await {
            Ok(action) => action,
            // The model's own: everything else is the endpoint's.
            Err(error @ (LlmError::Timeout { .. } | LlmError::Nonsense { .. })) => {
                turn.error = Some(error.to_string());
                let late = matches!(error, LlmError::Timeout { .. });
                turn.lack = Some(if late { Lack::Late } else { Lack::Nonsense });
                None
            }
            Err(error) => return Err(error),
        };
        self.steps = step;
        turn.action = action.unwrap_or_else(|| self.briefing.actions().hold());
        self.history.push(asked, self.briefing.actions().text(&turn.action));
        Ok(turn)
    }

    /// Asks, and once more with what was wrong.
    async fn decide(&self, mut messages: Vec<Message>, turn: &mut Turn) -> Result<Option<Value>, LlmError> {
        for _ in 0..2 {
            let (text, read) = self.ask(messages.clone(), turn).await?;
            let reason = match read {
                Ok(action) => {
                    (turn.error, turn.lack) = (None, None);
                    return Ok(Some(action));
                }
                Err(reason) => reason,
            };
            turn.invalid += 1;
            turn.error = Some(format!("the answer is no action: {reason}"));
            let cut = turn.completions.last().is_some_and(|completion| completion.cut);
            turn.lack = Some(if cut { Lack::CutOff } else { Lack::NoAction });
            let shown: String = text.chars().take(SHOWN_AGAIN).collect();
            // Some endpoints refuse a message without words.
            let shown = if shown.trim().is_empty() { "(nothing)".to_owned() } else { shown };
            messages.push(Message::new(Role::Assistant, shown));
            messages.push(Message::new(Role::User, self.briefing.repair(&reason)));
        }
        Ok(None)
    }

    /// One call: what was said, and the action in it or what is wrong with it.
    async fn ask(
        &self,
        messages: Vec<Message>,
        turn: &mut Turn,
    ) -> Result<(String, Result<Value, String>), LlmError> {
        let actions = self.briefing.actions();
        let ask = Ask {
            messages,
            schema: actions.schema().clone(),
            name: "action",
            max_tokens: self.settings.max_tokens,
            temperature: self.settings.temperature,
        };
        let (begun, mut bill) = (Instant::now(), Bill::default());
        let call = Call { run: &self.settings.run, ask: &ask, until: None };
        let answer = self.llm.ask(&call, &mut bill).await;
        let latency_ms = u64::try_from(begun.elapsed().as_millis()).unwrap_or(u64::MAX);
        let Bill { tokens_in, tokens_out, .. } = bill;
        let mut completion = Completion {
            messages: ask.messages,
            text: None,
            cut: false,
            error: None,
            tokens_in,
            tokens_out,
            latency_ms,
            tokens: None,
        };
        match answer {
            Ok(reply) => {
                let read = answer::read(&reply.text, actions, self.llm.config()).map_err(|reason| {
                    if reply.cut { format!("{reason}; it was cut off for its length") } else { reason }
                });
                completion.cut = reply.cut;
                completion.tokens = reply.tokens;
                if let (Some(last), Some(appended)) = (completion.messages.last_mut(), reply.appended) {
                    last.content.push_str(&appended);
                }
                completion.error = read.as_ref().err().cloned();
                completion.text = Some(reply.text.clone());
                turn.completions.push(completion);
                Ok((reply.text, read))
            }
            Err(error) => {
                completion.error = Some(error.to_string());
                turn.completions.push(completion);
                Err(error)
            }
        }
    }
}
