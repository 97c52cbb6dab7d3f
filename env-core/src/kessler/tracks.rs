//! *tracks* observations: single-precision columns of a fixed size for neural policies. Each satellite sees
//! itself and the debris that threatens it most, in its own radial/in-track axes, so the observation does not
//! change when the whole scene is rotated about the Earth.
//!
//! Debris is forecast by the episode's own dynamics in single precision, with the satellite under hold. The
//! most threatening debris is that with the least distance within the look-ahead; older debris comes first in
//! a tie. Only visible debris counts. Relative velocities are differences of velocities along the satellite's
//! current radial and in-track directions.

mod columns;
mod selection;

use std::cell::RefCell;

use pulp::Arch;

pub use self::columns::TrackColumn;
use self::columns::{
    CLIMB_SCALE, CLOSING_SPEED_SCALE, DRIFT_SCALE, MISS_SCALE, OWN_COLUMNS, RADIUS_OFFSET, RADIUS_SCALE,
    SPEED_SCALE, THREAT_COLUMNS, THREAT_DISTANCE_SCALE,
};
use self::selection::{SelectedThreat, SelectedThreats};
use super::constants::{EARTH_RADIUS, FORMATION_SIDE, GM, HORIZON, SATELLITES, TARGET_RADIUS};
use super::forecast::{ForecastInput, TracksForecast};
use super::reward::Objective;
use super::simulation::{KesslerSim, Satellite};
use super::spaces::MAX_DEBRIS;
use crate::episode_rng::EpisodeRng;

/// Default number of debris bodies per satellite.
pub const DEFAULT_THREATS: usize = 8;
/// Default number of steps that debris is forecast.
pub const DEFAULT_LOOK_AHEAD: usize = 15;
/// Largest absolute value of a cell; larger values are clamped.
pub const CELL_LIMIT: f32 = 2.0;

/// Number of threats or look-ahead that is out of range.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field} must be from {min} to {max}, got {value}")]
pub struct TracksError {
    /// Name of the argument: `k` or `look_ahead`.
    pub field: &'static str,
    /// Rejected value of the argument.
    pub value: usize,
    /// Smallest allowed value of the argument.
    pub min: usize,
    /// Largest allowed value of the argument.
    pub max: usize,
}

/// Encoder of tracks observations. It may be used for any episode at any step: its buffers keep memory
/// between calls, but no state that changes a result.
#[derive(Debug, Clone)]
pub struct TracksEncoder {
    threats: usize,
    look_ahead: usize,
    arch: Arch,
}

impl Default for TracksEncoder {
    fn default() -> Self {
        Self::with_checked_size(DEFAULT_THREATS, DEFAULT_LOOK_AHEAD)
    }
}

impl TracksEncoder {
    /// Creates an encoder of `k` debris bodies per satellite (0 to 1000), forecast for `look_ahead` steps (1
    /// to 50).
    ///
    /// # Errors
    /// Returns [`TracksError`] if an argument is out of range.
    pub fn new(k: usize, look_ahead: usize) -> Result<Self, TracksError> {
        let check = |field, value, min, max| {
            if (min..=max).contains(&value) { Ok(()) } else { Err(TracksError { field, value, min, max }) }
        };
        check("k", k, 0, MAX_DEBRIS as usize)?;
        check("look_ahead", look_ahead, 1, HORIZON as usize)?;
        Ok(Self::with_checked_size(k, look_ahead))
    }

    fn with_checked_size(threats: usize, look_ahead: usize) -> Self {
        Self { threats, look_ahead, arch: Arch::new() }
    }

    /// Number of cells per satellite.
    #[must_use]
    pub const fn len(&self) -> usize {
        OWN_COLUMNS.len() + self.threats * THREAT_COLUMNS.len()
    }

