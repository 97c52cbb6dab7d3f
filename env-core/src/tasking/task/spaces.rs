//! Parameter spaces, options and levels of the tasks, as data.

use std::sync::LazyLock;

use crate::space::{ActionSpace, Harder, Levels, OptionSpec, ParamSpec};

/// Number of targets that an imager observes and can image: the first actions of tasks with targets.
pub const IMAGE_ACTIONS: usize = 10;
/// Largest number of satellites.
pub const MAX_SATELLITES: u32 = 8;
/// Names of the actions of `tasking/scanning`, by index.
pub const SCANNING_ACTION_NAMES: &[&str] = &["scan", "charge", "downlink", "desaturate"];
/// Names of the actions of `tasking/imaging` and `tasking/constellation`, by index.
pub const IMAGING_ACTION_NAMES: &[&str] = &[
    "image_0",
    "image_1",
    "image_2",
    "image_3",
    "image_4",
    "image_5",
    "image_6",
    "image_7",
    "image_8",
    "image_9",
    "charge",
    "downlink",
    "desaturate",
];

/// Actions of the task `tasking/scanning`.
pub(super) const SCANNING_ACTIONS: ActionSpace = ActionSpace::discrete(SCANNING_ACTION_NAMES);
/// Actions of `tasking/imaging` and `tasking/constellation`.
pub(super) const IMAGING_ACTIONS: ActionSpace = ActionSpace::discrete(IMAGING_ACTION_NAMES);

const fn param(
    name: &'static str,
    unit: &'static str,
    [min, max, step]: [f64; 3],
    default: f64,
    harder: Harder,
    description: &'static str,
) -> ParamSpec {
    ParamSpec { name, unit, min, max, step, whole: false, default, harder, description }
}

/// A param that must be an integer.
const fn whole(
    name: &'static str,
    unit: &'static str,
    range: [f64; 3],
    default: f64,
    harder: Harder,
    description: &'static str,
) -> ParamSpec {
    ParamSpec { whole: true, ..param(name, unit, range, default, harder, description) }
}

const BATTERY: ParamSpec = param(
    "battery_wh",
    "W·h",
    [1.0, 2000.0, 5.0],
    200.0,
    Harder::Down,
    "capacity of the battery; a satellite whose battery is empty dies",
);
const CHARGE_MIN: ParamSpec = param(
    "charge_min",
    "",
    [0.01, 1.0, 0.05],
    0.3,
    Harder::Down,
    "the battery's charge at the start is U(this, charge_max) of its capacity",
);
const CHARGE_MAX: ParamSpec = param(
    "charge_max",
    "",
    [0.01, 1.0, 0.05],
    1.0,
    Harder::Down,
    "largest charge at the start, as a share of the battery",
);
const PANEL: ParamSpec =
    param("panel_m2", "m²", [0.01, 5.0, 0.01], 0.25, Harder::Down, "area of the solar panel");
/// Factor of what makes a start hard.
const START_SCALE: ParamSpec = ParamSpec {
    description: "factor of the time limit, of the charge that is missing at the start, and in scanning of the data and the wheel \
                  speeds at the start",
    ..crate::space::START_SCALE
};
/// Start rungs of `tasking/scanning`, in equal ratios. In shorter episodes scanning all the time is as good as planning.
pub(super) static SCANNING_START_RUNGS: [f64; 6] = [0.45, 0.5279, 0.6193, 0.7266, 0.8524, 1.0];
/// Start rungs of the tasks with targets, in equal ratios.
pub(super) static IMAGING_START_RUNGS: [f64; 8] = [0.1, 0.1389, 0.1931, 0.2683, 0.3728, 0.5179, 0.7197, 1.0];
const SCANNING_TIME: ParamSpec = whole(
    "time_limit_s",
    "s",
    [600.0, 57_000.0, 300.0],
    28_500.0,
    Harder::Up,
    "duration of an episode: by default five orbits",
);
const STATIONS: ParamSpec = whole(
    "stations",
    "",
    [1.0, 7.0, 1.0],
    7.0,
    Harder::Down,
    "ground stations, the first of Boulder, Merritt, Singapore, Weilheim, Santiago, Dongara and Hawaii",
);

/// Parameter space of `tasking/scanning`.
pub(super) static SCANNING_SPACE: [ParamSpec; 11] = [
    BATTERY,
    CHARGE_MIN,
    CHARGE_MAX,
    PANEL,
    param("storage_gbit", "Gbit", [0.1, 1000.0, 1.0], 40.0, Harder::Down, "capacity of the data storage"),
    param(
        "storage_fill",
        "",
        [0.0, 1.0, 0.05],
        0.8,
        Harder::Up,
        "the storage holds U(0, this) of its capacity at the start",
    ),
    param(
        "wheel_rpm",
        "rpm",
        [0.0, 5900.0, 100.0],
        3000.0,
        Harder::Up,
        "speeds of the wheels at the start are U(-this, this); a wheel at 6000 rpm ends the episode",
    ),
    param(
        "disturbance_mnm",
        "mN·m",
        [0.0, 10.0, 0.05],
        0.1,
        Harder::Up,
        "standard deviation of the constant disturbing torque about each axis",
    ),
    STATIONS,
    SCANNING_TIME,
    START_SCALE,
];

