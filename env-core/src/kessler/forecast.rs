//! Forecast of the closest approaches of all debris to satellites under hold, by the episode's own dynamics.
//! The bodies of a vector are propagated step by step without leaving the registers. Keeping a forecast for
//! the next step is no faster: loading it from memory takes longer than computing it again.
//!
//! The forecast is single precision, like the observation built from it: a vector holds twice as many bodies.
//! Fifteen steps ahead positions are off by about 1e-5 LU for that, against a contact distance of 2 LU. Only
//! `+ − × ÷ √` are used, body by body in the same order for any vector width, so the bits are the same on all
//! machines.

use pulp::{Arch, Simd, WithSimd};

use super::body_blocks::{BLOCK_LEN, BodyBlock};
use super::constants::{EARTH_RADIUS_2, GM, HORIZON, J2_PULL, SATELLITES};
use super::debris::Debris;
use super::kernel::{Body, Gravity, euler_step};
use super::setup::Physics;

/// Bodies propagated together: the widest vectors of today hold sixteen f32.
const GROUP_LEN: usize = 2 * BLOCK_LEN;

/// Closest approach of each debris body to one satellite, by index. Entries beyond the number of bodies are
/// undefined.
#[derive(Debug, Clone, Default)]
pub(super) struct ClosestApproaches {
    /// Least squared distance within the look-ahead, LU².
    pub distance_2: Vec<f32>,
    /// Time of the closest approach, TU from now.
    pub time: Vec<f32>,
}

/// State from which a forecast starts.
#[derive(Debug, Clone, Copy)]
pub(super) struct ForecastInput<'a> {
    pub debris: &'a Debris,
    pub physics: Physics,
    /// Active satellites, which hold; lost satellites are `None` and have no closest approach.
    pub satellites: [Option<Body>; SATELLITES],
    /// Number of steps to forecast, at most [`HORIZON`].
    pub look_ahead: usize,
}

/// Positions of the satellites after a step, LU.
type SatellitePositions = [(f32, f32); SATELLITES];

/// Position of a lost satellite: no distance from it is less than another.
const ABSENT_POSITION: (f32, f32) = (f32::NAN, f32::NAN);

/// Computes the closest approach of every debris body to each satellite within the look-ahead.
pub(super) fn forecast_closest_approaches(
    arch: Arch,
    input: ForecastInput<'_>,
    approaches: &mut [ClosestApproaches; SATELLITES],
) {
    let ForecastInput { debris, physics, satellites, look_ahead } = input;
    let blocks = debris.blocks();
    for column in approaches.iter_mut().flat_map(|of| [&mut of.distance_2, &mut of.time]) {
        // Reserves the episode's capacity, so that arrivals allocate nothing.
        column.reserve((debris.capacity() + GROUP_LEN).saturating_sub(column.len()));
        column.resize(blocks.len().div_ceil(2) * GROUP_LEN, 0.0);
    }
    let mut paths = [[ABSENT_POSITION; SATELLITES]; HORIZON as usize + 1];
    let paths = &mut paths[..=look_ahead];
    let upstream = physics.upstream_compat;
    match physics.gravity {
        Gravity::Point => {
            let satellites = CoastingSatellites::<false>::new(satellites);
            arch.dispatch(ApproachForecast { blocks, satellites, paths, upstream, approaches });
        }
        Gravity::J2 => {
            let satellites = CoastingSatellites::<true>::new(satellites);
            arch.dispatch(ApproachForecast { blocks, satellites, paths, upstream, approaches });
        }
    }
}

/// Satellites under hold, propagated step by step.
struct CoastingSatellites<const OBLATE: bool>([Body; SATELLITES]);

impl<const OBLATE: bool> CoastingSatellites<OBLATE> {
    fn new(satellites: [Option<Body>; SATELLITES]) -> Self {
        let absent = Body { x: f64::NAN, y: f64::NAN, vx: 0.0, vy: 0.0 };
        Self(satellites.map(|body| body.unwrap_or(absent)))
    }

    /// Returns the current positions and advances by one step.
    #[inline(always)]
    fn step(&mut self) -> SatellitePositions {
        let mut positions = [ABSENT_POSITION; SATELLITES];
        for (position, body) in positions.iter_mut().zip(&mut self.0) {
            *position = (single(body.x), single(body.y));
            // A satellite that falls into the Earth is absent from then on.
            body.x = if body.radius_squared() < EARTH_RADIUS_2 { f64::NAN } else { body.x };
            euler_step::<OBLATE>(&mut body.x, &mut body.y, &mut body.vx, &mut body.vy);
        }
        positions
    }
}

