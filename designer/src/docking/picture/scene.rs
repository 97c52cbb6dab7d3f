//! [`DockingScene`]: the contents of a layout's picture, computed by running it without thrust and with the reference plan.

use env_core::docking::constants::{DOCKING_RADIUS_M, MAX_DISTANCE_M};
use env_core::docking::end_conditions::DeputyStatus;
use env_core::docking::relative_motion::{RelativeState, StepTransition, distance};
use env_core::docking::setup::DockingSetup;
use env_core::docking::telemetry::DockingTelemetry;
use env_core::episode_rng::SeededRng;
use env_core::task::StepReport;
use env_core::{ActionLog, Scenario};

use crate::design_language::LayoutView;
use crate::docking::aim::{AimedDeputies, MatchingDeputy};
use crate::docking::design::DockingDesign;

/// Largest number of points of a track.
const MAX_POINTS: usize = 110;

/// Layout that was run.
pub(super) struct DockingScene {
    /// Design of the layout; `None` if it was made by hand.
    pub(super) design: Option<DockingDesign>,
    /// Deputies that match the aim of the design.
    pub(super) aimed: Vec<MatchingDeputy>,
    /// Deputies in the order of the layout.
    pub(super) deputies: Vec<DeputyTracks>,
    pub(super) setup: DockingSetup,
}

/// Start and tracks of a deputy.
pub(super) struct DeputyTracks {
    pub(super) start: RelativeState,
    /// States without thrust, up to the docking radius, the bounds or the time limit.
    pub(super) coast: Vec<RelativeState>,
    /// States under the reference plan.
    pub(super) reference: Vec<RelativeState>,
    /// Status at the end of the reference plan.
    pub(super) status: DeputyStatus,
    /// Step in which the deputy leaves the episode under the reference plan.
    pub(super) end_step: u32,
}

impl DockingScene {
    /// Runs a layout; `None` if its episode cannot start.
    pub(super) fn new(layout: LayoutView<'_>) -> Option<Self> {
        let scenario = layout.scenario;
        let setup = DockingSetup::read(scenario.recipe()).ok()?;
        let start = setup.sample_starts(&mut SeededRng::new(scenario.seed())).ok()?;
        let states = &start.states[..start.deputies];
        let mut deputies: Vec<DeputyTracks> =
            states.iter().map(|state| DeputyTracks::coasting(state, start.time_limit)).collect();
        run_plan(scenario, &layout.bracket.reference_plan, &mut deputies)?;
        for deputy in &mut deputies {
            thin_out(&mut deputy.coast);
            thin_out(&mut deputy.reference);
        }
        let design = layout.design.and_then(|design| DockingDesign::from_json(design).ok());
        let aimed = design.as_ref().map_or_else(Vec::new, |design| {
            AimedDeputies::new(&design.deputies, &setup).matching(&design.aim.mode)
        });
        Some(Self { design, aimed, deputies, setup })
    }

    /// Returns true if a deputy matches the aim.
    pub(super) fn is_aimed(&self, index: usize) -> bool {
        self.aimed.iter().any(|deputy| deputy.index == index)
    }

    /// Returns the largest distance of a start or of the reference plan from the chief, m.
    pub(super) fn farthest(&self) -> f64 {
        let states = self.deputies.iter().flat_map(|deputy| deputy.reference.iter().chain([&deputy.start]));
        states.map(distance).fold(4.0 * DOCKING_RADIUS_M, f64::max)
    }
}

impl DeputyTracks {
    fn coasting(start: &RelativeState, time_limit: u32) -> Self {
        let mut coast = vec![*start];
        let mut state = *start;
        for _ in 0..time_limit {
            state = StepTransition::world_step().advance(&state, [0.0; 3]);
            coast.push(state);
            if !(DOCKING_RADIUS_M..=MAX_DISTANCE_M).contains(&distance(&state)) {
                break;
            }
        }
        let (reference, status) = (Vec::new(), DeputyStatus::Active);
        Self { start: *start, coast, reference, status, end_step: 0 }
    }
}

/// Runs a plan and records the states of all deputies.
fn run_plan(scenario: &Scenario, plan: &ActionLog, deputies: &mut [DeputyTracks]) -> Option<()> {
    let mut episode = scenario.task().start(scenario).ok()?;
    let mut report = StepReport::default();
    loop {
        let telemetry = episode.observation().downcast_ref::<DockingTelemetry>()?;
        for (deputy, seen) in deputies.iter_mut().zip(&telemetry.deputies) {
            if deputy.status == DeputyStatus::Active {
                deputy.reference.push([seen.x, seen.y, seen.z, seen.vx, seen.vy, seen.vz]);
                deputy.status = seen.status;
                deputy.end_step = episode.steps();
            }
        }
        if episode.done() {
            return Some(());
        }
        episode.step(plan.step(episode.steps() as usize), &mut report).ok()?;
    }
}

/// Keeps at most about [`MAX_POINTS`] states at equal intervals, with the first and the last one.
fn thin_out(states: &mut Vec<RelativeState>) {
    let every = states.len().div_ceil(MAX_POINTS).max(1);
    let last = states.last().copied();
    *states = states.iter().step_by(every).copied().collect();
    if states.last() != last.as_ref() {
        states.extend(last);
    }
}
