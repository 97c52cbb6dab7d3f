//! Parameter spaces, levels and the action grid of docking.

use std::sync::LazyLock;

use super::constants::{MAX_THRUST_N, TIME_LIMIT_S};
use crate::space::{ActionGrid, Axes, Harder, Levels, ParamSpec};

const DEPUTIES: ParamSpec = ParamSpec {
    name: "deputies",
    unit: "",
    min: 1.0,
    max: 5.0,
    step: 1.0,
    whole: true,
    default: 3.0,
    harder: Harder::Up,
    description: "deputies, each an agent",
};

const START_RADIUS: ParamSpec = ParamSpec {
    name: "start_radius",
    unit: "m",
    min: 10.0,
    max: 1000.0,
    step: 5.0,
    whole: false,
    default: 150.0,
    harder: Harder::Up,
    description: "deputies start between two thirds of this distance of the chief and all of it",
};

const SPEED_RATIO: ParamSpec = ParamSpec {
    name: "speed_ratio",
    unit: "",
    min: 0.0,
    max: 5.0,
    step: 0.1,
    whole: false,
    default: 0.8,
    harder: Harder::Up,
    description: "speeds at the start are U(0, this) times the speed limit there, in any direction",
};

const TIME_LIMIT: ParamSpec = ParamSpec {
    name: "time_limit_s",
    unit: "s",
    min: 20.0,
    max: TIME_LIMIT_S,
    step: 10.0,
    whole: true,
    default: TIME_LIMIT_S,
    harder: Harder::Down,
    description: "time after which a deputy that has not docked has failed",
};

const THRUST_BOUND: ParamSpec = ParamSpec {
    name: "thrust_bound",
    unit: "N",
    min: 0.01,
    max: MAX_THRUST_N,
    step: 0.01,
    whole: false,
    default: MAX_THRUST_N,
    harder: Harder::Down,
    description: "thrust on each axis is clamped to plus and minus this",
};

const START_SCALE: ParamSpec = ParamSpec {
    description: "factor of the drawn start distances, which stay at 0.8 m or more; below 1, the time limit is 10 s/m, 40 s or \
            more, and speeds at the start are multiplied by 4 times this, at most 1",
    ..crate::space::START_SCALE
};

/// Start rungs of both tasks, from 1 % of the distance to all of it in equal ratios.
pub(super) static START_RUNGS: [f64; 16] = [
    0.01, 0.0136, 0.0185, 0.0251, 0.0341, 0.0464, 0.0631, 0.0858, 0.1166, 0.1585, 0.2154, 0.2929, 0.3981,
    0.5412, 0.7356, 1.0,
];

/// Parameter space of `docking/single`.
pub static SINGLE_SPACE: [ParamSpec; 5] = [START_RADIUS, SPEED_RATIO, TIME_LIMIT, THRUST_BOUND, START_SCALE];
/// Parameter space of `docking/multiagent`.
pub static MULTIAGENT_SPACE: [ParamSpec; 6] =
    [DEPUTIES, START_RADIUS, SPEED_RATIO, TIME_LIMIT, THRUST_BOUND, START_SCALE];

// After 1 530 s, a quarter of an orbit, cross-track motion alone brings a deputy that starts at rest above the chief to
// it. So every level has a shorter time limit.
const START_RADII: [f64; 10] = [50.0, 100.0, 150.0, 150.0, 150.0, 150.0, 150.0, 150.0, 150.0, 150.0];
const THRUST_BOUNDS: [f64; 10] = [1.0, 1.0, 1.0, 0.5, 0.3, 0.2, 0.15, 0.15, 0.1, 0.08];

/// Default levels of `docking/single`.
pub static SINGLE_LEVELS: LazyLock<Levels> = LazyLock::new(|| {
    Levels::from_table(
        &SINGLE_SPACE,
        &[
            ("start_radius", START_RADII),
            ("speed_ratio", [0.0, 0.4, 0.8, 0.8, 0.8, 1.0, 1.2, 1.2, 1.5, 2.0]),
            ("time_limit_s", [1500.0, 1500.0, 1500.0, 1000.0, 600.0, 550.0, 540.0, 525.0, 500.0, 475.0]),
            ("thrust_bound", THRUST_BOUNDS),
        ],
    )
});

/// Default levels of `docking/multiagent`.
pub static MULTIAGENT_LEVELS: LazyLock<Levels> = LazyLock::new(|| {
    Levels::from_table(
        &MULTIAGENT_SPACE,
        &[
            ("deputies", [1.0, 2.0, 3.0, 3.0, 3.0, 3.0, 4.0, 4.0, 5.0, 5.0]),
            ("start_radius", START_RADII),
            ("speed_ratio", [0.0, 0.4, 0.8, 0.8, 0.8, 1.0, 1.2, 1.2, 1.5, 2.0]),
            ("time_limit_s", [1500.0, 1500.0, 1500.0, 1000.0, 600.0, 570.0, 560.0, 550.0, 545.0, 535.0]),
            ("thrust_bound", THRUST_BOUNDS),
        ],
    )
});

/// Every combination of no thrust and full thrust in either direction along each axis; coasting is first.
pub(super) fn choices() -> ActionGrid {
    const AXIS: [f32; 3] = [0.0, 1.0, -1.0];
    let thrusts = AXIS.iter().flat_map(|&x| AXIS.iter().flat_map(move |&y| AXIS.map(|z| vec![x, y, z])));
    ActionGrid {
        axes: Axes::World,
        rows: thrusts.collect(),
        hold: Some(0),
        description: "coasting, then every combination of 0, 1 and -1 N along x, y and z, z changing first; more than the bound is \
                clamped to it",
    }
}

/// Coasting, and thrusts of a small and a larger size in either direction along each axis.
pub(super) fn few_actions() -> ActionGrid {
    const SMALL_N: f32 = 0.08;
    const LARGE_N: f32 = 0.3;
    let along = |axis: usize, thrust: f32| {
        let mut row = vec![0.0; 3];
        row[axis] = thrust;
        row
    };
    let thrusts =
        (0..3).flat_map(|axis| [SMALL_N, -SMALL_N, LARGE_N, -LARGE_N].map(|thrust| along(axis, thrust)));
    ActionGrid {
        axes: Axes::World,
        rows: std::iter::once(vec![0.0; 3]).chain(thrusts).collect(),
        hold: Some(0),
        description: "coasting, then thrusts of 0.08, -0.08, 0.3 and -0.3 N along x, then y, then z; more than the bound is clamped \
                to it",
    }
}
