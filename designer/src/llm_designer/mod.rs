//! [`LlmDesigner`]: asks a language model for layouts, and sends refused ones back with the gate's reasons.
//!
//! The model gets the brief as a prompt and a JSON schema for its answer. A model that is slow, down, rate limited, over
//! budget, or that answers badly costs a run nothing but its layouts: every problem is a warning or an [`LlmError`] within the
//! time limit, and the caller continues with another designer. Connections, retries and budgets belong to the crate `llm`.
//!
//! `extract` finds designs in an answer; [`prompt`] has the texts.

pub(crate) mod extract;
pub mod prompt;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use env_core::Scenario;
use llm::{
    ChatCall, ChatRequest, ChatResponse, LlmClient, LlmError, Message, OrderedSchema, Role, TokenUsage,
    sanitize_line_to,
};
use serde_json::{Value, json};
use tokio::time::Instant;

use self::extract::{ExtractedDesigns, extract_designs};
use self::prompt::RefusedLayout;
use crate::brief::DesignBrief;
use crate::designer::{DesignError, DesignFuture, DesignOutcome, DesignUsage, Designer, JudgedLayout};
use crate::gate::Gate;
use crate::refusal::Refusal;

/// Maximum number of layouts per call.
const MAX_LAYOUTS_PER_CALL: usize = 8;
/// Maximum number of repairs in one conversation.
const MAX_REPAIRS: u32 = 3;
/// Number of base scenarios in which each design is tried.
const BASES_PER_DESIGN: u64 = 8;
/// Number of layouts of an answer that are judged, per requested layout.
const JUDGED_PER_REQUESTED: usize = 2;
/// Length limit of a design that is stored and sent back for repair, in bytes. A full design has about 2000.
const MAX_DESIGN_BYTES: usize = 8 * 1024;
/// Length limit of an unreadable answer that is sent back, in characters.
const MAX_QUOTED_CHARS: usize = 400;
/// Length limit of the name of a layout, in characters.
const MAX_NAME_CHARS: usize = 60;

/// Designer of one run that asks a language model.
///
/// Its future waits for the network and yields between designs. Judging one design blocks for as long as the planner runs, so run
/// it on a thread of its own or on a runtime with spare threads.
#[derive(Debug, Clone)]
pub struct LlmDesigner {
    client: LlmClient,
    run: String,
}

impl LlmDesigner {
    /// Creates the designer of a run, whose budget pays for the calls.
    #[must_use]
    pub fn new(client: LlmClient, run: &str) -> Self {
        Self { client, run: run.to_owned() }
    }

    /// Holds conversations until there are enough layouts, or one adds none.
    async fn design_layouts(
        &self,
        brief: &DesignBrief,
        gate: &mut Gate,
    ) -> Result<DesignOutcome, DesignError> {
        let started = Instant::now();
        let deadline = brief.time_limit.and_then(|limit| started.checked_add(limit));
        let mut outcome = DesignOutcome::default();
        outcome.usage.model = Some(self.client.config().model.clone());
        outcome.usage.prompt = Some(gate.language().prompt_texts().version.to_owned());
        let mut failure = None;
        while outcome.admitted() < brief.count && failure.is_none() {
            let before = outcome.admitted();
            failure = self.converse(brief, gate, deadline, &mut outcome).await.err();
            if outcome.admitted() == before {
                break;
            }
        }
        outcome.usage.latency = started.elapsed();
        match failure {
            Some(error) if outcome.usage.rounds == 0 => return Err(DesignError::Model(error)),
            // Earlier rounds are kept, also refused layouts: they show how well the model does.
            Some(LlmError::Timeout { .. }) if is_over(deadline) => {
                let seconds = started.elapsed().as_secs_f64();
                outcome.warnings.push(format!("the time limit ended the request after {seconds:.0} s"));
            }
            Some(error) => outcome.warnings.push(error.to_string()),
            None => {}
        }
        Ok(outcome)
    }

    /// Holds one conversation: a request for layouts and its repairs.
    async fn converse(
        &self,
        brief: &DesignBrief,
        gate: &mut Gate,
        deadline: Option<Instant>,
        outcome: &mut DesignOutcome,
    ) -> Result<(), LlmError> {
        let started = Instant::now();
        let count = brief.count.saturating_sub(outcome.admitted()).min(MAX_LAYOUTS_PER_CALL);
        let opening = prompt::opening(brief, gate.language(), count);
        let schema = gate.language().schema(brief);
        let mut requested = count;
        let mut messages = opening.clone();
        for round in 1..=1 + MAX_REPAIRS {
            if is_over(deadline) {
                return Err(LlmError::Timeout { after: started.elapsed() });
            }
            let request = self.request(messages.clone(), list_schema(&schema, requested));
            let response = self.complete(&request, deadline, outcome).await?;
            outcome.usage.rounds += 1;
            let exchange =
                match extract_designs(&response.text, gate.language(), JUDGED_PER_REQUESTED * requested) {
                    Ok(mut found) => {
                        found
                            .designs
                            .iter_mut()
                            .for_each(|design| self.client.config().redact_key_in(design));
                        let refused = judge(brief, gate, found, round, outcome).await;
                        if refused.is_empty() || outcome.admitted() >= brief.count {
                            return Ok(());
                        }
                        requested = refused.len().min(MAX_LAYOUTS_PER_CALL);
                        repair_exchange(&refused[..requested])
                    }
                    Err(reason) => unreadable_exchange(&response, &reason, requested, round, outcome),
                };
            // Only the last refusals: a growing conversation would exceed the context of a small model.
            messages.clone_from(&opening);
            messages.extend(exchange);
        }
        Ok(())
    }

