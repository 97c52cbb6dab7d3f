//! Close approaches under `risk: pc`: finds the debris that passes a satellite close enough to count, with a
//! branch-free filter before the exact computation.

use super::DebrisEphemeris;
use crate::kessler::constants::{CONTACT_DISTANCE, SIGMAS};
use crate::kessler::kernel::Body;

/// Columns that are filtered together.
const CHUNK_LEN: usize = 8;

impl DebrisEphemeris {
    /// Survival of a satellite after `step`, which moves it from `before` to `body`; `survival` is that
    /// before the step.
    pub(in crate::kessler::planner) fn survival_after(
        &self,
        step: usize,
        before: &Body,
        body: &Body,
        sigma: f64,
        survival: f64,
    ) -> f64 {
        let mut survival = survival;
        self.for_each_close_column(step, before, body, sigma, |column| {
            survival *= self.survival_factor(column, step, before, body, sigma);
        });
        survival
    }

    /// Calls `visit`, in order, for the columns whose survival factor in `step` may be below 1. The factor of
    /// every other column is exactly 1, so leaving it out changes no bit.
    ///
    /// [`survival_factor`](Self::survival_factor) is below 1 only if a body passed closer than the largest
    /// miss. The sign conditions are those of [`closest_approach_squared`], computed by the same expressions.
    /// The miss is at least
    /// |d × w|/|w|, the distance of the straight relative course. The rounding of that product is below 1e-15·|d|·|w|,
    /// and everything within the world is closer than 1e5 LU. The slack of 1e-6 in the squares is a million
    /// times that.
    ///
    /// [`closest_approach_squared`]: crate::kessler::kernel::closest_approach_squared
    #[inline]
    pub(crate) fn for_each_close_column(
        &self,
        step: usize,
        before: &Body,
        body: &Body,
        sigma: f64,
        mut visit: impl FnMut(usize),
    ) {
        let max_miss = CONTACT_DISTANCE + SIGMAS * sigma;
        if let Some(near) = self.passing_grid().and_then(|grid| grid.columns_passing(step, body, max_miss)) {
            return near.iter().for_each(|&column| visit(usize::from(column)));
        }
        let max_miss_2 = max_miss * max_miss * (1.0 + 1e-6);
        let mut first = 0;
        while first + CHUNK_LEN <= self.columns {
            let now = self.chunk(step * self.columns + first);
            let then = self.chunk((step - 1) * self.columns + first);
            if let (Some(now), Some(then)) = (now, then) {
                let mut marks = [0u64; CHUNK_LEN];
                #[expect(clippy::needless_range_loop, reason = "an iterator is not vectorised here")]
                for i in 0..CHUNK_LEN {
                    marks[i] = may_be_close(now, then, i, before, body, max_miss_2);
                }
                if marks.iter().fold(0, |any, mark| any | mark) != 0 {
                    (0..CHUNK_LEN).filter(|&lane| marks[lane] != 0).for_each(|lane| visit(first + lane));
                }
            }
            first += CHUNK_LEN;
        }
        (first..self.columns).for_each(visit);
    }

    /// [`CHUNK_LEN`] columns of a row, starting at a cell index.
    #[inline]
    fn chunk(&self, cell: usize) -> Option<ColumnChunk<'_>> {
        Some(ColumnChunk {
            x: self.x.get(cell..)?.first_chunk()?,
            y: self.y.get(cell..)?.first_chunk()?,
            vx: self.vx.get(cell..)?.first_chunk()?,
            vy: self.vy.get(cell..)?.first_chunk()?,
        })
    }
}

/// Adjacent columns of one row.
#[derive(Clone, Copy)]
struct ColumnChunk<'a> {
    x: &'a [f64; CHUNK_LEN],
    y: &'a [f64; CHUNK_LEN],
    vx: &'a [f64; CHUNK_LEN],
    vy: &'a [f64; CHUNK_LEN],
}

/// Returns 1 if the survival factor of column `i` may be below 1, else 0. It has no short-circuits: without
/// branches several columns are processed at once.
#[inline(always)]
fn may_be_close(
    now: ColumnChunk<'_>,
    then: ColumnChunk<'_>,
    i: usize,
    before: &Body,
    body: &Body,
    max_miss_2: f64,
) -> u64 {
    let (dx, dy) = (body.x - now.x[i], body.y - now.y[i]);
    let (wx, wy) = (body.vx - now.vx[i], body.vy - now.vy[i]);
    let (end, w2) = (dx * wx + dy * wy, wx * wx + wy * wy);
    let across = dx * wy - dy * wx;
    let (dx, dy) = (before.x - then.x[i], before.y - then.y[i]);
    let (wx, wy) = (before.vx - then.vx[i], before.vy - then.vy[i]);
    let approached = dx * wx + dy * wy;
    u64::from(end >= 0.0)
        & u64::from(across * across <= max_miss_2 * w2)
        & (u64::from(end - w2 < 0.0) | u64::from(approached < 0.0))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::kessler::planner::trajectory::Trajectory;
    use crate::kessler::setup::KesslerSetup;
    use crate::kessler::tests::scenario_at_risk;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]

        /// The exact computation for every column gives the same bits, also with rogues that have not arrived
        /// yet and debris inside the Earth.
        #[test]
        fn skipped_columns_have_survival_factor_one(
            seed in 0u64..1 << 40,
            debris in 0u32..120,
            sigma in prop::sample::select(vec![0.05, 0.5, 3.0, 10.0]),
            burns in prop::collection::vec((1u32..=50, -1.0..1.0f64, -1.0..1.0f64), 0..4),
            is_prepared: bool,
        ) {
            let params =
                [("debris", f64::from(debris)), ("spread", 2.0), ("sigma", sigma), ("rogue_probability", 0.2)];
            let scenario = scenario_at_risk("kessler/survival", &params, seed);
            let setup = KesslerSetup::from_recipe(scenario.recipe()).unwrap();
            let mut rng = crate::episode_rng::SeededRng::new(scenario.seed());
            let Ok(start) = setup.draw_initial_state(&mut rng) else { return Ok(()) };
            let ephemeris = DebrisEphemeris::from_initial_state(&setup, &start);
            if is_prepared {
                ephemeris.prepare_search();
            }
            let mut trajectory = Trajectory::new(start.satellites[0], setup.fuel);
            for step in 1..=50u32 {
                let burn = burns.iter().find(|burn| burn.0 == step).map(|&(_, x, y)| (x, y));
                if !trajectory.advance(&ephemeris, step, burn) {
                    break;
                }
                let t = step as usize;
                let (before, body) = (trajectory.bodies[t - 1], trajectory.bodies[t]);
                let exact = (0..ephemeris.len()).fold(trajectory.survival[t - 1], |survival, column| {
                    survival * ephemeris.survival_factor(column, t, &before, &body, sigma)
                });
                prop_assert_eq!(exact.to_bits(), trajectory.survival[t].to_bits(), "step {}", step);
            }
        }
    }
}
