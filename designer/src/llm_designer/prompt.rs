//! Prompts of the designer. The templates are files in `prompts/`: one folder for each version of a world's prompt, and
//! `prompts/shared/` for all worlds. A change of a template, of a language's rules or of a refusal's message needs a new
//! version of each prompt that has it, so that layouts are traceable to their prompt.

use env_core::critique::{PROFILE_SECTORS, SpeedBands};
use llm::{Message, Role, sanitize_line_to};
use serde_json::Value;

use crate::angles::sector_middle_deg;
use crate::brief::{
    DesignBrief, DesignRung, EASE_BELOW, HARDEN_ABOVE, LayoutOutcome, ParamChoice, PastLayout,
};
use crate::design_language::{DesignLanguage, PromptTexts};
use crate::profile::{FailureProfile, ModeProfile};
use crate::refusal::Refusal;
use crate::untrusted_text::identifier;

const USER: &str = include_str!("../../prompts/shared/user.md");
const REPAIR: &str = include_str!("../../prompts/shared/repair.md");
const UNREADABLE: &str = include_str!("../../prompts/shared/unreadable.md");

/// Maximum number of rows of the failure profile.
const MAX_PROFILE_ROWS: usize = 16;
/// Maximum number of past layouts.
const MAX_PAST_LAYOUTS: usize = 12;
/// Maximum number of past layouts with episodes.
const MAX_EVALUATED: usize = 8;
/// Maximum number of past layouts that the gate refused.
const MAX_REFUSED: usize = 4;
/// Length limit of a name, in characters.
const MAX_NAME_CHARS: usize = 60;
/// Length limit of a reason, in characters.
const MAX_REASON_CHARS: usize = 240;

/// Layout that the gate refused in the last answer.
#[derive(Debug, Clone, Copy)]
pub struct RefusedLayout<'a> {
    /// Position in the list of the next assistant message, counted from 1.
    pub number: usize,
    /// Name of the layout.
    pub name: &'a str,
    /// Reason of the refusal.
    pub refusal: &'a Refusal,
}

/// Returns the messages that ask for `count` layouts.
#[must_use]
pub fn opening(brief: &DesignBrief, language: &dyn DesignLanguage, count: usize) -> Vec<Message> {
    let task = brief.recipe.task();
    let texts = language.prompt_texts();
    let system = fill(texts.system, &[("rules", language.rules(brief))]);
    let user = fill(
        USER,
        &[
            ("task", task.id().to_owned()),
            ("rung", wanted_rung_text(brief)),
            ("about", task.description().to_owned()),
            ("params", params_text(brief)),
            ("limits", choices_text(&language.param_choices(brief))),
            ("standing", mastery_text(brief)),
            ("profile", profile_text(&brief.profile, task.speed_bands(), texts)),
            ("fates", past_layouts_text(&brief.past_layouts, language)),
            ("count", count_text(count)),
            ("ease_below", EASE_BELOW.to_string()),
            ("harden_above", HARDEN_ABOVE.to_string()),
        ],
    );
    vec![Message::new(Role::System, system), Message::new(Role::User, user)]
}

/// Returns the message that asks for replacements of refused layouts.
#[must_use]
pub fn repair(refused: &[RefusedLayout<'_>]) -> Message {
    let line = |RefusedLayout { number, name, refusal }: &RefusedLayout<'_>| {
        format!(
            "- layout {number}, {}: {}: {}",
            quote(name, MAX_NAME_CHARS),
            refusal.check().as_str(),
            quote(&refusal.to_string(), MAX_REASON_CHARS)
        )
    };
    let refusals = refused.iter().map(line).collect::<Vec<_>>().join("\n");
    Message::new(Role::User, fill(REPAIR, &[("refusals", refusals), ("count", count_text(refused.len()))]))
}

/// Returns the message that asks again after an answer that could not be parsed.
#[must_use]
pub fn unreadable(reason: &str, count: usize) -> Message {
    let reason = sanitize_line_to(reason, MAX_REASON_CHARS);
    Message::new(Role::User, fill(UNREADABLE, &[("reason", reason), ("count", count_text(count))]))
}

