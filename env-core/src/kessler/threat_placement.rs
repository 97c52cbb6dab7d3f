//! Places threats: debris that hits a satellite under hold, found by running the dynamics backwards from the
//! contact.

use super::constants::{EARTH_RADIUS_2, HORIZON, SATELLITES};
use super::kernel::{Body, Gravity};
use super::setup::KesslerSetup;
use crate::admission::admit;
use crate::bracket::Bracket;
use crate::episode_rng::{EpisodeRng, RngStream, SeededRng};
use crate::error::ScenarioError;
use crate::task::{Layout, LayoutMode, Recipe, Scenario};

/// Range of the initial radius of a placed body, LU.
pub const THREAT_START_RADII: (f64, f64) = (22.0, 150.0);
/// Maximum number of random threats tried to make a scenario contested.
const MAX_THREAT_TRIES: u32 = 48;

/// Debris that meets a satellite which holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Threat {
    /// Number of the satellite, 0 to 2.
    pub satellite: u32,
    /// Step of the contact, 1 to 50.
    pub step: u32,
    /// Direction from which the debris comes, seen from the satellite at contact: angle from radial out
    /// towards in-track, radians.
    pub direction: f64,
    /// Relative speed at contact, LU/TU.
    pub speed: f64,
}

/// Returns the scenario with one more debris body, which meets a satellite as `threat` says.
///
/// # Errors
/// Returns [`ScenarioError`] if a number of the threat is out of range, if its start would be inside the
/// Earth or outside [`THREAT_START_RADII`], or if the start is not fair.
pub fn place_threat(scenario: &Scenario, threat: Threat) -> Result<Scenario, ScenarioError> {
    let last_satellite = SATELLITES as f64 - 1.0;
    ScenarioError::check_range("threat.satellite", f64::from(threat.satellite), 0.0, last_satellite)?;
    ScenarioError::check_range("threat.step", f64::from(threat.step), 1.0, f64::from(HORIZON))?;
    ScenarioError::check_range("threat.speed", threat.speed, 0.0, 20.0)?;
    ScenarioError::check_range("threat.direction", threat.direction, -10.0, 10.0)?;
    let setup = KesslerSetup::from_recipe(scenario.recipe())?;
    let start = setup.draw_initial_state(&mut SeededRng::new(scenario.seed()))?;
    let body = initial_body(start.satellites[threat.satellite as usize], threat, setup.physics.gravity)?;
    let recipe = with_debris(scenario.recipe(), body)?;
    let with_threat = Scenario::new(recipe, scenario.seed());
    KesslerSetup::from_recipe(with_threat.recipe())?
        .draw_initial_state(&mut SeededRng::new(with_threat.seed()))?;
    Ok(with_threat)
}

/// Initial state of the body that meets the satellite as `threat` says.
fn initial_body(mut satellite: Body, threat: Threat, gravity: Gravity) -> Result<Body, ScenarioError> {
    for _ in 0..threat.step {
        satellite = satellite.coast(gravity);
    }
    let ((rx, ry), (tx, ty)) = satellite.local_axes();
    let (sin, cos) = libm::sincos(threat.direction);
    let (ux, uy) = (cos * rx + sin * tx, cos * ry + sin * ty);
    let mut body =
        Body { vx: satellite.vx - threat.speed * ux, vy: satellite.vy - threat.speed * uy, ..satellite };
    for step in (0..threat.step).rev() {
        body = body.coast_back(gravity);
        if body.radius_squared() < EARTH_RADIUS_2 {
            return Err(fault(&threat, &format!("it would come out of the Earth at step {step}")));
        }
    }
    let radius = body.radius();
    if radius < THREAT_START_RADII.0 || radius > THREAT_START_RADII.1 {
        return Err(fault(&threat, &format!("its start radius must be 22 to 150 LU, got {radius:.0}")));
    }
    Ok(body)
}

fn fault(threat: &Threat, reason: &str) -> ScenarioError {
    ScenarioError::Layout {
        field: "threat".to_owned(),
        reason: format!(
            "to satellite {} at step {} at {:.1} LU/TU cannot be placed: {reason}",
            threat.satellite, threat.step, threat.speed
        ),
    }
}

/// Returns the recipe with one more debris row in its layout.
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
                reason: "must be extend to add a threat: the layout replaces only satellites".to_owned(),
            });
        }
        // `params.debris` must equal the number of rows if the layout replaces debris.
        let more = recipe.param("debris").unwrap_or(0.0) + 1.0;
        recipe = recipe.with_layout(None)?.with_param("debris", more)?;
    }
    layout.bodies.entry("debris".to_owned()).or_default().push(row);
    recipe.with_layout(Some(layout))
}

/// Places random threats until the scenario is contested. All draws come from the scenario's seed. Returns
/// `None` if no try succeeds.
#[must_use]
pub fn place_contested_threat(scenario: &Scenario) -> Option<(Scenario, Bracket)> {
    let mut rng = SeededRng::new(scenario.seed());
    let mut draw = |low: f64, high: f64| rng.uniform_in(RngStream::ThreatPlacement, low, high);
    for _ in 0..MAX_THREAT_TRIES {
        let threat = Threat {
            satellite: draw(0.0, SATELLITES as f64) as u32,
            step: draw(4.0, 25.0) as u32,
            direction: draw(0.0, std::f64::consts::TAU),
            speed: draw(1.5, 8.0),
        };
        let Ok(candidate) = place_threat(scenario, threat) else { continue };
        let admission = admit(&candidate);
        if let (true, Some(bracket)) = (admission.contested, admission.bracket) {
            return Some((candidate, bracket));
        }
    }
    None
}
