//! Everything the agents see as columns of f32, for policies that take it whole.

use super::batch::{DEBRIS_COLUMNS, SATELLITE_VALUES};
use super::constants::SATELLITES;
use super::flight::Flight;
use super::kernel::Body;
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
        self.debris().narrow(debris, bodies);
        if self.setup().radar_range.is_some() {
            self.hide(debris, bodies);
        }
    }

    /// Zeroes what no radar sees.
    fn hide(&self, debris: &mut [f32], bodies: usize) {
        let hidden = |body: &Body| !self.sees(body.x, body.y);
        for (i, _) in self.debris().bodies().enumerate().take(bodies).filter(|(_, body)| hidden(body)) {
            for column in 0..DEBRIS_COLUMNS {
                debris[column * bodies + i] = 0.0;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::chance::Seeded;
    use crate::kessler::TASKS;
    use crate::kessler::flight::Flight;
    use crate::kessler::setup::Setup;
    use crate::scenario::Recipe;
    use crate::seed::Seed;

    /// Whatever number of bodies meets whatever room for them: blocks, parts of blocks, none.
    #[test]
    fn every_body_has_its_cells() {
        for (debris, radar) in
            [0, 1, 3, 7, 8, 9, 15, 16, 17].into_iter().flat_map(|n| [(n, 200.0), (n, 30.0)])
        {
            let params = [("debris", f64::from(debris)), ("radar_range", radar)];
            let setup = Setup::read(&Recipe::with_params(&TASKS[0], params.into_iter()).unwrap()).unwrap();
            let mut chance = Seeded::new(Seed::user(4).unwrap());
            let start = setup.start(&mut chance).unwrap();
            let flight = Flight::new(TASKS[0].objective(), setup, &start, chance);
            for room in 0..20 {
                let mut out = vec![f32::NAN; 18 + 5 * room];
                flight.observe_into(&mut out, room);
                for i in 0..room {
                    let body = (i < start.debris.len()).then(|| flight.debris().body(i));
                    let seen = body.filter(|body| flight.sees(body.x, body.y));
                    let cells = seen.map_or([0.0; 5], |b| [b.x, b.y, b.vx, b.vy, 1.0]);
                    for (column, cell) in cells.into_iter().enumerate() {
                        let found = out[18 + column * room + i];
                        assert_eq!(found, cell as f32, "{debris} debris, room for {room}: {i}, {column}");
                    }
                }
            }
        }
    }
}
