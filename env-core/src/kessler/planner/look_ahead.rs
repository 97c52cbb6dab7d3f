//! Look-ahead against a debris ephemeris: detects contacts to come and finds the gentlest burn that avoids
//! them.

use super::ephemeris::DebrisEphemeris;
use super::panel::affordable_size;
use crate::kessler::constants::CONTACT_2;
use crate::kessler::kernel::Body;

/// Sizes of the avoidance burns tried, LU/TU, gentlest first.
const DODGE_SIZES: [f64; 6] = [0.05, 0.1, 0.2, 0.4, 0.7, 1.0];
/// Number of directions of the avoidance burns tried.
const DODGE_DIRECTIONS: u32 = 16;

/// Settings of a look-ahead.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::kessler) struct LookAhead {
    /// Steps that are checked for a contact.
    pub steps: u32,
    /// A burn is considered only for a contact within this many steps. Later burns keep fuel and know more
    /// debris.
    pub act_within: u32,
    /// Factor of the squared contact distance that a burn must clear.
    pub margin: f64,
}

impl LookAhead {
    /// Settings of the causal policies.
    pub(in crate::kessler) const DEFAULT: Self = Self { steps: 12, act_within: 8, margin: 1.2 };

    /// Returns `planned` unless it leads to a contact. Otherwise returns the gentlest burn that avoids all
    /// contacts, or the one that delays the first contact most. `row` is the row of the ephemeris at which
    /// the satellite is.
    pub(in crate::kessler) fn dodge(
        &self,
        body: Body,
        fuel: f64,
        planned: Option<(f64, f64)>,
        ephemeris: &DebrisEphemeris,
        row: usize,
    ) -> Option<(f64, f64)> {
        let contact = self.first_contact(
            after_burn(body, planned.unwrap_or_default().into()),
            ephemeris,
            row,
            CONTACT_2,
        );
        if contact.is_none_or(|step| step > self.act_within) {
            return planned;
        }
        let (mut best_contact, mut best_burn) = (contact, planned);
        for size in DODGE_SIZES {
            let size = affordable_size(size, fuel);
            for direction in 0..DODGE_DIRECTIONS {
                let angle = std::f64::consts::TAU * f64::from(direction) / f64::from(DODGE_DIRECTIONS);
                let (sin, cos) = libm::sincos(angle);
                let dv = (size * cos, size * sin);
                let limit_2 = CONTACT_2 * self.margin;
                match self.first_contact(after_burn(body, dv.into()), ephemeris, row, limit_2) {
                    None => return Some(dv),
                    later if later > best_contact => (best_contact, best_burn) = (later, Some(dv)),
                    _ => {}
                }
            }
        }
        best_burn
    }

    /// First step from now, counted from 1, at which debris is closer to the coasting `body` than the square root of
    /// `limit_2`.
    fn first_contact(
        &self,
        mut body: Body,
        ephemeris: &DebrisEphemeris,
        row: usize,
        limit_2: f64,
    ) -> Option<u32> {
        let rows = u32::try_from(ephemeris.rows().saturating_sub(row + 1)).unwrap_or(u32::MAX);
        (1..=self.steps.min(rows)).find(|&step| {
            body = body.coast(ephemeris.physics.gravity);
            ephemeris.any_within(row + step as usize, body.x, body.y, limit_2)
        })
    }
}

/// Returns the body after a burn that changes its velocity by (`dvx`, `dvy`).
fn after_burn(body: Body, [dvx, dvy]: [f64; 2]) -> Body {
    Body { vx: body.vx + dvx, vy: body.vy + dvy, ..body }
}
