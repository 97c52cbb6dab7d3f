//! Grid of debris near each place, by which a satellite is compared with few bodies instead of all of them.

use super::DebrisEphemeris;
use crate::kessler::constants::{CONTACT_2, CONTACT_DISTANCE, SIGMAS};
use crate::kessler::kernel::Body;
use crate::kessler::setup::ContactModel;

/// Half of the side of the square that the grid covers, LU. Satellites live between 20 and about 110 LU.
const HALF_SIDE: f64 = 128.0;
/// Cells along a side of the grid.
const SIDE_CELLS: usize = 32;
/// Side of a cell, LU.
const CELL_SIDE: f64 = 2.0 * HALF_SIDE / SIDE_CELLS as f64;
/// Largest squared distance from the end of a step that a look-ahead asks for, LU².
const LOOK_AHEAD_LIMIT_2: f64 = 2.0 * CONTACT_2;
/// Relative speed of a satellite and debris up to which the grid knows all bodies passed within a step, LU/TU.
const MAX_RELATIVE_SPEED: f64 = 12.0;
/// Farthest reach with which comparing all bodies, several at once, is not faster, LU.
const MAX_REACH: f64 = 32.0;
/// Covers the rounding of distances and of cells: a million times that of coordinates below 1e3 LU.
const SLACK: f64 = 1e-6;

/// Columns of an ephemeris near each cell of a square about the Earth, for each row.
pub(super) struct ProximityGrid {
    /// A cell lists all bodies that are nearer than this to any of its points, LU.
    reach: f64,
    /// Largest speed of debris in each row, LU/TU; 0 without velocities.
    max_speeds: Vec<f64>,
    /// For each row and cell, the index in `columns` at which its list starts; the next one is its end.
    starts: Vec<u32>,
    /// Lists of columns, each in ascending order.
    columns: Vec<u16>,
}

/// Grids of an ephemeris for searches.
pub(super) struct SearchGrids {
    /// Bodies near the end of a step.
    pub(super) near: Option<ProximityGrid>,
    /// Bodies that pass within a step; none if only the ends of steps count.
    pub(super) passing: Option<ProximityGrid>,
}

impl SearchGrids {
    /// Builds the grids that are faster than comparing all bodies.
    pub(super) fn new(ephemeris: &DebrisEphemeris) -> Self {
        let miss = match ephemeris.physics.contact {
            ContactModel::EndOfStep => None,
            ContactModel::Swept => Some(CONTACT_DISTANCE),
            ContactModel::Probability(sigma) => Some(CONTACT_DISTANCE + SIGMAS * sigma),
        };
        Self {
            near: ProximityGrid::new(ephemeris, LOOK_AHEAD_LIMIT_2.sqrt()),
            passing: miss.and_then(|miss| ProximityGrid::new(ephemeris, miss + MAX_RELATIVE_SPEED)),
        }
    }
}

impl ProximityGrid {
    /// Builds a grid of an ephemeris; `None` if comparing all bodies is as fast.
    fn new(ephemeris: &DebrisEphemeris, reach: f64) -> Option<Self> {
        if reach > MAX_REACH || ephemeris.columns > usize::from(u16::MAX) {
            return None;
        }
        let mut grid = Self { reach, max_speeds: Vec::new(), starts: vec![0], columns: Vec::new() };
        (0..ephemeris.rows).for_each(|row| grid.push_row(ephemeris, row));
        Some(grid)
    }

    /// Columns that may be nearer than the square root of `distance_2` to a point after step `row`, in ascending order;
    /// `None` if the grid does not know them.
    #[inline]
    pub(super) fn columns_near(&self, row: usize, x: f64, y: f64, distance_2: f64) -> Option<&[u16]> {
        if distance_2 > self.reach * self.reach {
            return None;
        }
        let cell = row * SIDE_CELLS * SIDE_CELLS + cell_index(y)? * SIDE_CELLS + cell_index(x)?;
        let (start, end) = (*self.starts.get(cell)?, *self.starts.get(cell + 1)?);
        self.columns.get(start as usize..end as usize)
    }

    /// Columns that may pass a satellite within `miss` in the step that ends at `row`; `None` if the grid does not know
    /// them. `body` is the satellite's state at the end of the step.
    pub(super) fn columns_passing(&self, row: usize, body: &Body, miss: f64) -> Option<&[u16]> {
        // Within a step the relative position changes by the relative velocity.
        let speed = (body.vx * body.vx + body.vy * body.vy).sqrt() + self.max_speeds.get(row)?;
        self.columns_near(row, body.x, body.y, (miss + speed) * (miss + speed))
    }

