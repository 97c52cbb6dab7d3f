//! A real model, small and bad at design: the pipeline must end properly all the same, and let nothing unfair through.
//! Not part of `make test`; `make test-llm` serves the model and runs this with its address.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test that finds something else than it wants must fail; what it measures is for people"
)]

use std::sync::Arc;
use std::time::Duration;

use designer::llm::{Llm, LlmConfig, WallClock};
use designer::procedural::Procedural;
use designer::profile::{Cell, ModeProfile, SectorWeight};
use designer::{Brief, Designed, Designer, Gate, Profile, Refusal, language};
use env_core::{Recipe, Scenario};

/// Layouts asked for: as many as a small model can list in a minute.
const LAYOUTS: usize = 3;

fn brief(task: &str, level: u32, seed: u64) -> Brief {
    let task = env_core::task(task).unwrap();
    let levels = task.levels();
    let recipe = Recipe::with_params(task, levels.params(level as usize)).unwrap();
    Brief::new(Arc::new(recipe), LAYOUTS, seed).at_level(levels, level)
}

/// An agent that does not see what overtakes it, and debris from +Y.
fn blind() -> Profile {
    let cell = |sector, band, weight: f64| Cell {
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
        inertial: vec![SectorWeight { sector: 3, count: 20, weight: 20.0 }],
    };
    Profile { task: "kessler/survival".to_owned(), criticised: 40, weight: 40.0, modes: vec![mode] }
}

fn report(name: &str, designed: &Designed) {
    let all = designed.judged.len();
    let past = |rank: usize| {
        let passed = |refusal: &Refusal| refusal.rank() > rank;
        designed.judged.iter().filter(|judged| judged.verdict.as_ref().map_or_else(passed, |_| true)).count()
    };
    let usage = &designed.usage;
    println!(
        "{name}: {all} layouts in {} rounds: {} schema-valid, {} compiled, {} admitted; {} + {} tokens, {:.1} s",
        usage.rounds,
        past(0),
        past(1),
        designed.admitted(),
        usage.tokens_in,
        usage.tokens_out,
        usage.latency.as_secs_f64(),
    );
    for judged in &designed.judged {
        let verdict = judged.verdict.as_ref().map_or_else(
            |refusal| format!("{}: {refusal}", refusal.check()),
            |admitted| format!("admitted, a {}", admitted.claim().word()),
        );
        println!("  round {}: {:?}: {verdict}", judged.round, judged.name);
    }
    for trouble in &designed.troubles {
        println!("  trouble: {trouble}");
    }
}

/// Flies every admitted layout again from its stored form, by a gate that knows nothing.
fn check(designed: &Designed) {
    for admitted in designed.judged.iter().filter_map(|judged| judged.verdict.as_ref().ok()) {
        let stored = admitted.scenario().to_json().to_string();
        let read = Scenario::from_json(&serde_json::from_str(&stored).unwrap()).unwrap();
        let language = language(read.task()).unwrap();
        let again = Gate::new(language, Vec::new()).judge_scenario(&read).unwrap();
        assert_eq!(again.bracket(), admitted.bracket());
    }
}

#[tokio::test]
#[ignore = "needs a model: make test-llm"]
async fn a_real_model_designs_only_what_is_fair() {
    let url = std::env::var("LLM_URL").expect("LLM_URL says where the model is: run make test-llm");
    let model = std::env::var("LLM_MODEL").unwrap_or_else(|_| "default".to_owned());
    let mut config = LlmConfig::new(url, model, WallClock::new(|| 0));
    // One thread of a small machine: a call takes a minute or two.
    config.timeout = Duration::from_secs(900);
    config.max_tokens = 1_500;
    config.tokens_per_run = Some(200_000);
    let llm = Llm::new(config).unwrap();
    let mut known = brief("kessler/survival", 3, 1);
    known.profile = blind();
    for (name, brief) in [("blind spots", known), ("nothing known", brief("kessler/eco_station", 2, 2))] {
        let language = language(brief.base.task()).unwrap();
        let mut gate = Gate::new(language, Vec::new());
        let designed = llm.designer("test").design(&brief, &mut gate).await.unwrap_or_else(|error| {
            println!("{name}: {error}");
            Designed::default()
        });
        report(name, &designed);
        check(&designed);
        assert!(designed.admitted() <= brief.count);
        if designed.admitted() == 0 {
            let instead = Procedural::layouts(&brief, &mut gate);
            println!(
                "  nothing was admitted; the procedural designer instead: {} admitted",
                instead.admitted()
            );
            check(&instead);
            assert!(instead.admitted() > 0);
        }
    }
    let health = llm.health();
    println!("{}", serde_json::to_string_pretty(&health).unwrap());
    // A machine that is too slow for a call is no fault of ours; one that never answers was not tested.
    assert!(health.calls > health.failed, "no call was answered");
}
