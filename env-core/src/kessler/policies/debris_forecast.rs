//! Forecast of visible debris that is carried over from step to step.

use std::collections::VecDeque;

use crate::kessler::body_blocks::ABSENT_BODY;
use crate::kessler::constants::EARTH_RADIUS_2;
use crate::kessler::kernel::{Body, Gravity, distance_squared};
use crate::kessler::telemetry::DebrisTelemetry;

/// Forecast positions of the visible debris. Debris does not react to satellites, so one step later the
/// forecast needs only one row more.
#[derive(Default)]
pub(super) struct DebrisForecast {
    ids: Vec<u32>,
    /// Positions after each step ahead.
    rows: VecDeque<ForecastRow>,
    /// Bodies at the last row.
    end: Vec<Body>,
}

/// Positions of all bodies after one step.
#[derive(Default)]
struct ForecastRow {
    x: Vec<f64>,
    y: Vec<f64>,
}

impl DebrisForecast {
    /// Number of steps that are forecast.
    pub(super) fn len(&self) -> usize {
        self.rows.len()
    }

    /// Updates the forecast to `horizon` steps from the debris that is visible now. Returns true if that is
    /// exactly what was forecast for this step.
    pub(super) fn update(&mut self, visible: &[DebrisTelemetry], horizon: usize) -> bool {
        let as_forecast = self.rows.front().is_some_and(|row| {
            visible.len() == self.ids.len()
                && visible
                    .iter()
                    .enumerate()
                    .all(|(i, d)| d.id == self.ids[i] && (d.x, d.y) == row.position(i))
        });
        let spare = if as_forecast {
            self.rows.pop_front().unwrap_or_default()
        } else {
            self.ids.clear();
            self.ids.extend(visible.iter().map(|d| d.id));
            self.rows.clear();
            self.end.clear();
            self.end.extend(visible.iter().map(DebrisTelemetry::body));
            ForecastRow::default()
        };
        self.extend(spare, horizon);
        as_forecast
    }

    /// Column of the body nearest to `body` in a row, if it is closer than the square root of `limit_2`.
    pub(super) fn nearest(&self, row: usize, body: &Body, limit_2: f64) -> Option<usize> {
        self.rows[row].nearest(body, limit_2)
    }

    /// Position of a column relative to a satellite when it passes nearest, LU. The satellite is at `body` in
    /// `row`.
    pub(super) fn miss_vector(&self, column: usize, row: usize, mut body: Body) -> (f64, f64) {
        let (mut miss, mut nearest_2) = ((0.0, 0.0), f64::INFINITY);
        for row in self.rows.range(row..) {
            let (x, y) = row.position(column);
            let d2 = distance_squared(body.x, body.y, x, y);
            if d2 >= nearest_2 {
                break;
            }
            (miss, nearest_2) = ((x - body.x, y - body.y), d2);
            body = body.coast(Gravity::Point);
        }
        miss
    }

    /// Appends rows up to `horizon`; the first one reuses the memory of `spare`.
    fn extend(&mut self, spare: ForecastRow, horizon: usize) {
        let mut spare = Some(spare);
        while self.rows.len() < horizon {
            let mut row = spare.take().unwrap_or_default();
            row.x.clear();
            row.y.clear();
            for body in &mut self.end {
                // Debris inside the Earth is removed.
                *body = if body.radius_squared() < EARTH_RADIUS_2 {
                    ABSENT_BODY
                } else {
                    body.coast(Gravity::Point)
                };
                row.x.push(body.x);
                row.y.push(body.y);
            }
            self.rows.push_back(row);
        }
    }
}

impl ForecastRow {
    fn position(&self, column: usize) -> (f64, f64) {
        (self.x[column], self.y[column])
    }

    fn nearest(&self, body: &Body, limit_2: f64) -> Option<usize> {
        let (x, y) = (&self.x[..], &self.y[..self.x.len()]);
        let mut any = 0u64;
        for i in 0..x.len() {
            any |= u64::from(distance_squared(body.x, body.y, x[i], y[i]) < limit_2);
        }
        if any == 0 {
            return None;
        }
        let distance = |i: &usize| distance_squared(body.x, body.y, x[*i], y[*i]);
        (0..x.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }
}
