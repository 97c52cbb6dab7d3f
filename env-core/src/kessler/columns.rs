//! Observation of everything the agents see, as columns of f32 for neural policies.

use super::constants::SATELLITES;
use super::kernel::Body;
use super::simulation::KesslerSim;
use crate::episode_rng::EpisodeRng;

/// Values of one satellite in the observation: x, y, vx, vy, fuel, survival.
pub(super) const SATELLITE_VALUES: usize = 6;
/// Columns of debris in the observation: x, y, vx, vy, visible.
pub(super) const DEBRIS_COLUMNS: usize = 5;

impl<R: EpisodeRng> KesslerSim<R> {
    /// Writes the observation: per satellite x, y, vx, vy, fuel and survival (0 once it is lost), then the
    /// columns x, y, vx, vy, visible of `bodies` debris, one column after the other, in order of arrival.
    ///
    /// Hidden or absent debris is zero in every column; debris beyond `bodies` is left out. Values are in LU,
    /// LU/TU and fuel units, not normalised.
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
        self.debris().write_columns(debris, bodies);
        if self.setup().radar_range.is_some() {
            self.zero_hidden(debris, bodies);
        }
    }

    /// Zeroes the columns of debris that no radar sees.
    fn zero_hidden(&self, debris: &mut [f32], bodies: usize) {
        let hidden = |body: &Body| !self.is_visible(body.x, body.y);
        for (i, _) in self.debris().bodies().enumerate().take(bodies).filter(|(_, body)| hidden(body)) {
            for column in 0..DEBRIS_COLUMNS {
                debris[column * bodies + i] = 0.0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::episode_rng::SeededRng;
    use crate::kessler::KESSLER_TASKS;
    use crate::kessler::setup::KesslerSetup;
    use crate::kessler::simulation::KesslerSim;
    use crate::seed::Seed;
    use crate::task::Recipe;

    /// Any number of bodies in any number of slots: full blocks, partial blocks, none.
    #[test]
    fn every_body_fills_its_own_cells() {
        for (debris, radar) in
            [0, 1, 3, 7, 8, 9, 15, 16, 17].into_iter().flat_map(|n| [(n, 200.0), (n, 30.0)])
        {
            let params = [("debris", f64::from(debris)), ("radar_range", radar)];
            let setup = KesslerSetup::from_recipe(
                &Recipe::with_params(&KESSLER_TASKS[0], params.into_iter()).unwrap(),
            )
            .unwrap();
            let mut rng = SeededRng::new(Seed::user(4).unwrap());
            let start = setup.draw_initial_state(&mut rng).unwrap();
            let sim = KesslerSim::new(KESSLER_TASKS[0].objective(), setup, &start, rng);
            for slots in 0..20 {
                let mut out = vec![f32::NAN; 18 + 5 * slots];
                sim.observe_into(&mut out, slots);
                for i in 0..slots {
                    let body = (i < start.debris.len()).then(|| sim.debris().body(i));
                    let visible = body.filter(|body| sim.is_visible(body.x, body.y));
                    let cells = visible.map_or([0.0; 5], |b| [b.x, b.y, b.vx, b.vy, 1.0]);
                    for (column, cell) in cells.into_iter().enumerate() {
                        let actual = out[18 + column * slots + i];
                        assert_eq!(actual, cell as f32, "{debris} debris, {slots} slots: {i}, {column}");
                    }
                }
            }
        }
    }
}
