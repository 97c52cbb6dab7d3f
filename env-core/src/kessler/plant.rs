//! Threats put on a satellite's hold trajectory by running the step backwards.

use super::constants::{EARTH_RADIUS_2, HORIZON, SATELLITES};
use super::kernel::{Body, Gravity};
use super::setup::Setup;
use crate::bracket::{Bracket, admit};
use crate::chance::{Chance, Seeded, Stream};
use crate::error::ScenarioError;
use crate::scenario::{Layout, LayoutMode, Recipe, Scenario};

/// Start radii a planted body may have, LU.
pub const START_RADII: (f64, f64) = (22.0, 150.0);
/// Tries at a contested scenario with one and two threats.
const TRIES: u32 = 48;

/// A body that meets a satellite which holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Threat {
    /// Which satellite, 0 to 2.
    pub satellite: u32,
    /// At which step, 1 to 50.
    pub step: u32,
    /// Where it comes from, seen from the satellite at contact: angle from radial out towards in-track, radians.
    pub direction: f64,
    /// Relative speed at contact, LU/TU.
    pub speed: f64,
}

/// The scenario with one threat more.
///
/// # Errors
/// A threat that is none (satellite, step), one whose start cannot be, or one that is not fair.
pub fn plant(scenario: &Scenario, threat: Threat) -> Result<Scenario, ScenarioError> {
    let bounds = |name: &str, value: f64, min: f64, max: f64| {
        if value >= min && value <= max {
            Ok(())
        } else {
            Err(ScenarioError::OutOfRange { field: format!("threat.{name}"), value, min, max })
        }
    };
    bounds("satellite", f64::from(threat.satellite), 0.0, SATELLITES as f64 - 1.0)?;
    bounds("step", f64::from(threat.step), 1.0, f64::from(HORIZON))?;
    bounds("speed", threat.speed, 0.0, 20.0)?;
    bounds("direction", threat.direction, -10.0, 10.0)?;
    let setup = Setup::read(scenario.recipe())?;
    let start = setup.start(&mut Seeded::new(scenario.seed()))?;
    let body = backwards(start.satellites[threat.satellite as usize], threat, setup.physics.gravity)?;
    let recipe = with_debris(scenario.recipe(), body)?;
    let planted = Scenario::new(recipe, scenario.seed());
    Setup::read(planted.recipe())?.start(&mut Seeded::new(planted.seed()))?;
    Ok(planted)
}

/// The start of the body that meets the satellite as `threat` says.
fn backwards(mut satellite: Body, threat: Threat, gravity: Gravity) -> Result<Body, ScenarioError> {
    for _ in 0..threat.step {
        satellite = satellite.coasted(gravity);
    }
    let ((rx, ry), (tx, ty)) = satellite.frame();
    let (sin, cos) = libm::sincos(threat.direction);
    let (ux, uy) = (cos * rx + sin * tx, cos * ry + sin * ty);
    let mut body =
        Body { vx: satellite.vx - threat.speed * ux, vy: satellite.vy - threat.speed * uy, ..satellite };
    for step in (0..threat.step).rev() {
        body = body.uncoasted(gravity);
        if body.radius_2() < EARTH_RADIUS_2 {
            return Err(fault(&threat, &format!("it would come out of the Earth at step {step}")));
        }
    }
    let radius = body.radius();
    if radius < START_RADII.0 || radius > START_RADII.1 {
        return Err(fault(&threat, &format!("it would start at radius {radius:.0} LU, outside 22 to 150")));
    }
    Ok(body)
}

fn fault(threat: &Threat, reason: &str) -> ScenarioError {
    ScenarioError::Layout {
        field: "threat".to_owned(),
        reason: format!(
            "a pass of satellite {} at step {} at {:.1} LU/TU cannot be planted: {reason}",
            threat.satellite, threat.step, threat.speed
        ),
    }
}

/// The recipe with one more body of debris.
fn with_debris(recipe: &Recipe, body: Body) -> Result<Recipe, ScenarioError> {
    let row = vec![body.x, body.y, body.vx, body.vy];
    let mut layout = recipe.layout().cloned().unwrap_or_else(|| Layout {
        mode: LayoutMode::Extend,
        bodies: std::collections::BTreeMap::new(),
        provenance: None,
    });
    let mut recipe = recipe.clone();
    if layout.mode == LayoutMode::Replace {
        if !layout.bodies.contains_key("debris") {
            return Err(ScenarioError::Layout {
                field: "layout.mode".to_owned(),
                reason: "a layout that replaces satellites alone cannot be planted on; use extend".to_owned(),
            });
        }
        // Where the layout replaces debris the param says how many it gives.
        let more = recipe.param("debris").unwrap_or(0.0) + 1.0;
        recipe = recipe.with_layout(None)?.with_param("debris", more)?;
    }
    layout.bodies.entry("debris".to_owned()).or_default().push(row);
    recipe.with_layout(Some(layout))
}

/// Threats planted at random until the scenario is contested; every draw comes from the scenario's seed.
#[must_use]
pub fn plant_contested(scenario: &Scenario) -> Option<(Scenario, Bracket)> {
    let mut chance = Seeded::new(scenario.seed());
    let mut draw = |low: f64, high: f64| chance.between(Stream::Plant, low, high);
    for _ in 0..TRIES {
        let threat = Threat {
            satellite: draw(0.0, SATELLITES as f64) as u32,
            step: draw(4.0, 25.0) as u32,
            direction: draw(0.0, std::f64::consts::TAU),
            speed: draw(1.5, 8.0),
        };
        let Ok(planted) = plant(scenario, threat) else { continue };
        let admission = admit(&planted);
        if let (true, Some(bracket)) = (admission.contested, admission.bracket) {
            return Some((planted, bracket));
        }
    }
    None
}
