//! `sparring design`: layouts through the gate.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::ValueEnum;
use designer::{Designer, gate, replay::Replay};
use env_core::bracket::panel_success;
use serde_json::json;

use super::output::{Format, print, print_json, table};

/// Who designs.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Who {
    /// Layouts from a file.
    Replay,
}

/// Pass layouts through the gate: fair, solvable, contested. Exit code 1 if one is refused.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The file is JSON: {\"layouts\": [{\"name\": \"from below\", \"scenario\": {\"task\": \"kessler/survival\", \"params\": \
{\"debris\": 0, \"fuel\": 20}, \"seed\": 5, \"layout\": {\"mode\": \"extend\", \"bodies\": {\"debris\": [[15, -85.9, 2.3, \
4.4]]}}}}]}. A body is x, y, vx, vy.

Examples:
  sparring design --layouts examples/layouts.json
  sparring design --layouts mine.json --format json")]
pub struct Args {
    /// Who designs.
    #[arg(long, value_enum, default_value_t = Who::Replay)]
    designer: Who,
    /// The file of layouts.
    #[arg(long, value_name = "FILE")]
    layouts: PathBuf,
    /// How many at most.
    #[arg(long, default_value_t = 1000)]
    n: usize,
    /// How to print.
    #[arg(long, value_enum, default_value_t = Format::Table)]
    format: Format,
}

/// Designs and gates.
///
/// # Errors
/// A file that cannot be read, or a layout that is none.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let mut designer = match args.designer {
        Who::Replay => Replay::new(args.layouts.clone()),
    };
    let drafts = designer.drafts(None, args.n)?;
    let gated: Vec<_> = drafts.iter().map(|draft| (draft, gate::threat(&draft.scenario))).collect();
    match args.format {
        Format::Json => {
            let rows: Vec<_> = gated
                .iter()
                .map(|(draft, result)| {
                    let bracket = result.as_ref().ok();
                    json!({
                        "name": draft.name,
                        "designer": designer.name(),
                        "scenario": draft.scenario.to_json(),
                        "scenario_id": draft.scenario.id().to_string(),
                        "admitted": bracket.is_some(),
                        "refusal": result.as_ref().err().map(ToString::to_string),
                        "hold": bracket.map(env_core::Bracket::hold),
                        "floor": bracket.map(|b| b.floor),
                        "reference": bracket.map(|b| b.reference.score),
                        "panel_success": bracket.map(|b| panel_success(&draft.scenario, b)),
                    })
                })
                .collect();
            print_json(&json!({ "layouts": rows }))?;
        }
        Format::Table => {
            let mut out = table(&["layout", "task", "gate", "hold", "floor", "reference"], 3);
            let mut reasons = Vec::new();
            for (draft, result) in &gated {
                let task = draft.scenario.task().id().to_owned();
                let mut row = vec![draft.name.clone(), task];
                match result {
                    Ok(b) => {
                        row.push("admitted".to_owned());
                        row.extend([b.hold(), b.floor, b.reference.score].map(|v| format!("{v:.3}")));
                    }
                    Err(refusal) => {
                        row.extend(["refused", "", "", ""].map(str::to_owned));
                        reasons.push(textwrap::fill(&format!("{}: {refusal}", draft.name), 100));
                    }
                }
                out.add_row(row);
            }
            reasons.insert(0, out.to_string());
            print(&reasons.join("\n"))?;
        }
    }
    let refused = gated.iter().any(|(_, result)| result.is_err());
    Ok(if refused { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}
