//! Propagation of all bodies and the satellites side by side, for the vectors of the machine.

use pulp::{Simd, WithSimd};

use super::{GROUP_LEN, NearestStep, Position, SatellitePositions, TracksForecast, dot, single};
use crate::kessler::body_blocks::{BLOCK_LEN, BodyBlock};
use crate::kessler::constants::{EARTH_RADIUS_2, GM, J2_PULL, SATELLITES};
use crate::kessler::kernel::Body;

/// Columns x, y, vx, vy of a group of bodies.
type GroupColumns = [[f32; GROUP_LEN]; 4];

/// Columns of the satellites, the first bodies of a group.
pub(super) fn satellite_columns(satellites: [Option<Body>; SATELLITES]) -> GroupColumns {
    let mut columns = [[f32::NAN; GROUP_LEN]; 4];
    for (number, body) in satellites.into_iter().enumerate() {
        let Some(Body { x, y, vx, vy }) = body else { continue };
        for (column, value) in columns.iter_mut().zip([x, y, vx, vy]) {
            column[number] = single(value);
        }
    }
    columns
}

/// Propagation of all bodies and the satellites.
///
/// This is a type, since a closure is not compiled for the vectors that [`pulp::Arch`] detects.
pub(super) struct Propagation<'a, const OBLATE: bool> {
    pub(super) blocks: &'a [BodyBlock],
    /// Columns of the satellites, which hold.
    pub(super) satellites: GroupColumns,
    /// True if debris inside the Earth is frozen.
    pub(super) upstream: bool,
    pub(super) forecast: &'a mut TracksForecast,
}

impl<const OBLATE: bool> WithSimd for Propagation<'_, OBLATE> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { blocks, satellites, upstream, forecast } = self;
        let TracksForecast { positions, satellites: paths, nearest, fastest } = forecast;
        let mut satellites = Satellites::<S>::load(&satellites);
        let vectors = blocks.len().div_ceil(2) * (GROUP_LEN / S::F32_LANES);
        *fastest = 0.0;
        let mut first = 0;
        while first < vectors {
            let mut pass = Pass { blocks, positions, paths, upstream, nearest, fastest, first };
            match vectors - first {
                1 => pass.run::<S, OBLATE, 1>(simd, &mut satellites),
                2 => pass.run::<S, OBLATE, 2>(simd, &mut satellites),
                3 => pass.run::<S, OBLATE, 3>(simd, &mut satellites),
                _ => pass.run::<S, OBLATE, SIDE_BY_SIDE>(simd, &mut satellites),
            }
            first += SIDE_BY_SIDE;
        }
    }
}

/// Satellites under hold, in vectors.
struct Satellites<S: Simd> {
    /// Vectors of satellites; where one holds all, the others are copies of it.
    vectors: [[S::f32s; 4]; SATELLITES],
}

impl<S: Simd> Satellites<S> {
    /// Number of vectors that hold the satellites.
    const COUNT: usize = SATELLITES.div_ceil(S::F32_LANES);

    #[inline(always)]
    fn load(columns: &GroupColumns) -> Self {
        let vector = |number: usize| {
            columns.each_ref().map(|column| S::as_simd_f32s(column).0[number.min(Self::COUNT - 1)])
        };
        Self { vectors: std::array::from_fn(vector) }
    }

    /// Positions of the satellites now.
    #[inline(always)]
    fn positions(&self) -> SatellitePositions {
        let (mut x, mut y) = ([0.0; GROUP_LEN], [0.0; GROUP_LEN]);
        for (number, vector) in self.vectors.iter().enumerate().take(Self::COUNT) {
            S::as_mut_simd_f32s(&mut x).0[number] = vector[0];
            S::as_mut_simd_f32s(&mut y).0[number] = vector[1];
        }
        std::array::from_fn(|number| Position { x: x[number], y: y[number] })
    }

    /// Advances by a step. A satellite inside the Earth is absent from then on.
    #[inline(always)]
    fn advance<const OBLATE: bool>(&mut self, simd: S) {
        for vector in self.vectors.iter_mut().take(Self::COUNT) {
            *vector = advanced::<S, OBLATE>(simd, *vector, f32::NAN);
        }
    }
}

/// Vectors of bodies that are propagated side by side.
const SIDE_BY_SIDE: usize = 4;