/// Forecasts the closest approaches of all bodies to satellites on their paths.
///
/// Within a step both move on straight lines. Their closest approach is therefore at the end of a step, or
/// within a step in which they first approach and then separate: there it is the distance from a line, |d ×
/// w| / |w|. Distances are compared as fractions and divided once, at the end, since divisions would dominate
/// the run time.
///
/// This is a type, since a closure is not compiled for the vectors that [`Arch`] detects.
struct ApproachForecast<'a, const OBLATE: bool> {
    blocks: &'a [BodyBlock],
    satellites: CoastingSatellites<OBLATE>,
    /// Memory for the positions of the satellites now and after each step.
    paths: &'a mut [SatellitePositions],
    upstream: bool,
    approaches: &'a mut [ClosestApproaches; SATELLITES],
}

impl<const OBLATE: bool> WithSimd for ApproachForecast<'_, OBLATE> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { blocks, mut satellites, paths, upstream, approaches } = self;
        for (index, pair) in blocks.chunks(2).enumerate() {
            let columns = group_columns(pair);
            // A machine's vectors may hold a part of the group.
            for lane in 0..GROUP_LEN / S::F32_LANES {
                let [x, y, vx, vy] = &columns;
                let bodies = [
                    S::as_simd_f32s(x).0[lane],
                    S::as_simd_f32s(y).0[lane],
                    S::as_simd_f32s(vx).0[lane],
                    S::as_simd_f32s(vy).0[lane],
                ];
                // The paths of the satellites are computed beside the first bodies: in both, each step waits
                // for the one before it.
                let nearest = if index == 0 && lane == 0 {
                    let positions = paths.iter_mut().map(|positions| {
                        *positions = satellites.step();
                        *positions
                    });
                    closest_approaches::<S, OBLATE>(simd, bodies, upstream, positions)
                } else {
                    closest_approaches::<S, OBLATE>(simd, bodies, upstream, paths.iter().copied())
                };
                let from = index * GROUP_LEN + lane * S::F32_LANES;
                for s in 0..SATELLITES {
                    let ApproachFraction { numerator, denominator, along, end } = nearest[s];
                    let store = |column: &mut [f32], cells| {
                        S::as_mut_simd_f32s(&mut column[from..from + S::F32_LANES]).0[0] = cells;
                    };
                    store(&mut approaches[s].distance_2, simd.div_f32s(numerator, denominator));
                    let time = simd.sub_f32s(end, simd.div_f32s(along, denominator));
                    store(&mut approaches[s].time, time);
                }
            }
        }
    }
}

/// Least squared distance as a fraction. Its time is `along`/`denominator` before `end`.
#[derive(Clone, Copy)]
struct ApproachFraction<S: Simd> {
    numerator: S::f32s,
    denominator: S::f32s,
    along: S::f32s,
    end: S::f32s,
}

/// Computes the closest approaches of a vector of bodies to each satellite.
#[inline(always)]
fn closest_approaches<S: Simd, const OBLATE: bool>(
    simd: S,
    mut bodies: [S::f32s; 4],
    upstream: bool,
    mut paths: impl Iterator<Item = SatellitePositions>,
) -> [ApproachFraction<S>; SATELLITES] {
    let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
    let infinite = simd.splat_f32s(f32::INFINITY);
    let start = ApproachFraction { numerator: infinite, denominator: one, along: zero, end: zero };
    let mut nearest = [start; SATELLITES];
    let mut before = [[zero, zero]; SATELLITES];
    let now = paths.next().unwrap_or([ABSENT_POSITION; SATELLITES]);
    for s in 0..SATELLITES {
        before[s] = relative_position(simd, now[s], bodies);
        nearest[s].numerator = dot(simd, before[s], before[s]);
    }
    let mut end = zero;
    for positions in paths {
        bodies = step_debris::<S, OBLATE>(simd, bodies, upstream);
        end = simd.add_f32s(end, one);
        for s in 0..SATELLITES {
            let [dx, dy] = relative_position(simd, positions[s], bodies);
            let [wx, wy] = [simd.sub_f32s(dx, before[s][0]), simd.sub_f32s(dy, before[s][1])];
            before[s] = [dx, dy];
            let (along, speed_2) = (dot(simd, [dx, dy], [wx, wy]), dot(simd, [wx, wy], [wx, wy]));
            // True if they approach at the start of the step and separate at its end.
            let turns = simd.and_m32s(simd.less_than_f32s(zero, along), simd.less_than_f32s(along, speed_2));
            let cross = simd.sub_f32s(simd.mul_f32s(dx, wy), simd.mul_f32s(dy, wx));
            let at_end = dot(simd, [dx, dy], [dx, dy]);
            let numerator = simd.select_f32s(turns, simd.mul_f32s(cross, cross), at_end);
            let denominator = simd.select_f32s(turns, speed_2, one);
            let best = &mut nearest[s];
            let nearer = simd.less_than_f32s(
                simd.mul_f32s(numerator, best.denominator),
                simd.mul_f32s(best.numerator, denominator),
            );
            best.numerator = simd.select_f32s(nearer, numerator, best.numerator);
            best.denominator = simd.select_f32s(nearer, denominator, best.denominator);
            best.along = simd.select_f32s(nearer, simd.select_f32s(turns, along, zero), best.along);
            best.end = simd.select_f32s(nearer, end, best.end);
        }
    }
    nearest
}