    /// Appends the lists of a row.
    fn push_row(&mut self, ephemeris: &DebrisEphemeris, row: usize) {
        let cells = row * ephemeris.columns..(row + 1) * ephemeris.columns;
        let (x, y) = (&ephemeris.x[cells.clone()], &ephemeris.y[cells.clone()]);
        let speeds_2 = ephemeris
            .vx
            .get(cells.clone())
            .into_iter()
            .flatten()
            .zip(ephemeris.vy.get(cells).into_iter().flatten());
        let max_speed_2 = speeds_2.map(|(vx, vy)| vx * vx + vy * vy).fold(0.0, f64::max);
        self.max_speeds.push(max_speed_2.sqrt() + SLACK);
        // The number of bodies of each cell, then the place of its next one.
        let mut places = [0u32; SIDE_CELLS * SIDE_CELLS];
        for (x, y) in x.iter().zip(y) {
            for_each_cell(*x, *y, self.reach, |cell| places[cell] += 1);
        }
        let mut end = u32::try_from(self.columns.len()).unwrap_or(u32::MAX);
        for place in &mut places {
            let count = std::mem::replace(place, end);
            end = end.saturating_add(count);
            self.starts.push(end);
        }
        self.columns.resize(end as usize, 0);
        for (column, (x, y)) in (0u16..).zip(x.iter().zip(y)) {
            for_each_cell(*x, *y, self.reach, |cell| {
                self.columns[places[cell] as usize] = column;
                places[cell] += 1;
            });
        }
    }
}

/// Index of the cells at a coordinate along one axis; `None` outside the grid.
#[inline]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to be within the grid")]
fn cell_index(coordinate: f64) -> Option<usize> {
    let place = (coordinate + HALF_SIDE) * (1.0 / CELL_SIDE);
    (place >= 0.0 && place < SIDE_CELLS as f64).then_some(place as usize)
}

/// Calls `visit` for each cell with a point within `reach` of a body.
fn for_each_cell(x: f64, y: f64, reach: f64, mut visit: impl FnMut(usize)) {
    let reach = reach + SLACK;
    let (columns, rows) = (cell_range(x, reach), cell_range(y, reach));
    for row in rows {
        let dy = distance_to_cell(y, row);
        for column in columns.clone() {
            let dx = distance_to_cell(x, column);
            if dx * dx + dy * dy <= reach * reach {
                visit(row * SIDE_CELLS + column);
            }
        }
    }
}

/// Cells of the grid along one axis that are within `reach` of a coordinate.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the grid")]
fn cell_range(coordinate: f64, reach: f64) -> std::ops::Range<usize> {
    let place = |coordinate: f64| ((coordinate + HALF_SIDE) / CELL_SIDE).clamp(0.0, SIDE_CELLS as f64);
    place(coordinate - reach).floor() as usize..place(coordinate + reach).ceil() as usize
}

/// Distance of a coordinate from a cell along one axis, LU.
fn distance_to_cell(coordinate: f64, cell: usize) -> f64 {
    let low = cell as f64 * CELL_SIDE - HALF_SIDE;
    (low - coordinate).max(coordinate - (low + CELL_SIDE)).max(0.0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::kessler::setup::Physics;

    fn body() -> impl Strategy<Value = Body> {
        // Also inside the Earth and outside the grid.
        (5.0..200.0f64, 0.0..std::f64::consts::TAU, -1.5..1.5f64)
            .prop_map(|(radius, angle, speed)| Body::circular(radius, angle, speed))
    }

    proptest! {
        /// Contacts at the end of a step and within it are those that comparing all bodies finds.
        #[test]
        fn nearby_debris_has_all_contacts(
            debris in prop::collection::vec(body(), 0..80),
            satellites in prop::collection::vec(body(), 1..20),
            is_swept: bool,
        ) {
            let contact = if is_swept { ContactModel::Swept } else { ContactModel::EndOfStep };
            let physics = Physics { contact, ..Physics::DEFAULT };
            let all = DebrisEphemeris::propagate(&debris, &[], 12, physics);
            let prepared = DebrisEphemeris::propagate(&debris, &[], 12, physics);
            prepared.prepare_search();
            prop_assert!(prepared.near_grid().is_some());
            prop_assert_eq!(prepared.passing_grid().is_some(), is_swept);
            for step in 1..all.rows() {
                // Places near debris, and those of satellites.
                let near = debris.iter().enumerate().map(|(column, body)| {
                    let (x, y) = all.position(column, step);
                    Body { x: x + 0.3 * body.vx, y: y + 0.3 * body.vy, ..*body }
                });
                for body in near.chain(satellites.iter().copied()) {
                    prop_assert_eq!(prepared.destroys(step, &body), all.destroys(step, &body));
                    for limit_2 in [CONTACT_2, LOOK_AHEAD_LIMIT_2, 400.0] {
                        let within = |ephemeris: &DebrisEphemeris| ephemeris.any_within(step, body.x, body.y, limit_2);
                        prop_assert_eq!(within(&prepared), within(&all));
                    }
                }
            }
        }
    }
}
