//! The passes over debris, in the machine's vector width.

use pulp::{Arch, Simd, WithSimd};

use super::cloud::{BLOCK, Block};
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

/// One step of free flight of all, and whether anything rare happened: where the step ends or (`swept`) within it.
pub(super) fn advance(
    arch: Arch,
    gravity: Gravity,
    swept: bool,
    blocks: &mut [Block],
    satellites: &[Body; SATELLITES],
) -> Found {
    match (gravity, swept) {
        (Gravity::Point, false) => arch.dispatch(Pass::<false, false> { blocks, satellites }),
        (Gravity::Point, true) => arch.dispatch(Pass::<false, true> { blocks, satellites }),
        (Gravity::J2, false) => arch.dispatch(Pass::<true, false> { blocks, satellites }),
        (Gravity::J2, true) => arch.dispatch(Pass::<true, true> { blocks, satellites }),
    }
}

/// The arithmetic of `kernel::coast` (`OBLATE`: with J₂) and of distance (`SWEPT`: of `kernel::swept_2`), operation by
/// operation.
struct Pass<'a, const OBLATE: bool, const SWEPT: bool> {
    blocks: &'a mut [Block],
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
        let mut lowest = simd.splat_f64s(f64::MAX);
        let mut nearest = lowest;
        // Not `map`: the compiler does not carry the vector instructions through it.
        let [a, b, c] = self.satellites;
        let satellites = [Splat::of(simd, a), Splat::of(simd, b), Splat::of(simd, c)];
        for block in self.blocks {
            let (x, y) = (S::as_mut_simd_f64s(&mut block.x).0, S::as_mut_simd_f64s(&mut block.y).0);
            let (vx, vy) = (S::as_mut_simd_f64s(&mut block.vx).0, S::as_mut_simd_f64s(&mut block.vy).0);
            for (((x, y), vx), vy) in x.iter_mut().zip(y).zip(vx).zip(vy) {
                [*x, *y, *vx, *vy] = coasted::<S, OBLATE>(simd, [*x, *y, *vx, *vy]);
                lowest = simd.min_f64s(lowest, square(simd, *x, *y));
                for satellite in &satellites {
                    nearest = simd.min_f64s(nearest, satellite.distance_2::<SWEPT>(simd, [*x, *y, *vx, *vy]));
                }
            }
        }
        Found {
            inside: simd.reduce_min_f64s(lowest) < EARTH_RADIUS_2,
            touched: simd.reduce_min_f64s(nearest) < CONTACT_2,
        }
    }
}

/// Whether any body is inside the Earth.
pub(super) fn inside(arch: Arch, blocks: &[Block]) -> bool {
    arch.dispatch(Inside { blocks })
}

struct Inside<'a> {
    blocks: &'a [Block],
}

impl WithSimd for Inside<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let mut lowest = simd.splat_f64s(f64::MAX);
        for block in self.blocks {
            let (x, y) = (S::as_simd_f64s(&block.x).0, S::as_simd_f64s(&block.y).0);
            for (x, y) in x.iter().zip(y) {
                lowest = simd.min_f64s(lowest, square(simd, *x, *y));
            }
        }
        simd.reduce_min_f64s(lowest) < EARTH_RADIUS_2
    }
}

/// Which blocks of [`BLOCK`] bodies have one that touches a satellite at the points of these paths, at most 128 of them:
/// the first where everything starts, then step by step.
pub(super) fn early(gravity: Gravity, swept: bool, blocks: &[Block], paths: &[[Body; SATELLITES]]) -> u128 {
    let mut found = 0;
    nearest(gravity, swept, blocks, paths, |number, nearest_2| {
        found |= u128::from(nearest_2.iter().any(|d2| *d2 < CONTACT_2)) << number;
    });
    found
}

