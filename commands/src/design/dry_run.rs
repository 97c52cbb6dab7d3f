//! Output of `--dry-run`: the brief that the designer would receive.

use designer::brief::ParamChoice;
use designer::procedural::ProceduralDesigner;
use designer::{DesignBrief, DesignLanguage};
use serde_json::{Value, json};

use super::super::output::{self, Column, Report, TextTable};
use super::designers::{self, DesignerKind, ModelRequest};
use super::{Args, table};
use crate::worlds::describe_param;

/// Prints the brief and the first ideas, or the prompt and schema of a language model.
///
/// # Errors
/// Returns an error if stdout cannot be written.
pub(super) fn show(args: &Args, brief: &DesignBrief, language: &dyn DesignLanguage) -> anyhow::Result<()> {
    let uses_model = args.designer == Some(DesignerKind::Llm);
    let ModelRequest { prompt, schema } = designers::model_request(brief, language);
    match (args.output.json, uses_model) {
        (true, true) => output::print_json(&json!({"prompt": prompt, "schema": schema})),
        (false, true) => {
            let schema = serde_json::to_string_pretty(&schema)?;
            output::print(&format!("{}\n\nThe schema of a layout:\n{schema}", prompt.trim_end()))
        }
        (true, false) => output::print_json(&json(brief, language)),
        (false, false) => output::print_report(&text_report(brief, language)),
    }
}

fn json(brief: &DesignBrief, language: &dyn DesignLanguage) -> Value {
    let recipe = &brief.recipe;
    let limits: serde_json::Map<_, _> =
        brief.param_choices.iter().map(|limit| (limit.param.clone(), json!(limit.values))).collect();
    json!({
        "task": recipe.task().id(),
        "level": brief.level,
        "recipe": recipe.to_json(),
        "limits": limits,
        "mastery": brief.mastery.map(|s| json!({"n": s.n, "mean": s.mean, "q10": s.q10, "q90": s.q90})),
        "profile": brief.profile,
        "ideas": ProceduralDesigner::preview(brief, language, brief.count),
    })
}

pub(super) fn text_report(brief: &DesignBrief, language: &dyn DesignLanguage) -> Report {
    let mut report = Report::default();
    report.paragraph(heading(brief));
    let choices = language.param_choices(brief);
    if !choices.is_empty() {
        report.separate_table(limits(&choices));
    }
    add_profile(&mut report, brief);
    report.separate_table(ideas(brief, language));
    report
}

fn heading(brief: &DesignBrief) -> String {
    let recipe = &brief.recipe;
    let task = recipe.task();
    let varied = |name: &str| task.levels().columns().iter().any(|column| column == name);
    let params = task.params().iter().filter_map(|spec| {
        let value = recipe.param(spec.name)?;
        let tells = varied(spec.name) || value.to_bits() != spec.default.to_bits();
        tells.then(|| describe_param(spec, &value.to_string()))
    });
    let params = params.collect::<Vec<_>>().join(", ");
    let level = brief.level.map_or_else(String::new, |level| format!(", level {level}"));
    let mut text = format!("{} layouts of {}{level}: {params}.", brief.count, task.id());
    if let Some(s) = brief.mastery {
        text += &format!(
            " At this level the agent succeeds in {:.2} ({:.2} to {:.2}) of {} contested scenarios.",
            s.mean, s.q10, s.q90, s.n
        );
    }
    text
}

fn limits(choices: &[&ParamChoice]) -> TextTable {
    let mut table = TextTable::new([Column::text("param"), Column::prose("allowed values")]);
    for limit in choices {
        let values = limit.values.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
        table.add_row([limit.param.clone(), values]);
    }
    table
}

/// Adds each mode with its share, and the bearings it mostly comes from in either frame.
fn add_profile(report: &mut Report, brief: &DesignBrief) {
    let profile = &brief.profile;
    let all = profile.total_weight();
    if all <= 0.0 {
        report.paragraph("There are no failures to design for: aims and directions vary.");
        return;
    }
    let mut table = TextTable::new([
        Column::text("failure mode"),
        Column::number("share"),
        Column::number("count").optional(1),
        Column::text("radial/in-track"),
        Column::text("inertial").optional(2),
    ]);
    for mode in profile.modes.iter().filter(|mode| mode.weight > 0.0) {
        table.add_row([
            table::one_line(&mode.mode),
            format!("{:.2}", mode.weight / all),
            mode.count.to_string(),
            heaviest_sectors(&mode.sector_weights()),
            heaviest_sectors(&mode.inertial_sector_weights()),
        ]);
    }
    report
        .paragraph(format!(
            "Failures over {} episodes, and the bearings of most of them:",
            profile.criticised
        ))
        .table(table);
}

/// Lists the three heaviest sectors of a rose with their centres and shares.
fn heaviest_sectors(rose: &[f64]) -> String {
    let all: f64 = rose.iter().sum();
    let mut sectors: Vec<_> = rose.iter().enumerate().filter(|(_, weight)| **weight > 0.0).collect();
    sectors.sort_by(|a, b| b.1.total_cmp(a.1));
    let heaviest = sectors.iter().take(3).map(|(sector, weight)| {
        let centre = sector * 360 / rose.len();
        format!("{centre}° {:.0} %", 100.0 * **weight / all)
    });
    heaviest.collect::<Vec<_>>().join(", ")
}

fn ideas(brief: &DesignBrief, language: &dyn DesignLanguage) -> TextTable {
    let mut table = TextTable::new([Column::text("first ideas aim at"), Column::number("parts")]);
    for idea in ProceduralDesigner::preview(brief, language, brief.count) {
        if let Some(listing) = language.table(&idea) {
            table.add_row([listing.aim, listing.rows.len().to_string()]);
        }
    }
    table
}
