//! The designer that asks a model.

use std::sync::Arc;

use serde_json::{Value, json};
use tokio::time::Instant;

use super::chat::{Ask, Message, Role};
use super::client::{Bill, Call};
use super::extract::{self, Found};
use super::ordered::Ordered;
use super::{Llm, LlmError, prompt};
use crate::brief::Brief;
use crate::gate::{Gate, Judged, Refusal, Usage};
use crate::{DesignError, Designed, Designer, Designing};

/// Layouts asked for in one call, at most.
const PER_CALL: usize = 8;
/// Rounds of repair in one conversation, at most.
pub(super) const REPAIRS: u32 = 3;
/// Skies that a design is tried under.
const SKIES: u64 = 8;
/// Layouts of an answer that are looked at, for each that was asked for.
const LOOKED_AT: usize = 2;
/// Bytes of a design that are kept, and sent back for repair: a full one has some 2 000.
const KEPT: usize = 8 * 1024;
/// Characters of an answer without designs that are sent back.
const SENT_BACK: usize = 400;

/// A run's designer on a model. Its future waits for the network and, between designs, lets other tasks of the executor
/// go first; but judging one design takes the planner's time (milliseconds to tenths of a second), so run it where that
/// blocks nobody: a worker of its own, or a runtime with threads to spare.
#[derive(Debug, Clone)]
pub struct LlmDesigner {
    llm: Llm,
    run: String,
}

impl LlmDesigner {
    pub(super) fn new(llm: Llm, run: &str) -> Self {
        Self { llm, run: run.to_owned() }
    }

    /// Conversations until there are enough layouts, or one brings none.
    async fn layouts(&self, brief: &Brief, gate: &mut Gate) -> Result<Designed, DesignError> {
        let begun = Instant::now();
        let until = brief.patience.and_then(|patience| begun.checked_add(patience));
        let mut designed = Designed::default();
        designed.usage.model = Some(self.llm.config().model.clone());
        designed.usage.prompt = Some(prompt::version(brief));
        let mut ended = None;
        while designed.admitted() < brief.count && ended.is_none() {
            let before = designed.admitted();
            ended = self.converse(brief, gate, until, &mut designed).await.err();
            if designed.admitted() == before {
                break;
            }
        }
        designed.usage.latency = begun.elapsed();
        match ended {
            // What was judged before is worth keeping, the refused too: they tell how the model does.
            Some(error) if designed.usage.rounds == 0 => Err(DesignError::Model(error)),
            Some(error) => {
                designed.troubles.push(match error {
                    LlmError::Timeout { .. } if over(until) => {
                        format!("its time was over after {:.0} s", begun.elapsed().as_secs_f64())
                    }
                    error => error.to_string(),
                });
                Ok(designed)
            }
            None => Ok(designed),
        }
    }

    /// One conversation: a question and its repairs.
    async fn converse(
        &self,
        brief: &Brief,
        gate: &mut Gate,
        until: Option<Instant>,
        designed: &mut Designed,
    ) -> Result<(), LlmError> {
        let begun = Instant::now();
        let count = brief.count.saturating_sub(designed.admitted()).min(PER_CALL);
        let opening = prompt::opening(brief, gate.language(), count);
        let schema = gate.language().schema(brief);
        let mut wanted = count;
        let mut messages = opening.clone();
        for round in 1..=1 + REPAIRS {
            if over(until) {
                return Err(LlmError::Timeout { after: begun.elapsed() });
            }
            let ask = Ask {
                messages: messages.clone(),
                schema: Arc::new(list_of(&schema, wanted)),
                name: "layouts",
                max_tokens: self.llm.config().max_tokens,
                temperature: None,
            };
            let mut bill = Bill::default();
            let answer = self.llm.ask(&Call { run: &self.run, ask: &ask, until }, &mut bill).await;
            spend(&mut designed.usage, bill);
            let reply = answer?;
            designed.usage.rounds += 1;
            let (said, answer) = match extract::designs(&reply.text, LOOKED_AT * wanted) {
                Ok(mut found) => {
                    found.designs.iter_mut().for_each(|design| self.llm.config().scrub_value(design));
                    let refused = judge(brief, gate, found, round, designed).await;
                    if refused.is_empty() || designed.admitted() >= brief.count {
                        return Ok(());
                    }
                    wanted = refused.len().min(PER_CALL);
                    told(&refused[..wanted])
                }
                Err(reason) => {
                    let cut = if reply.cut { "; it was cut off at the most tokens it may have" } else { "" };
                    let reason = format!("{reason}{cut}");
                    designed.troubles.push(format!("round {round}: the answer holds no layouts: {reason}"));
                    let said: String = reply.text.chars().take(SENT_BACK).collect();
                    (Message::new(Role::Assistant, said), prompt::nonsense(&reason, wanted))
                }
            };
            // Only what was refused last: a conversation that grew would outgrow a small model's memory.
            messages.clone_from(&opening);
            messages.extend([said, answer]);
        }
        Ok(())
    }
}

