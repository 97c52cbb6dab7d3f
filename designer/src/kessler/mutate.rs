//! Mutates scenarios without a design. Bodies that pass near a satellite are read as encounters, a few of these are edited as
//! those of a design, and all other bodies stay where they are.

use std::collections::BTreeMap;

use env_core::critique::BEARING_STEPS;
use env_core::episode_rng::SeededRng;
use env_core::kessler::bearing::BearingFrame;
use env_core::kessler::constants::{EARTH_RADIUS, HORIZON, SATELLITES};
use env_core::kessler::kernel::Body;
use env_core::kessler::setup::{InitialState, KesslerSetup, RogueArrival};
use env_core::{KeyedRng, Recipe, Scenario};

use super::aim::allows_rogues;
use super::coast::CoastPaths;
use super::compile::layout;
use super::design::{Aim, Design, Encounter};
use super::edit::{self, all_distinct};
use super::placement::place;
use super::sample::sample_design;
use super::vocabulary::{KINDS, MAX_ENCOUNTERS, MISS, SPEED, STEP};
use crate::angles::whole_degrees;
use crate::bound::Bound;
use crate::brief::DesignBrief;
use crate::mutation::{Mutation, adjacent_value, pick_choice};

/// Maximum number of attempts to mutate a scenario.
const MAX_ATTEMPTS: u32 = 12;
/// Frame of the encounters. Its bearings do not depend on the position of the Earth, so that they survive a shift in time.
const FRAME: BearingFrame = BearingFrame::RadialInTrack;

/// Edit of the encounters. Returns false if it does not apply.
type EncounterEdit = fn(&mut Design, &DesignBrief, &mut KeyedRng) -> bool;

/// Edits of the encounters. The names are stored with the scenario.
const EDITS: [(&str, EncounterEdit); 8] = [
    ("one passes at another time", edit::shift_one),
    ("all pass earlier or later", edit::shift_all),
    ("one has another speed", edit::change_speed),
    ("one passes nearer or wider", edit::change_miss_distance),
    ("one more", duplicate_encounter),
    ("one less", edit::remove_encounter),
    ("one goes for another satellite", edit::change_satellite),
    ("one appears out of nothing, or no longer does", toggle_rogue),
];

/// Returns a scenario after one to three edits of its encounters, or of a param that acts on existing bodies; `None` if no
/// attempt succeeds.
pub(crate) fn mutate(parent: &Scenario, brief: &DesignBrief, rng: &mut KeyedRng) -> Option<Mutation> {
    let decomposed = DecomposedScenario::new(parent)?;
    let recipe_without_layout = parent.recipe().as_ref().clone().with_layout(None).ok()?;
    let aim = Aim { mode: String::new(), bearing_deg: None };
    let encounters: Vec<Encounter> = decomposed.encounters.iter().map(|(encounter, _)| *encounter).collect();
    let design = Design { name: String::new(), aim, frame: FRAME, params: BTreeMap::new(), encounters };
    for _ in 0..MAX_ATTEMPTS {
        let mut child = design.clone();
        let mut recipe = recipe_without_layout.clone();
        let mut changes = Vec::new();
        for _ in 0..rng.range_inclusive(1, 3) {
            // One edit in nine changes a param.
            match EDITS.get(rng.below(EDITS.len() as u32 + 1) as usize) {
                Some((name, edit)) if edit(&mut child, brief, rng) => changes.push(*name),
                Some(_) => {}
                None => changes.extend(change_param(&mut recipe, brief, rng)),
            }
        }
        if child.encounters.is_empty() && design.encounters.is_empty() {
            changes.extend(add_first_encounter(&mut child, brief, parent, rng));
        }
        if recipe == recipe_without_layout && child.encounters == design.encounters {
            continue;
        }
        if let Some(scenario) = decomposed.with_encounters(recipe, &child.encounters, parent) {
            return Some(Mutation { scenario, changes });
        }
    }
    None
}

/// Index of a body in the initial state of a scenario.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum BodyIndex {
    Debris(usize),
    Rogue(usize),
}

