//! Edits of scenarios as they are drawn: what comes near a satellite is read as encounters, a few of these are changed as the
//! procedural designer changes those of its designs, and everything else stays where it is.

use std::collections::BTreeMap;

use env_core::chance::Seeded;
use env_core::critique::BEARING_STEPS;
use env_core::kessler::bearing::Frame;
use env_core::kessler::constants::{EARTH_RADIUS, HORIZON, SATELLITES};
use env_core::kessler::kernel::{Body, Gravity};
use env_core::kessler::setup::{Contact, Setup, Start};
use env_core::scenario::LayoutMode;
use env_core::{Draws, Layout, Recipe, Scenario};

use super::edit;
use super::hold::Hold;
use super::language::{Aim, BEARING, Bound, Design, Encounter, KINDS, MAX_ENCOUNTERS, MISS, SPEED, STEP};
use super::place::{Laws, place};
use super::sample;
use super::speak::rogues;
use crate::brief::Brief;
use crate::vary::{Varied, beside};

/// Tries at a change that can be.
const TRIES: u32 = 12;
/// Bearings do not depend on where the Earth is, so that one can be kept while its time changes.
const FRAME: Frame = Frame::RadialInTrack;

type Change = fn(&mut Design, &Brief, &mut Draws) -> bool;

/// What may be changed of the encounters.
const CHANGES: [(&str, Change); 8] = [
    ("one passes at another time", edit::retime),
    ("all pass earlier or later", edit::rephase),
    ("one has another speed", edit::speed_up),
    ("one passes nearer or wider", edit::nearer),
    ("one more", add),
    ("one less", edit::remove),
    ("one goes for another satellite", edit::other_satellite),
    ("one appears out of nothing, or no longer does", surprise),
];

/// A body of a scenario.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Whose {
    Debris(usize),
    Rogue(usize),
}

/// A scenario, body by body.
struct Frozen {
    start: Start,
    hold: Hold,
    laws: Laws,
    /// What comes near, as encounters, each once.
    met: Vec<(Encounter, Whose)>,
}

/// A scenario with one to three things changed: its encounters, or one of the params that act on bodies that are given.
pub(crate) fn vary(parent: &Scenario, brief: &Brief, draws: &mut Draws) -> Option<Varied> {
    let frozen = Frozen::of(parent)?;
    let bare = parent.recipe().as_ref().clone().with_layout(None).ok()?;
    let aim = Aim { mode: String::new(), bearing_deg: None };
    let encounters: Vec<Encounter> = frozen.met.iter().map(|(encounter, _)| *encounter).collect();
    let design = Design { name: String::new(), aim, frame: FRAME, params: BTreeMap::new(), encounters };
    for _ in 0..TRIES {
        let (mut child, mut recipe, mut changes) = (design.clone(), bare.clone(), Vec::new());
        for _ in 0..draws.between(1, 3) {
            // One in nine changes a param.
            match CHANGES.get(draws.below(CHANGES.len() as u32 + 1) as usize) {
                Some((name, change)) if change(&mut child, brief, draws) => changes.push(*name),
                Some(_) => {}
                None => changes.extend(param(&mut recipe, brief, draws)),
            }
        }
        if child.encounters.is_empty() && design.encounters.is_empty() {
            changes.extend(first(&mut child, brief, parent, draws));
        }
        if recipe == bare && child.encounters == design.encounters {
            continue;
        }
        if let Some(scenario) = frozen.with(recipe, &child.encounters, parent) {
            return Some(Varied { scenario, changes });
        }
    }
    None
}

impl Frozen {
    fn of(scenario: &Scenario) -> Option<Self> {
        let setup = Setup::read(scenario.recipe()).ok()?;
        let start = setup.start(&mut Seeded::new(scenario.seed())).ok()?;
        let hold = Hold::of(&start.satellites, setup.physics.gravity, setup.radar_range);
        let laws = Laws { gravity: setup.physics.gravity, swept: setup.physics.contact == Contact::Swept };
        let debris = start.debris.iter().enumerate().map(|(at, body)| (Whose::Debris(at), 0, *body));
        let rogues =
            start.rogues.iter().enumerate().map(|(at, (step, body))| (Whose::Rogue(at), *step, *body));
        let read = |(whose, arrives, body)| Some((meeting(&hold, laws.gravity, arrives, body)?, whose));
        let mut met: Vec<(Encounter, Whose)> = debris.chain(rogues).filter_map(read).collect();
        // The nearest first; of two that read alike one is known and the other is left as it is.
        met.sort_by_key(|(encounter, _)| encounter.miss_distance);
        let mut known: Vec<Encounter> = Vec::new();
        met.retain(|(encounter, _)| {
            let new = known.len() < MAX_ENCOUNTERS && !known.contains(encounter);
            known.extend(new.then_some(*encounter));
            new
        });
        Some(Self { start, hold, laws, met })
    }

