//! Who designs.

use std::collections::BTreeMap;

use anyhow::{Context, bail};
use clap::ValueEnum;
use designer::llm_designer::{LlmDesigner, prompt};
use llm::LlmClient;
use designer::procedural::ProceduralDesigner;
use designer::replay::{StoredLayout, ReplayDesigner};
use designer::{DesignBrief, Designer, Gate, JudgedLayout, DesignLanguage, DesignUsage, gate, design_language};
use serde_json::Value;

use super::Args;
use super::row::{Outcome, Passed, Row};
use orchestrator::clock::Clock;

/// Who designs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Who {
    /// Samples from the failure profile; needs no network and no model
    Procedural,
    /// A language model
    Llm,
    /// Layouts from a file
    Replay,
}

/// The designer that was asked for: the one place where designers are made of arguments.
pub(super) fn designer(args: &Args) -> anyhow::Result<Box<dyn Designer>> {
    match args.designer.unwrap_or(Who::Procedural) {
        Who::Procedural => Ok(Box::new(ProceduralDesigner)),
        Who::Llm => {
            let config = args.llm.config(&Clock::system())?;
            let config = config.context("no language model is configured: give --llm-url")?;
            Ok(Box::new(LlmDesigner::new(LlmClient::new(config)?, args.run.as_deref().unwrap_or_default())))
        }
        Who::Replay => bail!("--designer replay: say which file with --layouts"),
    }
}

/// What a language model would be sent: the words, and the schema its answer is held to. The one place where `--dry-run`
/// learns the prompt.
pub(super) fn prompt(brief: &DesignBrief, language: &dyn DesignLanguage) -> (String, Value) {
    let words = prompt::opening(brief, language, brief.count);
    let words: Vec<_> = words.into_iter().map(|message| message.content).collect();
    (words.join("\n"), language.schema(brief))
}

/// The layouts of a file, each through the gate: those that say by which design they were made by that of their world's
/// language, others, of whatever world, as threats.
pub(super) fn replay(args: &Args) -> anyhow::Result<Outcome> {
    let Some(path) = &args.layouts else { bail!("--layouts: a file is wanted") };
    let mut replay = ReplayDesigner::new(path.clone());
    let drafts = replay.next_layouts(args.task.as_deref(), args.n as usize).context("--layouts")?;
    let started = std::time::Instant::now();
    let mut gates: BTreeMap<&'static str, Option<Gate>> = BTreeMap::new();
    let rows = drafts.into_iter().map(|StoredLayout { name, scenario }| {
        let task = scenario.task();
        let of_task = gates
            .entry(task.id())
            .or_insert_with(|| design_language(task).map(|known| Gate::new(known, Vec::new())));
        let design = scenario.recipe().layout().and_then(|layout| layout.provenance.clone());
        match of_task {
            Some(of_task) => {
                let verdict = of_task.judge_scenario(&scenario);
                let row = Row::of("replay", task.id(), JudgedLayout { name, design, round: 1, verdict });
                Row { scenario: Some(scenario), ..row }
            }
            None => {
                let verdict = gate::check_threat(&scenario).map(Passed::threat);
                let scenario = Some(scenario);
                Row { name, designer: "replay", task: task.id(), round: 1, design: None, scenario, verdict }
            }
        }
    });
    let rows = rows.collect();
    let usage = DesignUsage { rounds: 1, ..DesignUsage::default() };
    let left = match replay.remaining() {
        0 => None,
        left => Some(format!("{left} more layouts of the file were not looked at; --n takes more of them")),
    };
    Ok(Outcome {
        designer: "replay",
        rows,
        usage,
        troubles: left.into_iter().collect(),
        took: started.elapsed(),
    })
}
