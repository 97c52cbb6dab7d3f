//! What a model is told. The words are files in `prompts/`, one folder a version; whatever changes there or in a
//! language's rules gets a new version, so that layouts can be told apart by the prompt that led to them.

use env_core::critique::{SECTORS, SpeedBands};
use serde_json::Value;

use super::chat::{Message, Role};
use super::error::shortened;
use crate::brief::{Brief, Fate, Past};
use crate::gate::Refusal;
use crate::language::Language;
use crate::profile::{ModeProfile, Profile};

/// The version of the words.
const VERSION: &str = "1";
const SYSTEM: &str = include_str!("../../prompts/1/system.md");
const USER: &str = include_str!("../../prompts/1/user.md");
const REPAIR: &str = include_str!("../../prompts/1/repair.md");
const NONSENSE: &str = include_str!("../../prompts/1/nonsense.md");

/// Rows of the failure profile that are told, at most.
const ROWS: usize = 16;
/// Earlier layouts that are told of, at most: in all, of those flown, of those refused.
const TOLD: usize = 12;
const FLOWN: usize = 8;
const REFUSED: usize = 4;
/// Characters of a name or a reason.
const NAME: usize = 60;
const REASON: usize = 240;

/// The version of the prompt for a brief, as `kessler-1`.
#[must_use]
pub fn version(brief: &Brief) -> String {
    let world = brief.base.task().world();
    format!("{}-{VERSION}", world.split('@').next().unwrap_or(world))
}

/// The conversation that asks for `count` layouts.
#[must_use]
pub fn opening(brief: &Brief, language: &dyn Language, count: usize) -> Vec<Message> {
    let task = brief.base.task();
    let system = fill(SYSTEM, &[("rules", language.rules(brief))]);
    let user = fill(
        USER,
        &[
            ("task", task.id().to_owned()),
            ("level", brief.level.map_or_else(String::new, |level| format!(", level {level}"))),
            ("about", task.about().to_owned()),
            ("params", params(brief)),
            ("limits", limits(brief)),
            ("standing", standing(brief)),
            ("profile", profile(&brief.profile, task.speed_bands())),
            ("fates", fates(&brief.fates)),
            ("count", layouts(count)),
        ],
    );
    vec![Message::new(Role::System, system), Message::new(Role::User, user)]
}

/// What is said of refused layouts: each with its number in the list it was in, counted from 1.
#[must_use]
pub fn repair(refused: &[(usize, String, Refusal)]) -> Message {
    let line = |(number, name, refusal): &(usize, String, Refusal)| {
        format!(
            "- layout {number}, {}: {}: {}",
            quoted(name, NAME),
            refusal.check(),
            quoted(&refusal.to_string(), REASON)
        )
    };
    let refusals = refused.iter().map(line).collect::<Vec<_>>().join("\n");
    Message::new(Role::User, fill(REPAIR, &[("refusals", refusals), ("count", layouts(refused.len()))]))
}

/// What is said of an answer that could not be read.
#[must_use]
pub fn nonsense(reason: &str, count: usize) -> Message {
    let reason = shortened(reason, REASON);
    Message::new(Role::User, fill(NONSENSE, &[("reason", reason), ("count", layouts(count))]))
}

/// Puts values in the places that a text names, `{{name}}`; what a value holds is not looked at again.
fn fill(text: &str, values: &[(&str, String)]) -> String {
    let mut filled = String::with_capacity(text.len());
    let mut rest = text;
    while let Some((before, after)) = rest.split_once("{{") {
        let Some((name, after)) = after.split_once("}}") else { break };
        filled.push_str(before);
        filled.push_str(values.iter().find(|(n, _)| *n == name).map_or("", |(_, value)| value));
        rest = after;
    }
    filled.push_str(rest);
    filled.trim_end().to_owned()
}

fn layouts(count: usize) -> String {
    if count == 1 { "1 layout".to_owned() } else { format!("{count} layouts") }
}

/// What a stranger wrote, as data: short, in one line and in quotes that it cannot end.
fn quoted(text: &str, most: usize) -> String {
    Value::String(shortened(text, most)).to_string()
}

/// A word of ours that came by way of a file: letters, digits and `_`.
fn word(text: &str) -> String {
    text.chars().filter(|c| c.is_ascii_alphanumeric() || *c == '_').take(40).collect()
}

fn numbers(values: impl Iterator<Item = f64>) -> String {
    values.map(|value| value.to_string()).collect::<Vec<_>>().join(", ")
}

fn params(brief: &Brief) -> String {
    let told = |spec: &env_core::space::ParamSpec| {
        let unit = if spec.unit.is_empty() || spec.unit == spec.name {
            String::new()
        } else {
            format!(" {}", spec.unit)
        };
        format!("{} {}{unit}", spec.name, brief.param(spec.name))
    };
    brief.base.task().params().iter().map(told).collect::<Vec<_>>().join(", ")
}

fn limits(brief: &Brief) -> String {
    if brief.limits.is_empty() {
        return "They are fixed: leave the field params out.".to_owned();
    }
    let row = |limit: &crate::brief::Limit| {
        format!("- {}: one of {}", limit.param, numbers(limit.values.iter().copied()))
    };
    let rows = brief.limits.iter().map(row).collect::<Vec<_>>().join("\n");
    format!("A layout may choose these in its field params:\n{rows}")
}

