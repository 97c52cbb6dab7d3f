//! Fixtures for tests: simulations of scenarios, and close approaches of known geometry.

use serde_json::{Value, json};

use crate::episode_rng::SeededRng;
use crate::kessler::KESSLER_TASKS;
use crate::kessler::constants::{GM, SATELLITES};
use crate::kessler::kernel::{Body, Gravity};
use crate::kessler::setup::KesslerSetup;
use crate::kessler::simulation::KesslerSim;
use crate::task::Scenario;
use crate::task::TaskSpec;

/// Starts a simulation of a scenario.
pub(super) fn start_sim(scenario: &Scenario) -> KesslerSim<SeededRng> {
    let setup = KesslerSetup::from_recipe(scenario.recipe()).unwrap();
    let mut rng = SeededRng::new(scenario.seed());
    let start = setup.draw_initial_state(&mut rng).unwrap();
    let task = KESSLER_TASKS.iter().find(|task| task.id() == scenario.task().id()).unwrap();
    KesslerSim::new(task.objective(), setup, &start, rng)
}

/// Satellites on circular orbits far from each other.
pub(super) fn separate_satellites() -> [Body; SATELLITES] {
    let v = |r: f64| (GM / r).sqrt();
    [
        Body { x: 60.0, y: 0.0, vx: 0.0, vy: v(60.0) },
        Body { x: -70.0, y: 0.0, vx: 0.0, vy: -v(70.0) },
        Body { x: 0.0, y: 80.0, vx: -v(80.0), vy: 0.0 },
    ]
}

/// Close approach of known geometry: debris passes a satellite that holds.
#[derive(Debug, Clone, Copy)]
pub(super) struct StagedPass {
    /// Time of the closest approach, TU from the start.
    pub time: f64,
    /// Offset to the left of the relative velocity, LU. It is the miss distance if the closest approach lies
    /// within the step.
    pub miss: f64,
    /// Relative speed at the closest approach, LU/TU.
    pub speed: f64,
    /// Direction of the debris seen from the satellite: angle from the satellite's radial, radians.
    pub heading: f64,
}

impl StagedPass {
    /// Initial state of the debris, by steps backwards from the closest approach.
    pub(super) fn start(&self, satellite: Body, gravity: Gravity) -> Body {
        self.displaced_start(satellite, gravity, [0.0, 0.0])
    }

    /// Initial state of debris that is displaced at the closest approach by `offset`, LU, along the relative
    /// velocity and to its left.
    pub(super) fn displaced_start(&self, mut satellite: Body, gravity: Gravity, offset: [f64; 2]) -> Body {
        let steps = self.time.ceil() as u32;
        for _ in 0..steps {
            satellite = satellite.coast(gravity);
        }
        let ((rx, ry), (tx, ty)) = satellite.local_axes();
        let (sin, cos) = libm::sincos(self.heading);
        let (ux, uy) = (cos * rx + sin * tx, cos * ry + sin * ty);
        // Distance from the closest approach to the end of its step.
        let along = self.speed * (f64::from(steps) - self.time) + offset[0];
        let left = self.miss + offset[1];
        let mut body = Body {
            x: satellite.x + along * ux - left * uy,
            y: satellite.y + along * uy + left * ux,
            vx: satellite.vx + self.speed * ux,
            vy: satellite.vy + self.speed * uy,
        };
        for _ in 0..steps {
            body = body.coast_back(gravity);
        }
        body
    }
}

/// Survival scenario of exactly these bodies.
pub(super) fn staged_scenario(
    satellites: &[Body],
    debris: &[Body],
    physics: &Value,
    params: &Value,
    seed: u64,
) -> Scenario {
    let rows = |bodies: &[Body]| bodies.iter().map(|b| [b.x, b.y, b.vx, b.vy]).collect::<Vec<_>>();
    let mut value = json!({
        "task": "kessler/survival",
        "params": {"debris": debris.len(), "fuel": 100},
        "physics": {"start": "upstream"},
        "layout": {"mode": "replace", "bodies": {"satellites": rows(satellites), "debris": rows(debris)}},
        "seed": seed,
    });
    for (field, given) in [("physics", physics), ("params", params)] {
        for (name, choice) in given.as_object().into_iter().flatten() {
            value[field][name] = choice.clone();
        }
    }
    Scenario::from_json(&value).unwrap()
}