/// Propagation of some vectors of bodies side by side.
struct Pass<'a> {
    blocks: &'a [BodyBlock],
    positions: &'a mut [f32],
    paths: &'a mut [SatellitePositions],
    upstream: bool,
    nearest: &'a mut [Vec<[u32; GROUP_LEN]>; SATELLITES],
    fastest: &'a mut f32,
    /// Number of the first vector.
    first: usize,
}

impl Pass<'_> {
    /// Propagates `N` vectors, and the satellites with the first ones.
    #[inline(always)]
    fn run<S: Simd, const OBLATE: bool, const N: usize>(&mut self, simd: S, satellites: &mut Satellites<S>) {
        let Self { blocks, positions, paths, upstream, nearest, fastest, first } = self;
        let first = *first;
        let inside_speed = if *upstream { 0.0 } else { f32::NAN };
        let mut rows = positions.chunks_exact_mut(paths.len() * 2 * S::F32_LANES).skip(first);
        // Variables instead of an array: in a loop over an array the vectors would be in memory.
        let mut a = Vector::<S>::load(simd, blocks, first, rows.next());
        let mut b = Vector::<S>::load(simd, blocks, first + 1.min(N - 1), rows.next());
        let mut c = Vector::<S>::load(simd, blocks, first + 2.min(N - 1), rows.next());
        let mut d = Vector::<S>::load(simd, blocks, first + 3.min(N - 1), rows.next());
        for vector in [&a, &b, &c, &d] {
            **fastest = fastest.max(vector.fastest(simd));
        }
        for (step, path) in paths.iter_mut().enumerate() {
            if first == 0 {
                if step > 0 {
                    satellites.advance::<OBLATE>(simd);
                }
                *path = satellites.positions();
            }
            a.record::<OBLATE>(simd, inside_speed, step, path);
            if N > 1 {
                b.record::<OBLATE>(simd, inside_speed, step, path);
            }
            if N > 2 {
                c.record::<OBLATE>(simd, inside_speed, step, path);
            }
            if N > 3 {
                d.record::<OBLATE>(simd, inside_speed, step, path);
            }
        }
        for (number, vector) in [a, b, c, d].iter().enumerate().take(N) {
            vector.store_nearest(nearest, first + number);
        }
    }
}

/// Bodies of one vector.
struct Vector<'a, S: Simd> {
    /// Columns x, y, vx, vy.
    bodies: [S::f32s; 4],
    /// Bits of the [`NearestStep`] to each satellite.
    least: [S::u32s; SATELLITES],
    /// Memory for the positions now and after each step.
    rows: std::slice::ChunksExactMut<'a, f32>,
}

impl<'a, S: Simd> Vector<'a, S> {
    #[inline(always)]
    fn load(simd: S, blocks: &[BodyBlock], number: usize, rows: Option<&'a mut [f32]>) -> Self {
        let parts = GROUP_LEN / S::F32_LANES;
        let columns = group_columns(&blocks[2 * (number / parts)..]);
        let bodies = columns.each_ref().map(|column| S::as_simd_f32s(column).0[number % parts]);
        let rows = rows.unwrap_or_default().chunks_exact_mut(2 * S::F32_LANES);
        Self { bodies, least: [simd.splat_u32s(u32::MAX); SATELLITES], rows }
    }

    /// Largest squared speed, (LU/TU)².
    #[inline(always)]
    fn fastest(&self, simd: S) -> f32 {
        let [.., vx, vy] = self.bodies;
        let speed_2 = dot(simd, [vx, vy], [vx, vy]);
        // Places without a body have NaN.
        let is_number = simd.equal_f32s(speed_2, speed_2);
        simd.reduce_max_f32s(simd.select_f32s(is_number, speed_2, simd.splat_f32s(0.0)))
    }

