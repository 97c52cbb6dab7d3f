//! Designers that follow a script, and requests to them.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use designer::procedural::ProceduralDesigner;
use designer::{DesignBrief, DesignError, DesignFuture, DesignOutcome, Designer, Gate};
use designer::{DesignUsage, JudgedLayout};
use llm::LlmError;
use orchestrator::designs::{DesignerKind, Designers};
use serde_json::{Value, json};
use system_tests::ApiClient;

use super::wait_for_response;

/// Requests a design over the API and waits for the end of the request.
pub(crate) async fn request_design(api: &ApiClient, request: Value) -> Value {
    let response = api.post("/v1/runs/run/designs", request).await.expect(202);
    let path = format!("/v1/runs/run/designs/requests/{}", response["id"].as_str().expect("an id"));
    wait_for_response(api, &path, |request| request["ended_at"].is_string()).await
}

/// Behaviour of a scripted designer when the server requests layouts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) enum Behaviour {
    /// Designs as the procedural designer does.
    #[default]
    Normal,
    /// Returns an error at once.
    Error,
    /// Panics in the worker thread.
    Panic,
    /// Returns a hundred invalid designs.
    Invalid,
    /// Never returns a result.
    Hang,
}

/// Behaviours of the designers of a server; tests change them while the server runs.
#[derive(Debug, Clone, Default)]
pub(crate) struct DesignerScript(Arc<Mutex<Behaviours>>);

#[derive(Debug, Default)]
struct Behaviours {
    llm: Behaviour,
    procedural: Behaviour,
}

impl DesignerScript {
    pub(crate) fn set_llm(&self, behaviour: Behaviour) {
        self.0.lock().expect("the lock is not poisoned").llm = behaviour;
    }

    pub(crate) fn set_procedural(&self, behaviour: Behaviour) {
        self.0.lock().expect("the lock is not poisoned").procedural = behaviour;
    }
}

/// Designers that behave as the script says.
#[derive(Debug)]
pub(crate) struct ScriptedDesigners(pub(crate) DesignerScript);

impl Designers for ScriptedDesigners {
    fn designer(&self, kind: DesignerKind, _: &str) -> Option<Box<dyn Designer>> {
        let behaviours = self.0.0.lock().expect("the lock is not poisoned");
        let behaviour = if kind == DesignerKind::Llm { behaviours.llm } else { behaviours.procedural };
        Some(Box::new(ScriptedDesigner { kind, behaviour }))
    }

    fn has_llm(&self) -> bool {
        true
    }
}

struct ScriptedDesigner {
    kind: DesignerKind,
    behaviour: Behaviour,
}

impl Designer for ScriptedDesigner {
    fn name(&self) -> &'static str {
        self.kind.as_str()
    }

    fn design<'a>(&'a mut self, brief: &'a DesignBrief, gate: &'a mut Gate) -> DesignFuture<'a> {
        Box::pin(async move {
            match self.behaviour {
                Behaviour::Normal => Ok(ProceduralDesigner::design_layouts(brief, gate)),
                Behaviour::Error => {
                    Err(DesignError::Model(LlmError::Connection { reason: "connection refused".to_owned() }))
                }
                Behaviour::Panic => panic!("nonsense"),
                Behaviour::Invalid => Ok(invalid_designs(brief, gate)),
                Behaviour::Hang => std::future::pending().await,
            }
        })
    }
}

/// Returns a hundred designs that are invalid or malicious.
fn invalid_designs(brief: &DesignBrief, gate: &mut Gate) -> DesignOutcome {
    let long = "x".repeat(100_000);
    let judged = (0..100u32).map(|number| {
        let design = match number % 4 {
            0 => json!({"name": long, "aim": {"mode": long, "bearing_deg": -7}, "encounters": "many"}),
            1 => json!([1, 2, 3]),
            2 => json!({"name": "'; DROP TABLE layouts; --", "aim": {"bearing_deg": 1e300}, "frame": 5}),
            _ => Value::Null,
        };
        let verdict = gate.judge(brief, &design, [brief.base_scenario(0)]);
        let (name, design, attempt) = (long.clone(), Some(design), number.into());
        JudgedLayout { name, design, attempt, round: u32::MAX, verdict }
    });
    let usage = DesignUsage {
        model: Some(long.clone()),
        prompt: Some("<script>alert(1)</script>".to_owned()),
        rounds: u32::MAX,
        tokens_in: u64::MAX,
        tokens_out: u64::MAX,
        cost: f64::NAN,
        latency: Duration::MAX,
    };
    DesignOutcome { judged: judged.collect(), usage, warnings: vec![format!("blah {long}"); 1000] }
}
