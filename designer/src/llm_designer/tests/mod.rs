//! Tests of the designer against scripted models: prompts, repairs, time limits, and the secrecy of the key.

mod key;
mod prompts;
mod repair;
mod schema;
mod time_limit;

use std::sync::Arc;
use std::time::Duration;

use env_core::Recipe;
use llm::testing::{ScriptedModel, answer, chat_response, received_bodies, start_endpoint, test_config};
use llm::{BreakerState, LlmClient, LlmConfig, LlmError};
use serde_json::{Value, json};
use wiremock::ResponseTemplate;

use super::{LlmDesigner, MAX_REPAIRS};
use crate::brief::DesignBrief;
use crate::gate::Gate;
use crate::procedural::ProceduralDesigner;
use crate::{DesignOutcome, Designer, design_language};

fn brief(count: usize) -> DesignBrief {
    let task = env_core::task("kessler/survival").unwrap();
    let recipe = Recipe::at_level(task, 3).unwrap();
    DesignBrief::new(Arc::new(recipe), count, 7).at_level(task.levels(), 3)
}

fn gate(brief: &DesignBrief) -> Gate {
    Gate::new(design_language(brief.recipe.task()).unwrap(), Vec::new())
}

/// Up to `count` designs that the gate admits under one of the brief's first eight base scenarios; at least one.
fn good_designs(count: usize) -> Vec<Value> {
    let brief = brief(count);
    let designed = ProceduralDesigner::design_layouts(&brief, &mut gate(&brief));
    let designs: Vec<Value> = designed
        .judged
        .into_iter()
        .filter(|judged| judged.verdict.is_ok())
        .filter_map(|judged| judged.design)
        // The procedural designer uses one base scenario per attempt; designs of a model are tried in the first eight.
        .filter(|design| {
            let bases = (0..8).map(|number| brief.base_scenario(number));
            gate(&brief).judge(&brief, design, bases).is_ok()
        })
        .collect();
    assert!(!designs.is_empty());
    designs
}

/// A good design with a step that is out of bounds.
fn invalid(mut design: Value) -> Value {
    design["encounters"][0]["step"] = json!(99);
    design
}

/// Answer of a model with these designs.
fn layouts(designs: &[Value]) -> String {
    json!({ "layouts": designs }).to_string()
}

/// Lets the designer fulfil a brief, for the run `r`.
async fn design_for(client: &LlmClient, brief: &DesignBrief) -> Result<DesignOutcome, LlmError> {
    let mut designer = LlmDesigner::new(client.clone(), "r");
    designer.design(brief, &mut gate(brief)).await.map_err(|error| match error {
        crate::DesignError::Model(error) => error,
        other => panic!("{other}"),
    })
}

/// Lets the designer make `count` layouts, for the run `r`.
async fn design(client: &LlmClient, count: usize) -> Result<DesignOutcome, LlmError> {
    design_for(client, &brief(count)).await
}
