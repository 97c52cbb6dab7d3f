//! Forecast of all debris for some steps, by the episode's own dynamics, and for each body the step at whose end it is nearest to a
//! satellite under hold. The bodies of a vector are propagated step by step without leaving the registers, several vectors side by side,
//! since each step waits for the one before it. Keeping a forecast for the next step is no faster: loading it from memory takes longer
//! than computing it again.
//!
//! The forecast is single precision, like the observation built from it: a vector holds twice as many bodies.
//! Fifteen steps ahead positions are off by about 1e-5 LU for that, against a contact distance of 2 LU. Only
//! `+ − × ÷` and fused `× +` are used, body by body in the same order for any vector width, so the bits are the same
//! on all machines.

mod propagation;

use pulp::{Arch, Simd};

use self::propagation::Propagation;
use super::body_blocks::BLOCK_LEN;
use super::constants::{EARTH_RADIUS, GM, HORIZON, SATELLITES};
use super::debris::Debris;
use super::kernel::{Body, Gravity};
use super::setup::Physics;

/// Bodies propagated together: the widest vectors of today hold sixteen f32.
pub(super) const GROUP_LEN: usize = 2 * BLOCK_LEN;
/// Bits of a [`NearestStep`] that hold the step.
const STEP_BITS: u32 = 6;
/// Squared speed that a fall from far away to the Earth's surface gives, (LU/TU)². The integrator does not conserve energy exactly, so
/// that bounds have twice as much.
const ESCAPE_SPEED_2: f32 = single(2.0 * GM / EARTH_RADIUS);
const _: () = assert!(HORIZON < 1 << STEP_BITS, "a look-ahead has more steps");

/// State from which a forecast starts.
#[derive(Debug, Clone, Copy)]
pub(super) struct ForecastInput<'a> {
    pub debris: &'a Debris,
    pub physics: Physics,
    /// Active satellites, which hold; lost satellites are `None`, and no body is near them.
    pub satellites: [Option<Body>; SATELLITES],
    /// Number of steps to forecast, at most [`HORIZON`].
    pub look_ahead: usize,
}

/// Step at whose end a body is nearest to a satellite, and its squared distance there: the bits of the distance as f32, of which the
/// last [`STEP_BITS`] are replaced by the step. In this form the nearer of two is the smaller number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct NearestStep(u32);

impl NearestStep {
    /// Bits of the step.
    const STEP_MASK: u32 = (1 << STEP_BITS) - 1;

    /// Number of the step, 0 for now.
    pub(super) const fn step(self) -> usize {
        (self.0 & Self::STEP_MASK) as usize
    }

    /// Largest bits of a body whose distance may be less than that of `bits` by up to `margin` LU² of its square. None beyond is finite.
    pub(super) fn limit(bits: u32, margin: f32) -> u32 {
        let farthest = f32::from_bits(bits | Self::STEP_MASK) + margin;
        farthest.min(f32::MAX).to_bits() | Self::STEP_MASK
    }
}

/// Position in the plane, LU.
#[derive(Debug, Clone, Copy)]
pub(super) struct Position {
    pub x: f32,
    pub y: f32,
}

impl Position {
    /// Position of a lost satellite: no distance from it is less than another.
    const ABSENT: Self = Self { x: f32::NAN, y: f32::NAN };
}

/// Positions of the satellites at the end of a step.
type SatellitePositions = [Position; SATELLITES];

/// Forecast with its memory, which is used again.
#[derive(Debug, Default)]
pub(super) struct TracksForecast {
    /// Positions of the bodies of a vector now and after each step, LU: x, then y; one vector after the other.
    positions: Vec<f32>,
    /// Positions of the satellites now and after each step.
    satellites: Vec<SatellitePositions>,
    /// Nearest step of each body by satellite. Entries beyond the number of bodies are undefined.
    nearest: [Vec<[u32; GROUP_LEN]>; SATELLITES],
    /// Largest squared speed of a body now, (LU/TU)².
    fastest: f32,
}

impl TracksForecast {
    /// Forecasts all debris and the satellites.
    pub(super) fn compute(&mut self, arch: Arch, input: ForecastInput<'_>) {
        let ForecastInput { debris, physics, satellites, look_ahead } = input;
        let blocks = debris.blocks();
        let groups = blocks.len().div_ceil(2);
        // Reserves the episode's capacity, so that arrivals allocate nothing.
        let most = debris.capacity().div_ceil(GROUP_LEN);
        let positions = GROUP_LEN * 2 * (look_ahead + 1);
        self.positions.reserve((most * positions).saturating_sub(self.positions.len()));
        self.positions.resize(groups * positions, 0.0);
        self.satellites.resize(look_ahead + 1, [Position::ABSENT; SATELLITES]);
        for nearest in &mut self.nearest {
            nearest.reserve(most.saturating_sub(nearest.len()));
            nearest.resize(groups, [u32::MAX; GROUP_LEN]);
        }
        let (satellites, upstream) = (propagation::satellite_columns(satellites), physics.upstream_compat);
        match physics.gravity {
            Gravity::Point => {
                arch.dispatch(Propagation::<false> { blocks, satellites, upstream, forecast: self });
            }
            Gravity::J2 => {
                arch.dispatch(Propagation::<true> { blocks, satellites, upstream, forecast: self });
            }
        }
    }
}

