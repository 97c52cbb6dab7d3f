//! From encounters to bodies: a layout that stands by itself, its satellites and background included, so that it is the
//! same whatever seed it is flown under.

use std::collections::BTreeMap;

use env_core::chance::Seeded;
use env_core::kessler::constants::CONTACT_DISTANCE;
use env_core::kessler::kernel::Body;
use env_core::kessler::setup::{Contact, Setup, Start};
use env_core::{Layout, Scenario, ScenarioError, Seed, SeedSpace};

use super::hold::Hold;
use super::language::{Design, Encounter, SPEED, frame_word};
use super::place::{BEARING_TOLERANCE, Laws, Placed, Trouble, place};
use crate::Fault;

/// How far background keeps from satellites that hold, LU.
const CLEAR: f64 = CONTACT_DISTANCE + 1.0;
/// Further skies that background is drawn from where the first has too little that keeps clear.
const SKIES: u64 = 8;

/// A design made into bodies.
#[derive(Debug, Clone, PartialEq)]
pub struct Compiled {
    /// The scenario: the base's task, options and seed, the design's params, and all bodies as a layout.
    pub scenario: Scenario,
    /// What each encounter became, in order.
    pub placed: Vec<Placed>,
}

/// Makes bodies of a design. `base` gives task, options, params that the design leaves alone, and the seed that satellites
/// and background are drawn from; a layout of its own is not looked at.
///
/// # Errors
/// The field at fault and a sentence that says what would do.
pub fn compile(design: &Design, base: &Scenario) -> Result<Compiled, Fault> {
    let mut recipe = base.recipe().as_ref().clone().with_layout(None).map_err(fault)?;
    for (name, value) in &design.params {
        recipe = recipe.with_param(name, *value).map_err(fault)?;
    }
    let setup = Setup::read(&recipe).map_err(fault)?;
    let start = setup.start(&mut Seeded::new(base.seed())).map_err(fault)?;
    let hold = Hold::of(&start.satellites, setup.physics.gravity, setup.radar_range);
    let laws = Laws { gravity: setup.physics.gravity, swept: setup.physics.contact == Contact::Swept };
    let placed = all(design, &hold, laws)?;

    let debris: Vec<Body> = placed.iter().filter(|p| p.arrives.is_none()).map(|p| p.body).collect();
    let wanted = recipe.param("debris").unwrap_or(0.0) as usize;
    let Some(room) = wanted.checked_sub(debris.len()) else {
        return Err(Fault::new(
            "encounters",
            format!(
                "{} of them are debris that is there from the start, and the param debris is {wanted}",
                debris.len()
            ),
        ));
    };
    let background = background(&setup, base.seed(), start, room, &hold, laws);
    let given = debris.len() + background.debris.len();
    let rogues = placed.iter().filter_map(|p| p.arrives.map(|step| (step, p.body))).chain(background.rogues);
    let row = |body: &Body| vec![body.x, body.y, body.vx, body.vy];
    let bodies = BTreeMap::from([
        ("satellites".to_owned(), hold.starts().iter().map(row).collect()),
        ("debris".to_owned(), debris.iter().chain(&background.debris).map(row).collect()),
        ("rogues".to_owned(), rogues.map(|(step, b)| vec![f64::from(step), b.x, b.y, b.vx, b.vy]).collect()),
    ]);
    let layout =
        Layout { mode: env_core::scenario::LayoutMode::Replace, bodies, provenance: Some(design.to_json()) };
    let recipe =
        recipe.with_param("debris", given as f64).and_then(|r| r.with_layout(Some(layout))).map_err(fault)?;
    Ok(Compiled { scenario: Scenario::new(recipe, base.seed()), placed })
}

/// Every encounter's body, and that they do not spoil each other: one satellite is hit once.
fn all(design: &Design, hold: &Hold, laws: Laws) -> Result<Vec<Placed>, Fault> {
    let mut placed = Vec::with_capacity(design.encounters.len());
    for (i, encounter) in design.encounters.iter().enumerate() {
        let at = format!("encounters.{i}");
        encounter.check(&at)?;
        if let Some(twin) = design.encounters[..i].iter().position(|other| other == encounter) {
            return Err(Fault::new(at, format!("it is encounters.{twin} again: two bodies would be one")));
        }
        let body = place(encounter, design.frame, hold, laws);
        placed.push(body.map_err(|trouble| Fault::new(at, sentence(encounter, design, trouble)))?);
    }
    Ok(placed)
}

/// Bodies of the generator that meet nobody who holds, so that what a layout does is what its encounters say.
fn background(setup: &Setup, seed: Seed, start: Start, room: usize, hold: &Hold, laws: Laws) -> Start {
    let mut sky = Start { debris: Vec::with_capacity(room), ..start.clone() };
    let mut next = Some(start);
    for turn in 1..=SKIES {
        let Some(drawn) = next.take() else { break };
        let distances = hold.least_distances(0, &drawn.debris, laws.swept);
        let clear = drawn.debris.iter().zip(distances).filter(|(_, distance)| *distance >= CLEAR);
        sky.debris.extend(clear.map(|(body, _)| *body).take(room - sky.debris.len()));
        if sky.debris.len() < room {
            let other = Seed::in_space(SeedSpace::User, seed.get().wrapping_mul(31).wrapping_add(turn));
            next = setup.start(&mut Seeded::new(other)).ok();
        }
    }
    sky.rogues.retain(|(step, body)| hold.least_distances(step - 1, &[*body], laws.swept)[0] >= CLEAR);
    sky
}

#[expect(clippy::needless_pass_by_value, reason = "it stands in map_err")]
fn fault(error: ScenarioError) -> Fault {
    Fault::new(error.field().to_owned(), error.to_string())
}

/// What is wrong, and what would do.
fn sentence(encounter: &Encounter, design: &Design, trouble: Trouble) -> String {
    let pass = format!(
        "a {} of satellite {} at step {} at {:.1} LU/TU from {} degrees ({})",
        encounter.kind.word(),
        encounter.satellite,
        encounter.step,
        SPEED.value(encounter.relative_speed),
        encounter.bearing_deg,
        frame_word(design.frame),
    );
    match trouble {
        Trouble::Fallen => format!("satellite {} has fallen into the Earth by then", encounter.satellite),
        Trouble::Bearing { nearest } => format!(
            "{pass} cannot be had to {BEARING_TOLERANCE} degrees: the nearest bearing is {nearest:.0}; ask for another, or \
             for a faster or nearer pass"
        ),
        Trouble::Earth { step } => format!(
            "{pass} would come out of the Earth at step {step}; ask for an earlier step, another bearing or a rogue"
        ),
        Trouble::Start { radius } => format!(
            "{pass} would start {radius:.0} LU from the Earth, outside 22 to 150; ask for an earlier step, a slower pass, \
             another bearing or a rogue"
        ),
        Trouble::Early { satellite, step } => format!(
            "{pass} would hit satellite {satellite} at step {step} already; ask for a faster pass, or another step or bearing"
        ),
        Trouble::Near { satellite, step, distance } => format!(
            "{pass} would be {distance:.1} LU from satellite {satellite} at step {step}; ask for another step or bearing"
        ),
    }
}
