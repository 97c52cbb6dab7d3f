//! [`TaskingDesign`]: the start of an episode and its target fields as a designer describes them, and the JSON form.
//!
//! Orbits are relative to the Sun and fields relative to the path of a satellite, since a designer knows what it wants there and cannot
//! compute places on the Earth. Numbers are integers, since grammars that constrain a language model enforce the range of integers but
//! not of fractions.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use super::vocabulary::{
    AIM_ANGLE, BATTERY, DAY, FIELD_NUMBERS, MAX_FIELDS, MAX_OUTAGES, MINUTE, NODE_HOUR, OFFSET,
    PRIORITY_HIGH, PRIORITY_LOW, SATELLITE, SPREAD, START_ANGLE, START_NUMBERS, STATION, STORAGE, TARGETS,
    UTC_MINUTE, WHEELS,
};
use crate::design_fields::{parse_list, parse_mode, parse_name, parse_object, parse_params, reject_unknown};
use crate::field_error::FieldError;

/// Layout as its designer describes it.
#[derive(Debug, Clone, PartialEq)]
pub struct TaskingDesign {
    /// Name of the layout, for display.
    pub name: String,
    /// Failure mode that the layout aims to cause.
    pub mode: String,
    /// Orbit angle at which the failure is meant to begin, see [`AIM_ANGLE`]; `None` for any.
    pub aim_angle_deg: Option<i32>,
    /// Params that replace those of the base scenario.
    pub params: BTreeMap<String, f64>,
    /// Start of the episode and of its satellites.
    pub start: DesignedStart,
    /// Numbers of the ground stations that are out of service, in ascending order.
    pub outages: Vec<i32>,
    /// True if the targets that the seed draws stay beside those of the fields.
    pub keeps_background: bool,
    /// Fields of targets; none in tasks without targets.
    pub fields: Vec<TargetField>,
}

/// Start of an episode and of its satellites.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DesignedStart {
    /// Day of the year, see [`DAY`].
    pub day: i32,
    /// Minute of the day, see [`UTC_MINUTE`].
    pub utc_minute: i32,
    /// Local solar time of the ascending node, see [`NODE_HOUR`].
    pub node_hour: i32,
    /// Orbit angle at the start, see [`START_ANGLE`].
    pub start_angle_deg: i32,
    /// Charge at the start, see [`BATTERY`].
    pub battery_percent: i32,
    /// Speed of the fastest wheel at the start, see [`WHEELS`].
    pub wheels_percent: i32,
    /// Data at the start, see [`STORAGE`].
    pub storage_percent: i32,
}

/// Field of targets on the way of a satellite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TargetField {
    /// Index of the satellite, see [`SATELLITE`].
    pub satellite: i32,
    /// Minute of the pass, see [`MINUTE`].
    pub minute: i32,
    /// Distance from the track, see [`OFFSET`].
    pub offset_km: i32,
    /// Radius of the field, see [`SPREAD`].
    pub spread_km: i32,
    /// Number of targets, see [`TARGETS`].
    pub targets: i32,
    /// Lowest priority, see [`PRIORITY_LOW`].
    pub priority_low: i32,
    /// Highest priority, see [`PRIORITY_HIGH`]; at least the lowest.
    pub priority_high: i32,
}

impl TaskingDesign {
    /// Returns the JSON form.
    #[must_use]
    pub fn to_json(&self) -> Value {
        json!({
            "name": self.name,
            "aim": {"mode": self.mode, AIM_ANGLE.name: self.aim_angle_deg},
            "params": self.params,
            "start": self.start.to_json(),
            STATION.name: self.outages,
            "background": self.keeps_background,
            "fields": self.fields.iter().map(|field| field.to_json()).collect::<Vec<_>>(),
        })
    }

