//! [`Design`]: a layout as a list of encounters of satellites with debris, and its JSON form.
//!
//! Numbers are integers, since grammars that constrain a language model enforce the range of integers but not of fractions.

use std::collections::BTreeMap;

use env_core::kessler::bearing::BearingFrame;
use serde_json::{Value, json};

use super::vocabulary::{
    BEARING, EncounterKind, FRAMES, KINDS, KindSpec, MAX_ENCOUNTERS, MISS, SATELLITE, SPEED, STEP, frame_spec,
};
use crate::design_fields::{
    parse_choice, parse_list, parse_mode, parse_name, parse_object, parse_params, reject_unknown,
};
use crate::field_error::FieldError;

/// Encounter of a satellite with debris. Numbers are as in JSON; [`Bound::value`](crate::Bound::value) converts them to quantities.
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
        let frame = match fields.get("frame") {
            None => FRAMES[0].frame,
            name => FRAMES[parse_choice("frame", name, &FRAMES.map(|spec| spec.name))?].frame,
        };
        let encounters = fields.get("encounters");
        Ok(Self {
            name: parse_name(fields),
            aim: Aim { mode: parse_mode(aim)?, bearing_deg: BEARING.parse_optional("aim", aim)? },
            frame,
            params: parse_params(fields.get("params"))?,
            encounters: parse_list("encounters", "encounters", encounters, MAX_ENCOUNTERS, Encounter::parse)?,
        })
    }
}
