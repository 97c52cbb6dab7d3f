//! Encounters of debris and satellites: contacts that destroy, and close approaches that cost survival.

use super::KesslerSim;
use crate::episode_rng::{EpisodeRng, RngStream};
use crate::kessler::constants::{CONTACT_DISTANCE, FRAGMENTS, SATELLITES, SIGMAS};
use crate::kessler::event::KesslerEvent;
use crate::kessler::kernel::{Body, closest_approach_squared, collision_probability};
use crate::kessler::setup::ContactModel;
use crate::kessler::simulation::SatelliteStatus;

impl<R: EpisodeRng> KesslerSim<R> {
    /// Destroys each satellite that debris touches; two fragments appear for each.
    #[cold]
    pub(super) fn resolve_contacts(&mut self) {
        let swept = self.setup.physics.contact == ContactModel::Swept;
        let moved = self.debris.len();
        for i in 0..SATELLITES {
            let s = self.satellites[i];
            if !s.is_active() {
                continue;
            }
            let Some(hit) = self.debris.first_contact(&s.body, swept, moved) else { continue };
            self.satellites[i].lose();
            self.events.push(KesslerEvent::Collision { satellite: i as u32, debris: self.debris.id(hit) });
            for _ in 0..FRAGMENTS {
                let fragment = draw_fragment(s.body, &mut self.rng);
                self.debris.push(fragment);
            }
        }
    }

    /// Multiplies the survival of each satellite by 1 − Pc for every closest approach in this step
    /// (`risk: pc`).
    pub(super) fn apply_close_approaches(&mut self, sigma: f64) {
        let max_miss = CONTACT_DISTANCE + SIGMAS * sigma;
        for i in 0..self.debris.len() {
            let d = self.debris.body(i);
            let mut approaching = 0;
            for (number, s) in
                self.satellites.iter_mut().enumerate().filter(|(_, s)| s.status == SatelliteStatus::Active)
            {
                let (dx, dy) = (s.body.x - d.x, s.body.y - d.y);
                let (wx, wy) = (s.body.vx - d.vx, s.body.vy - d.vy);
                let before = self.debris.approaching[i] & (1 << number) != 0;
                approaching |= u8::from(dx * wx + dy * wy < 0.0) << number;
                let Some(miss_2) =
                    closest_approach_squared(dx, dy, wx, wy, before).filter(|&m| m < max_miss * max_miss)
                else {
                    continue;
                };
                let miss = miss_2.sqrt();
                let probability = collision_probability(miss, sigma);
                s.survival *= 1.0 - probability;
                let (satellite, debris) = (number as u32, self.debris.id(i));
                self.events.push(KesslerEvent::CloseApproach { satellite, debris, miss, probability });
            }
            self.debris.approaching[i] = approaching;
        }
    }
}

/// Draws a fragment: it appears at the satellite with its velocity plus a kick U(−1, 1)², LU/TU.
pub(crate) fn draw_fragment(satellite: Body, rng: &mut impl EpisodeRng) -> Body {
    let mut kick = || rng.uniform_in(RngStream::Fragments, -1.0, 1.0);
    let (kx, ky) = (kick(), kick());
    Body { vx: satellite.vx + kx, vy: satellite.vy + ky, ..satellite }
}