    /// The scenario with these encounters instead of its own: those it had keep their bodies.
    fn with(&self, recipe: Recipe, encounters: &[Encounter], parent: &Scenario) -> Option<Scenario> {
        let distinct = encounters.iter().enumerate().all(|(at, one)| !encounters[..at].contains(one));
        if !distinct {
            return None;
        }
        let gone: Vec<Whose> =
            self.met.iter().filter(|(one, _)| !encounters.contains(one)).map(|(_, whose)| *whose).collect();
        let kept = |whose: Whose| !gone.contains(&whose);
        let all = self.start.debris.iter().enumerate().filter(|(at, _)| kept(Whose::Debris(*at)));
        let mut debris: Vec<Body> = all.map(|(_, body)| *body).collect();
        let all = self.start.rogues.iter().enumerate().filter(|(at, _)| kept(Whose::Rogue(*at)));
        let mut rogues: Vec<(u32, Body)> = all.map(|(_, rogue)| *rogue).collect();
        for encounter in encounters.iter().filter(|one| !self.met.iter().any(|(known, _)| known == *one)) {
            encounter.check("").ok()?;
            let placed = place(encounter, FRAME, &self.hold, self.laws).ok()?;
            match placed.arrives {
                Some(step) => rogues.push((step, placed.body)),
                None => debris.push(placed.body),
            }
        }
        rogues.sort_by_key(|(step, _)| *step);
        let row = |body: &Body| vec![body.x, body.y, body.vx, body.vy];
        let bodies = BTreeMap::from([
            ("satellites".to_owned(), self.hold.starts().iter().map(row).collect()),
            ("debris".to_owned(), debris.iter().map(row).collect::<Vec<_>>()),
            (
                "rogues".to_owned(),
                rogues.iter().map(|(step, b)| vec![f64::from(*step), b.x, b.y, b.vx, b.vy]).collect(),
            ),
        ]);
        let layout = Layout { mode: LayoutMode::Replace, bodies, provenance: None };
        let recipe = recipe.with_param("debris", debris.len() as f64).ok()?.with_layout(Some(layout)).ok()?;
        Some(Scenario::new(recipe, parent.seed()))
    }
}

/// The pass at which a body comes nearest to a satellite that holds, as far as that is one of the language's.
fn meeting(hold: &Hold, gravity: Gravity, arrives: u32, body: Body) -> Option<Encounter> {
    let mut path = vec![(arrives.saturating_sub(1), body)];
    for step in arrives.max(1)..=HORIZON {
        let next = path.last()?.1.coasted(gravity);
        if next.radius() < EARTH_RADIUS {
            break;
        }
        path.push((step, next));
    }
    let away = |satellite: usize, step: u32, at: &Body| {
        let of = hold.at(satellite, step);
        (of.x - at.x).hypot(of.y - at.y)
    };
    // What appears is first there where it has moved to.
    let there = usize::from(arrives > 0);
    let each = (0..SATELLITES)
        .flat_map(|satellite| path[there..].iter().map(move |(step, at)| (satellite, *step, *at)));
    let (satellite, step, at) = each.min_by(|a, b| away(a.0, a.1, &a.2).total_cmp(&away(b.0, b.1, &b.2)))?;
    let of = hold.at(satellite, step);
    let miss_distance = number(MISS, away(satellite, step, &at))?;
    let kind = KINDS.iter().find(|(_, _, min, max, _)| (*min..=*max).contains(&miss_distance))?.0;
    // The earliest of the last steps before at which it is seen.
    let mut earlier = path
        .iter()
        .filter(|(then, at)| *then < step && *then + BEARING_STEPS >= step && hold.sees(*then, at));
    let (then, seen) = earlier.next().copied().unwrap_or((step, at));
    let bearing = FRAME.bearing_deg(hold.at(satellite, then), (seen.x, seen.y));
    let encounter = Encounter {
        satellite: u32::try_from(satellite).ok()?,
        step,
        bearing_deg: sample::turned(bearing, 0.0).min(BEARING.max),
        relative_speed: number(SPEED, (of.vx - at.vx).hypot(of.vy - at.vy))?,
        miss_distance,
        kind,
        rogue: arrives > 0,
    };
    (STEP.min..=STEP.max).contains(&step).then_some(encounter)
}

/// A quantity in the language's whole numbers; none outside them.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a quotient of two positive numbers"
)]
fn number(bound: Bound, value: f64) -> Option<u32> {
    let whole = (value / bound.scale).round() as u32;
    (bound.min..=bound.max).contains(&whole).then_some(whole)
}

/// One more like one that is there. Where there is room for more debris than the level has: what is there stays.
fn add(design: &mut Design, _: &Brief, draws: &mut Draws) -> bool {
    edit::one_more(design, MAX_ENCOUNTERS, draws)
}

/// The first encounter where there is none: one of those that the procedural designer would begin with.
fn first(design: &mut Design, brief: &Brief, sky: &Scenario, draws: &mut Draws) -> Option<&'static str> {
    let bare = sky.recipe().as_ref().clone().with_layout(None).ok()?;
    let drawn = sample::sample(brief, &Scenario::new(bare, sky.seed()), draws)?;
    design.encounters.push(*drawn.encounters.first().filter(|_| drawn.frame == FRAME)?);
    Some("a first encounter")
}

/// A rogue becomes debris, or the other way round where the level has rogues.
fn surprise(design: &mut Design, brief: &Brief, draws: &mut Draws) -> bool {
    let Some(encounter) = edit::pick(design, draws) else { return false };
    let may = encounter.rogue || rogues(brief);
    if may {
        encounter.rogue = !encounter.rogue;
    }
    may
}

/// Fuel or radar, one step beside what it is: the other params say how bodies are drawn, and these are given.
fn param(recipe: &mut Recipe, brief: &Brief, draws: &mut Draws) -> Option<&'static str> {
    let acts = |name: &str| matches!(name, "fuel" | "radar_range");
    let free: Vec<_> = brief.limits.iter().filter(|limit| acts(&limit.param)).collect();
    let count = u32::try_from(free.len()).ok().filter(|count| *count > 0)?;
    let limit = free[draws.below(count) as usize];
    let value = beside(recipe, limit, draws)?;
    *recipe = recipe.clone().with_param(&limit.param, value).ok()?;
    Some(if limit.param == "fuel" { "fuel" } else { "radar range" })
}
