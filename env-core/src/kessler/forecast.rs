//! How near debris comes to satellites that hold, by the episode's own dynamics: all bodies of a vector at once, foreseen step
//! by step without leaving the registers. To keep what was foreseen for the step after is no faster: it would have to come
//! from memory, and that takes longer than to foresee it again.
//!
//! Single precision, as what is told of it: twice as many bodies a vector. Fifteen steps ahead the places are off by some
//! 1e-5 LU for that, where a contact is 2 LU. Only `+ − × ÷ √`, body by body in the same order whatever the machine's vectors:
//! the bits are the same on all.

use pulp::{Arch, Simd, WithSimd};

use super::cloud::{BLOCK, Block};
use super::constants::{EARTH_RADIUS_2, GM, HORIZON, J2_PULL, SATELLITES};
use super::debris::Debris;
use super::kernel::{Body, Gravity, coast};
use super::setup::Physics;

/// Bodies that are looked at together: the widest vectors of today hold sixteen f32.
const WIDE: usize = 2 * BLOCK;

/// How near each piece of debris comes to one satellite, by index; what is beyond the number of pieces says nothing.
#[derive(Debug, Clone, Default)]
pub(super) struct Nearest {
    /// Least distance squared within the look-ahead, LU².
    pub distance_2: Vec<f32>,
    /// When, TU from now.
    pub time: Vec<f32>,
}

/// Where satellites are after a step.
type Places = [(f32, f32); SATELLITES];

/// Who is not there: no distance from it is less than another.
const NOWHERE: (f32, f32) = (f32::NAN, f32::NAN);

/// How near everything comes, within so many steps, to each of these satellites, which hold from here; nothing is said of
/// those that do not fly.
pub(super) fn nearest(
    arch: Arch,
    (debris, physics): (&Debris, Physics),
    (satellites, look_ahead): ([Option<Body>; SATELLITES], usize),
    found: &mut [Nearest; SATELLITES],
) {
    let blocks = debris.blocks();
    for column in found.iter_mut().flat_map(|found| [&mut found.distance_2, &mut found.time]) {
        // As much room as the episode has, so that arrivals need none.
        column.reserve((debris.capacity() + WIDE).saturating_sub(column.len()));
        column.resize(blocks.len().div_ceil(2) * WIDE, 0.0);
    }
    let mut paths = [[NOWHERE; SATELLITES]; HORIZON as usize + 1];
    let paths = &mut paths[..=look_ahead];
    let upstream = physics.upstream;
    match physics.gravity {
        Gravity::Point => {
            let holding = Holding::<false>::new(satellites);
            arch.dispatch(Approaches { blocks, holding, paths, upstream, found });
        }
        Gravity::J2 => {
            let holding = Holding::<true>::new(satellites);
            arch.dispatch(Approaches { blocks, holding, paths, upstream, found });
        }
    }
}

/// Satellites that hold, step by step.
struct Holding<const OBLATE: bool>([Body; SATELLITES]);

impl<const OBLATE: bool> Holding<OBLATE> {
    fn new(satellites: [Option<Body>; SATELLITES]) -> Self {
        let nowhere = Body { x: f64::NAN, y: f64::NAN, vx: 0.0, vy: 0.0 };
        Self(satellites.map(|body| body.unwrap_or(nowhere)))
    }

    /// Where they are, and a step further.
    #[inline(always)]
    fn step(&mut self) -> Places {
        let mut places = [NOWHERE; SATELLITES];
        for (place, body) in places.iter_mut().zip(&mut self.0) {
            *place = (single(body.x), single(body.y));
            // What falls into the Earth is nowhere from then on.
            body.x = if body.radius_2() < EARTH_RADIUS_2 { f64::NAN } else { body.x };
            coast::<OBLATE>(&mut body.x, &mut body.y, &mut body.vx, &mut body.vy);
        }
        places
    }
}

