//! The language as a language model is told it: the JSON schema of a design, and the rules in words.

use serde_json::{Map, Value, json};

use super::language::{BEARING, Bound, FRAMES, KINDS, MAX_ENCOUNTERS, MISS, SATELLITE, SPEED, STEP};
use super::speak::{aims, rogues};
use crate::brief::Brief;

fn whole(bound: Bound) -> Value {
    json!({"type": "integer", "minimum": bound.min, "maximum": bound.max})
}

/// The schema of one design: the aim before the encounters, so that a model says what it is after before it lists them.
pub(super) fn schema(brief: &Brief) -> Value {
    let modes: Vec<_> = aims(brief).map(|aim| aim.0).collect();
    let params: Map<String, Value> =
        brief.limits.iter().map(|limit| (limit.param.clone(), json!({"enum": limit.values}))).collect();
    let rogue = if rogues(brief) { json!({"type": "boolean"}) } else { json!({"enum": [false]}) };
    json!({
        "type": "object",
        "additionalProperties": false,
        "required": ["name", "aim", "frame", "encounters"],
        "properties": {
            "name": {"type": "string", "maxLength": 60},
            "aim": {
                "type": "object",
                "additionalProperties": false,
                "required": ["mode", "bearing_deg"],
                "properties": {"mode": {"enum": modes}, "bearing_deg": whole(BEARING)},
            },
            "frame": {"enum": FRAMES.map(|row| row.0)},
            "params": {"type": "object", "additionalProperties": false, "properties": params},
            "encounters": {
                "type": "array", "minItems": 1, "maxItems": MAX_ENCOUNTERS,
                "items": {
                    "type": "object",
                    "additionalProperties": false,
                    "required": ["kind", "satellite", "step", "bearing_deg", "relative_speed", "miss_distance", "rogue"],
                    "properties": {
                        "kind": {"enum": KINDS.map(|row| row.1)},
                        "satellite": whole(SATELLITE),
                        "step": whole(STEP),
                        "bearing_deg": whole(BEARING),
                        "relative_speed": whole(SPEED),
                        "miss_distance": whole(MISS),
                        "rogue": rogue,
                    },
                },
            },
        },
    })
}

/// The rules in words.
pub(super) fn rules(_brief: &Brief) -> String {
    String::new()
}
