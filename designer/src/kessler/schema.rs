//! Description of the language for a language model: the JSON schema of a design, and the rules in words. Both are built from
//! `vocabulary` and `aim`.
//!
//! `required` lists fields in the order in which a model writes them: the aim before the list of encounters.
//! All texts are part of the prompt: changing one changes the prompt.

use env_core::kessler::constants::{
    CONTACT_DISTANCE, EARTH_RADIUS, FUEL_PER_SPEED, HORIZON, SATELLITE_RADII, SATELLITES,
};
use env_core::kessler::threat_placement::THREAT_START_RADII;
use serde_json::{Value, json};

use super::aim::{AIM_TOLERANCE_DEG, allowed_aims, allows_rogues};
use super::vocabulary::{
    BEARING, EncounterKind, FRAMES, KINDS, KindSpec, MAX_ENCOUNTERS, MISS, SATELLITE, SPEED, STEP,
};
use crate::bound::Bound;
use crate::brief::DesignBrief;
use crate::design_fields::MAX_NAME_CHARS;
use crate::schema_forms::{integer, object, params, string_of};

/// Maximum number of encounters that a model is asked for. A layout is as good as its worst encounter, every one must be
/// possible, and small models use all that they may.
const MAX_REQUESTED_ENCOUNTERS: usize = 4;
const _: () = assert!(MAX_REQUESTED_ENCOUNTERS <= MAX_ENCOUNTERS);

/// Returns the JSON schema of one design. Every field is required, as strict endpoints demand. A field without a choice is left
/// out.
pub(super) fn design_schema(brief: &DesignBrief) -> Value {
    // One form for each kind that aims need, so that a grammar enforces matching encounters.
    let forms: Vec<_> = [EncounterKind::Threat, EncounterKind::Decoy]
        .into_iter()
        .filter_map(|kind| {
            let modes: Vec<_> =
                allowed_aims(brief).filter(|aim| aim.kind == kind).map(|aim| aim.mode).collect();
            (!modes.is_empty()).then(|| design_form(brief, kind, modes))
        })
        .collect();
    match <[Value; 1]>::try_from(forms) {
        Ok([only]) => only,
        Err(forms) => json!({"anyOf": forms}),
    }
}

/// Returns the rules of the world and of the language in words.
pub(super) fn rules(brief: &DesignBrief) -> String {
    let (low, high) = SATELLITE_RADII;
    let (nearest, farthest) = THREAT_START_RADII;
    let mut text = format!(
        "The world: {SATELLITES} satellites (0 to {}) circle the Earth in one plane, prograde, between {low} and {high} LU \
         from its centre; the Earth's radius is {EARTH_RADIUS} LU. An episode has {HORIZON} steps of 1 TU. Debris that comes \
         closer than {CONTACT_DISTANCE} LU to a satellite destroys it. The agent may burn to evade; a burn costs \
         {FUEL_PER_SPEED} fuel for each LU/TU of change. Without burns the satellites stay on their orbits.\n\n\
         A layout is a list of encounters of satellites with debris. Each encounter has a satellite, a step, a bearing, a \
         relative speed and a miss distance; a program computes the orbits. Fields of a layout:\n",
        SATELLITES - 1,
    );
    text.push_str("- aim.mode: failure mode that the layout is meant to cause. One of:\n");
    for aim in allowed_aims(brief) {
        text.push_str(&format!("  - {}: needs {}\n", aim.mode, aim.needs));
    }
    text.push_str(&format!(
        "- aim.{}: bearing of the aim; a needed encounter must come from within {AIM_TOLERANCE_DEG} degrees of it\n\
         - frame: frame of all bearings of the layout. One of:\n",
        BEARING.name
    ));
    for frame in FRAMES {
        text.push_str(&format!("  - {}: {}\n", frame.name, frame.description));
    }
    if !brief.param_choices.is_empty() {
        text.push_str("- params: params of the task, each with one of the values that the brief lists\n");
    }
    text.push_str(&format!("- encounters: list of 1 to {MAX_REQUESTED_ENCOUNTERS} encounters, each with\n"));
    text.push_str("  - kind: purpose of the encounter. One of:\n");
    for KindSpec { name, min_miss, max_miss, description: about, .. } in KINDS {
        text.push_str(&format!("    - {name}: {about}; {} {min_miss} to {max_miss}\n", MISS.name));
    }
    for bound in [SATELLITE, STEP, BEARING, SPEED, MISS] {
        text.push_str(&format!(
            "  - {}: {} to {}: {}\n",
            bound.name, bound.min, bound.max, bound.description
        ));
    }
    if allows_rogues(brief) {
        text.push_str("  - rogue: true if the debris appears a few steps before the encounter; false if it exists from the start\n");
    }
    text.push_str(&format!("- name: short name of the layout, at most {MAX_NAME_CHARS} characters\n\n"));
    text.push_str(&format!(
        "The program refuses a layout in these cases:\n\
         - Debris comes out of the Earth, or does not start {nearest} to {farthest} LU from its centre. Choose an earlier \
         step or a slower pass.\n\
         - Debris touches a satellite before its step.\n\
         - The encounters do not match the aim.\n\
         - No agent could evade the threats.\n\
         - A layout with a threat loses no satellite if no satellite burns.\n\
         - A layout of decoys loses a satellite if no satellite burns.\n\
         - The layout is too similar to an earlier one."
    ));
    text
}

/// Returns the schema of a design whose aim needs encounters of a kind. Screens are allowed beside them, and decoys beside
/// threats.
fn design_form(brief: &DesignBrief, needed: EncounterKind, modes: Vec<&'static str>) -> Value {
    let aim = [("mode", string_of(modes)), ("bearing_deg", integer(BEARING.min, BEARING.max))];
    let mut fields = vec![("aim", object(&aim)), ("frame", string_of(FRAMES.map(|spec| spec.name)))];
    let choices: Vec<_> = brief.param_choices.iter().collect();
    fields.extend(params(&choices).map(|params| ("params", params)));
    // One form for each kind, so that a grammar enforces its miss distances.
    let is_allowed = |kind: EncounterKind| kind == needed || needed == EncounterKind::Threat;
    let encounters: Vec<_> = KINDS
        .iter()
        .filter(|spec| is_allowed(spec.kind))
        .map(|spec| encounter_form(spec, allows_rogues(brief)))
        .collect();
    fields.push((
        "encounters",
        json!({
            "type": "array",
            "minItems": 1,
            "maxItems": MAX_REQUESTED_ENCOUNTERS,
            "items": {"anyOf": encounters},
        }),
    ));
    fields.push(("name", json!({"type": "string", "maxLength": MAX_NAME_CHARS})));
    object(&fields)
}

/// Returns the schema of an encounter of a kind.
fn encounter_form(kind: &KindSpec, allows_rogues: bool) -> Value {
    let bounded = |bound: Bound<u32>| (bound.name, integer(bound.min, bound.max));
    let mut fields = vec![
        ("kind", string_of([kind.name])),
        bounded(SATELLITE),
        bounded(STEP),
        bounded(BEARING),
        bounded(SPEED),
        (MISS.name, integer(kind.min_miss, kind.max_miss)),
    ];
    if allows_rogues {
        fields.push(("rogue", json!({"type": "boolean"})));
    }
    object(&fields)
}