const TARGETS: ParamSpec = whole(
    "targets",
    "",
    [10.0, 10_000.0, 50.0],
    1250.0,
    Harder::Up,
    "targets on the Earth: with more of them, the choice matters more",
);
const PRIORITY_POWER: ParamSpec = param(
    "priority_power",
    "",
    [1.0, 8.0, 0.5],
    1.0,
    Harder::Up,
    "a target's priority is U(0, 1) to this power: the larger, the fewer valuable targets",
);
const OMEGA_MAX: ParamSpec = param(
    "omega_max_rad_s",
    "rad/s",
    [0.005, 0.2, 0.005],
    0.087,
    Harder::Down,
    "largest rate that the steering commands",
);
const U_MAX: ParamSpec =
    param("u_max_n_m", "N·m", [0.01, 1.0, 0.01], 0.4, Harder::Down, "largest torque of a wheel");
const ATTITUDE_ERROR: ParamSpec = param(
    "attitude_error",
    "",
    [0.0005, 0.1, 0.0005],
    0.01,
    Harder::Down,
    "largest attitude error of an image, as the norm of an MRP",
);
const STORAGE_IMAGES: ParamSpec = whole(
    "storage_images",
    "",
    [1.0, 10_000.0, 10.0],
    500.0,
    Harder::Down,
    "images that the data storage holds",
);

const fn imaging_time(default: f64) -> ParamSpec {
    whole("time_limit_s", "s", [600.0, 57_000.0, 300.0], default, Harder::Up, "duration of an episode")
}

/// Parameter space of `tasking/imaging`.
pub(super) static IMAGING_SPACE: [ParamSpec; 12] = [
    TARGETS,
    PRIORITY_POWER,
    OMEGA_MAX,
    U_MAX,
    ATTITUDE_ERROR,
    BATTERY,
    CHARGE_MIN,
    CHARGE_MAX,
    PANEL,
    STORAGE_IMAGES,
    imaging_time(17_100.0),
    START_SCALE,
];

/// Parameter space of `tasking/constellation`.
pub(super) static CONSTELLATION_SPACE: [ParamSpec; 15] = [
    whole(
        "satellites",
        "",
        [1.0, MAX_SATELLITES as f64, 1.0],
        3.0,
        Harder::Up,
        "satellites, each an agent, on one orbit at 800 km with an inclination of 60°",
    ),
    param(
        "spacing_deg",
        "°",
        [1.0, 120.0, 5.0],
        120.0,
        Harder::Down,
        "angle between neighbours along the orbit: close ones see the same targets",
    ),
    param(
        "link_km",
        "km",
        [100.0, 20_000.0, 100.0],
        20_000.0,
        Harder::Down,
        "largest distance of a line of sight along which satellites share which targets are imaged",
    ),
    ParamSpec { default: 1000.0, ..TARGETS },
    PRIORITY_POWER,
    OMEGA_MAX,
    U_MAX,
    ATTITUDE_ERROR,
    BATTERY,
    CHARGE_MIN,
    CHARGE_MAX,
    PANEL,
    STORAGE_IMAGES,
    imaging_time(11_400.0),
    START_SCALE,
];

const GRAVITY: OptionSpec = OptionSpec {
    name: "gravity",
    choices: &["ggm10", "j2", "kepler"],
    description: "ggm10: GGM03S to degree and order 10 with the Sun, as BSK-RL; j2: point mass and oblateness; kepler: point mass",
    manual_choices: &[],
};
const THRUSTERS: OptionSpec = OptionSpec {
    name: "thrusters",
    choices: &["basilisk", "full"],
    description: "basilisk: a pulse of a full second delivers a sixth of its impulse and a shorter one none, as in BSK-RL; full: \
                  every pulse delivers its impulse",
    manual_choices: &[],
};
const RETASKING: OptionSpec = OptionSpec {
    name: "retasking",
    choices: &["idle", "any"],
    description: "idle: actions of satellites that are busy are ignored; any: they replace the current action, as in BSK-RL",
    manual_choices: &[],
};
const TARGET_PLACES: OptionSpec = OptionSpec {
    name: "targets",
    choices: &["uniform", "cities"],
    description: "uniform: targets anywhere on the Earth; cities: some of its 10 000 largest cities",
    manual_choices: &[],
};
const COMMUNICATION: OptionSpec = OptionSpec {
    name: "communication",
    choices: &["los", "los_multi", "free", "none"],
    description: "at the end of a step, satellites tell each other which targets are imaged; los: those that saw each other in the step \
                  do; los_multi: those that a path of such links connects do; free: all satellites do; none: no satellite does",
    manual_choices: &[],
};