/// Scenario as its bodies, with the encounters that some of them have.
struct DecomposedScenario {
    start: InitialState,
    coast: CoastPaths,
    /// Distinct encounters with their bodies, nearest first.
    encounters: Vec<(Encounter, BodyIndex)>,
}

impl DecomposedScenario {
    fn new(scenario: &Scenario) -> Option<Self> {
        let setup = KesslerSetup::from_recipe(scenario.recipe()).ok()?;
        let start = setup.draw_initial_state(&mut SeededRng::new(scenario.seed())).ok()?;
        let coast = CoastPaths::new(&setup, &start);
        let debris = start.debris.iter().enumerate().map(|(at, body)| (BodyIndex::Debris(at), 0, *body));
        let rogues =
            start.rogues.iter().enumerate().map(|(at, rogue)| (BodyIndex::Rogue(at), rogue.step, rogue.body));
        let read = |(index, arrives, body)| Some((read_encounter(&coast, arrives, body)?, index));
        let mut encounters: Vec<(Encounter, BodyIndex)> = debris.chain(rogues).filter_map(read).collect();
        encounters.sort_by_key(|(encounter, _)| encounter.miss_distance);
        // Of two equal encounters one is editable; the body of the other stays as it is.
        let mut known: Vec<Encounter> = Vec::new();
        encounters.retain(|(encounter, _)| {
            let is_new = known.len() < MAX_ENCOUNTERS && !known.contains(encounter);
            known.extend(is_new.then_some(*encounter));
            is_new
        });
        Some(Self { start, coast, encounters })
    }

    /// Returns the scenario with these encounters in place of its own. Encounters that it already has keep their bodies.
    fn with_encounters(
        &self,
        recipe: Recipe,
        encounters: &[Encounter],
        parent: &Scenario,
    ) -> Option<Scenario> {
        if !all_distinct(encounters) {
            return None;
        }
        let removed: Vec<BodyIndex> = self
            .encounters
            .iter()
            .filter(|(encounter, _)| !encounters.contains(encounter))
            .map(|(_, index)| *index)
            .collect();
        let is_kept = |index: BodyIndex| !removed.contains(&index);
        let kept = self.start.debris.iter().enumerate().filter(|(at, _)| is_kept(BodyIndex::Debris(*at)));
        let mut debris: Vec<Body> = kept.map(|(_, body)| *body).collect();
        let kept = self.start.rogues.iter().enumerate().filter(|(at, _)| is_kept(BodyIndex::Rogue(*at)));
        let mut rogues: Vec<RogueArrival> = kept.map(|(_, rogue)| *rogue).collect();
        let is_new = |encounter: &&Encounter| !self.encounters.iter().any(|(known, _)| known == *encounter);
        for encounter in encounters.iter().filter(is_new) {
            encounter.validate("").ok()?;
            let placed = place(encounter, FRAME, &self.coast).ok()?;
            match placed.arrives {
                Some(step) => rogues.push(RogueArrival { step, body: placed.body }),
                None => debris.push(placed.body),
            }
        }
        rogues.sort_by_key(|rogue| rogue.step);
        let layout = layout(&self.coast, &debris, &rogues);
        let recipe = recipe.with_param("debris", debris.len() as f64).ok()?.with_layout(Some(layout)).ok()?;
        Some(Scenario::new(recipe, parent.seed()))
    }
}

