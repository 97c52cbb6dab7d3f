//! [`CoastPaths`]: paths of the satellites of a scenario if all of them hold.

use env_core::Scenario;
use env_core::episode_rng::SeededRng;
use env_core::kessler::constants::{EARTH_RADIUS, HORIZON, SATELLITES};
use env_core::kessler::kernel::{Body, Gravity};
use env_core::kessler::min_distances;
use env_core::kessler::setup::{ContactModel, InitialState, KesslerSetup};

/// Paths of coasting satellites, with the physics that decides what they meet.
#[derive(Debug, Clone)]
pub(super) struct CoastPaths {
    /// Satellites at the start and after each step. One that falls into the Earth stays where it fell.
    states: Vec<[Body; SATELLITES]>,
    gravity: Gravity,
    /// Radar range in LU; `None` is unlimited.
    radar_range: Option<f64>,
    /// True if contacts within a step count, and not only those at its end.
    is_swept: bool,
}

impl CoastPaths {
    /// Returns the paths of a scenario; `None` if its recipe or start is invalid.
    pub(super) fn of_scenario(scenario: &Scenario) -> Option<Self> {
        let setup = KesslerSetup::from_recipe(scenario.recipe()).ok()?;
        let start = setup.draw_initial_state(&mut SeededRng::new(scenario.seed())).ok()?;
        Some(Self::new(&setup, &start))
    }

    pub(super) fn new(setup: &KesslerSetup, start: &InitialState) -> Self {
        let gravity = setup.physics.gravity;
        let mut states = Vec::with_capacity(HORIZON as usize + 1);
        let mut current = start.satellites;
        states.push(current);
        for _ in 0..HORIZON {
            current =
                current.map(|body| if body.radius() >= EARTH_RADIUS { body.coast(gravity) } else { body });
            states.push(current);
        }
        let is_swept = setup.physics.contact == ContactModel::Swept;
        Self { states, gravity, radar_range: setup.radar_range, is_swept }
    }

    pub(super) const fn gravity(&self) -> Gravity {
        self.gravity
    }

    pub(super) const fn is_swept(&self) -> bool {
        self.is_swept
    }

    /// Satellites at the start.
    pub(super) fn start(&self) -> &[Body; SATELLITES] {
        &self.states[0]
    }

    /// A satellite after a step.
    pub(super) fn satellite(&self, satellite: usize, step: u32) -> &Body {
        &self.states[step as usize][satellite]
    }

    /// Returns true if the radar of any satellite shows a body after a step.
    pub(super) fn is_visible(&self, step: u32, body: &Body) -> bool {
        self.radar_range.is_none_or(|range| {
            self.states[step as usize].iter().any(|satellite| {
                let (dx, dy) = (satellite.x - body.x, satellite.y - body.y);
                dx * dx + dy * dy <= range * range
            })
        })
    }

    /// Returns, for each body that exists after step `from`, its least distance to any satellite from then on, in LU.
    pub(super) fn min_distances(&self, from: u32, bodies: &[Body]) -> Vec<f64> {
        min_distances(bodies, &self.states[from as usize..], self.gravity, self.is_swept)
    }
}