#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "what is foreseen is in single precision")]
const fn single(value: f64) -> f32 {
    value as f32
}

/// Sixteen bodies, column by column: x, y, vx, vy.
#[inline(always)]
fn columns(blocks: &[Block]) -> [[f32; WIDE]; 4] {
    let mut columns = [[NOWHERE.0; WIDE]; 4];
    for (half, block) in blocks.iter().take(2).enumerate() {
        let [x, y, vx, vy] = &mut columns;
        for i in 0..BLOCK {
            x[half * BLOCK + i] = single(block.x[i]);
            y[half * BLOCK + i] = single(block.y[i]);
            vx[half * BLOCK + i] = single(block.vx[i]);
            vy[half * BLOCK + i] = single(block.vy[i]);
        }
    }
    columns
}

/// One step, as `debris_moved` has it: what is inside the Earth is gone, or (`upstream`) frozen.
#[inline(always)]
fn followed<S: Simd, const OBLATE: bool>(simd: S, at: [S::f32s; 4], upstream: bool) -> [S::f32s; 4] {
    let [x, y, vx, vy] = at;
    let r2 = dot(simd, (x, y), (x, y));
    let inside = simd.less_than_f32s(r2, simd.splat_f32s(single(EARTH_RADIUS_2)));
    let mut k = simd.div_f32s(simd.splat_f32s(single(GM)), simd.mul_f32s(r2, simd.sqrt_f32s(r2)));
    if OBLATE {
        let oblate = simd.div_f32s(simd.splat_f32s(single(J2_PULL)), r2);
        k = simd.mul_f32s(k, simd.add_f32s(simd.splat_f32s(1.0), oblate));
    }
    let (vx, vy) = (simd.sub_f32s(vx, simd.mul_f32s(k, x)), simd.sub_f32s(vy, simd.mul_f32s(k, y)));
    let (nowhere, still) = (simd.splat_f32s(NOWHERE.0), simd.splat_f32s(0.0));
    let (gone_x, gone_y) = if upstream { (x, y) } else { (nowhere, nowhere) };
    [
        simd.select_f32s(inside, gone_x, simd.add_f32s(x, vx)),
        simd.select_f32s(inside, gone_y, simd.add_f32s(y, vy)),
        simd.select_f32s(inside, still, vx),
        simd.select_f32s(inside, still, vy),
    ]
}

/// Closest approaches of everything to satellites on their paths.
///
/// In a step both move on straight lines, from one place to the next. So where they are nearest is one of these places, or
/// within a step that begins with them closing and ends with them parting: there it is the distance from a line,
/// |d × w| / |w|. Distances are compared as fractions, and divided once, at the end: dividing would be most of the work.
///
/// A type of its own, since a closure is not compiled for the vectors that [`Arch`] finds.
struct Approaches<'a, const OBLATE: bool> {
    blocks: &'a [Block],
    holding: Holding<OBLATE>,
    /// Room for where the satellites are now, then after each step.
    paths: &'a mut [Places],
    upstream: bool,
    found: &'a mut [Nearest; SATELLITES],
}

impl<const OBLATE: bool> WithSimd for Approaches<'_, OBLATE> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { blocks, mut holding, paths, upstream, found } = self;
        for (number, pair) in blocks.chunks(2).enumerate() {
            let columns = columns(pair);
            // A machine's vectors may be a part of it.
            for lane in 0..WIDE / S::F32_LANES {
                let [x, y, vx, vy] = &columns;
                let at = [
                    S::as_simd_f32s(x).0[lane],
                    S::as_simd_f32s(y).0[lane],
                    S::as_simd_f32s(vx).0[lane],
                    S::as_simd_f32s(vy).0[lane],
                ];
                // The satellites' paths are found beside the first approaches: in both each step waits for the one before it.
                let nearest = if number == 0 && lane == 0 {
                    approach::<S, OBLATE>(
                        simd,
                        (at, upstream),
                        paths.iter_mut().map(|places| {
                            *places = holding.step();
                            *places
                        }),
                    )
                } else {
                    approach::<S, OBLATE>(simd, (at, upstream), paths.iter().copied())
                };
                let from = number * WIDE + lane * S::F32_LANES;
                for s in 0..SATELLITES {
                    let Fraction { above, below, along, end } = nearest[s];
                    let put = |column: &mut [f32], cells| {
                        S::as_mut_simd_f32s(&mut column[from..from + S::F32_LANES]).0[0] = cells;
                    };
                    put(&mut found[s].distance_2, simd.div_f32s(above, below));
                    put(&mut found[s].time, simd.sub_f32s(end, simd.div_f32s(along, below)));
                }
            }
        }
    }
}

