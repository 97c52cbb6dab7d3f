//! What there is to draw of a layout: flown under hold and by the witness.

use env_core::chance::Seeded;
use env_core::critique::BEARING_STEPS;
use env_core::kessler::constants::{CONTACT_DISTANCE, EARTH_RADIUS, HORIZON, SATELLITES};
use env_core::kessler::kernel::{Body, Gravity};
use env_core::kessler::setup::{Setup, Start};
use env_core::kessler::telemetry::Telemetry;
use env_core::log::Precision;
use env_core::task::StepReport;
use env_core::{ActionLog, Scenario, Stopped};

use super::super::hold::Hold;
use super::super::language::{Aim, Design, Encounter, Kind};
use super::super::place::ROGUE_LEAD;
use crate::picture::Subject;

/// Steps that decoys and screens are followed past their encounter.
const AFTER: u32 = 3;

/// A layout, flown.
pub(super) struct Scene {
    /// The design; without one, what can be told of it by flying it.
    pub(super) design: Option<Design>,
    pub(super) hold: Hold,
    /// The step at whose end a satellite that holds is hit or has fallen; none for one that lives.
    pub(super) lost: [Option<u32>; SATELLITES],
    /// Where the witness takes each satellite, from the start on.
    pub(super) witness: [Vec<Body>; SATELLITES],
    pub(super) burns: Vec<Burn>,
    pub(super) passes: Vec<Pass>,
    /// Debris of no encounter at the start.
    pub(super) background: Vec<Body>,
    /// The radius the task asks for, LU; 0 for none.
    pub(super) target_radius: f64,
}

/// A burn of the witness.
pub(super) struct Burn {
    pub(super) at: Body,
    /// Change of velocity, LU/TU.
    pub(super) by: (f64, f64),
}

/// Debris on its way to an encounter.
pub(super) struct Pass {
    pub(super) encounter: Encounter,
    /// The step after which its path begins.
    pub(super) from: u32,
    /// Where it is after that step and each one more; past its encounter only if it misses.
    pub(super) path: Vec<Body>,
    /// The step after which its bearing is taken.
    pub(super) seen: u32,
}

impl Pass {
    /// Where it is after a step of its path.
    pub(super) fn at(&self, step: u32) -> Option<&Body> {
        self.path.get(step.checked_sub(self.from)? as usize)
    }

    /// The steps of its path.
    pub(super) fn steps(&self) -> impl Iterator<Item = (u32, &Body)> {
        (self.from..).zip(&self.path)
    }
}

impl Scene {
    /// Flies a layout; none where it cannot start.
    pub(super) fn of(subject: Subject<'_>) -> Option<Self> {
        let scenario = subject.scenario;
        let setup = Setup::read(scenario.recipe()).ok()?;
        let start = setup.start(&mut Seeded::new(scenario.seed())).ok()?;
        let gravity = setup.physics.gravity;
        let hold = Hold::of(&start.satellites, gravity, setup.radar_range);
        let design = subject.design.and_then(|design| Design::from_json(design).ok());
        let (met, background) = match &design {
            Some(design) => designed(design, scenario, &start),
            None => found(scenario, &start, &hold, gravity),
        };
        let passes: Vec<Pass> = met
            .into_iter()
            .map(|(encounter, from, body)| pass(encounter, from, body, &hold, gravity))
            .collect();
        let lost = std::array::from_fn(|satellite| lost(satellite, &passes, &hold));
        let (witness, burns, target_radius) = flown(scenario, &subject.bracket.witness)?;
        Some(Self { design, hold, lost, witness, burns, passes, background, target_radius })
    }

    /// The encounter at which the aim is shown: the first in time that is of its kind, or else the first.
    pub(super) fn aimed(&self) -> Option<(&Aim, &Pass)> {
        let design = self.design.as_ref()?;
        let kind = super::super::claim::AIMS.iter().find(|row| row.0 == design.aim.mode).map(|row| row.1);
        let first = |kind: Option<Kind>| {
            let counts =
                self.passes.iter().filter(|pass| kind.is_none_or(|kind| pass.encounter.kind == kind));
            counts.min_by_key(|pass| pass.encounter.step)
        };
        Some((&design.aim, first(kind).or_else(|| first(None))?))
    }
}

/// An encounter, the step after which its debris' path begins, and where it is then.
type Met = (Encounter, u32, Body);

/// Whose body is whose in a layout that the compiler has made: encounters come first, in order.
fn designed(design: &Design, scenario: &Scenario, start: &Start) -> (Vec<Met>, Vec<Body>) {
    let mut debris = start.debris.iter();
    // A start has them in order of arrival, the layout as they were thought of.
    let rows = scenario.recipe().layout().and_then(|layout| layout.bodies.get("rogues"));
    let mut rogues = rows.into_iter().flatten().filter_map(|row| <[f64; 5]>::try_from(row.as_slice()).ok());
    let met = design.encounters.iter().filter_map(|encounter| {
        if encounter.rogue {
            // The step in which it appears comes first; it is where it is given before that step's motion.
            let [step, x, y, vx, vy] = rogues.next()?;
            Some((*encounter, whole(step).saturating_sub(1), Body { x, y, vx, vy }))
        } else {
            debris.next().map(|body| (*encounter, 0, *body))
        }
    });
    let met = met.collect();
    (met, debris.copied().collect())
}

