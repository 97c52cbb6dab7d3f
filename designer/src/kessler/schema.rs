//! The language as a language model is told it: the JSON schema of a design, and the rules in words. Both are made of
//! what `language` and `claim` say; nothing is said twice.
//!
//! `required` lists fields in the order a model is to say them: what it is after before how, the aim before the list.

use env_core::kessler::constants::{
    CONTACT_DISTANCE, EARTH_RADIUS, FUEL_PER_SPEED, HORIZON, SATELLITE_RADII, SATELLITES,
};
use env_core::kessler::plant::START_RADII;
use serde_json::{Map, Value, json};

use super::Kind;
use super::claim::AIM_WIDTH;
use super::language::{
    BEARING, Bound, FRAMES, KINDS, MAX_ENCOUNTERS, MAX_NAME, MISS, SATELLITE, SPEED, STEP,
};

use super::speak::{aims, rogues};
use crate::brief::Brief;

/// Encounters that a model is asked for, at most. A layout is as good as its worst encounter, every one of which must be
/// buildable, and small models fill what they may.
const ASKED: usize = 4;
const _: () = assert!(ASKED <= MAX_ENCOUNTERS);

fn whole(min: u32, max: u32) -> Value {
    json!({"type": "integer", "minimum": min, "maximum": max})
}

fn one_of<'a>(words: impl IntoIterator<Item = &'a str>) -> Value {
    json!({"type": "string", "enum": words.into_iter().collect::<Vec<_>>()})
}

/// An object of these fields, all wanted, in this order.
fn object(fields: &[(&str, Value)]) -> Value {
    let order: Vec<_> = fields.iter().map(|field| field.0).collect();
    let properties: Map<_, _> =
        fields.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
    json!({"type": "object", "additionalProperties": false, "required": order, "properties": properties})
}

/// The schema of one design. Every field is wanted, as strict endpoints have it; a field in which nothing can be chosen is
/// not there.
pub(super) fn schema(brief: &Brief) -> Value {
    // A form for each kind that aims take, so that a grammar holds the encounters to what the aim needs.
    let forms: Vec<_> = [Kind::Threat, Kind::Decoy]
        .into_iter()
        .filter_map(|kind| {
            let modes: Vec<_> = aims(brief).filter(|aim| aim.1 == kind).map(|aim| aim.0).collect();
            (!modes.is_empty()).then(|| form(brief, kind, modes))
        })
        .collect();
    match <[Value; 1]>::try_from(forms) {
        Ok([only]) => only,
        Err(forms) => json!({"anyOf": forms}),
    }
}

/// The schema of a design whose aim takes encounters of this kind; wide passes may stand beside them, and decoys beside
/// threats.
fn form(brief: &Brief, needed: Kind, modes: Vec<&'static str>) -> Value {
    let bearing = whole(BEARING.min, BEARING.max);
    let aim = vec![("mode", one_of(modes)), ("bearing_deg", bearing)];
    let mut fields = vec![("aim", object(&aim)), ("frame", one_of(FRAMES.map(|row| row.0)))];
    let params = brief.limits.iter();
    let params: Vec<_> =
        params.map(|l| (l.param.as_str(), json!({"type": "number", "enum": l.values}))).collect();
    if !params.is_empty() {
        fields.push(("params", object(&params)));
    }
    // One form a kind, so that a grammar holds each to the miss distances it may have.
    let fits = |kind: Kind| kind == needed || needed == Kind::Threat;
    let encounters: Vec<_> = KINDS
        .iter()
        .filter(|row| fits(row.0))
        .map(|(_, kind, min, max, _)| encounter(kind, whole(*min, *max), rogues(brief)))
        .collect();
    fields.push((
        "encounters",
        json!({
            "type": "array", "minItems": 1, "maxItems": ASKED, "items": {"anyOf": encounters},
        }),
    ));
    fields.push(("name", json!({"type": "string", "maxLength": MAX_NAME})));
    object(&fields)
}

fn encounter(kind: &str, miss: Value, rogues: bool) -> Value {
    let bounded = |bound: Bound| (bound.name, whole(bound.min, bound.max));
    let mut fields = vec![
        ("kind", one_of([kind])),
        bounded(SATELLITE),
        bounded(STEP),
        bounded(BEARING),
        bounded(SPEED),
        (MISS.name, miss),
    ];
    if rogues {
        fields.push(("rogue", json!({"type": "boolean"})));
    }
    object(&fields)
}

/// The rules in words.
pub(super) fn rules(brief: &Brief) -> String {
    let (low, high) = SATELLITE_RADII;
    let (nearest, farthest) = START_RADII;
    let mut text = format!(
        "The world: {SATELLITES} satellites (0 to {}) circle the Earth in one plane, prograde, between {low} and {high} LU \
         from its centre; the Earth's radius is {EARTH_RADIUS} LU. An episode has {HORIZON} steps of 1 TU. Debris that comes \
         closer than {CONTACT_DISTANCE} LU to a satellite destroys it. The agent may burn to evade; a burn costs \
         {FUEL_PER_SPEED} fuel for each LU/TU of change, and an agent that does nothing stays on its orbits.\n\n\
         A layout is a list of encounters of satellites with debris, said as who, when, from where, how fast and how close; \
         a program works out the orbits. Its fields:\n",
        SATELLITES - 1,
    );
    text.push_str("- aim.mode: what the layout is meant to hit. One of:\n");
    for (mode, _, _, needs) in aims(brief) {
        text.push_str(&format!("  - {mode}: it takes {needs}\n"));
    }
    text.push_str(&format!(
        "- aim.{}: the bearing it is about; an encounter that counts for the aim must come from within {AIM_WIDTH} degrees \
         of it\n- frame: what all bearings of the layout are measured in. One of:\n",
        BEARING.name
    ));
    for (word, _, about) in FRAMES {
        text.push_str(&format!("  - {word}: {about}\n"));
    }
    if !brief.limits.is_empty() {
        text.push_str("- params: params of the task, among the values that the brief allows\n");
    }
    text.push_str(&format!("- encounters: 1 to {ASKED} of them, each with\n"));
    text.push_str("  - kind: what it is for. One of:\n");
    for (_, word, min, max, about) in KINDS {
        text.push_str(&format!("    - {word}: {about}; {} {min} to {max}\n", MISS.name));
    }
    for bound in [SATELLITE, STEP, BEARING, SPEED, MISS] {
        text.push_str(&format!("  - {}: {} to {}: {}\n", bound.name, bound.min, bound.max, bound.about));
    }
    if rogues(brief) {
        text.push_str("  - rogue: true if it appears a few steps before, out of nothing; false if it is there from the start\n");
    }
    text.push_str(&format!("- name: a few words for people, at most {MAX_NAME} characters\n\n"));
    text.push_str(&format!(
        "What is refused: debris whose path back to the start leaves {nearest} to {farthest} LU or comes out of the Earth \
         (ask for an earlier step or a slower pass), debris that touches a satellite before its step, encounters that do not \
         keep the aim, threats that no agent could evade, a layout with a threat in which doing nothing loses nobody, \
         a layout of decoys in which doing nothing loses somebody, and layouts too much like earlier ones."
    ));
    text
}