/// Replaces each `{{name}}` of a template by its value. Values are not searched for further names.
fn fill(template: &str, values: &[(&str, String)]) -> String {
    let mut filled = String::with_capacity(template.len());
    let mut rest = template;
    while let Some((before, after)) = rest.split_once("{{") {
        let Some((name, after)) = after.split_once("}}") else { break };
        filled.push_str(before);
        filled.push_str(values.iter().find(|(n, _)| *n == name).map_or("", |(_, value)| value));
        rest = after;
    }
    filled.push_str(rest);
    filled.trim_end().to_owned()
}

fn count_text(count: usize) -> String {
    if count == 1 { "1 layout".to_owned() } else { format!("{count} layouts") }
}

/// Returns untrusted text as data: short, one line, and in quotes that it cannot close.
fn quote(text: &str, max_chars: usize) -> String {
    Value::String(sanitize_line_to(text, max_chars)).to_string()
}

fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share.clamp(0.0, 1.0))
}

fn params_text(brief: &DesignBrief) -> String {
    let param = |spec: &env_core::space::ParamSpec| {
        let unit = if spec.unit.is_empty() || spec.unit == spec.name {
            String::new()
        } else {
            format!(" {}", spec.unit)
        };
        format!("{} {}{unit}", spec.name, brief.param(spec.name))
    };
    brief.recipe.task().params().iter().map(param).collect::<Vec<_>>().join(", ")
}

/// Returns the rung at which layouts are wanted.
fn wanted_rung_text(brief: &DesignBrief) -> String {
    let rung = brief.rung();
    match rung.start_scale {
        Some(_) => format!("{rung} (a smaller start scale is easier)"),
        None if rung.level.is_some() => format!("{rung} (level 0 is the easiest)"),
        None => "the difficulty of the params".to_owned(),
    }
}

fn choices_text(choices: &[&ParamChoice]) -> String {
    if choices.is_empty() {
        return "All params are fixed: leave out the field params.".to_owned();
    }
    let row = |choice: &&ParamChoice| {
        let values = choice.values.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
        format!("- {}: one of {values}", choice.param)
    };
    let rows = choices.iter().map(row).collect::<Vec<_>>().join("\n");
    format!("A layout may set these in its field params:\n{rows}")
}

fn mastery_text(brief: &DesignBrief) -> String {
    match &brief.mastery {
        Some(mastery) if mastery.n > 0 => format!(
            "{1} on {0} contested scenarios of this level (80 % interval: {2} to {3}).",
            mastery.n,
            percent(mastery.mean),
            percent(mastery.q10),
            percent(mastery.q90)
        ),
        _ => "unknown.".to_owned(),
    }
}

/// Row of the failure profile.
struct ProfileRow {
    weight: f64,
    text: String,
}

/// Returns the profile as a table, heaviest rows first, and the shares of inertial bearings.
fn profile_text(profile: &FailureProfile, bands: SpeedBands, texts: &PromptTexts) -> String {
    let total = profile.total_weight();
    if total <= 0.0 {
        return texts.unknown_failures.to_owned();
    }
    let rows = profile_rows(profile, bands);
    let mut lines = vec![format!("share | mode | {}", texts.profile_columns)];
    let shown = rows.iter().take(MAX_PROFILE_ROWS);
    lines.extend(shown.map(|row| format!("{} | {}", percent(row.weight / total), row.text)));
    let others: f64 = rows.iter().skip(MAX_PROFILE_ROWS).map(|row| row.weight).sum();
    if others > 0.0 {
        lines.push(format!("{} | others", percent(others / total)));
    }
    lines.extend(profile.modes.iter().filter_map(inertial_bearings_text));
    lines.join("\n")
}

/// Returns a row for each cell, and one for the failures of a mode without a cell; heaviest first.
fn profile_rows(profile: &FailureProfile, bands: SpeedBands) -> Vec<ProfileRow> {
    let mut rows: Vec<ProfileRow> = Vec::new();
    for mode in &profile.modes {
        let name = identifier(&mode.mode);
        for cell in &mode.cells {
            let bearing =
                cell.sector.map_or_else(|| "-".to_owned(), |sector| sector_middle_deg(sector).to_string());
            let steps = cell.mean_steps_left.map_or_else(|| "-".to_owned(), |steps| format!("{steps:.1}"));
            let text = format!("{name} | {bearing} | {} | {steps}", band_text(bands, cell.band));
            rows.push(ProfileRow { weight: cell.weight, text });
        }
        let in_cells: f64 = mode.cells.iter().map(|cell| cell.weight).sum();
        if mode.weight > in_cells {
            rows.push(ProfileRow { weight: mode.weight - in_cells, text: format!("{name} | - | - | -") });
        }
    }
    rows.retain(|row| row.weight > 0.0);
    rows.sort_by(|a, b| b.weight.total_cmp(&a.weight).then_with(|| a.text.cmp(&b.text)));
    rows
}

