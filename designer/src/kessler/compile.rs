//! Compiles a design into a scenario. Its layout contains all bodies, also satellites and background, so that it is the same
//! under every seed.

use std::collections::BTreeMap;

use env_core::episode_rng::SeededRng;
use env_core::kessler::constants::CONTACT_DISTANCE;
use env_core::kessler::kernel::Body;
use env_core::kessler::setup::{InitialState, KesslerSetup, RogueArrival};
use env_core::task::LayoutMode;
use env_core::{Layout, Scenario, ScenarioError, Seed, SeedSpace};

use super::coast::CoastPaths;
use super::design::{Design, Encounter};
use super::placement::{BEARING_TOLERANCE, PlacedBody, PlacementError, place};
use super::vocabulary::{SPEED, frame_spec};
use crate::field_error::FieldError;

/// Minimum distance of background from coasting satellites, in LU.
const MIN_BACKGROUND_DISTANCE: f64 = CONTACT_DISTANCE + 1.0;
/// Maximum number of initial states from which background is drawn.
const MAX_BACKGROUND_DRAWS: u64 = 8;

/// Design that was compiled.
#[derive(Debug, Clone, PartialEq)]
pub struct CompiledDesign {
    /// Scenario with task, options and seed of the base scenario, params of the design, and all bodies as its layout.
    pub scenario: Scenario,
    /// Body of each encounter, in order.
    pub placed: Vec<PlacedBody>,
}

/// Compiles a design in a base scenario. The base scenario gives task, options, the remaining params, and the seed of
/// satellites and background; its layout is ignored.
///
/// # Errors
/// Returns an error with the field of the first impossible encounter or param, and a way to fix it.
pub fn compile(design: &Design, base: &Scenario) -> Result<CompiledDesign, FieldError> {
    let mut recipe = base.recipe().as_ref().clone().with_layout(None).map_err(field_error)?;
    for (name, value) in &design.params {
        recipe = recipe.with_param(name, *value).map_err(field_error)?;
    }
    let setup = KesslerSetup::from_recipe(&recipe).map_err(field_error)?;
    let start = setup.draw_initial_state(&mut SeededRng::new(base.seed())).map_err(field_error)?;
    let coast = CoastPaths::new(&setup, &start);
    let placed = place_all(design, &coast)?;

    let debris: Vec<Body> = placed.iter().filter(|p| p.arrives.is_none()).map(|p| p.body).collect();
    let debris_param = recipe.param("debris").unwrap_or(0.0) as usize;
    let Some(background_count) = debris_param.checked_sub(debris.len()) else {
        return Err(FieldError::new(
            "encounters",
            format!(
                "must have at most {debris_param} encounters that are not rogues (the param debris), got {}",
                debris.len()
            ),
        ));
    };
    let background = draw_background(&setup, base.seed(), start, background_count, &coast);
    let debris: Vec<Body> = debris.into_iter().chain(background.debris).collect();
    let placed_rogues =
        placed.iter().filter_map(|p| p.arrives.map(|step| RogueArrival { step, body: p.body }));
    let rogues: Vec<RogueArrival> = placed_rogues.chain(background.rogues).collect();
    let layout = layout(&coast, &debris, &rogues);
    let layout = Layout { provenance: Some(design.to_json()), ..layout };
    let recipe = recipe
        .with_param("debris", debris.len() as f64)
        .and_then(|recipe| recipe.with_layout(Some(layout)))
        .map_err(field_error)?;
    Ok(CompiledDesign { scenario: Scenario::new(recipe, base.seed()), placed })
}

/// Returns the layout of the coasting satellites with this debris and these rogues.
pub(super) fn layout(coast: &CoastPaths, debris: &[Body], rogues: &[RogueArrival]) -> Layout {
    let row = |body: &Body| vec![body.x, body.y, body.vx, body.vy];
    let rogue_row =
        |RogueArrival { step, body }: &RogueArrival| vec![f64::from(*step), body.x, body.y, body.vx, body.vy];
    let bodies = BTreeMap::from([
        ("satellites".to_owned(), coast.start().iter().map(row).collect()),
        ("debris".to_owned(), debris.iter().map(row).collect()),
        ("rogues".to_owned(), rogues.iter().map(rogue_row).collect()),
    ]);
    Layout { mode: LayoutMode::Replace, bodies, provenance: None }
}

