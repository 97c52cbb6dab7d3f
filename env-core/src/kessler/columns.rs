//! Everything the agents see as columns of f32, for policies that take it whole.

use super::batch::{DEBRIS_COLUMNS, SATELLITE_VALUES};
use super::constants::SATELLITES;
use super::flight::Flight;
use crate::chance::Chance;

impl<C: Chance> Flight<C> {
    /// Writes the observation: per satellite x, y, vx, vy, fuel and survival (0 once it is lost); then the columns x, y,
    /// vx, vy, visible of `bodies` debris, one column after the other, in order of arrival. Debris that is hidden or not
    /// there is zero in every column; what there is no room for is left out. LU, LU/TU and units of fuel, as they are.
    #[expect(clippy::cast_possible_truncation, reason = "observations are single precision")]
    pub fn observe_into(&self, out: &mut [f32], bodies: usize) {
        let (own, debris) = out.split_at_mut((SATELLITES * SATELLITE_VALUES).min(out.len()));
        for (cells, s) in own.chunks_exact_mut(SATELLITE_VALUES).zip(self.satellites()) {
            let b = s.body;
            for (cell, value) in cells.iter_mut().zip([b.x, b.y, b.vx, b.vy, s.fuel, s.survival]) {
                *cell = value as f32;
            }
        }
        if bodies == 0 || debris.len() != DEBRIS_COLUMNS * bodies {
            debris.fill(0.0);
            return;
        }
        let there = self.debris().len().min(bodies);
        let (moving, visible) = debris.split_at_mut((DEBRIS_COLUMNS - 1) * bodies);
        self.debris().narrow(moving, bodies);
        visible[..there].fill(1.0);
        visible[there..].fill(0.0);
        if self.setup().radar_range.is_some() {
            self.hide(debris, bodies, there);
        }
    }

    /// Zeroes what no radar sees.
    fn hide(&self, debris: &mut [f32], bodies: usize, there: usize) {
        for i in (0..there).filter(|&i| !self.sees(self.debris().x[i], self.debris().y[i])) {
            for column in 0..DEBRIS_COLUMNS {
                debris[column * bodies + i] = 0.0;
            }
        }
    }
}
