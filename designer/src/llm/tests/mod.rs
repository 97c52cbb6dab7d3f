//! The designer against endpoints that misbehave, and what it says to those that do not.

mod breaker;
mod faults;
mod key;
mod modes;
mod patience;
mod repair;
mod tokens;
mod words;

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use env_core::Recipe;
use serde_json::{Value, json};
use wiremock::matchers::{method, path};
use wiremock::{Mock, MockServer, Request, Respond, ResponseTemplate};

use super::chat::{Ask, Calling, Chat, Message, Reply, Role};
use super::client::{Bill, Call};
use super::{Llm, LlmConfig, LlmError, WallClock};
use crate::brief::Brief;
use crate::gate::Gate;
use crate::procedural::Procedural;
use crate::{Designed, Designer, language};

/// 2026-01-01 00:00 UTC.
pub(super) const NEW_YEAR_MS: i64 = 1_767_225_600_000;

pub(super) fn brief(count: usize) -> Brief {
    let task = env_core::task("kessler/survival").unwrap();
    let recipe = Recipe::with_params(task, task.levels().params(3)).unwrap();
    Brief::new(Arc::new(recipe), count, 7).at_level(task.levels(), 3)
}

pub(super) fn gate(brief: &Brief) -> Gate {
    Gate::new(language(brief.base.task()).unwrap(), Vec::new())
}

/// Designs that pass the gate under a brief's first sky.
pub(super) fn good(count: usize) -> Vec<Value> {
    let brief = brief(count);
    let designed = Procedural::layouts(&brief, &mut gate(&brief));
    let designs: Vec<Value> = designed
        .judged
        .into_iter()
        .filter(|judged| judged.verdict.is_ok())
        .filter_map(|judged| judged.design)
        // The procedural designer draws a sky a try; a model's designs are tried under the first eight.
        .filter(|design| {
            let skies = (0..8).map(|number| brief.sky(number));
            gate(&brief).judge(&brief, design, skies).is_ok()
        })
        .collect();
    assert!(!designs.is_empty());
    designs
}

pub(super) fn list(designs: &[Value]) -> String {
    json!({ "layouts": designs }).to_string()
}

/// A chat completion that says this.
pub(super) fn completion(text: &str) -> Value {
    json!({
        "id": "1", "object": "chat.completion",
        "choices": [{"index": 0, "message": {"role": "assistant", "content": text}, "finish_reason": "stop"}],
        "usage": {"prompt_tokens": 100, "completion_tokens": 50, "total_tokens": 150},
    })
}

pub(super) fn says(text: &str) -> ResponseTemplate {
    ResponseTemplate::new(200).set_body_json(completion(text))
}

/// A config with short times.
pub(super) fn config(url: &str) -> LlmConfig {
    let mut config = LlmConfig::new(format!("{url}/v1"), "small", WallClock::new(|| NEW_YEAR_MS));
    config.timeout = Duration::from_millis(1500);
    config.backoff = Duration::from_millis(5);
    config
}

/// Answers in turn; the last for ever.
struct Script(Mutex<VecDeque<ResponseTemplate>>);

impl Respond for Script {
    fn respond(&self, _: &Request) -> ResponseTemplate {
        let mut left = self.0.lock().unwrap();
        if left.len() > 1 { left.pop_front().unwrap() } else { left[0].clone() }
    }
}

/// An endpoint that answers so in turn.
pub(super) async fn endpoint(answers: impl IntoIterator<Item = ResponseTemplate>) -> MockServer {
    let server = MockServer::start().await;
    let script = Script(Mutex::new(answers.into_iter().collect()));
    Mock::given(method("POST")).and(path("/v1/chat/completions")).respond_with(script).mount(&server).await;
    server
}

/// What an endpoint was sent.
pub(super) async fn sent(server: &MockServer) -> Vec<Value> {
    let requests = server.received_requests().await.unwrap();
    requests.iter().map(|request| serde_json::from_slice(&request.body).unwrap()).collect()
}

/// Designs `count` layouts at this endpoint.
pub(super) async fn design(llm: &Llm, count: usize) -> Result<Designed, LlmError> {
    let brief = brief(count);
    llm.designer("r").design(&brief, &mut gate(&brief)).await.map_err(|error| match error {
        crate::DesignError::Model(error) => error,
        other => panic!("{other}"),
    })
}

pub(super) fn question() -> Ask {
    Ask {
        messages: vec![Message::new(Role::User, "a question")],
        schema: Arc::new(json!({"type": "object"})),
        name: "answer",
        max_tokens: 100,
        temperature: None,
    }
}

/// Asks a question, for a run.
pub(super) async fn asks(llm: &Llm, run: &str) -> Result<Reply, LlmError> {
    billed(llm, run).await.0
}

/// The same with what it came to.
pub(super) async fn billed(llm: &Llm, run: &str) -> (Result<Reply, LlmError>, Bill) {
    let (ask, mut bill) = (question(), Bill::default());
    (llm.ask(&Call { run, ask: &ask, until: None }, &mut bill).await, bill)
}

/// A model without a network, so that time can be paused: answers in turn, each after a while.
pub(super) struct Puppet {
    pub(super) takes: Duration,
    pub(super) answers: Mutex<VecDeque<Result<Reply, LlmError>>>,
    pub(super) asked: Arc<Mutex<u32>>,
}

pub(super) fn reply(text: &str) -> Reply {
    Reply { text: text.to_owned(), tokens_in: Some(100), tokens_out: Some(50), ..Reply::default() }
}

impl Puppet {
    /// An endpoint of one, and how often it was asked. The last answer is for ever.
    pub(super) fn llm(
        config: LlmConfig,
        takes: Duration,
        answers: impl IntoIterator<Item = Result<Reply, LlmError>>,
    ) -> (Llm, Arc<Mutex<u32>>) {
        let asked = Arc::default();
        let puppet =
            Self { takes, answers: Mutex::new(answers.into_iter().collect()), asked: Arc::clone(&asked) };
        (Llm::with(config, Box::new(puppet)).unwrap(), asked)
    }
}

impl Chat for Puppet {
    fn ask<'a>(&'a self, _: &'a Ask, requests: &'a mut u32) -> Calling<'a> {
        Box::pin(async move {
            *requests = requests.saturating_sub(1);
            *self.asked.lock().unwrap() += 1;
            tokio::time::sleep(self.takes).await;
            let mut answers = self.answers.lock().unwrap();
            if answers.len() > 1 { answers.pop_front().unwrap() } else { answers[0].clone() }
        })
    }

    fn mode(&self) -> &'static str {
        "text"
    }
}
