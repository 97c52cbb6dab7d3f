//! Test with a real language model, small and bad at design: the designer must end properly, and admit only fair layouts.
//! It is not part of `make test`; `make test-llm` serves a model and runs it.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails on what it does not expect; its measurements are printed for people"
)]

use std::sync::Arc;
use std::time::Duration;

use designer::llm_designer::LlmDesigner;
use designer::procedural::ProceduralDesigner;
use designer::profile::{FailureCell, ModeProfile, SectorWeight};
use designer::{DesignBrief, DesignOutcome, Designer, FailureProfile, Gate, GateCheck, design_language};
use env_core::{Recipe, Scenario};
use llm::{LlmClient, LlmConfig, WallClock};

/// Number of requested layouts: as many as a small model can write in a minute.
const LAYOUTS: usize = 3;

fn brief(task: &str, level: u32, seed: u64) -> DesignBrief {
    let task = env_core::task(task).unwrap();
    let levels = task.levels();
    let recipe = Recipe::with_params(task, levels.params(level as usize)).unwrap();
    DesignBrief::new(Arc::new(recipe), LAYOUTS, seed).at_level(levels, level)
}

/// Profile of an agent that does not see debris from behind.
fn profile_of_blind_agent() -> FailureProfile {
    let cell = |sector, band, weight: f64| FailureCell {
        sector: Some(sector),
        band: Some(band),
        count: weight as u64,
        weight,
        avoidable_share: Some(0.9),
        mean_steps_left: Some(4.0),
    };
    let mode = ModeProfile {
        mode: "collision".to_owned(),
        count: 20,
        weight: 20.0,
        cells: vec![cell(9, 3, 14.0), cell(8, 2, 4.0), cell(1, 3, 2.0)],
        inertial_sectors: vec![SectorWeight { sector: 3, count: 20, weight: 20.0 }],
    };
    FailureProfile { task: "kessler/survival".to_owned(), criticised: 40, weight: 40.0, modes: vec![mode] }
}

fn print_outcome(name: &str, outcome: &DesignOutcome) {
    let all = outcome.judged.len();
    let count_past = |check: GateCheck| {
        let refused_by = outcome.judged.iter().map(|judged| judged.verdict.as_ref().err());
        refused_by.filter(|refusal| refusal.is_none_or(|refusal| refusal.check() > check)).count()
    };
    let usage = &outcome.usage;
    println!(
        "{name}: {all} layouts in {} rounds: {} schema-valid, {} compiled, {} admitted; {} + {} tokens, {:.1} s",
        usage.rounds,
        count_past(GateCheck::Schema),
        count_past(GateCheck::Compiles),
        outcome.admitted(),
        usage.tokens_in,
        usage.tokens_out,
        usage.latency.as_secs_f64(),
    );
    for judged in &outcome.judged {
        let verdict = judged.verdict.as_ref().map_or_else(
            |refusal| format!("{}: {refusal}", refusal.check().as_str()),
            |admitted| format!("admitted, a {}", admitted.kind().as_str()),
        );
        println!("  round {}: {:?}: {verdict}", judged.round, judged.name);
    }
    for warning in &outcome.warnings {
        println!("  warning: {warning}");
    }
}

/// Judges every admitted layout again from its JSON form, with an empty archive.
fn assert_admitted_again(outcome: &DesignOutcome) {
    for admitted in outcome.judged.iter().filter_map(|judged| judged.verdict.as_ref().ok()) {
        let stored = admitted.scenario().to_json().to_string();
        let parsed = Scenario::from_json(&serde_json::from_str(&stored).unwrap()).unwrap();
        let language = design_language(parsed.task()).unwrap();
        let again = Gate::new(language, Vec::new()).judge_scenario(&parsed).unwrap();
        assert_eq!(again.bracket(), admitted.bracket());
    }
}

#[tokio::test]
#[ignore = "needs a model: make test-llm"]
async fn real_model_designs_only_fair_layouts() {
    let url = std::env::var("LLM_URL").expect("LLM_URL is the address of the model: run make test-llm");
    let model = std::env::var("LLM_MODEL").unwrap_or_else(|_| "default".to_owned());
    let mut config = LlmConfig::new(url, model, WallClock::new(|| 0));
    // A call takes a minute or two on one thread of a small machine.
    config.timeout = Duration::from_secs(900);
    config.max_tokens = 1_500;
    config.tokens_per_run = Some(200_000);
    let client = LlmClient::new(config).unwrap();
    let mut known_agent = brief("kessler/survival", 3, 1);
    known_agent.profile = profile_of_blind_agent();
    let unknown_agent = brief("kessler/eco_station", 2, 2);
    for (name, brief) in [("blind agent", known_agent), ("unknown agent", unknown_agent)] {
        let mut gate = Gate::new(design_language(brief.recipe.task()).unwrap(), Vec::new());
        let mut designer = LlmDesigner::new(client.clone(), "test");
        let outcome = designer.design(&brief, &mut gate).await.unwrap_or_else(|error| {
            println!("{name}: {error}");
            DesignOutcome::default()
        });
        print_outcome(name, &outcome);
        assert_admitted_again(&outcome);
        assert!(outcome.admitted() <= brief.count);
        if outcome.admitted() == 0 {
            let instead = ProceduralDesigner::design_layouts(&brief, &mut gate);
            println!(
                "  no layout was admitted; the procedural designer instead: {} admitted",
                instead.admitted()
            );
            assert_admitted_again(&instead);
            assert!(instead.admitted() > 0);
        }
    }
    let health = client.health();
    println!("{}", serde_json::to_string_pretty(&health).unwrap());
    // A machine that is too slow for some calls is acceptable; without any answer nothing was tested.
    assert!(health.calls > health.failed, "no call was answered");
}
