//! [`Scene`]: the contents of a layout's picture, computed by running it with holding satellites and with the reference plan.

use env_core::critique::BEARING_STEPS;
use env_core::episode_rng::SeededRng;
use env_core::kessler::constants::{EARTH_RADIUS, HORIZON, SATELLITES};
use env_core::kessler::kernel::Body;
use env_core::kessler::setup::{InitialState, KesslerSetup};
use env_core::kessler::telemetry::KesslerTelemetry;
use env_core::log::Precision;
use env_core::task::StepReport;
use env_core::{ActionLog, Scenario, StopReason};

use crate::angles::whole_degrees;
use crate::design_language::LayoutView;
use crate::kessler::aim::AIMS;
use crate::kessler::coast::CoastPaths;
use crate::kessler::design::{Aim, Design, Encounter};
use crate::kessler::vocabulary::EncounterKind;

/// Number of steps that the path of a decoy or screen continues after its encounter.
const STEPS_AFTER_ENCOUNTER: u32 = 3;

/// Layout that was run.
pub(super) struct Scene {
    /// Design of the layout; `None` if it was made by hand.
    pub(super) design: Option<Design>,
    /// Paths of the satellites if they hold.
    pub(super) coast: CoastPaths,
    /// Step at whose end each satellite is lost if it holds; `None` if it is not.
    pub(super) lost: [Option<u32>; SATELLITES],
    /// Run of the reference plan.
    pub(super) reference: ReferenceRun,
    /// Debris of each encounter.
    pub(super) passes: Vec<Pass>,
    /// Other debris at the start.
    pub(super) background: Vec<Body>,
}

/// Run of the reference plan.
#[derive(Default)]
pub(super) struct ReferenceRun {
    /// Path of each satellite from the start.
    pub(super) paths: [Vec<Body>; SATELLITES],
    pub(super) burns: Vec<Burn>,
    /// Target radius of the task, in LU; 0 if it has none.
    pub(super) target_radius: f64,
}

/// Burn of the reference plan.
pub(super) struct Burn {
    /// Satellite before the burn.
    pub(super) satellite: Body,
    /// Change of velocity, in LU/TU.
    pub(super) delta_v: (f64, f64),
}

/// Path of the debris of an encounter.
pub(super) struct Pass {
    pub(super) encounter: Encounter,
    /// Step after which the path begins.
    pub(super) first_step: u32,
    /// State after that step and after each following one.
    pub(super) path: Vec<Body>,
    /// Step after which the bearing is measured.
    pub(super) bearing_step: u32,
}

/// Encounter, with the debris where its path begins.
struct Approach {
    encounter: Encounter,
    /// Step after which the path begins.
    first_step: u32,
    body: Body,
}

/// Encounters of a layout, and all other debris at its start.
struct Approaches {
    approaches: Vec<Approach>,
    background: Vec<Body>,
}

impl Pass {
    fn new(approach: &Approach, coast: &CoastPaths) -> Self {
        let Approach { encounter, first_step, mut body } = *approach;
        let beyond = if encounter.kind == EncounterKind::Threat { 0 } else { STEPS_AFTER_ENCOUNTER };
        let mut path = vec![body];
        for _ in first_step..(encounter.step + beyond).min(HORIZON) {
            if body.radius() < EARTH_RADIUS {
                break;
            }
            body = body.coast(coast.gravity());
            path.push(body);
        }
        let mut pass = Self { encounter, first_step, path, bearing_step: encounter.step };
        let exists_from = first_step + u32::from(encounter.is_rogue);
        let earliest = encounter.step.saturating_sub(BEARING_STEPS).max(exists_from);
        let is_visible = |step: &u32| pass.at(*step).is_some_and(|body| coast.is_visible(*step, body));
        pass.bearing_step = (earliest..=encounter.step).find(is_visible).unwrap_or(encounter.step);
        pass
    }

    /// Returns the state after a step; `None` outside the path.
    pub(super) fn at(&self, step: u32) -> Option<&Body> {
        self.path.get(step.checked_sub(self.first_step)? as usize)
    }

    /// Iterates over the steps of the path and the states after them.
    pub(super) fn steps(&self) -> impl Iterator<Item = (u32, &Body)> {
        (self.first_step..).zip(&self.path)
    }

    /// Index of the satellite of the encounter.
    pub(super) const fn satellite(&self) -> usize {
        self.encounter.satellite as usize
    }
}

impl Scene {
    /// Runs a layout; `None` if its episode cannot start.
    pub(super) fn new(layout: LayoutView<'_>) -> Option<Self> {
        let scenario = layout.scenario;
        let setup = KesslerSetup::from_recipe(scenario.recipe()).ok()?;
        let start = setup.draw_initial_state(&mut SeededRng::new(scenario.seed())).ok()?;
        let coast = CoastPaths::new(&setup, &start);
        let design = layout.design.and_then(|design| Design::from_json(design).ok());
        let Approaches { approaches, background } = match &design {
            Some(design) => approaches_of_design(design, scenario, &start),
            None => approaches_of_hits(scenario, &start, &coast),
        };
        let passes: Vec<Pass> = approaches.iter().map(|approach| Pass::new(approach, &coast)).collect();
        let lost = std::array::from_fn(|satellite| step_of_loss(satellite, &passes, &coast));
        let reference = run_plan(scenario, &layout.bracket.reference_plan)?;
        Some(Self { design, coast, lost, reference, passes, background })
    }