/// Options of the task `tasking/scanning`.
pub(super) static SCANNING_OPTIONS: [OptionSpec; 3] = [GRAVITY, THRUSTERS, RETASKING];
/// Options of the task `tasking/imaging`.
pub(super) static IMAGING_OPTIONS: [OptionSpec; 4] = [GRAVITY, THRUSTERS, RETASKING, TARGET_PLACES];
/// Options of the task `tasking/constellation`.
pub(super) static CONSTELLATION_OPTIONS: [OptionSpec; 5] =
    [GRAVITY, THRUSTERS, RETASKING, TARGET_PLACES, COMMUNICATION];

const CHARGES_MIN: [f64; 10] = [0.6, 0.5, 0.4, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3];
const SCANNER_CHARGES: [f64; 10] = [1.0, 1.0, 1.0, 1.0, 0.9, 0.8, 0.75, 0.75, 0.7, 0.65];
const IMAGER_CHARGES: [f64; 10] = [1.0, 1.0, 1.0, 1.0, 0.9, 0.8, 0.7, 0.65, 0.65, 0.65];
const IMAGER_BATTERIES: [f64; 10] = [1000.0, 1000.0, 400.0, 200.0, 150.0, 100.0, 80.0, 75.0, 72.0, 67.0];

/// Default levels of `tasking/scanning`; level 3 is the environment of the paper.
pub(super) static SCANNING_LEVELS: LazyLock<Levels> = LazyLock::new(|| {
    Levels::from_table(
        &SCANNING_SPACE,
        &[
            ("battery_wh", [400.0, 300.0, 200.0, 200.0, 150.0, 100.0, 95.0, 85.0, 75.0, 67.0]),
            ("charge_min", CHARGES_MIN),
            ("charge_max", SCANNER_CHARGES),
            ("panel_m2", [0.5, 0.35, 0.3, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25]),
            ("storage_gbit", [40.0, 40.0, 40.0, 40.0, 30.0, 20.0, 18.0, 15.0, 12.0, 10.0]),
            ("storage_fill", [0.2, 0.4, 0.6, 0.8, 0.8, 0.8, 0.8, 0.8, 0.8, 0.8]),
            ("wheel_rpm", [1000.0, 2000.0, 3000.0, 3000.0, 3500.0, 4000.0, 4000.0, 4000.0, 4000.0, 4000.0]),
            ("disturbance_mnm", [0.1, 0.1, 0.1, 0.1, 0.1, 0.2, 0.2, 0.25, 0.25, 0.3]),
            ("stations", [7.0, 7.0, 7.0, 7.0, 7.0, 6.0, 6.0, 5.0, 5.0, 5.0]),
        ],
    )
});

/// Columns of the levels that imaging and constellations share.
const IMAGER_LEVELS: [(&str, [f64; 10]); 8] = [
    ("targets", [5000.0, 5000.0, 4500.0, 4500.0, 4000.0, 4000.0, 4000.0, 4000.0, 4000.0, 5000.0]),
    ("priority_power", [1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 3.0, 4.0]),
    ("omega_max_rad_s", [0.087, 0.087, 0.087, 0.087, 0.07, 0.06, 0.05, 0.045, 0.04, 0.035]),
    ("u_max_n_m", [0.4, 0.4, 0.4, 0.3, 0.3, 0.2, 0.2, 0.18, 0.16, 0.15]),
    ("attitude_error", [0.01, 0.01, 0.01, 0.01, 0.008, 0.006, 0.005, 0.0045, 0.004, 0.0035]),
    ("battery_wh", IMAGER_BATTERIES),
    ("charge_min", CHARGES_MIN),
    ("charge_max", IMAGER_CHARGES),
];

/// Default levels of `tasking/imaging`.
pub(super) static IMAGING_LEVELS: LazyLock<Levels> = LazyLock::new(|| {
    let own = [("panel_m2", [0.5, 0.35, 0.3, 0.25, 0.25, 0.25, 0.25, 0.25, 0.24, 0.24])];
    Levels::from_table(&IMAGING_SPACE, &[&own[..], &IMAGER_LEVELS].concat())
});

/// Default levels of `tasking/constellation`.
pub(super) static CONSTELLATION_LEVELS: LazyLock<Levels> = LazyLock::new(|| {
    let own = [
        ("satellites", [2.0, 3.0, 3.0, 4.0, 4.0, 5.0, 6.0, 6.0, 8.0, 8.0]),
        ("spacing_deg", [40.0, 30.0, 20.0, 20.0, 15.0, 10.0, 10.0, 5.0, 5.0, 5.0]),
        ("panel_m2", [0.5, 0.35, 0.3, 0.25, 0.25, 0.25, 0.25, 0.24, 0.23, 0.21]),
    ];
    Levels::from_table(&CONSTELLATION_SPACE, &[&own[..], &IMAGER_LEVELS].concat())
});