    /// Always false: a satellite at least sees itself.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        false
    }

    /// Number of cells of all satellites together.
    #[must_use]
    pub const fn total_cells(&self) -> usize {
        SATELLITES * self.len()
    }

    /// Columns of one satellite, in order.
    #[must_use]
    pub fn columns(&self) -> Vec<TrackColumn> {
        columns::describe(self.threats, self.look_ahead)
    }

    /// Writes one row of [`TracksEncoder::len`] cells per satellite, one after another. Cells that do not fit
    /// into `out` are left out; the rest of `out` is zeroed. Allocates nothing once an episode with as much
    /// debris was encoded.
    pub fn write<R: EpisodeRng>(&self, sim: &KesslerSim<R>, out: &mut [f32]) {
        out.fill(0.0);
        MEMORY.with_borrow_mut(|memory| {
            if self.threats > 0 {
                self.forecast(sim, &mut memory.forecast);
                memory.threats.select(self.arch, &memory.forecast, self.threats, sim.debris().len());
            }
            let rows = out.chunks_mut(self.len());
            for ((number, satellite), row) in sim.satellites().iter().enumerate().zip(rows) {
                if satellite.is_active() {
                    let mut cells = CellWriter { axes: satellite.body.local_axes(), cells: row.iter_mut() };
                    write_own_state(&mut cells, sim, number);
                    if self.threats > 0 {
                        self.write_threats(&mut cells, sim, number, memory.threats.of(number));
                    }
                }
            }
        });
    }

    /// Writes the most threatening bodies of a satellite.
    fn write_threats<R: EpisodeRng>(
        &self,
        cells: &mut CellWriter<'_>,
        sim: &KesslerSim<R>,
        number: usize,
        threats: &[SelectedThreat],
    ) {
        let satellite = sim.satellites()[number].body;
        for SelectedThreat { body, distance_2, time } in threats {
            let debris = sim.debris().body(*body as usize);
            cells.put(1.0, 0.0, 1.0);
            cells.put_vector(debris.x - satellite.x, debris.y - satellite.y, THREAT_DISTANCE_SCALE);
            cells.put_vector(debris.vx - satellite.vx, debris.vy - satellite.vy, CLOSING_SPEED_SCALE);
            cells.put(f64::from(distance_2.sqrt()), 0.0, MISS_SCALE);
            cells.put(f64::from(*time), 0.0, self.look_ahead as f64);
        }
    }

    /// Forecasts all debris, and hides what the radar does not see.
    fn forecast<R: EpisodeRng>(&self, sim: &KesslerSim<R>, forecast: &mut TracksForecast) {
        let debris = sim.debris();
        let input = ForecastInput {
            debris,
            physics: sim.setup().physics,
            satellites: sim.satellites().each_ref().map(|s| s.is_active().then_some(s.body)),
            look_ahead: self.look_ahead,
        };
        forecast.compute(self.arch, input);
        if sim.setup().radar_range.is_some() {
            let hidden = debris.bodies().enumerate().filter(|(_, body)| !sim.is_visible(body.x, body.y));
            hidden.for_each(|(index, _)| forecast.hide(index));
        }
    }
}

thread_local! {
    /// Memory of this thread's encoders. The environments of a batch share it, so that it stays in the nearest cache.
    static MEMORY: RefCell<EncoderMemory> = RefCell::default();
}

/// Memory that encoders use again. It has no state that changes a result.
#[derive(Debug, Default)]
struct EncoderMemory {
    forecast: TracksForecast,
    threats: SelectedThreats,
}

/// Writer of the cells of one satellite, in order.
struct CellWriter<'a> {
    /// Directions radial out and in-track of the satellite.
    axes: ((f64, f64), (f64, f64)),
    cells: std::slice::IterMut<'a, f32>,
}

impl CellWriter<'_> {
    #[expect(clippy::cast_possible_truncation, reason = "observations are single precision")]
    #[inline(always)]
    fn put(&mut self, value: f64, offset: f64, scale: f64) {
        if let Some(cell) = self.cells.next() {
            // Multiplies by the reciprocal, which is mostly a compile-time constant. Adding zero turns −0
            // into 0.
            *cell = (((value - offset) * (1.0 / scale)) as f32).clamp(-CELL_LIMIT, CELL_LIMIT) + 0.0;
        }
    }

    /// Writes the radial and in-track components of a vector.
    fn put_vector(&mut self, x: f64, y: f64, scale: f64) {
        let ((rx, ry), (tx, ty)) = self.axes;
        self.put(x * rx + y * ry, 0.0, scale);
        self.put(x * tx + y * ty, 0.0, scale);
    }
}

/// Writes the cells of [`OWN_COLUMNS`].
fn write_own_state<R: EpisodeRng>(cells: &mut CellWriter<'_>, sim: &KesslerSim<R>, number: usize) {
    let Satellite { body, fuel, survival, .. } = sim.satellites()[number];
    let ((rx, ry), (tx, ty)) = cells.axes;
    let radius = body.radius();
    let objective = sim.objective();
    let circular = (GM / radius.max(EARTH_RADIUS)).sqrt();
    let has_target = objective == Objective::Rendezvous && number == 0;
    cells.put(1.0, 0.0, 1.0);
    cells.put(radius, RADIUS_OFFSET, RADIUS_SCALE);
    cells.put(body.vx * rx + body.vy * ry, 0.0, SPEED_SCALE);
    cells.put(body.vx * tx + body.vy * ty - circular, 0.0, DRIFT_SCALE);
    cells.put(fuel, 0.0, sim.setup().fuel);
    cells.put(f64::from(sim.steps()), 0.0, f64::from(HORIZON));
    cells.put(survival, 0.0, 1.0);
    cells.put(if has_target { radius - TARGET_RADIUS } else { 0.0 }, 0.0, CLIMB_SCALE);
    for offset in 1..SATELLITES {
        let other = &sim.satellites()[(number + offset) % SATELLITES];
        let is_shown = objective == Objective::Formation && other.is_active();
        let other = if is_shown { other.body } else { body };
        cells.put_vector(other.x - body.x, other.y - body.y, FORMATION_SIDE);
        cells.put_vector(other.vx - body.vx, other.vy - body.vy, DRIFT_SCALE);
    }
}
