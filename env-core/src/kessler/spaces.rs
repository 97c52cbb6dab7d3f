//! Parameter spaces, physics options, levels and the action grid of kessler, as data.

use std::sync::LazyLock;

use super::constants::{MAX_BURN, RADAR_NONE};
use crate::space::{ActionGrid, ActionSpace, Axes, Harder, Levels, ManualChoice, OptionSpec, ParamSpec};

/// Largest number of debris bodies of a scenario, drawn and given together, and of threats in a *tracks*
/// observation.
pub const MAX_DEBRIS: f64 = 1000.0;

/// Number of parameters of each task.
const PARAM_COUNT: usize = 7;

/// Parameters of the survival task.
pub static SURVIVAL_SPACE: [ParamSpec; PARAM_COUNT] = param_space(25.0, 100.0, 0.0, 0.0);
/// Parameters of the eco_station task.
pub static ECO_STATION_SPACE: [ParamSpec; PARAM_COUNT] = param_space(35.0, 50.0, 0.8, 0.0);
/// Parameters of the rendezvous task.
pub static RENDEZVOUS_SPACE: [ParamSpec; PARAM_COUNT + 1] = {
    let [debris, fuel, spread, rogue_probability, rogue_speed, radar_range, sigma] =
        param_space(50.0, 100.0, 1.0, 0.06);
    [debris, fuel, spread, rogue_probability, rogue_speed, radar_range, sigma, START_SCALE]
};
/// Start rungs of the rendezvous task, from 5 % of the distance to all of it in equal ratios. At the first, satellite 0 has
/// reached its target.
pub static RENDEZVOUS_START_RUNGS: [f64; 8] = [0.05, 0.0767, 0.1177, 0.1805, 0.277, 0.4249, 0.6518, 1.0];
/// Parameters of the formation task.
pub static FORMATION_SPACE: [ParamSpec; PARAM_COUNT] = param_space(25.0, 100.0, 0.0, 0.0);

/// Returns the parameters of a task, with these defaults for the parameters that differ between tasks.
const fn param_space(debris: f64, fuel: f64, spread: f64, rogue: f64) -> [ParamSpec; PARAM_COUNT] {
    [
        ParamSpec { default: debris, ..DEBRIS },
        ParamSpec { default: fuel, ..FUEL },
        ParamSpec { default: spread, ..SPREAD },
        ParamSpec { default: rogue, ..ROGUE_PROBABILITY },
        ROGUE_SPEED,
        RADAR_RANGE,
        SIGMA,
    ]
}

/// Number of debris bodies that the generator draws.
const DEBRIS: ParamSpec = ParamSpec {
    name: "debris",
    unit: "",
    min: 0.0,
    max: MAX_DEBRIS,
    step: 5.0,
    whole: true,
    default: 0.0,
    harder: Harder::Up,
    description: "bodies the generator draws at radii 40 to 90 LU",
};

/// Fuel of each satellite at the start.
const FUEL: ParamSpec = ParamSpec {
    name: "fuel",
    unit: "fuel",
    min: 0.1,
    max: 1000.0,
    step: 0.5,
    whole: false,
    default: 100.0,
    harder: Harder::Down,
    description: "fuel of each satellite at the start; a change of speed by 1 LU/TU costs 5",
};

/// Spread of the velocities of debris around circular orbits.
const SPREAD: ParamSpec = ParamSpec {
    name: "spread",
    unit: "LU/TU",
    min: 0.0,
    max: 3.0,
    step: 0.1,
    whole: false,
    default: 0.0,
    harder: Harder::Up,
    description: "each velocity component of debris is off circular by U(−spread, spread)",
};

/// Probability in each step that rogue debris arrives.
const ROGUE_PROBABILITY: ParamSpec = ParamSpec {
    name: "rogue_probability",
    unit: "1/TU",
    min: 0.0,
    max: 1.0,
    step: 0.02,
    whole: false,
    default: 0.0,
    harder: Harder::Up,
    description: "chance in each step that rogue debris arrives at radius 95 LU",
};