fn standing(brief: &Brief) -> String {
    match &brief.standing {
        Some(standing) if standing.n > 0 => format!(
            "on {} contested scenarios of this level it succeeds in {} (between {} and {} with 80 % certainty).",
            standing.n,
            percent(standing.mean),
            percent(standing.q10),
            percent(standing.q90)
        ),
        _ => "not known yet.".to_owned(),
    }
}

fn percent(share: f64) -> String {
    format!("{:.0} %", 100.0 * share.clamp(0.0, 1.0))
}

fn band(bands: SpeedBands, band: Option<u32>) -> String {
    let Some(band) = band.map(|band| band as usize) else { return "-".to_owned() };
    let (edges, unit) = (bands.edges, bands.unit);
    match (band.checked_sub(1).and_then(|below| edges.get(below)), edges.get(band)) {
        (None, Some(above)) => format!("below {above} {unit}"),
        (Some(below), Some(above)) => format!("{below} to {above} {unit}"),
        (Some(below), None) => format!("above {below} {unit}"),
        (None, None) => "-".to_owned(),
    }
}

/// The middle of a sector.
fn bearing(sector: u32) -> u32 {
    sector * 360 / SECTORS
}

/// The profile as a table, the heaviest first.
fn profile(profile: &Profile, bands: SpeedBands) -> String {
    let all = profile.failures();
    if all <= 0.0 {
        return "Nothing is known of its failures yet: spread the layouts over aims, bearings, speeds and satellites."
            .to_owned();
    }
    let mut rows: Vec<(f64, String)> = Vec::new();
    for mode in &profile.modes {
        let met: f64 = mode.cells.iter().map(|cell| cell.weight).sum();
        for cell in &mode.cells {
            let from = cell.sector.map_or_else(|| "-".to_owned(), |sector| bearing(sector).to_string());
            let left = cell.mean_steps_left.map_or_else(|| "-".to_owned(), |steps| format!("{steps:.1}"));
            rows.push((
                cell.weight,
                format!("{} | {from} | {} | {left}", word(&mode.mode), band(bands, cell.band)),
            ));
        }
        if mode.weight > met {
            rows.push((mode.weight - met, format!("{} | - | - | -", word(&mode.mode))));
        }
    }
    rows.retain(|(weight, _)| *weight > 0.0);
    rows.sort_by(|a, b| b.0.total_cmp(&a.0).then_with(|| a.1.cmp(&b.1)));
    let mut lines = vec![
        "share | mode | bearing in degrees (frame radial_in_track, sectors of 30) | relative speed | steps left to act"
            .to_owned(),
    ];
    lines.extend(rows.iter().take(ROWS).map(|(weight, row)| format!("{} | {row}", percent(weight / all))));
    let others: f64 = rows.iter().skip(ROWS).map(|(weight, _)| weight).sum();
    if others > 0.0 {
        lines.push(format!("{} | others", percent(others / all)));
    }
    lines.extend(profile.modes.iter().filter_map(rose));
    lines.join("\n")
}

/// The same failures of a mode by where they came from in the inertial frame.
fn rose(mode: &ModeProfile) -> Option<String> {
    let weights = mode.inertial_rose();
    let all: f64 = weights.iter().sum();
    if all <= 0.0 {
        return None;
    }
    let sectors = (0..SECTORS).zip(weights).filter(|(_, weight)| *weight > 0.0);
    let told = sectors.map(|(sector, weight)| format!("{} from {}", percent(weight / all), bearing(sector)));
    let told = told.collect::<Vec<_>>().join(", ");
    Some(format!("{} by bearing in the frame inertial: {told}", word(&mode.mode)))
}

fn fates(fates: &[Past]) -> String {
    if fates.is_empty() {
        return "There are none yet.".to_owned();
    }
    // How the agent did tells the most, what is refused comes next, and what nobody has flown fills up.
    let of = |is: fn(&Fate) -> bool| fates.iter().filter(move |past| is(&past.fate));
    let flown = of(|fate| matches!(fate, Fate::Flown { .. })).take(FLOWN);
    let refused = of(|fate| matches!(fate, Fate::Refused { .. })).take(REFUSED);
    let fresh = of(|fate| matches!(fate, Fate::Fresh));
    flown.chain(refused).chain(fresh).take(TOLD).map(fate).collect::<Vec<_>>().join("\n")
}

fn fate(past: &Past) -> String {
    let text = |at: &str| past.design.pointer(at).and_then(Value::as_str);
    let name = quoted(text("/name").unwrap_or_default(), NAME);
    let mode = word(text("/aim/mode").unwrap_or_default());
    let from = past.design.pointer("/aim/bearing_deg").and_then(Value::as_u64);
    let from = from.map_or_else(String::new, |bearing| {
        format!(" from {bearing} degrees ({})", word(text("/frame").unwrap_or("radial_in_track")))
    });
    let became = match &past.fate {
        Fate::Refused { check, reason } => format!("refused, {}: {}", word(check), quoted(reason, REASON)),
        Fate::Fresh => "admitted; nobody has flown it yet".to_owned(),
        Fate::Flown { episodes, success, as_aimed, retired, .. } => {
            let retired = if *retired { "; it serves no longer" } else { "" };
            let aimed = as_aimed.map(|share| format!("; what went wrong was the aim in {}", percent(share)));
            let aimed = aimed.unwrap_or_default();
            format!(
                "admitted; the agent succeeded in {} of {episodes} episodes{aimed}{retired}",
                percent(*success)
            )
        }
    };
    format!("- {name}, aimed at {mode}{from}: {became}")
}