/// Places the bodies of all encounters, which must differ.
fn place_all(design: &Design, coast: &CoastPaths) -> Result<Vec<PlacedBody>, FieldError> {
    let mut placed = Vec::with_capacity(design.encounters.len());
    for (i, encounter) in design.encounters.iter().enumerate() {
        let path = format!("encounters.{i}");
        encounter.validate(&path)?;
        if let Some(twin) = design.encounters[..i].iter().position(|other| other == encounter) {
            let message = format!("repeats encounters.{twin}; change it or leave it out");
            return Err(FieldError::new(path, message));
        }
        let body = place(encounter, design.frame, coast);
        placed.push(body.map_err(|error| FieldError::new(path, describe(encounter, design, error)))?);
    }
    Ok(placed)
}

/// Draws up to `max_debris` debris bodies, and rogues, that keep away from coasting satellites, so that only the encounters of
/// the design matter.
fn draw_background(
    setup: &KesslerSetup,
    seed: Seed,
    start: InitialState,
    max_debris: usize,
    coast: &CoastPaths,
) -> InitialState {
    let mut background = InitialState { debris: Vec::with_capacity(max_debris), ..start.clone() };
    let mut next = Some(start);
    for attempt in 1..=MAX_BACKGROUND_DRAWS {
        let Some(drawn) = next.take() else { break };
        let distances = coast.min_distances(0, &drawn.debris);
        let clear =
            drawn.debris.iter().zip(distances).filter(|(_, distance)| *distance >= MIN_BACKGROUND_DISTANCE);
        background.debris.extend(clear.map(|(body, _)| *body).take(max_debris - background.debris.len()));
        if background.debris.len() < max_debris {
            let other = Seed::in_space(SeedSpace::User, seed.get().wrapping_mul(31).wrapping_add(attempt));
            next = setup.draw_initial_state(&mut SeededRng::new(other)).ok();
        }
    }
    background
        .rogues
        .retain(|rogue| coast.min_distances(rogue.step - 1, &[rogue.body])[0] >= MIN_BACKGROUND_DISTANCE);
    background
}

#[expect(clippy::needless_pass_by_value, reason = "the signature that map_err takes")]
fn field_error(error: ScenarioError) -> FieldError {
    FieldError::new(error.field().to_owned(), error.reason())
}

/// Returns the message of a placement error: the problem and a way to fix it. Messages are part of repair prompts.
fn describe(encounter: &Encounter, design: &Design, error: PlacementError) -> String {
    let pass = format!(
        "a {} for satellite {} at step {} at {:.1} LU/TU from {} degrees ({})",
        encounter.kind.as_str(),
        encounter.satellite,
        encounter.step,
        SPEED.value(encounter.relative_speed),
        encounter.bearing_deg,
        frame_spec(design.frame).name,
    );
    match error {
        PlacementError::SatelliteFallen => {
            format!(
                "satellite {} falls into the Earth before; choose an earlier step or another satellite",
                encounter.satellite
            )
        }
        PlacementError::NoSuchBearing { nearest } => format!(
            "{pass} cannot be placed within {BEARING_TOLERANCE} degrees: the nearest bearing is {nearest:.0}; choose that \
             bearing, or a faster or nearer pass"
        ),
        PlacementError::ThroughEarth { step } => format!(
            "{pass} would come out of the Earth at step {step}; choose an earlier step, another bearing or a rogue"
        ),
        PlacementError::StartOutOfRange { radius } => format!(
            "{pass} must start 22 to 150 LU from the Earth's centre, but would start at {radius:.0}; choose an earlier step, \
             a slower pass, another bearing or a rogue"
        ),
        PlacementError::TooEarly { satellite, step } => format!(
            "{pass} would hit satellite {satellite} at step {step} already; choose a faster pass, or another step or bearing"
        ),
        PlacementError::TooNear { satellite, step, distance } => format!(
            "{pass} would be only {distance:.1} LU from satellite {satellite} at step {step}; choose another step or bearing"
        ),
    }
}
