//! The passes over debris, in the machine's vector width.

use pulp::{Arch, Simd, WithSimd};

use super::constants::{CONTACT_2, EARTH_RADIUS_2, GM, J2_PULL, SATELLITES};
use super::kernel::{Body, Gravity};

/// What a pass found, of any body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Found {
    /// It is inside the Earth.
    pub inside: bool,
    /// It touches a satellite.
    pub touched: bool,
}

/// Bodies as columns of whole vectors.
pub(super) struct Columns<'a> {
    pub x: &'a mut [f64],
    pub y: &'a mut [f64],
    pub vx: &'a mut [f64],
    pub vy: &'a mut [f64],
}

/// One step of free flight of all, and whether anything rare happened: where the step ends or (`swept`) within it.
pub(super) fn advance(
    arch: Arch,
    gravity: Gravity,
    swept: bool,
    columns: Columns<'_>,
    satellites: &[Body; SATELLITES],
) -> Found {
    match (gravity, swept) {
        (Gravity::Point, false) => arch.dispatch(Pass::<false, false> { columns, satellites }),
        (Gravity::Point, true) => arch.dispatch(Pass::<false, true> { columns, satellites }),
        (Gravity::J2, false) => arch.dispatch(Pass::<true, false> { columns, satellites }),
        (Gravity::J2, true) => arch.dispatch(Pass::<true, true> { columns, satellites }),
    }
}

/// The arithmetic of `kernel::coast` (`OBLATE`: with J₂) and of distance (`SWEPT`: of `kernel::swept_2`), operation by
/// operation.
struct Pass<'a, const OBLATE: bool, const SWEPT: bool> {
    columns: Columns<'a>,
    satellites: &'a [Body; SATELLITES],
}

/// x² + y².
#[inline(always)]
fn square<S: Simd>(simd: S, x: S::f64s, y: S::f64s) -> S::f64s {
    simd.add_f64s(simd.mul_f64s(x, x), simd.mul_f64s(y, y))
}

/// One step of free flight: x, y, vx, vy.
#[inline(always)]
fn coasted<S: Simd, const OBLATE: bool>(simd: S, [x, y, vx, vy]: [S::f64s; 4]) -> [S::f64s; 4] {
    let r2 = square(simd, x, y);
    let mut k = simd.div_f64s(simd.splat_f64s(GM), simd.mul_f64s(r2, simd.sqrt_f64s(r2)));
    if OBLATE {
        let oblate = simd.div_f64s(simd.splat_f64s(J2_PULL), r2);
        k = simd.mul_f64s(k, simd.add_f64s(simd.splat_f64s(1.0), oblate));
    }
    let (vx, vy) = (simd.sub_f64s(vx, simd.mul_f64s(k, x)), simd.sub_f64s(vy, simd.mul_f64s(k, y)));
    [simd.add_f64s(x, vx), simd.add_f64s(y, vy), vx, vy]
}

/// One satellite in every lane.
#[derive(Clone, Copy)]
struct Splat<S: Simd> {
    x: S::f64s,
    y: S::f64s,
    vx: S::f64s,
    vy: S::f64s,
}

impl<S: Simd> Splat<S> {
    #[inline(always)]
    fn of(simd: S, body: &Body) -> Self {
        Self {
            x: simd.splat_f64s(body.x),
            y: simd.splat_f64s(body.y),
            vx: simd.splat_f64s(body.vx),
            vy: simd.splat_f64s(body.vy),
        }
    }

    /// Distance squared where the step ends, or least distance squared within it.
    #[inline(always)]
    fn distance_2<const SWEPT: bool>(&self, simd: S, at: [S::f64s; 4]) -> S::f64s {
        let [x, y, vx, vy] = at;
        let (dx, dy) = (simd.sub_f64s(self.x, x), simd.sub_f64s(self.y, y));
        if !SWEPT {
            return square(simd, dx, dy);
        }
        let (wx, wy) = (simd.sub_f64s(self.vx, vx), simd.sub_f64s(self.vy, vy));
        let along = simd.add_f64s(simd.mul_f64s(dx, wx), simd.mul_f64s(dy, wy));
        let moving = simd.max_f64s(square(simd, wx, wy), simd.splat_f64s(f64::MIN_POSITIVE));
        let back = simd.div_f64s(along, moving);
        let back = simd.min_f64s(simd.max_f64s(back, simd.splat_f64s(0.0)), simd.splat_f64s(1.0));
        let (mx, my) =
            (simd.sub_f64s(dx, simd.mul_f64s(wx, back)), simd.sub_f64s(dy, simd.mul_f64s(wy, back)));
        square(simd, mx, my)
    }
}

