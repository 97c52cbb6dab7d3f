//! A turn of a harness session: the language model acts until the episode is over.

use clock::Millis;
use llm_policy::{ChatPolicy, ChatTurn, Completion, TimeStep};
use serde_json::{Value, json};

use super::error_message::session_error_message;
use super::step_response;
use crate::sessions::Session;

/// Name of the tool whose calls are the model's actions.
const TOOL: &str = "step";

/// Event of a turn, before it has a time.
pub(super) struct TurnEvent {
    /// Type of the event, such as `tool_call`.
    pub(super) kind: &'static str,
    /// Data of the event.
    pub(super) data: Value,
    /// Time since the event occurred, in milliseconds.
    pub(super) ago: Millis,
}

impl TurnEvent {
    const fn now(kind: &'static str, data: Value) -> Self {
        Self { kind, data, ago: 0 }
    }
}

/// Events of one step of a turn.
pub(super) struct TurnEvents {
    /// Events in the order of their occurrence.
    pub(super) list: Vec<TurnEvent>,
    /// End of the turn, or why the session must end with it; `None` if the turn goes on.
    pub(super) end: Option<Result<(), String>>,
}

/// Turn of a harness session.
pub(super) struct HarnessTurn<'a> {
    session: &'a mut Session,
    policy: &'a mut ChatPolicy,
}

impl<'a> HarnessTurn<'a> {
    pub(super) const fn new(session: &'a mut Session, policy: &'a mut ChatPolicy) -> Self {
        Self { session, policy }
    }

    /// Asks the model for an action and steps the episode by it.
    pub(super) async fn next(&mut self) -> TurnEvents {
        let mut list = Vec::new();
        let end = match self.step(&mut list).await {
            Ok(false) => None,
            Ok(true) => {
                list.push(TurnEvent::now("turn_complete", self.summary()));
                Some(Ok(()))
            }
            Err(message) => Some(Err(message)),
        };
        TurnEvents { list, end }
    }

    /// Steps the episode. Returns true if it is over.
    async fn step(&mut self, events: &mut Vec<TurnEvent>) -> Result<bool, String> {
        let seen = self.time_step()?;
        let turn = self.policy.act(&seen).await.map_err(|error| error.to_string())?;
        let model = self.policy.model().to_owned();
        events.extend(call_events(&model, &turn.completions));
        let arguments = turn.action.clone();
        events.push(TurnEvent::now("tool_call", json!({"tool_name": TOOL, "arguments": arguments})));
        let view = self.session.step(&turn.action).await.map_err(|error| session_error_message(&error))?;
        let result = step_response::step_value(&view);
        let done = view.done;
        let data = json!({"tool_name": TOOL, "result": result, "error": turn_error(&turn)});
        events.push(TurnEvent::now("tool_result", data));
        Ok(done)
    }

    /// The observation that the model acts on.
    fn time_step(&self) -> Result<TimeStep, String> {
        let view = self.session.view().map_err(|error| session_error_message(&error))?;
        Ok(TimeStep { observation: view.observation(), reward: view.reward, done: view.done })
    }

    /// Data of the event that ends a turn: a sentence, and the state of the session.
    fn summary(&self) -> Value {
        let status = self.session.status();
        let score = self.session.view().ok().map(|view| view.episode.outcome().score);
        let score = score.map_or_else(String::new, |score| format!(" with a score of {score:.3}"));
        let response = format!("The episode is over after {} steps{score}.", status.steps);
        json!({"response": response, "done": true, "state": step_response::state_value(&status)})
    }
}

/// Error of a turn in which the model chose no action, so that the agents hold.
fn turn_error(turn: &ChatTurn) -> Value {
    turn.error.as_ref().map_or(Value::Null, |error| json!(error))
}

/// Events of calls of the model: a request and a response each. Calls follow each other, and the last one has just ended.
fn call_events(model: &str, completions: &[Completion]) -> Vec<TurnEvent> {
    let mut events = Vec::new();
    let mut ago = completions.iter().map(|call| call.latency_ms).fold(0, u64::saturating_add);
    for call in completions {
        let request = json!({"messages": call.messages, "model": model});
        events.push(TurnEvent { kind: "llm_request", data: request, ago: ago.cast_signed() });
        ago = ago.saturating_sub(call.latency_ms);
        let usage = json!({"prompt_tokens": call.tokens_in, "completion_tokens": call.tokens_out});
        let response = json!({"content": call.text, "usage": usage, "error": call.error});
        events.push(TurnEvent { kind: "llm_response", data: response, ago: ago.cast_signed() });
    }
    events
}

/// Returns the frame of an event. Its time is in seconds.
pub(super) fn harness_event(kind: &str, data: &Value, at: Millis) -> Value {
    json!({"type": kind, "timestamp": at as f64 / 1000.0, "data": data})
}
