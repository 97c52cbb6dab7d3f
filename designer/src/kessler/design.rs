//! [`Design`]: a layout as a list of encounters of satellites with debris, and its JSON form.
//!
//! Numbers are integers, since grammars that constrain a language model enforce the range of integers but not of fractions.

use std::collections::BTreeMap;

use env_core::kessler::bearing::BearingFrame;
use serde_json::{Map, Value, json};

use super::vocabulary::{
    BEARING, EncounterKind, FRAMES, KINDS, KindSpec, MAX_ENCOUNTERS, MAX_NAME_CHARS, MISS, SATELLITE, SPEED,
    STEP, frame_spec,
};
use crate::field_error::FieldError;
use crate::untrusted_text::{is_control, shorten};

/// Maximum number of params that are parsed.
const MAX_PARAMS: usize = 40;

/// Encounter of a satellite with debris. Numbers are as in JSON; [`Bound::value`] converts them to quantities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Encounter {
    /// Index of the satellite, see [`SATELLITE`].
    pub satellite: u32,
    /// Step of the encounter, see [`STEP`].
    pub step: u32,
    /// Bearing in the frame of the design, see [`BEARING`].
    pub bearing_deg: u32,
    /// Relative speed, see [`SPEED`].
    pub relative_speed: u32,
    /// Miss distance, see [`MISS`].
    pub miss_distance: u32,
    /// Purpose of the encounter.
    pub kind: EncounterKind,
    /// True if the body appears a few steps before the encounter, instead of existing from the start.
    pub is_rogue: bool,
}

/// Failure that a design aims to cause.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Aim {
    /// Failure mode of the task.
    pub mode: String,
    /// Bearing of the failures, in the frame of the design; `None` if the mode has none.
    pub bearing_deg: Option<u32>,
}

/// Layout as its designer describes it.
#[derive(Debug, Clone, PartialEq)]
pub struct Design {
    /// Name of the layout, for display.
    pub name: String,
    /// Failure that the layout aims to cause.
    pub aim: Aim,
    /// Frame of all bearings.
    pub frame: BearingFrame,
    /// Params that replace those of the base scenario.
    pub params: BTreeMap<String, f64>,
    /// Encounters, at least one.
    pub encounters: Vec<Encounter>,
}

impl Encounter {
    /// Returns the JSON form.
    #[must_use]
    pub fn to_json(&self) -> Value {
        json!({
            "satellite": self.satellite,
            "step": self.step,
            "bearing_deg": self.bearing_deg,
            "relative_speed": self.relative_speed,
            "miss_distance": self.miss_distance,
            "kind": self.kind.as_str(),
            "rogue": self.is_rogue,
        })
    }

    /// Parses the JSON form. `path` is the position of the encounter, such as `encounters.0`.
    fn parse(path: &str, value: &Value) -> Result<Self, FieldError> {
        let fields = parse_object(path, value)?;
        reject_unknown(
            path,
            fields,
            &["satellite", "step", "bearing_deg", "relative_speed", "miss_distance", "kind", "rogue"],
        )?;
        let names = KINDS.map(|spec| spec.name);
        let kind = KINDS[parse_choice(&format!("{path}.kind"), fields.get("kind"), &names)?].kind;
        let is_rogue = match fields.get("rogue") {
            None => false,
            Some(value) => value
                .as_bool()
                .ok_or_else(|| FieldError::new(format!("{path}.rogue"), "must be true or false"))?,
        };
        let encounter = Self {
            satellite: SATELLITE.parse(path, fields)?,
            step: STEP.parse(path, fields)?,
            bearing_deg: BEARING.parse(path, fields)?,
            relative_speed: SPEED.parse(path, fields)?,
            miss_distance: MISS.parse(path, fields)?,
            kind,
            is_rogue,
        };
        encounter.validate(path)?;
        Ok(encounter)
    }

    /// Checks that all numbers are within their bounds, and that the miss distance fits the kind. `path` is the position of
    /// the encounter in error messages.
    ///
    /// # Errors
    /// Returns the first field that is out of bounds.
    pub fn validate(&self, path: &str) -> Result<(), FieldError> {
        let numbers = [
            (SATELLITE, self.satellite),
            (STEP, self.step),
            (BEARING, self.bearing_deg),
            (SPEED, self.relative_speed),
            (MISS, self.miss_distance),
        ];
        for (bound, number) in numbers {
            if !bound.contains(number) {
                return Err(FieldError::new(
                    format!("{path}.{}", bound.name),
                    format!("must be from {} to {}, got {number}", bound.min, bound.max),
                ));
            }
        }
        let KindSpec { name, min_miss, max_miss, description: about, .. } = self.kind.spec();
        if (*min_miss..=*max_miss).contains(&self.miss_distance) {
            Ok(())
        } else {
            Err(FieldError::new(
                format!("{path}.miss_distance"),
                format!(
                    "must be from {min_miss} to {max_miss} for a {name}, which {about}, got {}",
                    self.miss_distance
                ),
            ))
        }
    }
}