/// A least distance squared, `above`/`below`, and when: `along`/`below` before `end`.
#[derive(Clone, Copy)]
struct Fraction<S: Simd> {
    above: S::f32s,
    below: S::f32s,
    along: S::f32s,
    end: S::f32s,
}

/// Least distances of some bodies to each satellite.
#[inline(always)]
fn approach<S: Simd, const OBLATE: bool>(
    simd: S,
    (mut at, upstream): ([S::f32s; 4], bool),
    mut paths: impl Iterator<Item = Places>,
) -> [Fraction<S>; SATELLITES] {
    let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
    let far = simd.splat_f32s(f32::INFINITY);
    let mut nearest = [Fraction { above: far, below: one, along: zero, end: zero }; SATELLITES];
    let mut before = [(zero, zero); SATELLITES];
    let now = paths.next().unwrap_or([NOWHERE; SATELLITES]);
    for s in 0..SATELLITES {
        before[s] = seen(simd, now[s], at);
        nearest[s].above = dot(simd, before[s], before[s]);
    }
    let mut end = zero;
    for places in paths {
        at = followed::<S, OBLATE>(simd, at, upstream);
        end = simd.add_f32s(end, one);
        for s in 0..SATELLITES {
            let (dx, dy) = seen(simd, places[s], at);
            let (wx, wy) = (simd.sub_f32s(dx, before[s].0), simd.sub_f32s(dy, before[s].1));
            before[s] = (dx, dy);
            let (along, moving) = (dot(simd, (dx, dy), (wx, wy)), dot(simd, (wx, wy), (wx, wy)));
            let turns = simd.and_m32s(simd.less_than_f32s(zero, along), simd.less_than_f32s(along, moving));
            let beside = simd.sub_f32s(simd.mul_f32s(dx, wy), simd.mul_f32s(dy, wx));
            let there = dot(simd, (dx, dy), (dx, dy));
            let above = simd.select_f32s(turns, simd.mul_f32s(beside, beside), there);
            let below = simd.select_f32s(turns, moving, one);
            let known = &mut nearest[s];
            let nearer =
                simd.less_than_f32s(simd.mul_f32s(above, known.below), simd.mul_f32s(known.above, below));
            known.above = simd.select_f32s(nearer, above, known.above);
            known.below = simd.select_f32s(nearer, below, known.below);
            known.along = simd.select_f32s(nearer, simd.select_f32s(turns, along, zero), known.along);
            known.end = simd.select_f32s(nearer, end, known.end);
        }
    }
    nearest
}

/// Where a satellite is, seen from bodies.
#[inline(always)]
fn seen<S: Simd>(simd: S, (x, y): (f32, f32), at: [S::f32s; 4]) -> (S::f32s, S::f32s) {
    (simd.sub_f32s(simd.splat_f32s(x), at[0]), simd.sub_f32s(simd.splat_f32s(y), at[1]))
}

#[inline(always)]
fn dot<S: Simd>(simd: S, a: (S::f32s, S::f32s), b: (S::f32s, S::f32s)) -> S::f32s {
    simd.add_f32s(simd.mul_f32s(a.0, b.0), simd.mul_f32s(a.1, b.1))
}
