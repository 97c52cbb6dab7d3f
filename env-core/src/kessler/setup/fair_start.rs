//! Fairness of a start: contacts in the first steps, before any agent could act.

use super::{ContactModel, Physics};
use crate::kessler::body_blocks::BodyBlocks;
use crate::kessler::constants::{CONTACT_2, FAIR_STEPS, SATELLITES};
use crate::kessler::kernel::{Body, distance_squared, min_distance_squared};
use crate::kessler::propagate;

/// States of the satellites under hold at steps 0 to [`FAIR_STEPS`].
pub(super) struct EarlyPaths {
    paths: [[Body; SATELLITES]; FAIR_STEPS as usize + 1],
    physics: Physics,
}

/// Contact of a body with a satellite in the first steps.
#[derive(Debug, Clone, Copy)]
pub(super) struct EarlyContact {
    /// Number of the satellite.
    pub satellite: usize,
    /// Step after which they touch; 0 is the start.
    pub step: usize,
}

impl EarlyPaths {
    /// Propagates the satellites through the first steps.
    pub(super) fn new(satellites: &[Body; SATELLITES], physics: Physics) -> Self {
        let mut paths = [*satellites; FAIR_STEPS as usize + 1];
        for step in 1..paths.len() {
            paths[step] = paths[step - 1].map(|body| body.coast(physics.gravity));
        }
        Self { paths, physics }
    }

    /// Returns a bit set of the blocks in which some body touches a satellite; all bits if there are more
    /// blocks than bits.
    pub(super) fn blocks_in_contact(&self, debris: &BodyBlocks) -> u128 {
        if debris.blocks().len() > u128::BITS as usize {
            return u128::MAX;
        }
        let swept = self.physics.contact == ContactModel::Swept;
        propagate::blocks_in_contact(self.physics.gravity, swept, debris.blocks(), &self.paths)
    }

    /// Returns the first contact of this body, if any. A body with an arrival step is placed before the
    /// motion of that step, so it counts only from the end of that motion on.
    pub(super) fn first_contact(&self, mut body: Body, arrival: Option<u32>) -> Option<EarlyContact> {
        let swept = self.physics.contact == ContactModel::Swept;
        let first_step = arrival.map_or(0, |step| step as usize - 1);
        for (step, satellites) in self.paths.iter().enumerate().skip(first_step) {
            if step > first_step {
                body = body.coast(self.physics.gravity);
            }
            let touches = |s: &Body| {
                let counts = arrival.is_none() || step > first_step;
                let at_end = counts && distance_squared(s.x, s.y, body.x, body.y) < CONTACT_2;
                let within_step = || {
                    let (dx, dy) = (s.x - body.x, s.y - body.y);
                    min_distance_squared(dx, dy, s.vx - body.vx, s.vy - body.vy) < CONTACT_2
                };
                at_end || (swept && step > first_step && within_step())
            };
            if let Some(satellite) = satellites.iter().position(touches) {
                return Some(EarlyContact { satellite, step });
            }
        }
        None
    }
}
