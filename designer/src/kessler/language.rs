//! What a designer says: whom debris meets, when, from where, how fast and how close. Whole numbers only: grammars that
//! hold a language model to a schema enforce the range of integers and not of fractions.
//!
//! Bounds, units and words stand here once; the JSON schema, the prompt and the compiler read them.

use std::collections::BTreeMap;

use env_core::kessler::bearing::Frame;
use env_core::kessler::constants::{HORIZON, SATELLITES};
use serde_json::{Map, Value, json};

use crate::Fault;

/// A whole number of an encounter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bound {
    /// Its name.
    pub name: &'static str,
    /// Smallest.
    pub min: u32,
    /// Largest.
    pub max: u32,
    /// What one stands for, in `unit`.
    pub scale: f64,
    /// The unit.
    pub unit: &'static str,
    /// What it is, in one sentence.
    pub about: &'static str,
}

/// Which satellite.
pub const SATELLITE: Bound = Bound {
    name: "satellite",
    min: 0,
    max: SATELLITES as u32 - 1,
    scale: 1.0,
    unit: "",
    about: "the satellite it is about",
};
/// When: nothing may touch before step 3.
pub const STEP: Bound = Bound {
    name: "step",
    min: 3,
    max: HORIZON - 2,
    scale: 1.0,
    unit: "TU",
    about: "the step at whose end the debris is closest to the satellite, if nobody burns",
};
/// From where.
pub const BEARING: Bound = Bound {
    name: "bearing_deg",
    min: 0,
    max: 359,
    scale: 1.0,
    unit: "degrees",
    about: "where the debris is, seen from the satellite, five steps before that, or when it first becomes visible if that \
            is later",
};
/// How fast.
pub const SPEED: Bound = Bound {
    name: "relative_speed",
    min: 10,
    max: 120,
    scale: 0.1,
    unit: "LU/TU",
    about: "the debris' speed relative to the satellite at that step, in tenths of LU/TU",
};
/// How close.
pub const MISS: Bound = Bound {
    name: "miss_distance",
    min: 0,
    max: 200,
    scale: 0.1,
    unit: "LU",
    about: "how far from the satellite the debris passes, in tenths of LU; below 20 it hits",
};
/// Encounters of one layout, at most.
pub const MAX_ENCOUNTERS: usize = 12;
/// Characters of a layout's name, at most.
pub const MAX_NAME: usize = 60;

impl Bound {
    /// What a number stands for.
    #[must_use]
    pub fn value(&self, number: u32) -> f64 {
        // Division by ten is exact to the last bit where multiplication by a tenth is not.
        if self.scale < 1.0 { f64::from(number) / (1.0 / self.scale) } else { f64::from(number) }
    }

    fn read(&self, at: &str, fields: &Map<String, Value>) -> Result<u32, Fault> {
        let field = format!("{at}.{}", self.name);
        let wanted = || format!("a whole number from {} to {} is wanted", self.min, self.max);
        let Some(value) = fields.get(self.name) else {
            return Err(Fault::new(field, format!("it is missing; {}", wanted())));
        };
        let number = value.as_u64().and_then(|v| u32::try_from(v).ok());
        number.filter(|v| (self.min..=self.max).contains(v)).ok_or_else(|| {
            Fault::new(field, format!("it is {}; {}", crate::shorten(&value.to_string()), wanted()))
        })
    }
}

/// What an encounter is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Kind {
    /// It hits a satellite that holds.
    Threat,
    /// It looks like a threat and misses: burning for it is a waste.
    Decoy,
    /// It passes wide: something more to look at.
    Screen,
}

/// The kinds, with the miss distances each may have.
pub const KINDS: [(Kind, &str, u32, u32, &str); 3] = [
    (Kind::Threat, "threat", 0, 19, "hits a satellite that does nothing"),
    (Kind::Decoy, "decoy", 22, 80, "comes close and misses, if nobody burns"),
    (Kind::Screen, "screen", 60, 200, "passes wide, as something more to look at"),
];

impl Kind {
    /// Its row: word, least and largest miss distance, meaning.
    #[must_use]
    pub fn row(self) -> &'static (Kind, &'static str, u32, u32, &'static str) {
        &KINDS[self as usize]
    }

    /// The word on the wire.
    #[must_use]
    pub fn word(self) -> &'static str {
        self.row().1
    }
}

