//! Description of the language for a language model: the JSON schema of a design, and the rules in words. Both are built from
//! `vocabulary` and `aim`.
//!
//! `required` lists fields in the order in which a model writes them: the aim before the list of deputies.
//! All texts are part of the prompt: changing one changes the prompt.

use env_core::docking::constants::{
    COLLISION_DISTANCE_M, DOCKING_RADIUS_M, DOCKING_SPEED_M_S, LIMIT_SLOPE_1_S, MASS_KG, MAX_DISTANCE_M,
    MIN_VELOCITY_PENALTY, START_SEPARATION_M,
};
use env_core::docking::relative_motion::speed_limit;
use serde_json::{Value, json};

use super::aim::{AIM_TOLERANCE_DEG, DeputyCounts, allowed_aims};
use super::approach::time_at_limit;
use super::vocabulary::{BEARING, NUMBERS, effective_choices};
use crate::brief::DesignBrief;
use crate::design_fields::MAX_NAME_CHARS;
use crate::schema_forms::{integer, object, optional_integer, params, string_of};

/// Distances of the table of speed limits and times in the rules, m.
const TABLE_DISTANCES_M: [f64; 7] = [10.0, 30.0, 60.0, 100.0, 150.0, 300.0, 1000.0];

/// Formulas by which a deputy matches an aim, see [`approach`](super::approach).
const FORMULAS: &str = "\n\nFormulas, with the closing speed c, the speed v, the speed limit l at the start in m/s and \
    a = thrust_bound/12 in m/s per second:\n\
    - way of braking to the docking speed: (c*c - 0.04)/(2*a) metres\n\
    - velocity penalty of braking to the limit: 0.01*(e + e*e/2)/a with e = v - l\n\
    - seconds to the chief: seconds at the limit + (l - c)*(l - c)/(2*a*l)";

/// Returns the JSON schema of one design. Every field is required, as strict endpoints demand. A field without a choice is left
/// out.
pub(super) fn design_schema(brief: &DesignBrief) -> Value {
    let modes = allowed_aims(brief).map(|aim| aim.mode);
    let bearing = optional_integer(BEARING.min, BEARING.max);
    let aim = [("mode", string_of(modes)), (BEARING.name, bearing)];
    let mut fields = vec![("aim", object(&aim))];
    fields.extend(params(&effective_choices(brief)).map(|params| ("params", params)));
    let counts = DeputyCounts::of(brief);
    let deputy = object(&NUMBERS.map(|bound| (bound.name, integer(bound.min, bound.max))));
    let deputies = json!({"type": "array", "minItems": counts.min, "maxItems": counts.max, "items": deputy});
    fields.push(("deputies", deputies));
    fields.push(("name", json!({"type": "string", "maxLength": MAX_NAME_CHARS})));
    object(&fields)
}

/// Returns the rules of the world and of the language in words.
pub(super) fn rules(brief: &DesignBrief) -> String {
    let mut text = world_rules();
    text.push_str(FORMULAS);
    text.push_str("\n\nA layout is the list of all deputies at the start. Fields of a layout:\n");
    text.push_str("- aim.mode: failure mode that the layout is meant to cause. One of:\n");
    for aim in allowed_aims(brief) {
        text.push_str(&format!("  - {}: needs {}\n", aim.mode, aim.needs));
    }
    text.push_str(&format!(
        "- aim.{}: {}; at the start, within {AIM_TOLERANCE_DEG} degrees; null if any will do\n",
        BEARING.name, BEARING.description
    ));
    if !effective_choices(brief).is_empty() {
        text.push_str("- params: params of the task, each with one of the values that the brief lists\n");
    }
    let DeputyCounts { min, max } = DeputyCounts::of(brief);
    let count = if min == max { min.to_string() } else { format!("{min} to {max}") };
    text.push_str(&format!("- deputies: list of {count}, each with\n"));
    for bound in NUMBERS {
        text.push_str(&format!(
            "  - {}: {} to {}: {}\n",
            bound.name, bound.min, bound.max, bound.description
        ));
    }
    text.push_str(&format!("- name: short name of the layout, at most {MAX_NAME_CHARS} characters\n"));
    if max > 1 {
        text.push_str(
            "\nDeputies start abreast with equal distances and different azimuths, in a line with equal azimuths and different \
             distances, opposite each other with azimuths 180 apart, and on crossing paths abreast with cross_deg 0 and 180.\n",
        );
    }
    text.push_str(&format!(
        "\nThe program refuses a layout in these cases:\n\
         - Two deputies start less than {START_SEPARATION_M} m apart, or one is faster than 10 m/s on an axis.\n\
         - The deputies do not match the aim.\n\
         - No thrust can prevent a crash, a collision or a velocity penalty of {}, if the agent coasts for 5 s first.\n\
         - The program's own planner cannot dock all deputies.\n\
         - A deputy docks without any thrust.\n\
         - The layout is too similar to an earlier one.",
        -MIN_VELOCITY_PENALTY
    ));
    text
}

/// Returns the rules of the world, with speed limits and times at some distances.
fn world_rules() -> String {
    let mut text = format!(
        "The world: deputies dock with a chief on a circular orbit. Hill's frame: x is radial out, y in-track, z cross-track. A \
         deputy docks within {DOCKING_RADIUS_M} m of the chief at {DOCKING_SPEED_M_S} m/s or less, and crashes if it is faster. \
         At a distance of d metres the speed limit is {DOCKING_SPEED_M_S} + {LIMIT_SLOPE_1_S} (d - {DOCKING_RADIUS_M}) m/s. A \
         second above it costs a velocity penalty of 0.01, and 0.01 more for each m/s; a penalty of {} stops the deputy. Two \
         deputies closer than {COLLISION_DISTANCE_M} m collide, which ends the episode. {MAX_DISTANCE_M} m is out of bounds. The \
         agent thrusts on each axis up to the param thrust_bound; 1 N accelerates a deputy by {:.3} m/s each second. All must \
         dock within the param time_limit_s.\n\n\
         distance in m | speed limit in m/s | seconds to the chief at the limit",
        -MIN_VELOCITY_PENALTY,
        1.0 / MASS_KG
    );
    for distance in TABLE_DISTANCES_M {
        let (limit, seconds) = (speed_limit(distance), time_at_limit(distance));
        text.push_str(&format!("\n{distance} | {limit:.2} | {seconds:.0}"));
    }
    text
}
