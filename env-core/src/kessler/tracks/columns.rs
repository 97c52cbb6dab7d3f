//! Columns of a tracks observation: names, units, scales and descriptions.

use crate::kessler::constants::FORMATION_SIDE;

/// Middle of the radii where satellites live, LU.
pub(super) const RADIUS_OFFSET: f64 = 60.0;
/// Half-width of the radii where satellites live, LU.
pub(super) const RADIUS_SCALE: f64 = 40.0;
/// Speed of a fast climb, LU/TU: about circular speed at 60 LU.
pub(super) const SPEED_SCALE: f64 = 4.0;
/// Scale of velocity differences in a formation, and of in-track speed from circular speed, LU/TU.
pub(super) const DRIFT_SCALE: f64 = 2.0;
/// Largest climb of satellite 0, LU.
pub(super) const CLIMB_SCALE: f64 = 50.0;
/// Distance from which debris comes within the look-ahead, LU.
pub(super) const THREAT_DISTANCE_SCALE: f64 = 50.0;
/// Scale of relative speeds of debris, LU/TU.
pub(super) const CLOSING_SPEED_SCALE: f64 = 5.0;
/// Scale of miss distances, LU.
pub(super) const MISS_SCALE: f64 = 10.0;

/// Description of one column: cell = (value − offset)/scale, clamped to [−2, 2]; 0 if there is no value.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackColumn {
    /// Name of the column.
    pub name: String,
    /// Unit of the value; empty for a dimensionless number.
    pub unit: &'static str,
    /// Offset that is subtracted from the value, in its unit.
    pub offset: f64,
    /// Scale by which the difference is divided, in the value's unit.
    pub scale: f64,
    /// Meaning of the column.
    pub description: &'static str,
}

/// Constant description of a column.
pub(super) struct ColumnSpec {
    name: &'static str,
    unit: &'static str,
    offset: f64,
    scale: ColumnScale,
    about: &'static str,
}

/// Scale of a column.
#[derive(Clone, Copy)]
enum ColumnScale {
    /// Scale in the unit of the value.
    Fixed(f64),
    /// Look-ahead of the encoder, TU.
    LookAhead,
}

/// Returns the columns of one satellite with this many threats.
pub(super) fn describe(threats: usize, look_ahead: usize) -> Vec<TrackColumn> {
    let column = |name: String, spec: &ColumnSpec| {
        let scale = match spec.scale {
            ColumnScale::Fixed(scale) => scale,
            ColumnScale::LookAhead => look_ahead as f64,
        };
        TrackColumn { name, unit: spec.unit, offset: spec.offset, scale, description: spec.about }
    };
    let own = OWN_COLUMNS.iter().map(|spec| column(spec.name.to_owned(), spec));
    let threats = (0..threats).flat_map(|number| {
        THREAT_COLUMNS.iter().map(move |spec| column(format!("debris_{number}_{}", spec.name), spec))
    });
    own.chain(threats).collect()
}

/// Columns of a satellite's own state.
pub(super) const OWN_COLUMNS: [ColumnSpec; 16] = [
    spec("active", "", 1.0, "1 while it flies; a lost satellite's row is all zeros"),
    ColumnSpec {
        offset: RADIUS_OFFSET,
        ..spec("radius", "LU", RADIUS_SCALE, "distance from the Earth's centre")
    },
    spec("radial_speed", "LU/TU", SPEED_SCALE, "speed away from the Earth"),
    spec("in_track_excess", "LU/TU", DRIFT_SCALE, "in-track speed over circular speed at this radius"),
    spec("fuel", "", 1.0, "share of the fuel it started with"),
    spec("step", "", 1.0, "share of the horizon that has passed"),
    spec("survival", "", 1.0, "probability that it still flies: 1, or less under risk: pc"),
    spec(
        "target_error",
        "LU",
        CLIMB_SCALE,
        "rendezvous, satellite 0: radius over the target radius of 100 LU",
    ),
    spec("other_0_radial", "LU", FORMATION_SIDE, OTHER_POSITION),
    spec("other_0_in_track", "LU", FORMATION_SIDE, OTHER_POSITION),
    spec("other_0_radial_speed", "LU/TU", DRIFT_SCALE, OTHER_VELOCITY),
    spec("other_0_in_track_speed", "LU/TU", DRIFT_SCALE, OTHER_VELOCITY),
    spec("other_1_radial", "LU", FORMATION_SIDE, OTHER_POSITION),
    spec("other_1_in_track", "LU", FORMATION_SIDE, OTHER_POSITION),
    spec("other_1_radial_speed", "LU/TU", DRIFT_SCALE, OTHER_VELOCITY),
    spec("other_1_in_track_speed", "LU/TU", DRIFT_SCALE, OTHER_VELOCITY),
];
const OTHER_POSITION: &str =
    "formation: where the next satellite is (of 0: 1, 2; of 1: 2, 0; of 2: 0, 1); 0 if it is lost";
const OTHER_VELOCITY: &str = "formation: its velocity as seen from here";

/// Columns of one debris body.
pub(super) const THREAT_COLUMNS: [ColumnSpec; 7] = [
    spec("present", "", 1.0, "1 if there is such debris; else the seven are zeros"),
    spec("radial", "LU", THREAT_DISTANCE_SCALE, "where it is, seen from the satellite"),
    spec("in_track", "LU", THREAT_DISTANCE_SCALE, "where it is, seen from the satellite"),
    spec("radial_speed", "LU/TU", CLOSING_SPEED_SCALE, "its velocity as seen from the satellite"),
    spec("in_track_speed", "LU/TU", CLOSING_SPEED_SCALE, "its velocity as seen from the satellite"),
    spec("miss", "LU", MISS_SCALE, "how near it comes within the look-ahead"),
    ColumnSpec { scale: ColumnScale::LookAhead, ..spec("time", "TU", 0.0, "when, from now") },
];

const fn spec(name: &'static str, unit: &'static str, scale: f64, about: &'static str) -> ColumnSpec {
    ColumnSpec { name, unit, offset: 0.0, scale: ColumnScale::Fixed(scale), about }
}