/// Tells of every block how near, squared, each of its bodies comes to a satellite at the points of these paths: the first
/// where everything starts, then step by step.
pub(super) fn nearest(
    gravity: Gravity,
    swept: bool,
    blocks: &[Block],
    paths: &[[Body; SATELLITES]],
    tell: impl FnMut(usize, &[f64; BLOCK]),
) {
    let arch = Arch::new();
    match (gravity, swept) {
        (Gravity::Point, false) => arch.dispatch(Nearest::<_, false, false> { blocks, paths, tell }),
        (Gravity::Point, true) => arch.dispatch(Nearest::<_, false, true> { blocks, paths, tell }),
        (Gravity::J2, false) => arch.dispatch(Nearest::<_, true, false> { blocks, paths, tell }),
        (Gravity::J2, true) => arch.dispatch(Nearest::<_, true, true> { blocks, paths, tell }),
    }
}

struct Nearest<'a, F, const OBLATE: bool, const SWEPT: bool> {
    blocks: &'a [Block],
    paths: &'a [[Body; SATELLITES]],
    tell: F,
}

impl<F: FnMut(usize, &[f64; BLOCK]), const OBLATE: bool, const SWEPT: bool> WithSimd
    for Nearest<'_, F, OBLATE, SWEPT>
{
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        for (number, block) in self.blocks.iter().enumerate() {
            let (x, y) = (S::as_simd_f64s(&block.x).0, S::as_simd_f64s(&block.y).0);
            let (vx, vy) = (S::as_simd_f64s(&block.vx).0, S::as_simd_f64s(&block.vy).0);
            let mut all = [f64::MAX; BLOCK];
            let out = S::as_mut_simd_f64s(&mut all).0;
            for ((((x, y), vx), vy), out) in x.iter().zip(y).zip(vx).zip(vy).zip(out) {
                let mut nearest = simd.splat_f64s(f64::MAX);
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
                *out = nearest;
            }
            (self.tell)(number, &all);
        }
    }
}

/// What is seen of bodies, one column of `bodies` values after the other: x, y, vx, vy rounded to f32, and one where there
/// is a body. Zeros from the `there`-th on.
pub(super) struct Narrow<'a> {
    pub blocks: &'a [Block],
    pub out: &'a mut [f32],
    pub bodies: usize,
    pub there: usize,
}

impl WithSimd for Narrow<'_> {
    type Output = ();

    /// Plain loops over blocks of a fixed size: inlined where the machine's vectors are known, they become vectors by
    /// themselves. Column after column, so that memory is written as one stream.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Narrow { blocks, out, bodies, there } = self;
        column::<0>(blocks, out, bodies, there);
        column::<1>(blocks, &mut out[bodies..], bodies, there);
        column::<2>(blocks, &mut out[2 * bodies..], bodies, there);
        column::<3>(blocks, &mut out[3 * bodies..], bodies, there);
        for (i, cell) in out[4 * bodies..].iter_mut().enumerate() {
            *cell = if i < there { 1.0 } else { 0.0 };
        }
    }
}

/// One column, to the front of `out`. What comes after it may be written over: columns are written in order.
#[inline(always)]
fn column<const C: usize>(blocks: &[Block], out: &mut [f32], bodies: usize, there: usize) {
    let whole = there / BLOCK;
    let (cells, _) = out[..bodies].as_chunks_mut::<BLOCK>();
    for (cells, block) in cells.iter_mut().zip(&blocks[..whole]) {
        *cells = narrow(block.column::<C>());
    }
    for from in (whole * BLOCK..bodies).step_by(BLOCK) {
        let mut cells = blocks.get(from / BLOCK).map_or([0.0; BLOCK], |block| narrow(block.column::<C>()));
        for (i, cell) in cells.iter_mut().enumerate() {
            *cell = if from + i < there { *cell } else { 0.0 };
        }
        if let Some(room) = out[from..].first_chunk_mut() {
            *room = cells;
        } else {
            out[from..].iter_mut().zip(cells).for_each(|(to, cell)| *to = cell);
        }
    }
}

#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "observations are single precision")]
fn narrow(from: &[f64; BLOCK]) -> [f32; BLOCK] {
    let mut to = [0.0; BLOCK];
    for i in 0..BLOCK {
        to[i] = from[i] as f32;
    }
    to
}