/// Returns the range of a speed band.
fn band_text(bands: SpeedBands, band: Option<u32>) -> String {
    let Some(band) = band.map(|band| band as usize) else { return "-".to_owned() };
    let (edges, unit) = (bands.edges, bands.unit);
    match (band.checked_sub(1).and_then(|below| edges.get(below)), edges.get(band)) {
        (None, Some(above)) => format!("below {above} {unit}"),
        (Some(below), Some(above)) => format!("{below} to {above} {unit}"),
        (Some(below), None) => format!("above {below} {unit}"),
        (None, None) => "-".to_owned(),
    }
}

/// Returns the failures of a mode by bearing in the inertial frame; `None` if there are none.
fn inertial_bearings_text(mode: &ModeProfile) -> Option<String> {
    let weights = mode.inertial_sector_weights();
    let total: f64 = weights.iter().sum();
    if total <= 0.0 {
        return None;
    }
    let sectors = (0..PROFILE_SECTORS).zip(weights).filter(|(_, weight)| *weight > 0.0);
    let shares = sectors
        .map(|(sector, weight)| format!("{} from {}", percent(weight / total), sector_middle_deg(sector)))
        .collect::<Vec<_>>()
        .join(", ");
    Some(format!("{} by bearing in the frame inertial: {shares}", identifier(&mode.mode)))
}

/// Returns past layouts with their outcomes. Those with episodes teach most and come first; refused ones follow, and untested
/// ones fill up.
fn past_layouts_text(past_layouts: &[PastLayout], language: &dyn DesignLanguage) -> String {
    if past_layouts.is_empty() {
        return "None.".to_owned();
    }
    let with =
        |matches: fn(&LayoutOutcome) -> bool| past_layouts.iter().filter(move |past| matches(&past.outcome));
    let evaluated = with(|outcome| matches!(outcome, LayoutOutcome::Evaluated { .. })).take(MAX_EVALUATED);
    let refused = with(|outcome| matches!(outcome, LayoutOutcome::Refused { .. })).take(MAX_REFUSED);
    let untested = with(|outcome| matches!(outcome, LayoutOutcome::Untested));
    let shown = evaluated.chain(refused).chain(untested).take(MAX_PAST_LAYOUTS);
    shown.map(|past| past_layout_text(past, language)).collect::<Vec<_>>().join("\n")
}

fn past_layout_text(past: &PastLayout, language: &dyn DesignLanguage) -> String {
    let text = |pointer: &str| past.design.pointer(pointer).and_then(Value::as_str);
    let name = quote(text("/name").unwrap_or_default(), MAX_NAME_CHARS);
    let mode = identifier(text("/aim/mode").unwrap_or_default());
    let place = language.aim_place(&past.design).map_or_else(String::new, |place| format!(" {place}"));
    let outcome = match &past.outcome {
        LayoutOutcome::Refused { check, reason } => {
            format!("refused, {}: {}", identifier(check), quote(reason, MAX_REASON_CHARS))
        }
        LayoutOutcome::Untested => "admitted, without episodes".to_owned(),
        LayoutOutcome::Evaluated { episodes, success_rate, aimed_share, is_retired, .. } => {
            let p = past.outcome.mean_success().unwrap_or_default();
            let retired = if *is_retired { ", retired" } else { "" };
            let aimed = aimed_share
                .map(|share| format!("; {} of its failures were of the aimed mode", percent(share)));
            let aimed = aimed.unwrap_or_default();
            format!(
                "admitted; p = {p:.2}: the agent succeeded in {} of {episodes} episodes{aimed}{retired}",
                percent(*success_rate)
            )
        }
    };
    let rung = if past.rung == DesignRung::default() { String::new() } else { format!(", {}", past.rung) };
    format!("- {name}{rung}, aim {mode}{place}: {outcome}")
}