    /// Parses the JSON form. Does not check failure mode, params and fields against the task.
    ///
    /// # Errors
    /// Returns the first invalid field, and which values are allowed.
    pub fn from_json(value: &Value) -> Result<Self, FieldError> {
        let fields = parse_object("design", value)?;
        let known = ["name", "aim", "params", "start", STATION.name, "background", "fields"];
        reject_unknown("design", fields, &known)?;
        let aim = parse_object("aim", fields.get("aim").unwrap_or(&Value::Null))?;
        reject_unknown("aim", aim, &["mode", AIM_ANGLE.name])?;
        let keeps_background = match fields.get("background") {
            None => true,
            Some(value) => {
                value.as_bool().ok_or_else(|| FieldError::new("background", "must be true or false"))?
            }
        };
        Ok(Self {
            name: parse_name(fields),
            mode: parse_mode(aim)?,
            aim_angle_deg: AIM_ANGLE.parse_optional("aim", aim)?,
            params: parse_params(fields.get("params"))?,
            start: DesignedStart::parse(fields.get("start").unwrap_or(&Value::Null))?,
            outages: parse_outages(fields.get(STATION.name))?,
            keeps_background,
            fields: parse_fields(fields.get("fields"))?,
        })
    }
}

impl DesignedStart {
    fn to_json(self) -> Value {
        json!({
            DAY.name: self.day,
            UTC_MINUTE.name: self.utc_minute,
            NODE_HOUR.name: self.node_hour,
            START_ANGLE.name: self.start_angle_deg,
            BATTERY.name: self.battery_percent,
            WHEELS.name: self.wheels_percent,
            STORAGE.name: self.storage_percent,
        })
    }

    fn parse(value: &Value) -> Result<Self, FieldError> {
        let fields = parse_object("start", value)?;
        reject_unknown("start", fields, &START_NUMBERS.map(|number| number.name))?;
        Ok(Self {
            day: DAY.parse("start", fields)?,
            utc_minute: UTC_MINUTE.parse("start", fields)?,
            node_hour: NODE_HOUR.parse("start", fields)?,
            start_angle_deg: START_ANGLE.parse("start", fields)?,
            battery_percent: BATTERY.parse("start", fields)?,
            wheels_percent: WHEELS.parse("start", fields)?,
            storage_percent: STORAGE.parse("start", fields)?,
        })
    }
}

impl TargetField {
    fn to_json(self) -> Value {
        json!({
            SATELLITE.name: self.satellite,
            MINUTE.name: self.minute,
            OFFSET.name: self.offset_km,
            SPREAD.name: self.spread_km,
            TARGETS.name: self.targets,
            PRIORITY_LOW.name: self.priority_low,
            PRIORITY_HIGH.name: self.priority_high,
        })
    }

    /// Parses the JSON form. `path` is the position of the field, such as `fields.0`.
    fn parse(path: &str, value: &Value) -> Result<Self, FieldError> {
        let fields = parse_object(path, value)?;
        reject_unknown(path, fields, &FIELD_NUMBERS.map(|number| number.name))?;
        let field = Self {
            satellite: SATELLITE.parse(path, fields)?,
            minute: MINUTE.parse(path, fields)?,
            offset_km: OFFSET.parse(path, fields)?,
            spread_km: SPREAD.parse(path, fields)?,
            targets: TARGETS.parse(path, fields)?,
            priority_low: PRIORITY_LOW.parse(path, fields)?,
            priority_high: PRIORITY_HIGH.parse(path, fields)?,
        };
        if field.priority_high < field.priority_low {
            let message = format!(
                "must be at least priority_low ({}), got {}",
                field.priority_low, field.priority_high
            );
            return Err(FieldError::new(format!("{path}.{}", PRIORITY_HIGH.name), message));
        }
        Ok(field)
    }
}

fn parse_fields(value: Option<&Value>) -> Result<Vec<TargetField>, FieldError> {
    if is_empty(value) {
        return Ok(Vec::new());
    }
    parse_list("fields", "fields of targets", value, MAX_FIELDS, TargetField::parse)
}

/// Parses the stations that are out of service, in ascending order.
fn parse_outages(value: Option<&Value>) -> Result<Vec<i32>, FieldError> {
    if is_empty(value) {
        return Ok(Vec::new());
    }
    let station = |path: &str, value: &Value| STATION.parse_value(path, value);
    let mut outages = parse_list(STATION.name, "numbers of stations", value, MAX_OUTAGES, station)?;
    outages.sort_unstable();
    match outages.windows(2).find(|pair| pair[0] == pair[1]) {
        None => Ok(outages),
        Some(pair) => Err(FieldError::new(STATION.name, format!("must name station {} only once", pair[0]))),
    }
}

/// Returns true if a list is missing or has no entries.
fn is_empty(value: Option<&Value>) -> bool {
    value.is_none_or(|value| value.is_null() || value.as_array().is_some_and(Vec::is_empty))
}