impl Design {
    /// Returns the JSON form.
    #[must_use]
    pub fn to_json(&self) -> Value {
        json!({
            "name": self.name,
            "aim": {"mode": self.aim.mode, "bearing_deg": self.aim.bearing_deg},
            "frame": frame_spec(self.frame).name,
            "params": self.params,
            "encounters": self.encounters.iter().map(Encounter::to_json).collect::<Vec<_>>(),
        })
    }

    /// Parses the JSON form. Does not check the failure mode and the params against the task.
    ///
    /// # Errors
    /// Returns the first invalid field, and which values are allowed.
    pub fn from_json(value: &Value) -> Result<Self, FieldError> {
        let fields = parse_object("design", value)?;
        reject_unknown("design", fields, &["name", "aim", "frame", "params", "encounters"])?;
        let aim = parse_object("aim", fields.get("aim").unwrap_or(&Value::Null))?;
        reject_unknown("aim", aim, &["mode", "bearing_deg"])?;
        let mode = aim.get("mode").and_then(Value::as_str).ok_or_else(|| {
            FieldError::new("aim.mode", "is required: the failure mode that the layout aims at")
        })?;
        let bearing_deg = match aim.get("bearing_deg") {
            None | Some(Value::Null) => None,
            Some(_) => Some(BEARING.parse("aim", aim)?),
        };
        let frame = match fields.get("frame") {
            None => FRAMES[0].frame,
            name => FRAMES[parse_choice("frame", name, &FRAMES.map(|spec| spec.name))?].frame,
        };
        Ok(Self {
            name: fields.get("name").and_then(Value::as_str).map_or_else(String::new, clean_name),
            aim: Aim { mode: clean_name(mode), bearing_deg },
            frame,
            params: parse_params(fields.get("params"))?,
            encounters: parse_encounters(fields.get("encounters"))?,
        })
    }
}

fn parse_params(value: Option<&Value>) -> Result<BTreeMap<String, f64>, FieldError> {
    let Some(value) = value.filter(|value| !value.is_null()) else { return Ok(BTreeMap::new()) };
    let param = |(name, value): (&String, &Value)| {
        let name = clean_name(name);
        match value.as_f64().filter(|number| number.is_finite()) {
            Some(number) => Ok((name, number)),
            None => Err(FieldError::new(format!("params.{name}"), "must be a number")),
        }
    };
    parse_object("params", value)?.iter().take(MAX_PARAMS).map(param).collect()
}

fn parse_encounters(value: Option<&Value>) -> Result<Vec<Encounter>, FieldError> {
    let list = value
        .and_then(Value::as_array)
        .ok_or_else(|| FieldError::new("encounters", "must be a list of encounters"))?;
    if list.is_empty() || list.len() > MAX_ENCOUNTERS {
        return Err(FieldError::new(
            "encounters",
            format!("must have 1 to {MAX_ENCOUNTERS} entries, got {}", list.len()),
        ));
    }
    list.iter().enumerate().map(|(i, value)| Encounter::parse(&format!("encounters.{i}"), value)).collect()
}

fn parse_object<'a>(field: &str, value: &'a Value) -> Result<&'a Map<String, Value>, FieldError> {
    value.as_object().ok_or_else(|| FieldError::new(field, "must be an object"))
}

fn reject_unknown(path: &str, fields: &Map<String, Value>, known: &[&str]) -> Result<(), FieldError> {
    match fields.keys().find(|key| !known.contains(&key.as_str())) {
        None => Ok(()),
        Some(key) => Err(FieldError::new(
            format!("{path}.{}", shorten(key)),
            format!("is not a known field; the known fields are {}", known.join(", ")),
        )),
    }
}

/// Parses one of some names and returns its index.
fn parse_choice(field: &str, value: Option<&Value>, names: &[&str]) -> Result<usize, FieldError> {
    value
        .and_then(Value::as_str)
        .and_then(|given| names.iter().position(|name| *name == given))
        .ok_or_else(|| FieldError::new(field, format!("must be one of {}", names.join(", "))))
}

/// Returns untrusted text as a name: one line, at most [`MAX_NAME_CHARS`] characters.
fn clean_name(text: &str) -> String {
    let plain = text.chars().map(|c| if is_control(c) { ' ' } else { c });
    plain.take(MAX_NAME_CHARS).collect::<String>().trim().to_owned()
}