    /// Returns the aim and the encounter at which it is drawn: the first in time that counts for the aim, or else the first.
    pub(super) fn aimed_pass(&self) -> Option<(&Aim, &Pass)> {
        let design = self.design.as_ref()?;
        let kind = AIMS.iter().find(|spec| spec.mode == design.aim.mode).map(|spec| spec.kind);
        let first = |kind: Option<EncounterKind>| {
            let of_kind =
                self.passes.iter().filter(|pass| kind.is_none_or(|kind| pass.encounter.kind == kind));
            of_kind.min_by_key(|pass| pass.encounter.step)
        };
        Some((&design.aim, first(kind).or_else(|| first(None))?))
    }
}

/// Assigns the bodies of a compiled layout to the encounters of its design: they come first, in order.
fn approaches_of_design(design: &Design, scenario: &Scenario, start: &InitialState) -> Approaches {
    let mut debris = start.debris.iter();
    // The initial state sorts rogues by arrival; the layout has them in the order of the encounters.
    let rows = scenario.recipe().layout().and_then(|layout| layout.bodies.get("rogues"));
    let mut rogues = rows.into_iter().flatten().filter_map(|row| <[f64; 5]>::try_from(row.as_slice()).ok());
    let approach = |encounter: &Encounter| {
        let encounter = *encounter;
        if encounter.is_rogue {
            // The row has the step in which the rogue appears, and its state before the motion of that step.
            let [step, x, y, vx, vy] = rogues.next()?;
            let first_step = round_to_u32(step).saturating_sub(1);
            Some(Approach { encounter, first_step, body: Body { x, y, vx, vy } })
        } else {
            debris.next().map(|body| Approach { encounter, first_step: 0, body: *body })
        }
    };
    let approaches = design.encounters.iter().filter_map(approach).collect();
    Approaches { approaches, background: debris.copied().collect() }
}

/// Finds the debris that hits holding satellites by the critique, for a layout without a design.
fn approaches_of_hits(scenario: &Scenario, start: &InitialState, coast: &CoastPaths) -> Approaches {
    let mut hold = ActionLog::new(2, Precision::F64);
    hold.stopped = Some(StopReason::TooLate); // the remaining steps hold
    let failures =
        scenario.task().critique(scenario, &hold).map(|critique| critique.failures).unwrap_or_default();
    let mut approaches: Vec<Approach> = Vec::new();
    let mut hit_by: Vec<usize> = Vec::new();
    for failure in &failures {
        let Some(met) = &failure.encounter else { continue };
        let index = met.body as usize;
        // Rogues and fragments do not exist at the start.
        let Some(body) = start.debris.get(index) else { continue };
        let at_hit = (0..failure.step).fold(*body, |state, _| state.coast(coast.gravity()));
        let satellite = coast.satellite(failure.agent as usize % SATELLITES, failure.step);
        let (dx, dy) = (satellite.x - at_hit.x, satellite.y - at_hit.y);
        let encounter = Encounter {
            satellite: failure.agent,
            step: failure.step,
            bearing_deg: whole_degrees(met.bearing_deg).into(),
            relative_speed: round_to_u32(10.0 * met.relative_speed),
            miss_distance: round_to_u32(10.0 * (dx * dx + dy * dy).sqrt()),
            kind: EncounterKind::Threat,
            is_rogue: false,
        };
        hit_by.push(index);
        approaches.push(Approach { encounter, first_step: 0, body: *body });
    }
    let others = start.debris.iter().enumerate().filter(|(index, _)| !hit_by.contains(index));
    let background = others.map(|(_, body)| *body).collect();
    Approaches { approaches, background }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "steps, degrees and tenths, never negative"
)]
fn round_to_u32(value: f64) -> u32 {
    libm::round(value) as u32
}

/// Returns the step at whose end a holding satellite is first hit or falls into the Earth.
fn step_of_loss(satellite: usize, passes: &[Pass], coast: &CoastPaths) -> Option<u32> {
    let hits = |pass: &&Pass| pass.encounter.kind == EncounterKind::Threat && pass.satellite() == satellite;
    let hit = passes.iter().filter(hits).map(|pass| pass.encounter.step).min();
    let fallen = (1..=HORIZON).find(|step| coast.satellite(satellite, *step).radius() < EARTH_RADIUS);
    hit.into_iter().chain(fallen).min()
}

/// Runs a plan and records the satellites and the burns.
fn run_plan(scenario: &Scenario, plan: &ActionLog) -> Option<ReferenceRun> {
    let mut episode = scenario.task().start(scenario).ok()?;
    let mut report = StepReport::default();
    let target_radius = episode.observation().downcast_ref::<KesslerTelemetry>()?.target_radius;
    let mut run = ReferenceRun { target_radius, ..ReferenceRun::default() };
    loop {
        let telemetry = episode.observation().downcast_ref::<KesslerTelemetry>()?;
        for satellite in telemetry.satellites.iter().filter(|satellite| satellite.is_active()) {
            run.paths.get_mut(satellite.id as usize)?.push(satellite.body());
        }
        if episode.done() {
            return Some(run);
        }
        let action = plan.step(episode.steps() as usize);
        for (agent, delta_v) in action.agents.iter().zip(action.values.chunks_exact(2)) {
            let satellite = telemetry.satellites.iter().find(|s| s.id == *agent && s.is_active());
            run.burns
                .extend(satellite.map(|s| Burn { satellite: s.body(), delta_v: (delta_v[0], delta_v[1]) }));
        }
        episode.step(action, &mut report).ok()?;
    }
}
