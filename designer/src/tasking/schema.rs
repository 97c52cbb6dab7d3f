//! Description of the language for a language model: the JSON schema of a design, and the rules in words. Both are built from
//! `vocabulary` and `aim`.
//!
//! `required` lists fields in the order in which a model writes them: the aim before the start and the fields.
//! All texts are part of the prompt: changing one changes the prompt.

use env_core::tasking::setup::environment::DEFAULT_STATIONS;
use serde_json::{Value, json};

use super::aim::{AIM_TOLERANCE_DEG, allowed_aims};
use super::orbit_facts::OrbitFacts;
use super::params::{choices, has_targets, station_count};
use super::units::S_PER_MINUTE;
use super::vocabulary::{AIM_ANGLE, FIELD_NUMBERS, MAX_FIELDS, MINUTE, SATELLITE, START_NUMBERS, STATION};
use crate::bound::Bound;
use crate::brief::DesignBrief;
use crate::design_fields::MAX_NAME_CHARS;
use crate::schema_forms::{integer, object, optional_integer, params, string_of};

/// Maximum number of fields that a model is asked for. Small models use all that they may.
const MAX_REQUESTED_FIELDS: usize = 4;
const _: () = assert!(MAX_REQUESTED_FIELDS <= MAX_FIELDS);

/// Returns the JSON schema of one design. Every field is required, as strict endpoints demand. A field without a choice is left
/// out.
pub(super) fn design_schema(brief: &DesignBrief) -> Value {
    let limits = Limits::of(brief);
    let bounded = |number: &Bound<i32>| (number.name, integer(number.min, limits.max(number)));
    let angle = optional_integer(AIM_ANGLE.min, AIM_ANGLE.max);
    let modes = allowed_aims(brief).map(|aim| aim.mode);
    let mut fields = vec![("aim", object(&[("mode", string_of(modes)), (AIM_ANGLE.name, angle)]))];
    fields.extend(params(&choices(brief)).map(|params| ("params", params)));
    fields.push(("start", object(&START_NUMBERS.each_ref().map(bounded))));
    fields.push((
        STATION.name,
        json!({
            "type": "array",
            "maxItems": limits.stations - 1,
            "items": integer(STATION.min, limits.max(&STATION)),
        }),
    ));
    if has_targets(&brief.recipe) {
        fields.push(("background", json!({"type": "boolean"})));
        fields.push((
            "fields",
            json!({
                "type": "array",
                "minItems": 1,
                "maxItems": MAX_REQUESTED_FIELDS,
                "items": object(&FIELD_NUMBERS.each_ref().map(bounded)),
            }),
        ));
    }
    fields.push(("name", json!({"type": "string", "maxLength": MAX_NAME_CHARS})));
    object(&fields)
}

/// Returns the rules of the world and of the language in words.
pub(super) fn rules(brief: &DesignBrief) -> String {
    let mut text = world_text(brief);
    text.push_str(
        "Fields of a layout:\n- aim.mode: failure mode that the layout is meant to cause. One of:\n",
    );
    for aim in allowed_aims(brief) {
        text.push_str(&format!("  - {}: needs {}\n", aim.mode, aim.needs));
    }
    text.push_str(&format!(
        "- aim.{}: {}; the failure must begin within {AIM_TOLERANCE_DEG} degrees of it\n",
        AIM_ANGLE.name, AIM_ANGLE.description
    ));
    if !choices(brief).is_empty() {
        text.push_str("- params: params of the task, each with one of the values that the brief lists\n");
    }
    let limits = Limits::of(brief);
    let mut add_numbers = |title: &str, numbers: &[Bound<i32>]| {
        text.push_str(title);
        for number in numbers {
            let (min, max) = (number.min, limits.max(number));
            text.push_str(&format!("  - {}: {min} to {max}: {}\n", number.name, number.description));
        }
    };
    add_numbers("- start: the start of the episode and of all satellites, with\n", &START_NUMBERS);
    let stations = DEFAULT_STATIONS.iter().take(limits.stations).enumerate();
    let names: Vec<_> = stations.map(|(number, station)| format!("{number} {}", station.name)).collect();
    add_numbers(
        &format!(
            "- {}: {}; [] for none. One must stay. They are {}\n",
            STATION.name,
            STATION.description,
            names.join(", ")
        ),
        &[],
    );
    if has_targets(&brief.recipe) {
        add_numbers(
            &format!(
                "- background: true if the targets that the task draws all over the Earth stay, false if only those of the fields count\n\
                 - fields: list of 1 to {MAX_REQUESTED_FIELDS} fields of targets, each with\n"
            ),
            &FIELD_NUMBERS,
        );
    }
    text.push_str(&format!(
        "- name: short name of the layout, at most {MAX_NAME_CHARS} characters\n\n\
         The program refuses a layout in these cases:\n\
         - Start and fields do not match the aim. It computes shadow, passes and windows, and says what is missing.\n\
         - The planner loses a satellite, or cannot succeed: with 5 % of charge in the shadow, or wheels near their limit, no action \
         helps. Leave sunlight to charge in, and some speed to turn with.\n\
         - Acting well does not matter: a fixed cycle of work and charging earns as much as the planner.\n\
         - The layout is too similar to an earlier one."
    ));
    text
}

