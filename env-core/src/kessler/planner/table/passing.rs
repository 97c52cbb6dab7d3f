//! Under `risk: pc`: which debris passes a body near enough to count, found without asking each at length.

use super::Table;
use crate::kessler::constants::{CONTACT_DISTANCE, SIGMAS};
use crate::kessler::kernel::Body;

/// Columns that are looked at together.
const LANES: usize = 8;

impl Table {
    /// What `step` leaves of a survival of `left`, of a body that was at `before` and is at `body`.
    pub(super) fn survival(&self, step: usize, before: &Body, body: &Body, sigma: f64, left: f64) -> f64 {
        let mut left = left;
        self.passing(step, before, body, sigma, |column| {
            left *= self.spares(column, step, before, body, sigma);
        });
        left
    }

    /// Names, in order, the columns that may spare a body less than wholly in `step`; every other column spares it by
    /// exactly 1, so that leaving it out changes no bit.
    ///
    /// [`spares`](Self::spares) is below 1 only where something passed nearer than `most`, and what passes has the one
    /// or the other sign that [`passing_2`] asks, here computed by the same expressions. How near it passed is at least
    /// |d × w|/|w|, the distance of the straight relative course. The rounding of that product is below 1e-15·|d|·|w|,
    /// and whatever is within the world is nearer than 1e5 LU: the slack of 1e-6 in the squares is a million times that.
    #[inline]
    pub(crate) fn passing(
        &self,
        step: usize,
        before: &Body,
        body: &Body,
        sigma: f64,
        mut each: impl FnMut(usize),
    ) {
        let most = CONTACT_DISTANCE + SIGMAS * sigma;
        let most_2 = most * most * (1.0 + 1e-6);
        let mut first = 0;
        while first + LANES <= self.n {
            let now = self.lanes(step * self.n + first);
            let then = self.lanes((step - 1) * self.n + first);
            if let (Some(now), Some(then)) = (now, then) {
                let mut marks = [0u64; LANES];
                #[expect(
                    clippy::needless_range_loop,
                    reason = "as an iterator it does not go through in vectors"
                )]
                for i in 0..LANES {
                    marks[i] = passes(now, then, i, before, body, most_2);
                }
                if marks.iter().fold(0, |any, mark| any | mark) != 0 {
                    (0..LANES).filter(|&lane| marks[lane] != 0).for_each(|lane| each(first + lane));
                }
            }
            first += LANES;
        }
        (first..self.n).for_each(each);
    }

    /// So many columns of a row from this place on.
    #[inline]
    fn lanes(&self, at: usize) -> Option<Lanes<'_>> {
        Some(Lanes {
            x: self.x.get(at..)?.first_chunk()?,
            y: self.y.get(at..)?.first_chunk()?,
            vx: self.vx.get(at..)?.first_chunk()?,
            vy: self.vy.get(at..)?.first_chunk()?,
        })
    }
}

/// Some columns of one row.
#[derive(Clone, Copy)]
struct Lanes<'a> {
    x: &'a [f64; LANES],
    y: &'a [f64; LANES],
    vx: &'a [f64; LANES],
    vy: &'a [f64; LANES],
}

/// Whether a column may spare less than wholly. No short cuts: without branches several columns go through at once.
#[inline(always)]
fn passes(now: Lanes<'_>, then: Lanes<'_>, i: usize, before: &Body, body: &Body, most_2: f64) -> u64 {
    let (dx, dy) = (body.x - now.x[i], body.y - now.y[i]);
    let (wx, wy) = (body.vx - now.vx[i], body.vy - now.vy[i]);
    let (end, w2) = (dx * wx + dy * wy, wx * wx + wy * wy);
    let across = dx * wy - dy * wx;
    let (dx, dy) = (before.x - then.x[i], before.y - then.y[i]);
    let (wx, wy) = (before.vx - then.vx[i], before.vy - then.vy[i]);
    let approached = dx * wx + dy * wy;
    u64::from(end >= 0.0)
        & u64::from(across * across <= most_2 * w2)
        & (u64::from(end - w2 < 0.0) | u64::from(approached < 0.0))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::kessler::planner::table::Path;
    use crate::kessler::setup::Setup;
    use crate::kessler::tests::at_risk;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]

        /// Asking every column at length gives the same bits, rogues that are not there yet and debris inside the Earth
        /// included.
        #[test]
        fn what_is_left_out_spares_wholly(
            seed in 0u64..1 << 40,
            debris in 0u32..120,
            sigma in prop::sample::select(vec![0.05, 0.5, 3.0, 10.0]),
            burns in prop::collection::vec((1u32..=50, -1.0..1.0f64, -1.0..1.0f64), 0..4),
        ) {
            let params = [("debris", f64::from(debris)), ("spread", 2.0), ("sigma", sigma), ("rogue_probability", 0.2)];
            let scenario = at_risk("kessler/survival", &params, seed);
            let setup = Setup::read(scenario.recipe()).unwrap();
            let Ok(start) = setup.start(&mut crate::chance::Seeded::new(scenario.seed())) else { return Ok(()) };
            let table = Table::of(&setup, &start);
            let mut path = Path::start(start.satellites[0], setup.fuel);
            for step in 1..=50u32 {
                let burn = burns.iter().find(|burn| burn.0 == step).map(|&(_, x, y)| (x, y));
                if !path.advance(&table, step, burn) {
                    break;
                }
                let t = step as usize;
                let (before, body) = (path.bodies[t - 1], path.bodies[t]);
                let naive = (0..table.len()).fold(path.survival[t - 1], |left, column| {
                    left * table.spares(column, t, &before, &body, sigma)
                });
                prop_assert_eq!(naive.to_bits(), path.survival[t].to_bits(), "step {}", step);
            }
        }
    }
}
