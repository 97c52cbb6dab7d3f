//! Creates designers from the command line.

use std::collections::BTreeMap;

use anyhow::{Context, bail};
use clap::ValueEnum;
use designer::llm_designer::{LlmDesigner, prompt};
use designer::procedural::ProceduralDesigner;
use designer::replay::{ReplayDesigner, StoredLayout};
use designer::{DesignBrief, DesignLanguage, DesignUsage, Designer, Gate, JudgedLayout, design_language};
use llm::LlmClient;
use serde_json::Value;

use super::Args;
use super::design_report::{DesignReport, LayoutResult};
use clock::Clock;

/// Designer selected by `--designer`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum DesignerKind {
    /// Sample from the failure profile; needs neither network nor model
    Procedural,
    /// Ask a language model (--llm-url)
    Llm,
    /// Read layouts from a file (--layouts)
    Replay,
}

/// Creates the selected designer. This is the only place that creates designers from arguments.
///
/// # Errors
/// Returns an error if no language model is configured, or `replay` is selected without a file.
pub(super) fn create_designer(args: &Args) -> anyhow::Result<Box<dyn Designer>> {
    // Incomplete options are an error whatever the designer.
    let config = args.llm.config(&Clock::system())?;
    match args.designer.unwrap_or(DesignerKind::Procedural) {
        DesignerKind::Procedural => Ok(Box::new(ProceduralDesigner)),
        DesignerKind::Llm => {
            let config = config.context("no language model is configured: give --llm-url")?;
            Ok(Box::new(LlmDesigner::new(LlmClient::new(config)?, args.run.as_deref().unwrap_or_default())))
        }
        DesignerKind::Replay => bail!("--designer replay needs --layouts FILE"),
    }
}

/// Request that a language model would receive.
#[derive(Debug)]
pub(super) struct ModelRequest {
    pub(super) prompt: String,
    /// JSON schema of the response.
    pub(super) schema: Value,
}

/// Builds the request that a language model would receive.
pub(super) fn model_request(brief: &DesignBrief, language: &dyn DesignLanguage) -> ModelRequest {
    let words = prompt::opening(brief, language, brief.count);
    let words: Vec<_> = words.into_iter().map(|message| message.content).collect();
    ModelRequest { prompt: words.join("\n"), schema: language.schema(brief) }
}

/// Passes the layouts of a file through the gates of their worlds. A layout without a design is judged as a threat.
///
/// # Errors
/// Returns an error if the file cannot be read or holds no layouts, and for a layout of a world without a design language.
pub(super) fn judge_file(args: &Args) -> anyhow::Result<DesignReport> {
    let Some(path) = &args.layouts else { bail!("the designer replay needs --layouts FILE") };
    let mut replay = ReplayDesigner::new(path.clone());
    let drafts = replay.next_layouts(args.task.as_deref(), args.n as usize).context("--layouts")?;
    let started = std::time::Instant::now();
    let mut gates: BTreeMap<&'static str, Gate> = BTreeMap::new();
    let mut rows = Vec::with_capacity(drafts.len());
    for StoredLayout { name, scenario } in drafts {
        let task = scenario.task();
        let language = design_language(task).with_context(|| {
            format!("no layout of {} can be judged: its world has no design language", task.id())
        })?;
        let gate = gates.entry(task.id()).or_insert_with(|| Gate::new(language, Vec::new()));
        let design = scenario.recipe().layout().and_then(|layout| layout.provenance.clone());
        let verdict = gate.judge_scenario(&scenario);
        let attempt = rows.len() as u64;
        let judged = JudgedLayout { name, design, attempt, round: 1, verdict };
        let row = LayoutResult::new("replay", task.id(), judged);
        rows.push(LayoutResult { scenario: Some(scenario), ..row });
    }
    let usage = DesignUsage { rounds: 1, ..DesignUsage::default() };
    let left = match replay.remaining() {
        0 => None,
        left => Some(format!("{left} more layouts of the file were not looked at; --n takes more of them")),
    };
    Ok(DesignReport {
        designer: "replay",
        rows,
        usage,
        warnings: left.into_iter().collect(),
        elapsed: started.elapsed(),
    })
}