/// Speed of a rogue, relative to circular speed.
const ROGUE_SPEED: ParamSpec = ParamSpec {
    name: "rogue_speed",
    unit: "",
    min: 0.3,
    max: 1.3,
    step: 0.05,
    whole: false,
    default: 1.2,
    harder: Harder::Down,
    description: "initial speed of a rogue / circular speed at 95 LU; at 1.2 the radius stays at or above 95 LU, at 0.7 it \
            crosses the satellites' orbits",
};

/// Range of the radar; farther debris is hidden.
const RADAR_RANGE: ParamSpec = ParamSpec {
    name: "radar_range",
    unit: "LU",
    min: 1.0,
    max: RADAR_NONE,
    step: 1.0,
    whole: false,
    default: RADAR_NONE,
    harder: Harder::Down,
    description: "debris farther than this from every active satellite is hidden, but flies and kills; 300 hides nothing",
};

/// Standard deviation of relative positions.
const SIGMA: ParamSpec = ParamSpec {
    name: "sigma",
    unit: "LU",
    min: 0.05,
    max: 10.0,
    step: 0.05,
    whole: false,
    default: 0.5,
    harder: Harder::Up,
    description: "standard deviation of the relative position of two bodies; counts under risk: pc, and in the \
            probabilities and noise of warnings",
};

/// Factor of the distance between satellite 0 and its target radius.
const START_SCALE: ParamSpec = ParamSpec {
    description: "factor of the distance of satellite 0 from its target radius at the start",
    ..crate::space::START_SCALE
};

/// Physics options of all kessler tasks.
pub static KESSLER_OPTIONS: [OptionSpec; 6] = [
    OptionSpec {
        name: "start",
        choices: &["fair", "upstream"],
        description: "fair: a generated body that would touch a satellite before step 3 under hold is drawn again; \
                upstream: bodies stay as first drawn",
        manual_choices: &[],
    },
    OptionSpec {
        name: "compat",
        choices: &["none", "upstream"],
        description: "upstream: burns are clamped and charged one by one, unknown satellites are ignored, debris inside \
                the Earth freezes: the public kessler-env's arithmetic, for replaying its episodes",
        manual_choices: &[ManualChoice {
            choice: "upstream",
            reason: "it is for replays of recorded episodes, in which a satellite may burn more in a step than the plans \
                  of its bracket",
        }],
    },
    OptionSpec {
        name: "contact",
        choices: &["end_of_step", "swept"],
        description: "end_of_step: bodies touch where a step ends; swept: at their closest approach within the step, so that \
                fast crossings cannot tunnel",
        manual_choices: &[],
    },
    OptionSpec {
        name: "gravity",
        choices: &["point", "j2"],
        description: "point: the Earth pulls as a point; j2: with the J2 term, in the equatorial plane",
        manual_choices: &[],
    },
    OptionSpec {
        name: "risk",
        choices: &["contact", "pc"],
        description: "contact: debris destroys what it touches; pc: every closest approach costs a probability of collision, and \
                a satellite's cumulative survival probability replaces the active flag in the reward",
        manual_choices: &[],
    },
    OptionSpec {
        name: "warnings",
        choices: &["none", "exact", "noisy"],
        description: "conjunction warnings in the observation, for visible debris, by the true dynamics under hold; noisy: with \
                errors that grow with the time to closest approach",
        manual_choices: &[],
    },
];

/// Radar range of each level of every task, LU.
const RADAR_RANGES: [f64; 10] = [300.0, 300.0, 300.0, 300.0, 300.0, 300.0, 20.0, 12.0, 8.0, 6.0];

/// Levels of the survival task.
pub static SURVIVAL_LEVELS: LazyLock<Levels> = LazyLock::new(|| {
    Levels::from_table(
        &SURVIVAL_SPACE,
        &[
            ("debris", [25.0, 35.0, 50.0, 75.0, 100.0, 100.0, 125.0, 150.0, 175.0, 200.0]),
            ("spread", [0.0, 0.0, 0.4, 0.8, 1.0, 1.0, 1.0, 1.0, 1.2, 1.5]),
            ("fuel", [100.0, 100.0, 50.0, 20.0, 10.0, 5.0, 4.0, 3.0, 2.0, 1.5]),
            ("radar_range", RADAR_RANGES),
        ],
    )
});

