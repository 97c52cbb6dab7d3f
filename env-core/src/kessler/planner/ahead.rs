//! Looking ahead against a table: what comes too near, and the gentlest burn that clears it.

use super::panel::capped;
use super::table::Table;
use crate::kessler::constants::CONTACT_2;
use crate::kessler::kernel::Body;

const SIZES: [f64; 6] = [0.05, 0.1, 0.2, 0.4, 0.7, 1.0];
const DIRECTIONS: u32 = 16;

/// How somebody looks ahead.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::kessler) struct LookAhead {
    /// Steps looked ahead.
    pub steps: u32,
    /// Steps before a contact at which it is acted on: later burns keep fuel and have seen more.
    pub act_within: u32,
    /// A burn must clear this much more than contact distance, as a factor of distance squared.
    pub margin: f64,
}

impl LookAhead {
    /// How the causal pilot looks ahead.
    pub(in crate::kessler) const STEADY: Self = Self { steps: 12, act_within: 8, margin: 1.2 };

    /// `planned`, unless it leads into something: then the gentlest burn that does not, or the one that puts it off
    /// longest. `now` is the table's row at which the body is.
    pub(in crate::kessler) fn dodge(
        &self,
        body: Body,
        fuel: f64,
        planned: Option<(f64, f64)>,
        table: &Table,
        now: usize,
    ) -> Option<(f64, f64)> {
        let hit = self.first_contact(body, planned.unwrap_or_default(), table, now, CONTACT_2);
        if hit.is_none_or(|step| step > self.act_within) {
            return planned;
        }
        let mut best = (hit, planned);
        for size in SIZES {
            let size = capped(size, fuel);
            for direction in 0..DIRECTIONS {
                let angle = std::f64::consts::TAU * f64::from(direction) / f64::from(DIRECTIONS);
                let (sin, cos) = libm::sincos(angle);
                let dv = (size * cos, size * sin);
                match self.first_contact(body, dv, table, now, CONTACT_2 * self.margin) {
                    None => return Some(dv),
                    later if later > best.0 => best = (later, Some(dv)),
                    _ => {}
                }
            }
        }
        best.1
    }

    /// The step from now, counted from 1, at which something comes nearer than `limit` (squared) after a burn now.
    fn first_contact(
        &self,
        mut body: Body,
        dv: (f64, f64),
        table: &Table,
        now: usize,
        limit: f64,
    ) -> Option<u32> {
        body.vx += dv.0;
        body.vy += dv.1;
        let rows = u32::try_from(table.rows().saturating_sub(now + 1)).unwrap_or(u32::MAX);
        (1..=self.steps.min(rows)).find(|&step| {
            body = body.coasted(table.physics.gravity);
            table.nearer(now + step as usize, body.x, body.y, limit)
        })
    }
}