impl Designer for LlmDesigner {
    fn name(&self) -> &'static str {
        "llm"
    }

    fn design<'a>(&'a mut self, brief: &'a Brief, gate: &'a mut Gate) -> Designing<'a> {
        Box::pin(self.layouts(brief, gate))
    }
}

/// A refused design: its text, its name, and why.
struct Refused {
    text: String,
    name: String,
    why: Refusal,
}

/// Whether there is no time left for another call.
fn over(until: Option<Instant>) -> bool {
    until.is_some_and(|until| Instant::now() >= until)
}

fn spend(usage: &mut Usage, bill: Bill) {
    usage.tokens_in = usage.tokens_in.saturating_add(bill.tokens_in);
    usage.tokens_out = usage.tokens_out.saturating_add(bill.tokens_out);
    usage.cost += bill.cost;
}

/// Judges the designs of one answer until there are enough; those refused are for the next round.
async fn judge(
    brief: &Brief,
    gate: &mut Gate,
    found: Found,
    round: u32,
    designed: &mut Designed,
) -> Vec<Refused> {
    if found.more > 0 {
        let more = found.more;
        designed.troubles.push(format!(
            "round {round}: {more} layouts more than twice what was asked for were not looked at"
        ));
    }
    if !found.whole {
        designed
            .troubles
            .push(format!("round {round}: the answer is not JSON as a whole; layouts were found in it"));
    }
    let mut refused = Vec::new();
    for design in found.designs {
        if designed.admitted() >= brief.count {
            break;
        }
        // Each under skies of its own: layouts that all begin alike would teach less.
        let first = designed.judged.len() as u64 * SKIES;
        let verdict = gate.judge(brief, &design, (first..first + SKIES).map(|number| brief.sky(number)));
        let name = name(&design);
        let text = serde_json::to_string(&Ordered(&design)).unwrap_or_default();
        let small = text.len() <= KEPT;
        if let Err(why) = &verdict {
            let text = if small { text } else { "{}".to_owned() };
            refused.push(Refused { text, name: name.clone(), why: why.clone() });
        }
        if !small {
            designed.troubles.push(format!("round {round}: a layout of more than {KEPT} bytes is not kept"));
        }
        designed.judged.push(Judged { name, design: small.then_some(design), round, verdict });
        tokio::task::yield_now().await;
    }
    refused
}

/// The refused designs as the model gave them, and what is said of them.
fn told(refused: &[Refused]) -> (Message, Message) {
    let texts = refused.iter().map(|refused| refused.text.as_str()).collect::<Vec<_>>().join(",");
    let said = Message::new(Role::Assistant, format!("{{\"layouts\":[{texts}]}}"));
    let why = refused.iter().enumerate().map(|(at, r)| (at + 1, r.name.clone(), r.why.clone()));
    (said, prompt::repair(&why.collect::<Vec<_>>()))
}

/// A design's name, short and in one line: a model may have put anything there.
fn name(design: &Value) -> String {
    let given = design.get("name").and_then(Value::as_str).unwrap_or_default();
    super::error::shortened(given, 60)
}

fn list_of(schema: &Value, count: usize) -> Value {
    json!({
        "type": "object",
        "additionalProperties": false,
        "required": ["layouts"],
        "properties": {"layouts": {"type": "array", "minItems": count, "maxItems": count, "items": schema}},
    })
}
