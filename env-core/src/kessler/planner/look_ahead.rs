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
/// Number of directions that are propagated side by side.
const DIRECTION_GROUP: usize = 4;

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

    /// Returns `planned` unless it leads to a contact, else the burn of [`avoid`](Self::avoid). `row` is the row of the
    /// ephemeris at which the satellite is.
    pub(in crate::kessler) fn dodge(
        &self,
        body: Body,
        fuel: f64,
        planned: Option<(f64, f64)>,
        ephemeris: &DebrisEphemeris,
        row: usize,
    ) -> Option<(f64, f64)> {
        let [contact] = self.contacts_of_plans([body], [planned], ephemeris, row);
        contact.map_or(planned, |contact| self.avoid(contact, body, fuel, planned, ephemeris, row))
    }

    /// First contact to act on of each satellite after its planned burn, as steps from now, counted from 1.
    pub(in crate::kessler) fn contacts_of_plans<const N: usize>(
        &self,
        bodies: [Body; N],
        planned: [Option<(f64, f64)>; N],
        ephemeris: &DebrisEphemeris,
        row: usize,
    ) -> [Option<u32>; N] {
        let bodies = std::array::from_fn(|i| after_burn(bodies[i], planned[i].unwrap_or_default().into()));
        first_contacts(bodies, ephemeris, row, self.steps.min(self.act_within), CONTACT_2)
    }

    /// Returns the gentlest burn that avoids all contacts, or the one that delays the first contact most. `planned`
    /// leads to a contact in step `contact` from now.
    pub(in crate::kessler) fn avoid(
        &self,
        contact: u32,
        body: Body,
        fuel: f64,
        planned: Option<(f64, f64)>,
        ephemeris: &DebrisEphemeris,
        row: usize,
    ) -> Option<(f64, f64)> {
        let (mut best_contact, mut best_burn) = (contact, planned);
        let limit_2 = CONTACT_2 * self.margin;
        for size in DODGE_SIZES {
            let size = affordable_size(size, fuel);
            for first in (0..DODGE_DIRECTIONS).step_by(DIRECTION_GROUP) {
                let burns: [(f64, f64); DIRECTION_GROUP] = std::array::from_fn(|i| {
                    let direction = f64::from(first) + i as f64;
                    let angle = std::f64::consts::TAU * direction / f64::from(DODGE_DIRECTIONS);
                    let (sin, cos) = libm::sincos(angle);
                    (size * cos, size * sin)
                });
                let bodies = burns.map(|burn| after_burn(body, burn.into()));
                let contacts = first_contacts(bodies, ephemeris, row, self.steps, limit_2);
                for (burn, contact) in burns.into_iter().zip(contacts) {
                    match contact {
                        None => return Some(burn),
                        Some(later) if later > best_contact => {
                            (best_contact, best_burn) = (later, Some(burn));
                        }
                        Some(_) => {}
                    }
                }
            }
        }
        best_burn
    }
}

/// First step from now, counted from 1 to `steps`, at which debris is closer to each coasting body than the square root
/// of `limit_2`. The bodies are propagated side by side: each step of one waits for the step before it.
fn first_contacts<const N: usize>(
    mut bodies: [Body; N],
    ephemeris: &DebrisEphemeris,
    row: usize,
    steps: u32,
    limit_2: f64,
) -> [Option<u32>; N] {
    let rows = u32::try_from(ephemeris.rows().saturating_sub(row + 1)).unwrap_or(u32::MAX);
    let mut contacts = [None; N];
    for step in 1..=steps.min(rows) {
        bodies = bodies.map(|body| body.coast(ephemeris.physics.gravity));
        for (contact, body) in contacts.iter_mut().zip(&bodies).filter(|(contact, _)| contact.is_none()) {
            if ephemeris.any_within(row + step as usize, body.x, body.y, limit_2) {
                *contact = Some(step);
            }
        }
        if contacts.iter().all(Option::is_some) {
            break;
        }
    }
    contacts
}

/// Returns the body after a burn that changes its velocity by (`dvx`, `dvy`).
pub(super) fn after_burn(body: Body, [dvx, dvy]: [f64; 2]) -> Body {
    Body { vx: body.vx + dvx, vy: body.vy + dvy, ..body }
}