/// The frames bearings can be given in: word, frame, meaning.
pub const FRAMES: [(&str, Frame, &str); 2] = [
    (
        "radial_in_track",
        Frame::RadialInTrack,
        "0 is away from the Earth, 90 ahead (prograde), 180 towards the Earth, 270 behind",
    ),
    ("inertial", Frame::Inertial, "0 is +X, 90 is +Y, 180 is -X, 270 is -Y"),
];

/// The word of a frame.
#[must_use]
pub fn frame_word(frame: Frame) -> &'static str {
    FRAMES.iter().find(|(_, f, _)| *f == frame).map_or("", |(word, _, _)| *word)
}

/// One encounter. Numbers are as on the wire; [`Bound::value`] says what they stand for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Encounter {
    /// Which satellite, from 0.
    pub satellite: u32,
    /// When.
    pub step: u32,
    /// From where, in the design's frame.
    pub bearing_deg: u32,
    /// How fast.
    pub relative_speed: u32,
    /// How close.
    pub miss_distance: u32,
    /// What for.
    pub kind: Kind,
    /// It appears a few steps before, out of nothing, instead of being there from the start.
    pub rogue: bool,
}

/// What a design is meant to hit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Aim {
    /// A failure mode of the task.
    pub mode: String,
    /// The bearing it is about, in the design's frame; none where the mode has none.
    pub bearing_deg: Option<u32>,
}

/// A layout as a designer thinks of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Design {
    /// Its name, for people.
    pub name: String,
    /// What it is meant to hit.
    pub aim: Aim,
    /// What its bearings are measured in.
    pub frame: Frame,
    /// Params that are not the base's.
    pub params: BTreeMap<String, f64>,
    /// The encounters.
    pub encounters: Vec<Encounter>,
}

impl Encounter {
    /// The wire form.
    #[must_use]
    pub fn to_json(&self) -> Value {
        json!({
            "satellite": self.satellite,
            "step": self.step,
            "bearing_deg": self.bearing_deg,
            "relative_speed": self.relative_speed,
            "miss_distance": self.miss_distance,
            "kind": self.kind.word(),
            "rogue": self.rogue,
        })
    }

    fn read(at: &str, value: &Value) -> Result<Self, Fault> {
        let fields = object(at, value)?;
        known(
            at,
            fields,
            &["satellite", "step", "bearing_deg", "relative_speed", "miss_distance", "kind", "rogue"],
        )?;
        let words = KINDS.map(|row| row.1);
        let word = word(&format!("{at}.kind"), fields.get("kind"), &words)?;
        let kind = KINDS.iter().find(|row| row.1 == word).map_or(Kind::Threat, |row| row.0);
        let rogue = match fields.get("rogue") {
            None => false,
            Some(value) => {
                value.as_bool().ok_or_else(|| Fault::new(format!("{at}.rogue"), "true or false is wanted"))?
            }
        };
        let encounter = Self {
            satellite: SATELLITE.read(at, fields)?,
            step: STEP.read(at, fields)?,
            bearing_deg: BEARING.read(at, fields)?,
            relative_speed: SPEED.read(at, fields)?,
            miss_distance: MISS.read(at, fields)?,
            kind,
            rogue,
        };
        encounter.check(at)?;
        Ok(encounter)
    }

    /// Whether its numbers are within their bounds, and its miss distance is one of its kind.
    ///
    /// # Errors
    /// The field at fault.
    pub fn check(&self, at: &str) -> Result<(), Fault> {
        let given = [
            (SATELLITE, self.satellite),
            (STEP, self.step),
            (BEARING, self.bearing_deg),
            (SPEED, self.relative_speed),
            (MISS, self.miss_distance),
        ];
        for (bound, number) in given {
            if !(bound.min..=bound.max).contains(&number) {
                return Err(Fault::new(
                    format!("{at}.{}", bound.name),
                    format!("it is {number}, outside {} to {}", bound.min, bound.max),
                ));
            }
        }
        let (_, word, min, max, about) = *self.kind.row();
        if (min..=max).contains(&self.miss_distance) {
            Ok(())
        } else {
            Err(Fault::new(
                format!("{at}.miss_distance"),
                format!("it is {}; a {word} {about}: {min} to {max} are wanted", self.miss_distance),
            ))
        }
    }
}

