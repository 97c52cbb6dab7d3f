//! Stages for tests: flights from scenarios, and encounters of known geometry.

use serde_json::{Value, json};

use crate::chance::Seeded;
use crate::kessler::TASKS;
use crate::kessler::constants::{GM, SATELLITES};
use crate::kessler::flight::Flight;
use crate::kessler::kernel::{Body, Gravity};
use crate::kessler::setup::Setup;
use crate::scenario::Scenario;
use crate::task::TaskSpec;

/// The engine itself, at the start of a scenario.
pub(super) fn flight(scenario: &Scenario) -> Flight<Seeded> {
    let setup = Setup::read(scenario.recipe()).unwrap();
    let mut chance = Seeded::new(scenario.seed());
    let start = setup.start(&mut chance).unwrap();
    let task = TASKS.iter().find(|task| task.id() == scenario.task().id()).unwrap();
    Flight::new(task.objective(), setup, &start, chance)
}

/// Satellites on circular orbits, out of the way of each other.
pub(super) fn apart() -> [Body; SATELLITES] {
    let v = |r: f64| (GM / r).sqrt();
    [
        Body { x: 60.0, y: 0.0, vx: 0.0, vy: v(60.0) },
        Body { x: -70.0, y: 0.0, vx: 0.0, vy: -v(70.0) },
        Body { x: 0.0, y: 80.0, vx: -v(80.0), vy: 0.0 },
    ]
}

/// A pass of known geometry: `time` TU after the start the debris is nearest to the satellite, which holds.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pass {
    /// TU from the start.
    pub time: f64,
    /// LU, to the left of the relative velocity; the closest approach, where that lies within the step.
    pub miss: f64,
    /// LU/TU.
    pub speed: f64,
    /// Where the debris goes, seen from the satellite: angle from the satellite's radial, radians.
    pub heading: f64,
}

impl Pass {
    /// Where the debris has to start: the step run backwards from the closest approach.
    pub(super) fn start(&self, satellite: Body, gravity: Gravity) -> Body {
        self.start_off(satellite, gravity, (0.0, 0.0))
    }

    /// The same, displaced at the closest approach by so much, LU, along the relative velocity and to its left.
    pub(super) fn start_off(&self, mut satellite: Body, gravity: Gravity, off: (f64, f64)) -> Body {
        let steps = self.time.ceil() as u32;
        for _ in 0..steps {
            satellite = satellite.coasted(gravity);
        }
        let ((rx, ry), (tx, ty)) = satellite.frame();
        let (sin, cos) = libm::sincos(self.heading);
        let (ux, uy) = (cos * rx + sin * tx, cos * ry + sin * ty);
        // From the closest approach to the end of its step.
        let along = self.speed * (f64::from(steps) - self.time) + off.0;
        let left = self.miss + off.1;
        let mut body = Body {
            x: satellite.x + along * ux - left * uy,
            y: satellite.y + along * uy + left * ux,
            vx: satellite.vx + self.speed * ux,
            vy: satellite.vy + self.speed * uy,
        };
        for _ in 0..steps {
            body = body.uncoasted(gravity);
        }
        body
    }
}

/// A survival scenario of these bodies and nothing else.
pub(super) fn staged(
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
