//! Propagates all debris by one step and computes its distances to satellites, in the machine's vector width.
//! Each operation is that of the scalar function in `kernel`, in the same order, so the bits are the same.

use pulp::{Arch, Simd, WithSimd};

use super::body_blocks::{BLOCK_LEN, BodyBlock, BodyBlocks};
use super::constants::{CONTACT_2, EARTH_RADIUS_2, GM, J2_PULL, SATELLITES};
use super::kernel::{Body, Gravity};

/// Rare events of a step, over all bodies together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct StepFlags {
    /// True if some body is inside the Earth.
    pub inside_earth: bool,
    /// True if some body touches a satellite.
    pub contact: bool,
}

/// Advances all bodies by one step of free flight. Contact is checked where the step ends or, if `swept`,
/// within it.
pub(super) fn advance(
    arch: Arch,
    gravity: Gravity,
    swept: bool,
    blocks: &mut [BodyBlock],
    satellites: &[Body; SATELLITES],
) -> StepFlags {
    match (gravity, swept) {
        (Gravity::Point, false) => arch.dispatch(PropagateBlocks::<false, false> { blocks, satellites }),
        (Gravity::Point, true) => arch.dispatch(PropagateBlocks::<false, true> { blocks, satellites }),
        (Gravity::J2, false) => arch.dispatch(PropagateBlocks::<true, false> { blocks, satellites }),
        (Gravity::J2, true) => arch.dispatch(PropagateBlocks::<true, true> { blocks, satellites }),
    }
}

/// Returns true if any body is inside the Earth.
pub(super) fn any_inside_earth(arch: Arch, blocks: &[BodyBlock]) -> bool {
    arch.dispatch(InsideEarthCheck { blocks })
}

/// Returns a bit set of the blocks, at most 128, in which some body touches a satellite at the points of
/// `paths`. The first row of `paths` is the start; each further row is one step later.
pub(super) fn blocks_in_contact(
    gravity: Gravity,
    swept: bool,
    blocks: &[BodyBlock],
    paths: &[[Body; SATELLITES]],
) -> u128 {
    let mut in_contact = 0;
    for_each_min_distance(gravity, swept, blocks, paths, |index, distances_2| {
        in_contact |= u128::from(distances_2.iter().any(|d2| *d2 < CONTACT_2)) << index;
    });
    in_contact
}

/// Least distance, LU, of each body to satellites on these paths. The first row of `paths` is where all
/// start; each further row is one step later. Satellites do not burn. Bodies that fall into the Earth come
/// out again, since callers look for bodies that stay clear of the satellites.
#[must_use]
pub fn min_distances(
    bodies: &[Body],
    paths: &[[Body; SATELLITES]],
    gravity: Gravity,
    swept: bool,
) -> Vec<f64> {
    let mut blocks = BodyBlocks::default();
    blocks.clear(bodies.len());
    bodies.iter().for_each(|body| blocks.push(*body));
    let mut distances = Vec::with_capacity(blocks.blocks().len() * BLOCK_LEN);
    for_each_min_distance(gravity, swept, blocks.blocks(), paths, |_, distances_2| {
        distances.extend(distances_2.iter().map(|d2| d2.sqrt()));
    });
    distances.truncate(bodies.len());
    distances
}

/// Calls `visit` for every block with its index and the least squared distance of each of its bodies to a
/// satellite at the points of `paths`.
fn for_each_min_distance(
    gravity: Gravity,
    swept: bool,
    blocks: &[BodyBlock],
    paths: &[[Body; SATELLITES]],
    visit: impl FnMut(usize, &[f64; BLOCK_LEN]),
) {
    let arch = Arch::new();
    match (gravity, swept) {
        (Gravity::Point, false) => arch.dispatch(MinDistances::<_, false, false> { blocks, paths, visit }),
        (Gravity::Point, true) => arch.dispatch(MinDistances::<_, false, true> { blocks, paths, visit }),
        (Gravity::J2, false) => arch.dispatch(MinDistances::<_, true, false> { blocks, paths, visit }),
        (Gravity::J2, true) => arch.dispatch(MinDistances::<_, true, true> { blocks, paths, visit }),
    }
}