impl Design {
    /// The wire form, the aim first.
    #[must_use]
    pub fn to_json(&self) -> Value {
        json!({
            "name": self.name,
            "aim": {"mode": self.aim.mode, "bearing_deg": self.aim.bearing_deg},
            "frame": frame_word(self.frame),
            "params": self.params,
            "encounters": self.encounters.iter().map(Encounter::to_json).collect::<Vec<_>>(),
        })
    }

    /// Reads the wire form. Which modes and params there are is the task's to say.
    ///
    /// # Errors
    /// The field at fault, and what is wanted there.
    pub fn from_json(value: &Value) -> Result<Self, Fault> {
        let fields = object("design", value)?;
        known("design", fields, &["name", "aim", "frame", "params", "encounters"])?;
        let aim = object("aim", fields.get("aim").unwrap_or(&Value::Null))?;
        known("aim", aim, &["mode", "bearing_deg"])?;
        let mode = aim.get("mode").and_then(Value::as_str).ok_or_else(|| {
            Fault::new("aim.mode", "the failure mode that the layout is meant to hit is wanted")
        })?;
        let bearing_deg = match aim.get("bearing_deg") {
            None | Some(Value::Null) => None,
            Some(_) => Some(BEARING.read("aim", aim)?),
        };
        let frame = match fields.get("frame") {
            None => Frame::RadialInTrack,
            some => {
                let word = word("frame", some, &FRAMES.map(|row| row.0))?;
                FRAMES.iter().find(|row| row.0 == word).map_or(Frame::RadialInTrack, |row| row.1)
            }
        };
        Ok(Self {
            name: fields.get("name").and_then(Value::as_str).map_or_else(String::new, clean),
            aim: Aim { mode: clean(mode), bearing_deg },
            frame,
            params: params(fields.get("params"))?,
            encounters: encounters(fields.get("encounters"))?,
        })
    }
}

fn params(value: Option<&Value>) -> Result<BTreeMap<String, f64>, Fault> {
    let Some(value) = value.filter(|v| !v.is_null()) else { return Ok(BTreeMap::new()) };
    let number = |(name, value): (&String, &Value)| {
        let number = value.as_f64().filter(|v| v.is_finite());
        let name = clean(name);
        number
            .map(|number| (name.clone(), number))
            .ok_or_else(|| Fault::new(format!("params.{name}"), "a number is wanted"))
    };
    object("params", value)?.iter().take(40).map(number).collect()
}

fn encounters(value: Option<&Value>) -> Result<Vec<Encounter>, Fault> {
    let list = value
        .and_then(Value::as_array)
        .ok_or_else(|| Fault::new("encounters", "a list of encounters is wanted"))?;
    if list.is_empty() || list.len() > MAX_ENCOUNTERS {
        return Err(Fault::new(
            "encounters",
            format!("{} are given; 1 to {MAX_ENCOUNTERS} are wanted", list.len()),
        ));
    }
    list.iter().enumerate().map(|(i, value)| Encounter::read(&format!("encounters.{i}"), value)).collect()
}

fn object<'a>(field: &str, value: &'a Value) -> Result<&'a Map<String, Value>, Fault> {
    value.as_object().ok_or_else(|| Fault::new(field, "an object is wanted"))
}

fn known(field: &str, fields: &Map<String, Value>, names: &[&str]) -> Result<(), Fault> {
    match fields.keys().find(|key| !names.contains(&key.as_str())) {
        None => Ok(()),
        Some(key) => Err(Fault::new(
            format!("{field}.{}", crate::shorten(key)),
            format!("there is no such field; known are {}", names.join(", ")),
        )),
    }
}

fn word<'a>(field: &str, value: Option<&'a Value>, words: &[&str]) -> Result<&'a str, Fault> {
    value
        .and_then(Value::as_str)
        .filter(|word| words.contains(word))
        .ok_or_else(|| Fault::new(field, format!("one of {} is wanted", words.join(", "))))
}

/// A stranger's words, short and in one line.
fn clean(text: &str) -> String {
    let plain = text.chars().map(|c| if crate::steers(c) { ' ' } else { c });
    plain.take(MAX_NAME).collect::<String>().trim().to_owned()
}