    /// Advances to a step, stores the positions, and keeps the step if a satellite is nearer than before.
    #[inline(always)]
    fn record<const OBLATE: bool>(
        &mut self,
        simd: S,
        inside_speed: f32,
        step: usize,
        satellites: &SatellitePositions,
    ) {
        if step > 0 {
            self.bodies = advanced::<S, OBLATE>(simd, self.bodies, inside_speed);
        }
        let [x, y, ..] = self.bodies;
        let (label, mask) = (simd.splat_u32s(step as u32), simd.splat_u32s(!NearestStep::STEP_MASK));
        if let Some(row) = self.rows.next()
            && let [row_x, row_y] = S::as_mut_simd_f32s(row).0
        {
            (*row_x, *row_y) = (x, y);
        }
        for (least, satellite) in self.least.iter_mut().zip(satellites) {
            let dx = simd.sub_f32s(simd.splat_f32s(satellite.x), x);
            let dy = simd.sub_f32s(simd.splat_f32s(satellite.y), y);
            let bits = simd.transmute_u32s_f32s(dot(simd, [dx, dy], [dx, dy]));
            let bits = simd.or_u32s(simd.and_u32s(bits, mask), label);
            *least = simd.select_u32s(simd.less_than_u32s(bits, *least), bits, *least);
        }
    }

    #[inline(always)]
    fn store_nearest(&self, nearest: &mut [Vec<[u32; GROUP_LEN]>; SATELLITES], number: usize) {
        let parts = GROUP_LEN / S::F32_LANES;
        for (nearest, least) in nearest.iter_mut().zip(self.least) {
            S::as_mut_simd_u32s(&mut nearest[number / parts]).0[number % parts] = least;
        }
    }
}

/// Columns x, y, vx, vy of two blocks in single precision.
#[inline(always)]
fn group_columns(blocks: &[BodyBlock]) -> GroupColumns {
    let mut columns = [[f32::NAN; GROUP_LEN]; 4];
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

/// Vector form of `warnings::propagate_debris`. Debris inside the Earth has the speed `inside_speed` from then on: NaN, so that it is
/// absent, or 0, so that it is frozen.
#[inline(always)]
fn advanced<S: Simd, const OBLATE: bool>(
    simd: S,
    [x, y, vx, vy]: [S::f32s; 4],
    inside_speed: f32,
) -> [S::f32s; 4] {
    let r2 = dot(simd, [x, y], [x, y]);
    let inside = simd.less_than_f32s(r2, simd.splat_f32s(single(EARTH_RADIUS_2)));
    let [reciprocal_2, reciprocal_3] = reciprocal_powers(simd, r2);
    let mut k = simd.mul_f32s(simd.splat_f32s(single(GM)), reciprocal_3);
    if OBLATE {
        let oblate = simd.mul_f32s(simd.splat_f32s(single(J2_PULL)), reciprocal_2);
        k = simd.mul_add_f32s(k, oblate, k);
    }
    let inside_speed = simd.splat_f32s(inside_speed);
    let vx = simd.select_f32s(inside, inside_speed, simd.negate_mul_add_f32s(k, x, vx));
    let vy = simd.select_f32s(inside, inside_speed, simd.negate_mul_add_f32s(k, y, vy));
    [simd.add_f32s(x, vx), simd.add_f32s(y, vy), vx, vy]
}

/// Computes 1/r² and 1/r³ of squared radii, without divisions and roots, which take most of the time of a step.
///
/// The bits of r², halved and negated, are about those of 1/r (Lomont 2003, *Fast Inverse Square Root*), off by up to 3.5 %. With h = 1 −
/// r²/r₀², a step of third order and one of second order follow from (1 − h)^(−1/2) = 1 + h/2 + 3h²/8 + … and (1 − h)^(−3/2) = 1 + 3h/2 +
/// …, so that the result is off by rounding alone.
#[inline(always)]
fn reciprocal_powers<S: Simd>(simd: S, r2: S::f32s) -> [S::f32s; 2] {
    let one = simd.splat_f32s(1.0);
    let halved = simd.wrapping_dyn_shr_u32s(simd.transmute_u32s_f32s(r2), simd.splat_u32s(1));
    let guess = simd.transmute_f32s_u32s(simd.sub_u32s(simd.splat_u32s(0x5f37_5a86), halved));
    let h = simd.negate_mul_add_f32s(simd.mul_f32s(r2, guess), guess, one);
    let series = simd.mul_add_f32s(h, simd.splat_f32s(0.375), simd.splat_f32s(0.5));
    let reciprocal = simd.mul_add_f32s(simd.mul_f32s(guess, h), series, guess);
    let squared = simd.mul_f32s(reciprocal, reciprocal);
    let h = simd.negate_mul_add_f32s(r2, squared, one);
    let cubed = simd.mul_f32s(squared, reciprocal);
    [squared, simd.mul_add_f32s(simd.mul_f32s(cubed, simd.splat_f32s(1.5)), h, cubed)]
}