/// Reads the nearest pass of a body as an encounter; `None` if it is outside the bounds of the language. `arrives` is the step
/// in which a rogue appears, and 0 for other debris.
fn read_encounter(coast: &CoastPaths, arrives: u32, body: Body) -> Option<Encounter> {
    let mut path = vec![(arrives.saturating_sub(1), body)];
    for step in arrives.max(1)..=HORIZON {
        let next = path.last()?.1.coast(coast.gravity());
        if next.radius() < EARTH_RADIUS {
            break;
        }
        path.push((step, next));
    }
    let distance = |satellite: usize, step: u32, body: &Body| {
        let satellite = coast.satellite(satellite, step);
        (satellite.x - body.x).hypot(satellite.y - body.y)
    };
    // A rogue counts only after its first motion.
    let first = usize::from(arrives > 0);
    let passes = (0..SATELLITES)
        .flat_map(|satellite| path[first..].iter().map(move |(step, body)| (satellite, *step, *body)));
    let (satellite, step, body) =
        passes.min_by(|a, b| distance(a.0, a.1, &a.2).total_cmp(&distance(b.0, b.1, &b.2)))?;
    let state = coast.satellite(satellite, step);
    let miss_distance = to_number(MISS, distance(satellite, step, &body))?;
    let kind = KINDS.iter().find(|spec| (spec.min_miss..=spec.max_miss).contains(&miss_distance))?.kind;
    // The bearing is measured where the body is first visible within the last steps.
    let mut visible = path.iter().filter(|(then, body)| {
        *then < step && *then + BEARING_STEPS >= step && coast.is_visible(*then, body)
    });
    let (seen_step, seen) = visible.next().copied().unwrap_or((step, body));
    let bearing_deg = FRAME.bearing_deg(coast.satellite(satellite, seen_step), [seen.x, seen.y]);
    let encounter = Encounter {
        satellite: u32::try_from(satellite).ok()?,
        step,
        bearing_deg: whole_degrees(bearing_deg).into(),
        relative_speed: to_number(SPEED, (state.vx - body.vx).hypot(state.vy - body.vy))?,
        miss_distance,
        kind,
        is_rogue: arrives > 0,
    };
    STEP.contains(step).then_some(encounter)
}

/// Converts a quantity to a number of the language; `None` if it is out of bounds.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a quotient of two positive numbers"
)]
fn to_number(bound: Bound<u32>, value: f64) -> Option<u32> {
    let number = libm::round(value * bound.per_unit) as u32;
    bound.contains(number).then_some(number)
}

/// Adds a copy of an encounter. The debris param does not limit it, since all existing bodies stay.
fn duplicate_encounter(design: &mut Design, _: &DesignBrief, rng: &mut KeyedRng) -> bool {
    edit::duplicate_within(design, MAX_ENCOUNTERS, rng)
}

/// Adds the first encounter of a sampled design to a scenario that has none.
fn add_first_encounter(
    design: &mut Design,
    brief: &DesignBrief,
    parent: &Scenario,
    rng: &mut KeyedRng,
) -> Option<&'static str> {
    let recipe = parent.recipe().as_ref().clone().with_layout(None).ok()?;
    let sampled = sample_design(brief, &Scenario::new(recipe, parent.seed()), rng)?;
    design.encounters.push(*sampled.encounters.first().filter(|_| sampled.frame == FRAME)?);
    Some("a first encounter")
}

/// Makes a rogue ordinary debris, or the reverse if the level has rogues.
fn toggle_rogue(design: &mut Design, brief: &DesignBrief, rng: &mut KeyedRng) -> bool {
    let Some(encounter) = edit::pick(design, rng) else { return false };
    let can_toggle = encounter.is_rogue || allows_rogues(brief);
    if can_toggle {
        encounter.is_rogue = !encounter.is_rogue;
    }
    can_toggle
}

/// Changes fuel or radar range to an adjacent value. Other params decide how bodies are drawn, and have no effect on existing
/// bodies.
fn change_param(recipe: &mut Recipe, brief: &DesignBrief, rng: &mut KeyedRng) -> Option<&'static str> {
    let has_effect = |param: &str| matches!(param, "fuel" | "radar_range");
    let choices: Vec<_> = brief.param_choices.iter().filter(|choice| has_effect(&choice.param)).collect();
    let choice = pick_choice(&choices, rng)?;
    let value = adjacent_value(recipe, choice, rng)?;
    *recipe = recipe.clone().with_param(&choice.param, value).ok()?;
    Some(if choice.param == "fuel" { "fuel" } else { "radar range" })
}