/// Columns x, y, vx, vy of two blocks in single precision.
#[inline(always)]
fn group_columns(blocks: &[BodyBlock]) -> [[f32; GROUP_LEN]; 4] {
    let mut columns = [[ABSENT_POSITION.0; GROUP_LEN]; 4];
    for (half, block) in blocks.iter().take(2).enumerate() {
        let [x, y, vx, vy] = &mut columns;
        for i in 0..BLOCK_LEN {
            x[half * BLOCK_LEN + i] = single(block.x[i]);
            y[half * BLOCK_LEN + i] = single(block.y[i]);
            vx[half * BLOCK_LEN + i] = single(block.vx[i]);
            vy[half * BLOCK_LEN + i] = single(block.vy[i]);
        }
    }
    columns
}

/// Vector form of `warnings::propagate_debris`: debris inside the Earth is absent or, with `upstream`,
/// frozen.
#[inline(always)]
fn step_debris<S: Simd, const OBLATE: bool>(simd: S, bodies: [S::f32s; 4], upstream: bool) -> [S::f32s; 4] {
    let [x, y, vx, vy] = bodies;
    let r2 = dot(simd, [x, y], [x, y]);
    let inside = simd.less_than_f32s(r2, simd.splat_f32s(single(EARTH_RADIUS_2)));
    let mut k = simd.div_f32s(simd.splat_f32s(single(GM)), simd.mul_f32s(r2, simd.sqrt_f32s(r2)));
    if OBLATE {
        let oblate = simd.div_f32s(simd.splat_f32s(single(J2_PULL)), r2);
        k = simd.mul_f32s(k, simd.add_f32s(simd.splat_f32s(1.0), oblate));
    }
    let (vx, vy) = (simd.sub_f32s(vx, simd.mul_f32s(k, x)), simd.sub_f32s(vy, simd.mul_f32s(k, y)));
    let (absent, zero) = (simd.splat_f32s(ABSENT_POSITION.0), simd.splat_f32s(0.0));
    let (inside_x, inside_y) = if upstream { (x, y) } else { (absent, absent) };
    [
        simd.select_f32s(inside, inside_x, simd.add_f32s(x, vx)),
        simd.select_f32s(inside, inside_y, simd.add_f32s(y, vy)),
        simd.select_f32s(inside, zero, vx),
        simd.select_f32s(inside, zero, vy),
    ]
}

/// Position of a satellite relative to a vector of bodies.
#[inline(always)]
fn relative_position<S: Simd>(simd: S, position: (f32, f32), bodies: [S::f32s; 4]) -> [S::f32s; 2] {
    let (x, y) = position;
    [simd.sub_f32s(simd.splat_f32s(x), bodies[0]), simd.sub_f32s(simd.splat_f32s(y), bodies[1])]
}

/// Dot products of two vectors of plane vectors.
#[inline(always)]
fn dot<S: Simd>(simd: S, a: [S::f32s; 2], b: [S::f32s; 2]) -> S::f32s {
    simd.add_f32s(simd.mul_f32s(a[0], b[0]), simd.mul_f32s(a[1], b[1]))
}

#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "forecasts are single precision")]
const fn single(value: f64) -> f32 {
    value as f32
}