/// Vector form of `kernel::euler_step` (`OBLATE`: with J₂) and of the distance to each satellite (`SWEPT`: of
/// `kernel::min_distance_squared`).
struct PropagateBlocks<'a, const OBLATE: bool, const SWEPT: bool> {
    blocks: &'a mut [BodyBlock],
    satellites: &'a [Body; SATELLITES],
}

impl<const OBLATE: bool, const SWEPT: bool> WithSimd for PropagateBlocks<'_, OBLATE, SWEPT> {
    type Output = StepFlags;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> StepFlags {
        let mut lowest_2 = simd.splat_f64s(f64::MAX);
        let mut nearest_2 = lowest_2;
        // Not `map`: the compiler does not carry the vector instructions through it.
        let [a, b, c] = self.satellites;
        let satellites =
            [SplatSatellite::new(simd, a), SplatSatellite::new(simd, b), SplatSatellite::new(simd, c)];
        for block in self.blocks {
            let (x, y) = (S::as_mut_simd_f64s(&mut block.x).0, S::as_mut_simd_f64s(&mut block.y).0);
            let (vx, vy) = (S::as_mut_simd_f64s(&mut block.vx).0, S::as_mut_simd_f64s(&mut block.vy).0);
            for (((x, y), vx), vy) in x.iter_mut().zip(y).zip(vx).zip(vy) {
                [*x, *y, *vx, *vy] = euler_step::<S, OBLATE>(simd, [*x, *y, *vx, *vy]);
                lowest_2 = simd.min_f64s(lowest_2, norm_squared(simd, *x, *y));
                for satellite in &satellites {
                    let d2 = satellite.distance_squared::<SWEPT>(simd, [*x, *y, *vx, *vy]);
                    nearest_2 = simd.min_f64s(nearest_2, d2);
                }
            }
        }
        StepFlags {
            inside_earth: simd.reduce_min_f64s(lowest_2) < EARTH_RADIUS_2,
            contact: simd.reduce_min_f64s(nearest_2) < CONTACT_2,
        }
    }
}

/// Check of all bodies against the Earth's radius.
struct InsideEarthCheck<'a> {
    blocks: &'a [BodyBlock],
}

impl WithSimd for InsideEarthCheck<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let mut lowest_2 = simd.splat_f64s(f64::MAX);
        for block in self.blocks {
            let (x, y) = (S::as_simd_f64s(&block.x).0, S::as_simd_f64s(&block.y).0);
            for (x, y) in x.iter().zip(y) {
                lowest_2 = simd.min_f64s(lowest_2, norm_squared(simd, *x, *y));
            }
        }
        simd.reduce_min_f64s(lowest_2) < EARTH_RADIUS_2
    }
}

/// Least squared distances along paths of the satellites, block by block.
struct MinDistances<'a, F, const OBLATE: bool, const SWEPT: bool> {
    blocks: &'a [BodyBlock],
    paths: &'a [[Body; SATELLITES]],
    visit: F,
}