/// Closest approaches of a group of bodies to a satellite.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClosestApproaches {
    /// Squared distances of the bodies, LU².
    pub distance_2: [f32; GROUP_LEN],
    /// Times from now, TU.
    pub time: [f32; GROUP_LEN],
}

impl TracksForecast {
    /// Nearest steps of all bodies to a satellite, by index. Entries beyond the number of bodies are undefined.
    pub(super) fn nearest_steps(&self, satellite: usize) -> &[[u32; GROUP_LEN]] {
        &self.nearest[satellite]
    }

    /// Removes a body from the nearest ones.
    pub(super) fn hide(&mut self, body: usize) {
        self.nearest.iter_mut().for_each(|of| of[body / GROUP_LEN][body % GROUP_LEN] = u32::MAX);
    }

    /// Largest reduction of a squared distance between two steps, LU²: half of a step's relative motion, squared.
    pub(super) fn margin(&self, satellite: usize) -> f32 {
        let motion = |pair: &[SatellitePositions]| {
            let (from, to) = (pair[0][satellite], pair[1][satellite]);
            (to.x - from.x) * (to.x - from.x) + (to.y - from.y) * (to.y - from.y)
        };
        let speed_2 = self.satellites.windows(2).map(motion).fold(0.0, f32::max);
        let relative = (self.fastest + 2.0 * ESCAPE_SPEED_2).sqrt() + speed_2.sqrt();
        0.25 * relative * relative
    }

    /// Closest approaches of at most [`GROUP_LEN`] bodies to a satellite: the least distances on the two straight lines that meet at the
    /// nearest step of a body.
    #[inline(always)]
    pub(super) fn closest_approaches<S: Simd>(
        &self,
        simd: S,
        satellite: usize,
        bodies: &[u32],
    ) -> ClosestApproaches {
        let last = self.satellites.len() - 1;
        let mut relative = [[[0.0f32; GROUP_LEN]; 2]; 3];
        let mut nearest = [0.0f32; GROUP_LEN];
        for (place, body) in bodies.iter().enumerate().take(GROUP_LEN) {
            let (group, lane) = (*body as usize / GROUP_LEN, *body as usize % GROUP_LEN);
            let step = NearestStep(self.nearest[satellite][group][lane]).step();
            let vector = *body as usize / S::F32_LANES * 2 * S::F32_LANES * (last + 1);
            let rows = &self.positions[vector + *body as usize % S::F32_LANES..];
            nearest[place] = step as f32;
            // At either end of the look-ahead there is one line. One without length has no closest approach within.
            for (number, step) in [step, step.saturating_sub(1), (step + 1).min(last)].into_iter().enumerate()
            {
                let (row, of) = (step * 2 * S::F32_LANES, self.satellites[step][satellite]);
                relative[number][0][place] = of.x - rows[row];
                relative[number][1][place] = of.y - rows[row + S::F32_LANES];
            }
        }
        let mut approaches = ClosestApproaches { distance_2: [0.0; GROUP_LEN], time: nearest };
        for part in 0..GROUP_LEN / S::F32_LANES {
            let [at, before, after] = relative
                .each_ref()
                .map(|columns| columns.each_ref().map(|column| S::as_simd_f32s(column).0[part]));
            let nearest = S::as_simd_f32s(&nearest).0[part];
            let mut best = (dot(simd, at, at), nearest);
            for (other, sign) in [(before, -1.0), (after, 1.0)] {
                let w = [simd.sub_f32s(other[0], at[0]), simd.sub_f32s(other[1], at[1])];
                let (along, length_2) = (simd.neg_f32s(dot(simd, at, w)), dot(simd, w, w));
                let cross = simd.sub_f32s(simd.mul_f32s(at[0], w[1]), simd.mul_f32s(at[1], w[0]));
                let miss_2 = simd.div_f32s(simd.mul_f32s(cross, cross), length_2);
                let time = simd
                    .add_f32s(nearest, simd.mul_f32s(simd.splat_f32s(sign), simd.div_f32s(along, length_2)));
                let is_within = simd.and_m32s(
                    simd.less_than_f32s(simd.splat_f32s(0.0), along),
                    simd.less_than_f32s(along, length_2),
                );
                let is_nearer = simd.and_m32s(is_within, simd.less_than_f32s(miss_2, best.0));
                best =
                    (simd.select_f32s(is_nearer, miss_2, best.0), simd.select_f32s(is_nearer, time, best.1));
            }
            S::as_mut_simd_f32s(&mut approaches.distance_2).0[part] = best.0;
            S::as_mut_simd_f32s(&mut approaches.time).0[part] = best.1;
        }
        approaches
    }
}

/// Dot products of two vectors of plane vectors.
#[inline(always)]
fn dot<S: Simd>(simd: S, a: [S::f32s; 2], b: [S::f32s; 2]) -> S::f32s {
    simd.mul_add_f32s(a[0], b[0], simd.mul_f32s(a[1], b[1]))
}

#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "forecasts are single precision")]
const fn single(value: f64) -> f32 {
    value as f32
}
