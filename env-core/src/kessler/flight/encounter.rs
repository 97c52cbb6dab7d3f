//! What happens where debris and satellites meet.

use super::Flight;
use crate::chance::{Chance, Stream};
use crate::kessler::constants::{CONTACT_DISTANCE, FRAGMENTS, SATELLITES, SIGMAS};
use crate::kessler::event::Event;
use crate::kessler::flight::Status;
use crate::kessler::kernel::{Body, collision_probability, passing_2};
use crate::kessler::setup::Contact;

impl<C: Chance> Flight<C> {
    #[cold]
    pub(super) fn contacts(&mut self) {
        let swept = self.setup.physics.contact == Contact::Swept;
        let moved = self.debris.len();
        for i in 0..SATELLITES {
            let s = self.satellites[i];
            if !s.active() {
                continue;
            }
            let Some(hit) = self.debris.touching(&s.body, swept, moved) else { continue };
            self.satellites[i].lose();
            self.events.push(Event::Collision { satellite: i as u32, debris: self.debris.id(hit) });
            for _ in 0..FRAGMENTS {
                let fragment = fragment(s.body, &mut self.chance);
                self.debris.push(fragment);
            }
        }
    }

    /// Under `risk: pc`: every closest approach in this step costs survival.
    pub(super) fn passings(&mut self, sigma: f64) {
        let most = CONTACT_DISTANCE + SIGMAS * sigma;
        for i in 0..self.debris.len() {
            let d = self.debris.body(i);
            let mut approaching = 0;
            for (number, s) in
                self.satellites.iter_mut().enumerate().filter(|(_, s)| s.status == Status::Active)
            {
                let (dx, dy) = (s.body.x - d.x, s.body.y - d.y);
                let (wx, wy) = (s.body.vx - d.vx, s.body.vy - d.vy);
                let before = self.debris.approaching[i] & (1 << number) != 0;
                approaching |= u8::from(dx * wx + dy * wy < 0.0) << number;
                let Some(miss_2) = passing_2(dx, dy, wx, wy, before).filter(|&m| m < most * most) else {
                    continue;
                };
                let miss = miss_2.sqrt();
                let probability = collision_probability(miss, sigma);
                s.survival *= 1.0 - probability;
                let (satellite, debris) = (number as u32, self.debris.id(i));
                self.events.push(Event::Passed { satellite, debris, miss, probability });
            }
            self.debris.approaching[i] = approaching;
        }
    }
}

/// A fragment appears at the satellite, with its velocity plus a kick U(−1, 1)².
pub(crate) fn fragment(of: Body, chance: &mut impl Chance) -> Body {
    let mut kick = || chance.between(Stream::Fragments, -1.0, 1.0);
    let (kx, ky) = (kick(), kick());
    Body { vx: of.vx + kx, vy: of.vy + ky, ..of }
}