    fn request(&self, messages: Vec<Message>, schema: Value) -> ChatRequest {
        ChatRequest {
            messages,
            schema: Arc::new(schema),
            schema_name: "layouts",
            max_tokens: self.client.config().max_tokens,
            temperature: None,
        }
    }

    /// Sends a request and adds its usage to the outcome, also if it fails.
    async fn complete(
        &self,
        request: &ChatRequest,
        deadline: Option<Instant>,
        outcome: &mut DesignOutcome,
    ) -> Result<ChatResponse, LlmError> {
        let mut usage = TokenUsage::default();
        let call = ChatCall { run: &self.run, request, deadline };
        let result = self.client.complete(&call, &mut usage).await;
        let DesignUsage { tokens_in, tokens_out, cost, .. } = &mut outcome.usage;
        *tokens_in = tokens_in.saturating_add(usage.tokens_in);
        *tokens_out = tokens_out.saturating_add(usage.tokens_out);
        *cost += usage.cost;
        result
    }
}

impl Designer for LlmDesigner {
    fn name(&self) -> &'static str {
        "llm"
    }

    fn design<'a>(&'a mut self, brief: &'a DesignBrief, gate: &'a mut Gate) -> DesignFuture<'a> {
        Box::pin(self.design_layouts(brief, gate))
    }
}

/// Design that the gate refused.
struct RefusedDesign {
    /// JSON of the design, as the model wrote it; `{}` if it is too long.
    json: String,
    name: String,
    refusal: Refusal,
}

fn is_over(deadline: Option<Instant>) -> bool {
    deadline.is_some_and(|deadline| Instant::now() >= deadline)
}

/// Judges the designs of one answer until there are enough. Returns the refused ones, for the next round.
async fn judge(
    brief: &DesignBrief,
    gate: &mut Gate,
    found: ExtractedDesigns,
    round: u32,
    outcome: &mut DesignOutcome,
) -> Vec<RefusedDesign> {
    if found.dropped > 0 {
        let dropped = found.dropped;
        outcome.warnings.push(format!(
            "round {round}: {dropped} layouts were ignored, beyond twice the requested number"
        ));
    }
    if !found.is_pure_json {
        outcome.warnings.push(format!("round {round}: the answer has text beside its JSON"));
    }
    let mut refused = Vec::new();
    for design in found.designs {
        if outcome.admitted() >= brief.count {
            break;
        }
        let attempt = outcome.judged.len() as u64;
        let verdict = gate.judge(brief, &design, base_scenarios(brief, attempt));
        let name = design_name(&design);
        let json = serde_json::to_string(&OrderedSchema(&design)).unwrap_or_default();
        let is_short = json.len() <= MAX_DESIGN_BYTES;
        if let Err(refusal) = &verdict {
            let json = if is_short { json } else { "{}".to_owned() };
            refused.push(RefusedDesign { json, name: name.clone(), refusal: refusal.clone() });
        }
        if !is_short {
            let warning =
                format!("round {round}: a layout of more than {MAX_DESIGN_BYTES} bytes was not stored");
            outcome.warnings.push(warning);
        }
        outcome.judged.push(JudgedLayout {
            name,
            design: is_short.then_some(design),
            attempt,
            round,
            verdict,
        });
        tokio::task::yield_now().await;
    }
    refused
}

/// Returns the base scenarios in which the design of an attempt is tried. Each design gets its own: layouts with the same start would
/// teach less.
pub(crate) fn base_scenarios(brief: &DesignBrief, attempt: u64) -> impl Iterator<Item = Scenario> {
    let first = attempt.saturating_mul(BASES_PER_DESIGN);
    (first..first.saturating_add(BASES_PER_DESIGN)).map(|number| brief.base_scenario(number))
}

/// Returns the refused designs as the model's answer, and the message that asks for their repair.
fn repair_exchange(refused: &[RefusedDesign]) -> [Message; 2] {
    let designs = refused.iter().map(|refused| refused.json.as_str()).collect::<Vec<_>>().join(",");
    let layouts = refused.iter().enumerate().map(|(index, refused)| RefusedLayout {
        number: index + 1,
        name: &refused.name,
        refusal: &refused.refusal,
    });
    let repair = prompt::repair(&layouts.collect::<Vec<_>>());
    [Message::new(Role::Assistant, format!("{{\"layouts\":[{designs}]}}")), repair]
}

/// Returns the beginning of an unreadable answer, and the message that asks for another one. Adds a warning.
fn unreadable_exchange(
    response: &ChatResponse,
    reason: &str,
    requested: usize,
    round: u32,
    outcome: &mut DesignOutcome,
) -> [Message; 2] {
    let cut = if response.is_truncated { "; it was cut off at the maximum number of tokens" } else { "" };
    let reason = format!("{reason}{cut}");
    outcome.warnings.push(format!("round {round}: the answer has no layouts: {reason}"));
    let quoted: String = response.text.chars().take(MAX_QUOTED_CHARS).collect();
    [Message::new(Role::Assistant, quoted), prompt::unreadable(&reason, requested)]
}

/// Returns the name of a design as one short line: a model may have put anything there.
fn design_name(design: &Value) -> String {
    let name = design.get("name").and_then(Value::as_str).unwrap_or_default();
    sanitize_line_to(name, MAX_NAME_CHARS)
}

/// Returns the schema of an object with a list of exactly `count` layouts.
fn list_schema(schema: &Value, count: usize) -> Value {
    json!({
        "type": "object",
        "additionalProperties": false,
        "required": ["layouts"],
        "properties": {"layouts": {"type": "array", "minItems": count, "maxItems": count, "items": schema}},
    })
}
