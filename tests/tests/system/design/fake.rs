//! A designer that does what it is told, and asking it.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use designer::gate::{Judged, Usage};
use designer::procedural::Procedural;
use designer::{Brief, DesignError, Designed, Designer, Designing, Gate};
use orchestrator::training::design::{Designers, Which};
use serde_json::{Value, json};
use system_tests::Api;

use super::until;

/// Asks by hand, and waits for its end.
pub(crate) async fn asked(api: &Api, wish: Value) -> Value {
    let answer = api.post("/v1/runs/run/designs", wish).await.expect(202);
    let path = format!("/v1/runs/run/designs/asks/{}", answer["id"].as_str().expect("an id"));
    until(api, &path, |ask| ask["ended_at"].is_string()).await
}

/// What the designers do, by a word each.
#[derive(Debug, Clone, Default)]
pub(crate) struct Script(Arc<Mutex<[String; 2]>>);

impl Script {
    pub(crate) fn llm(&self, word: &str) {
        self.0.lock().expect("nobody panics with it")[0] = word.to_owned();
    }

    pub(crate) fn procedural(&self, word: &str) {
        self.0.lock().expect("nobody panics with it")[1] = word.to_owned();
    }
}

/// Designers by a script: `error`, `panic`, `garbage`, `slow`; else the real one.
#[derive(Debug)]
pub(crate) struct Fake(pub(crate) Script);

impl Designers for Fake {
    fn designer(&self, which: Which, _: &str) -> Option<Box<dyn Designer>> {
        let words = self.0.0.lock().expect("nobody panics with it");
        let word = words[if which == Which::Llm { 0 } else { 1 }].clone();
        Some(Box::new(Scripted { which, word }))
    }

    fn has_llm(&self) -> bool {
        true
    }
}

struct Scripted {
    which: Which,
    word: String,
}

impl Designer for Scripted {
    fn name(&self) -> &'static str {
        self.which.word()
    }

    fn design<'a>(&'a mut self, brief: &'a Brief, gate: &'a mut Gate) -> Designing<'a> {
        Box::pin(async move {
            match self.word.as_str() {
                "error" => {
                    Err(DesignError::Source { what: "the model".to_owned(), reason: "it is down".to_owned() })
                }
                "panic" => panic!("nonsense"),
                "garbage" => Ok(garbage(brief, gate)),
                "slow" => {
                    tokio::time::sleep(Duration::from_secs(3600)).await;
                    Ok(Designed::default())
                }
                _ => Ok(Procedural::layouts(brief, gate)),
            }
        })
    }
}

/// What no designer should say, a hundred times.
fn garbage(brief: &Brief, gate: &mut Gate) -> Designed {
    let long = "x".repeat(100_000);
    let judged = (0..100u32).map(|number| {
        let design = match number % 4 {
            0 => json!({"name": long, "aim": {"mode": long, "bearing_deg": -7}, "encounters": "many"}),
            1 => json!([1, 2, 3]),
            2 => json!({"name": "'; DROP TABLE layouts; --", "aim": {"bearing_deg": 1e300}, "frame": 5}),
            _ => Value::Null,
        };
        let verdict = gate.judge(brief, &design, [brief.sky(0)]);
        Judged { name: long.clone(), design: Some(design), round: u32::MAX, verdict }
    });
    let usage = Usage {
        model: Some(long.clone()),
        prompt: Some("<script>alert(1)</script>".to_owned()),
        rounds: u32::MAX,
        tokens_in: u64::MAX,
        tokens_out: u64::MAX,
        cost: f64::NAN,
        latency: Duration::MAX,
    };
    Designed { judged: judged.collect(), usage, troubles: vec![format!("blah {long}"); 1000] }
}
