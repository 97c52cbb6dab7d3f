//! Vocabulary of designs: numbers with their bounds, kinds of encounters, and frames of bearings.
//!
//! The JSON schema, the prompt, the documentation and the compiler all use these definitions. Names and descriptions are part
//! of the prompt: changing one changes the prompt.

use env_core::kessler::bearing::BearingFrame;
use env_core::kessler::constants::{HORIZON, SATELLITES};

use crate::bound::Bound;

/// Maximum number of encounters in a layout.
pub const MAX_ENCOUNTERS: usize = 12;

/// Index of the satellite.
pub const SATELLITE: Bound<u32> = Bound {
    name: "satellite",
    min: 0,
    max: SATELLITES as u32 - 1,
    per_unit: 1.0,
    unit: "",
    description: "index of the satellite",
};
/// Step of the encounter. No contact may happen before step 3.
pub const STEP: Bound<u32> = Bound {
    name: "step",
    min: 3,
    max: HORIZON - 2,
    per_unit: 1.0,
    unit: "TU",
    description: "step at whose end the debris is closest to the satellite if no satellite burns",
};
/// Bearing from which the debris comes.
pub const BEARING: Bound<u32> = Bound {
    name: "bearing_deg",
    min: 0,
    max: 359,
    per_unit: 1.0,
    unit: "degrees",
    description: "direction from the satellite to the debris, five steps before the encounter, or when the debris first becomes \
            visible if that is later",
};
/// Speed relative to the satellite.
pub const SPEED: Bound<u32> = Bound {
    name: "relative_speed",
    min: 10,
    max: 120,
    per_unit: 10.0,
    unit: "LU/TU",
    description: "speed of the debris relative to the satellite at that step, in tenths of LU/TU",
};
/// Least distance to the satellite.
pub const MISS: Bound<u32> = Bound {
    name: "miss_distance",
    min: 0,
    max: 200,
    per_unit: 10.0,
    unit: "LU",
    description: "smallest distance of the debris to the satellite, in tenths of LU; below 20 it hits",
};

/// Purpose of an encounter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum EncounterKind {
    /// Hits a satellite that holds.
    Threat,
    /// Looks like a threat and misses: a burn against it is a waste.
    Decoy,
    /// Passes at a distance, as clutter.
    Screen,
}

/// Name, miss distances and meaning of a kind of encounter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct KindSpec {
    /// Kind that is described.
    pub kind: EncounterKind,
    /// Name of the kind in JSON.
    pub name: &'static str,
    /// Smallest miss distance, in the unit of [`MISS`].
    pub min_miss: u32,
    /// Largest miss distance, in the unit of [`MISS`].
    pub max_miss: u32,
    /// Meaning of the kind, in a few words.
    pub description: &'static str,
}

/// All kinds of encounters, in the order of [`EncounterKind`].
pub const KINDS: [KindSpec; 3] = [
    KindSpec {
        kind: EncounterKind::Threat,
        name: "threat",
        min_miss: 0,
        max_miss: 19,
        description: "hits a satellite that does not burn",
    },
    KindSpec {
        kind: EncounterKind::Decoy,
        name: "decoy",
        min_miss: 22,
        max_miss: 80,
        description: "comes close, and misses if no satellite burns",
    },
    KindSpec {
        kind: EncounterKind::Screen,
        name: "screen",
        min_miss: 60,
        max_miss: 200,
        description: "passes at a distance, as clutter",
    },
];

impl EncounterKind {
    /// Returns the description of the kind.
    #[must_use]
    pub const fn spec(self) -> &'static KindSpec {
        &KINDS[self as usize]
    }

    /// Returns the name of the kind in JSON.
    #[must_use]
    pub const fn as_str(self) -> &'static str {
        self.spec().name
    }
}

/// Name and meaning of a frame in which bearings are measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameSpec {
    /// Frame that is described.
    pub frame: BearingFrame,
    /// Name of the frame in JSON.
    pub name: &'static str,
    /// Meaning of its angles, in a few words.
    pub description: &'static str,
}

/// All frames; the first is the default.
pub const FRAMES: [FrameSpec; 2] = [
    FrameSpec {
        frame: BearingFrame::RadialInTrack,
        name: "radial_in_track",
        description: "0 is away from the Earth, 90 ahead (prograde), 180 towards the Earth, 270 behind (retrograde)",
    },
    FrameSpec {
        frame: BearingFrame::Inertial,
        name: "inertial",
        description: "0 is +X, 90 is +Y, 180 is -X, 270 is -Y",
    },
];

/// Returns the description of a frame.
#[must_use]
pub fn frame_spec(frame: BearingFrame) -> &'static FrameSpec {
    FRAMES.iter().find(|spec| spec.frame == frame).unwrap_or(&FRAMES[0])
}