/// Levels of the eco_station task.
pub static ECO_STATION_LEVELS: LazyLock<Levels> = LazyLock::new(|| {
    Levels::from_table(
        &ECO_STATION_SPACE,
        &[
            ("debris", [35.0, 50.0, 60.0, 75.0, 100.0, 125.0, 125.0, 150.0, 175.0, 200.0]),
            ("spread", [0.8, 0.8, 0.8, 0.8, 1.0, 1.0, 1.0, 1.0, 1.2, 1.5]),
            ("fuel", [50.0, 50.0, 40.0, 30.0, 25.0, 20.0, 15.0, 10.0, 8.0, 5.0]),
            ("radar_range", RADAR_RANGES),
        ],
    )
});

/// Levels of the rendezvous task.
pub static RENDEZVOUS_LEVELS: LazyLock<Levels> = LazyLock::new(|| {
    Levels::from_table(
        &RENDEZVOUS_SPACE,
        &[
            ("debris", [10.0, 20.0, 35.0, 50.0, 50.0, 60.0, 75.0, 100.0, 125.0, 150.0]),
            ("spread", [0.0, 0.5, 0.8, 1.0, 1.0, 1.0, 1.0, 1.0, 1.2, 1.5]),
            ("fuel", [100.0, 100.0, 100.0, 100.0, 70.0, 50.0, 40.0, 30.0, 22.0, 16.0]),
            ("rogue_probability", [0.0, 0.0, 0.0, 0.0, 0.06, 0.06, 0.1, 0.1, 0.2, 0.2]),
            ("radar_range", RADAR_RANGES),
        ],
    )
});

/// Levels of the formation task.
pub static FORMATION_LEVELS: LazyLock<Levels> = LazyLock::new(|| {
    Levels::from_table(
        &FORMATION_SPACE,
        &[
            ("debris", [5.0, 15.0, 25.0, 35.0, 40.0, 50.0, 60.0, 75.0, 100.0, 125.0]),
            ("spread", [0.0, 0.0, 0.0, 0.4, 0.6, 0.8, 1.0, 1.0, 1.0, 1.2]),
            ("fuel", [100.0, 100.0, 100.0, 80.0, 70.0, 60.0, 55.0, 45.0, 40.0, 32.0]),
            ("radar_range", RADAR_RANGES),
        ],
    )
});

/// Sizes of the burns of the action grid, LU/TU: those of the blind panel.
const GRID_BURN_SIZES: [f32; 4] = [0.05, 0.1, 0.2, 0.4];

/// Action space of each satellite.
pub(super) const ACTION_SPACE: ActionSpace =
    ActionSpace::new_box(&["delta_vx", "delta_vy"], -MAX_BURN, MAX_BURN, "LU/TU");

/// Action grid of each satellite: hold, and burns of each size prograde, radial out, retrograde and radial
/// in.
pub(super) fn action_grid() -> ActionGrid {
    let burns = GRID_BURN_SIZES.iter().flat_map(|&v| [[0.0, v], [v, 0.0], [0.0, -v], [-v, 0.0]]);
    ActionGrid {
        axes: Axes::Agent,
        rows: std::iter::once([0.0, 0.0]).chain(burns).map(Vec::from).collect(),
        hold: Some(0),
        description: "hold, then burns of 0.05, 0.1, 0.2 and 0.4 LU/TU, each prograde, radial out, retrograde and radial in",
    }
}

/// Hold, and burns of 0.2 LU/TU prograde, radial out, retrograde and radial in.
pub(super) fn few_actions() -> ActionGrid {
    const BURN: f32 = 0.2;
    ActionGrid {
        axes: Axes::Agent,
        rows: [[0.0, 0.0], [0.0, BURN], [BURN, 0.0], [0.0, -BURN], [-BURN, 0.0]].map(Vec::from).to_vec(),
        hold: Some(0),
        description: "hold, then burns of 0.2 LU/TU prograde, radial out, retrograde and radial in",
    }
}