impl<const OBLATE: bool, const SWEPT: bool> WithSimd for Pass<'_, OBLATE, SWEPT> {
    type Output = Found;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Found {
        let Columns { x, y, vx, vy } = self.columns;
        let (x, y) = (S::as_mut_simd_f64s(x).0, S::as_mut_simd_f64s(y).0);
        let (vx, vy) = (S::as_mut_simd_f64s(vx).0, S::as_mut_simd_f64s(vy).0);
        let mut lowest = simd.splat_f64s(f64::MAX);
        let mut nearest = lowest;
        // Not `map`: the compiler does not carry the vector instructions through it.
        let [a, b, c] = self.satellites;
        let satellites = [Splat::of(simd, a), Splat::of(simd, b), Splat::of(simd, c)];
        for (((x, y), vx), vy) in x.iter_mut().zip(y).zip(vx).zip(vy) {
            [*x, *y, *vx, *vy] = coasted::<S, OBLATE>(simd, [*x, *y, *vx, *vy]);
            lowest = simd.min_f64s(lowest, square(simd, *x, *y));
            for satellite in &satellites {
                nearest = simd.min_f64s(nearest, satellite.distance_2::<SWEPT>(simd, [*x, *y, *vx, *vy]));
            }
        }
        Found {
            inside: simd.reduce_min_f64s(lowest) < EARTH_RADIUS_2,
            touched: simd.reduce_min_f64s(nearest) < CONTACT_2,
        }
    }
}

/// Bodies looked at together in [`early`]: a whole number of vectors of any width.
pub(super) const BLOCK: usize = 8;
/// Far from everything, and still a number.
const FAR: f64 = 1e12;

/// Which blocks of [`BLOCK`] bodies have one that touches a satellite at the points of these paths, at most 128 of them:
/// the first where everything starts, then step by step.
pub(super) fn early(gravity: Gravity, swept: bool, bodies: &[Body], paths: &[[Body; SATELLITES]]) -> u128 {
    let arch = Arch::new();
    match (gravity, swept) {
        (Gravity::Point, false) => arch.dispatch(Early::<false, false> { bodies, paths }),
        (Gravity::Point, true) => arch.dispatch(Early::<false, true> { bodies, paths }),
        (Gravity::J2, false) => arch.dispatch(Early::<true, false> { bodies, paths }),
        (Gravity::J2, true) => arch.dispatch(Early::<true, true> { bodies, paths }),
    }
}

struct Early<'a, const OBLATE: bool, const SWEPT: bool> {
    bodies: &'a [Body],
    paths: &'a [[Body; SATELLITES]],
}

impl<const OBLATE: bool, const SWEPT: bool> WithSimd for Early<'_, OBLATE, SWEPT> {
    type Output = u128;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> u128 {
        let mut found = 0;
        for (number, block) in self.bodies.chunks(BLOCK).enumerate() {
            let (mut x, mut y, mut vx, mut vy) = ([FAR; BLOCK], [FAR; BLOCK], [0.0; BLOCK], [0.0; BLOCK]);
            for (i, body) in block.iter().enumerate() {
                (x[i], y[i], vx[i], vy[i]) = (body.x, body.y, body.vx, body.vy);
            }
            let (x, y) = (S::as_mut_simd_f64s(&mut x).0, S::as_mut_simd_f64s(&mut y).0);
            let (vx, vy) = (S::as_mut_simd_f64s(&mut vx).0, S::as_mut_simd_f64s(&mut vy).0);
            let mut nearest = simd.splat_f64s(f64::MAX);
            for (((x, y), vx), vy) in x.iter_mut().zip(y).zip(vx).zip(vy) {
                let mut at = [*x, *y, *vx, *vy];
                for (step, satellites) in self.paths.iter().enumerate() {
                    if step > 0 {
                        at = coasted::<S, OBLATE>(simd, at);
                    }
                    for body in satellites {
                        let satellite = Splat::of(simd, body);
                        let d2 = if SWEPT && step > 0 {
                            satellite.distance_2::<true>(simd, at)
                        } else {
                            satellite.distance_2::<false>(simd, at)
                        };
                        nearest = simd.min_f64s(nearest, d2);
                    }
                }
            }
            found |= u128::from(simd.reduce_min_f64s(nearest) < CONTACT_2) << number;
        }
        found
    }
}

/// Columns rounded to f32, each to `bodies` values; zeros from the `there`-th on. Columns are whole blocks.
pub(super) struct Narrow<'a> {
    pub columns: [&'a [f64]; 4],
    pub out: &'a mut [f32],
    pub bodies: usize,
    pub there: usize,
}

impl WithSimd for Narrow<'_> {
    type Output = ();

    /// Plain loops: inlined where the machine's vectors are known, they become vectors by themselves.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "observations are single precision")]
    fn with_simd<S: Simd>(self, _: S) {
        for (column, source) in self.out.chunks_exact_mut(self.bodies.max(1)).zip(self.columns) {
            // What is there, and what pads it: whole vectors where there is room.
            for (cell, value) in column.iter_mut().zip(source) {
                *cell = *value as f32;
            }
            column[self.there.min(self.bodies)..].fill(0.0);
        }
    }
}