impl<F: FnMut(usize, &[f64; BLOCK_LEN]), const OBLATE: bool, const SWEPT: bool> WithSimd
    for MinDistances<'_, F, OBLATE, SWEPT>
{
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        for (index, block) in self.blocks.iter().enumerate() {
            let (x, y) = (S::as_simd_f64s(&block.x).0, S::as_simd_f64s(&block.y).0);
            let (vx, vy) = (S::as_simd_f64s(&block.vx).0, S::as_simd_f64s(&block.vy).0);
            let mut distances_2 = [f64::MAX; BLOCK_LEN];
            let out = S::as_mut_simd_f64s(&mut distances_2).0;
            for ((((x, y), vx), vy), out) in x.iter().zip(y).zip(vx).zip(vy).zip(out) {
                let mut nearest_2 = simd.splat_f64s(f64::MAX);
                let mut body = [*x, *y, *vx, *vy];
                for (step, satellites) in self.paths.iter().enumerate() {
                    if step > 0 {
                        body = euler_step::<S, OBLATE>(simd, body);
                    }
                    for satellite in satellites {
                        let satellite = SplatSatellite::new(simd, satellite);
                        let d2 = if SWEPT && step > 0 {
                            satellite.distance_squared::<true>(simd, body)
                        } else {
                            satellite.distance_squared::<false>(simd, body)
                        };
                        nearest_2 = simd.min_f64s(nearest_2, d2);
                    }
                }
                *out = nearest_2;
            }
            (self.visit)(index, &distances_2);
        }
    }
}

/// State of one satellite in every lane.
#[derive(Clone, Copy)]
struct SplatSatellite<S: Simd> {
    x: S::f64s,
    y: S::f64s,
    vx: S::f64s,
    vy: S::f64s,
}

impl<S: Simd> SplatSatellite<S> {
    #[inline(always)]
    fn new(simd: S, body: &Body) -> Self {
        Self {
            x: simd.splat_f64s(body.x),
            y: simd.splat_f64s(body.y),
            vx: simd.splat_f64s(body.vx),
            vy: simd.splat_f64s(body.vy),
        }
    }

    /// Squared distance to bodies (x, y, vx, vy) at the end of the step or, if `SWEPT`, the least one within
    /// it.
    #[inline(always)]
    fn distance_squared<const SWEPT: bool>(&self, simd: S, body: [S::f64s; 4]) -> S::f64s {
        let [x, y, vx, vy] = body;
        let (dx, dy) = (simd.sub_f64s(self.x, x), simd.sub_f64s(self.y, y));
        if !SWEPT {
            return norm_squared(simd, dx, dy);
        }
        let (wx, wy) = (simd.sub_f64s(self.vx, vx), simd.sub_f64s(self.vy, vy));
        let along = simd.add_f64s(simd.mul_f64s(dx, wx), simd.mul_f64s(dy, wy));
        let speed_2 = simd.max_f64s(norm_squared(simd, wx, wy), simd.splat_f64s(f64::MIN_POSITIVE));
        let back = simd.div_f64s(along, speed_2);
        let back = simd.min_f64s(simd.max_f64s(back, simd.splat_f64s(0.0)), simd.splat_f64s(1.0));
        let (mx, my) =
            (simd.sub_f64s(dx, simd.mul_f64s(wx, back)), simd.sub_f64s(dy, simd.mul_f64s(wy, back)));
        norm_squared(simd, mx, my)
    }
}

/// One step of free flight of the columns x, y, vx, vy.
#[inline(always)]
fn euler_step<S: Simd, const OBLATE: bool>(simd: S, [x, y, vx, vy]: [S::f64s; 4]) -> [S::f64s; 4] {
    let r2 = norm_squared(simd, x, y);
    let mut k = simd.div_f64s(simd.splat_f64s(GM), simd.mul_f64s(r2, simd.sqrt_f64s(r2)));
    if OBLATE {
        let oblate = simd.div_f64s(simd.splat_f64s(J2_PULL), r2);
        k = simd.mul_f64s(k, simd.add_f64s(simd.splat_f64s(1.0), oblate));
    }
    let (vx, vy) = (simd.sub_f64s(vx, simd.mul_f64s(k, x)), simd.sub_f64s(vy, simd.mul_f64s(k, y)));
    [simd.add_f64s(x, vx), simd.add_f64s(y, vy), vx, vy]
}

/// Squared norm x² + y².
#[inline(always)]
fn norm_squared<S: Simd>(simd: S, x: S::f64s, y: S::f64s) -> S::f64s {
    simd.add_f64s(simd.mul_f64s(x, x), simd.mul_f64s(y, y))
}