/// Returns the description of the world at the params of the brief.
fn world_text(brief: &DesignBrief) -> String {
    let recipe = &brief.recipe;
    let agents = recipe.task().agents(recipe);
    let satellites = match agents {
        1 => "a satellite circles".to_owned(),
        _ => format!("{agents} satellites (0 to {}) circle", agents - 1),
    };
    let OrbitFacts { altitude_km, inclination_deg, minutes, deg_per_minute, half_shadow_deg, sight_km } =
        OrbitFacts::of(recipe.task());
    let limit = recipe.param("time_limit_s").unwrap_or(0.0) / S_PER_MINUTE;
    let work = if has_targets(recipe) {
        format!(
            "It earns the priority of each target that it images first while the target is in its window. It sees targets up to about \
             {:.0} km beside its track, each for one to three minutes, and turns to them, which takes half a minute or more.",
            50.0 * libm::floor(sight_km / 50.0)
        )
    } else {
        "It earns by every second in which it scans the ground below and stores the data.".to_owned()
    };
    format!(
        "The world: {satellites} the Earth at {altitude_km} km, inclined by {inclination_deg} degrees, in {minutes:.0} minutes each; an episode has \
         {limit:.0} minutes. {work} It has to charge its battery in sunlight, to send data to ground stations before the storage is \
         full, and to slow its wheels with thrusters. A satellite dies if its battery is empty or a wheel is too fast. Devices draw \
         11 W always and 30 W more at work. The shadow of the Earth lasts up to {:.0} minutes of each orbit, around midnight: orbit \
         angles of about {:.0} to {:.0} degrees if node_hour is near 0 or 12. A satellite moves by {deg_per_minute:.1} degrees a \
         minute.\n\n",
        2.0 * half_shadow_deg / deg_per_minute,
        180.0 - half_shadow_deg,
        180.0 + half_shadow_deg,
    )
}

/// Bounds of numbers that depend on the params of a brief.
struct Limits {
    satellites: i32,
    stations: usize,
    last_minute: i32,
}

impl Limits {
    fn of(brief: &DesignBrief) -> Self {
        let recipe = &brief.recipe;
        let minutes = recipe.param("time_limit_s").unwrap_or(0.0) / S_PER_MINUTE;
        Self {
            satellites: i32::try_from(recipe.task().agents(recipe)).unwrap_or(SATELLITE.max + 1),
            stations: station_count(recipe),
            last_minute: minutes as i32 - 1,
        }
    }

    /// Largest value of a number.
    fn max(&self, number: &Bound<i32>) -> i32 {
        let most = match number {
            number if number.name == SATELLITE.name => self.satellites - 1,
            number if number.name == MINUTE.name => self.last_minute,
            number if number.name == STATION.name => self.stations as i32 - 1,
            _ => number.max,
        };
        most.clamp(number.min, number.max)
    }
}