/// What hits satellites that hold, as the critique tells it: for a layout without a design.
fn found(scenario: &Scenario, start: &Start, hold: &Hold, gravity: Gravity) -> (Vec<Met>, Vec<Body>) {
    let mut log = ActionLog::new(2, Precision::F64);
    log.stopped = Some(Stopped::TooLate); // the rest is flown as hold
    let failures =
        scenario.task().critique(scenario, &log).map(|critique| critique.failures).unwrap_or_default();
    let mut met: Vec<(usize, Met)> = Vec::new();
    for failure in &failures {
        let Some(encounter) = &failure.encounter else { continue };
        let body = encounter.body as usize;
        // Rogues and fragments come later; theirs is no path from the start.
        let Some(at) = start.debris.get(body) else { continue };
        let there = (0..failure.step).fold(*at, |there, _| there.coasted(gravity));
        let of = hold.at(failure.agent as usize % SATELLITES, failure.step);
        let (dx, dy) = (of.x - there.x, of.y - there.y);
        let found = Encounter {
            satellite: failure.agent,
            step: failure.step,
            bearing_deg: whole(encounter.bearing_deg) % 360,
            relative_speed: whole(10.0 * encounter.relative_speed),
            miss_distance: whole(10.0 * (dx * dx + dy * dy).sqrt()),
            kind: Kind::Threat,
            rogue: false,
        };
        met.push((body, (found, 0, *at)));
    }
    let hits = |index: usize| met.iter().any(|(body, _)| *body == index);
    let others = start.debris.iter().enumerate().filter(|(index, _)| !hits(*index));
    let others = others.map(|(_, body)| *body).collect();
    (met.into_iter().map(|(_, met)| met).collect(), others)
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "degrees and tenths, never negative"
)]
fn whole(value: f64) -> u32 {
    libm::round(value) as u32
}

fn pass(encounter: Encounter, from: u32, mut body: Body, hold: &Hold, gravity: Gravity) -> Pass {
    let beyond = if encounter.kind == Kind::Threat { 0 } else { AFTER };
    let mut path = vec![body];
    for _ in from..(encounter.step + beyond).min(HORIZON) {
        if body.radius() < EARTH_RADIUS {
            break;
        }
        body = body.coasted(gravity);
        path.push(body);
    }
    let mut pass = Pass { encounter, from, path, seen: encounter.step };
    let first = from + u32::from(encounter.rogue);
    let earliest = encounter.step.saturating_sub(BEARING_STEPS).max(first);
    let visible = |step: &u32| pass.at(*step).is_some_and(|body| hold.sees(*step, body));
    pass.seen = (earliest..=encounter.step).find(visible).unwrap_or(encounter.step);
    pass
}

/// When a satellite that holds is lost: by what hits it first, or by the Earth.
fn lost(satellite: usize, passes: &[Pass], hold: &Hold) -> Option<u32> {
    let hits =
        |pass: &&Pass| pass.encounter.kind == Kind::Threat && pass.encounter.satellite as usize == satellite;
    let hit = passes.iter().filter(hits).map(|pass| pass.encounter.step).min();
    let fallen = (1..=HORIZON).find(|step| hold.at(satellite, *step).radius() < EARTH_RADIUS);
    hit.into_iter().chain(fallen).min()
}

/// Where the witness takes satellites, what it burns, and the radius it is after.
fn flown(scenario: &Scenario, witness: &ActionLog) -> Option<([Vec<Body>; SATELLITES], Vec<Burn>, f64)> {
    let mut episode = scenario.task().start(scenario).ok()?;
    let mut report = StepReport::default();
    let mut paths: [Vec<Body>; SATELLITES] = Default::default();
    let mut burns = Vec::new();
    let target_radius = episode.observation().downcast_ref::<Telemetry>()?.target_radius;
    loop {
        let seen = episode.observation().downcast_ref::<Telemetry>()?;
        for satellite in seen.satellites.iter().filter(|satellite| satellite.active()) {
            paths.get_mut(satellite.id as usize)?.push(satellite.body());
        }
        if episode.done() {
            return Some((paths, burns, target_radius));
        }
        let action = witness.step(episode.steps() as usize);
        for (agent, by) in action.agents.iter().zip(action.values.chunks_exact(2)) {
            let at = seen.satellites.iter().find(|s| s.id == *agent && s.active());
            burns.extend(at.map(|s| Burn { at: s.body(), by: (by[0], by[1]) }));
        }
        episode.step(action, &mut report).ok()?;
    }
}

/// How near a pass comes to its satellite within this is a contact, LU.
pub(super) const CONTACT: f64 = CONTACT_DISTANCE;
const _: () = assert!(ROGUE_LEAD > BEARING_STEPS, "a rogue is there when its bearing is taken");
