//! Initial debris: turns random draws into bodies on circular orbits, in the machine's vector
//! width.

use std::f64::consts::TAU;

use pulp::{Arch, Simd, WithSimd};

use super::body_blocks::{BLOCK_LEN, BodyBlock, BodyBlocks};
use super::constants::{DEBRIS_RADII, GM};
use super::kernel::Body;
use crate::episode_rng::{EpisodeRng, RngStream};

/// Draws per body, each uniform in [0, 1): radius, angle, and both velocity offsets.
pub(super) const DRAWS_PER_BODY: usize = 4;

/// Builds a body from its draws: on a circular prograde orbit at a radius in [`DEBRIS_RADII`], with each
/// velocity component changed by U(−spread, spread), LU/TU.
pub(super) fn body_from_draws([radius, angle, vx, vy]: [f64; DRAWS_PER_BODY], spread: f64) -> Body {
    let radius = DEBRIS_RADII.0 + (DEBRIS_RADII.1 - DEBRIS_RADII.0) * radius;
    let mut body = Body::circular(radius, TAU * angle, 1.0);
    body.vx += (-1.0 + 2.0 * vx) * spread;
    body.vy += (-1.0 + 2.0 * vy) * spread;
    body
}

/// Draws `count` bodies and appends them to `blocks`. Each has the bits that [`body_from_draws`] gives for
/// its draws.
pub(super) fn draw_bodies(rng: &mut impl EpisodeRng, spread: f64, count: usize, blocks: &mut BodyBlocks) {
    let arch = Arch::new();
    let mut draws = [0.5; BLOCK_LEN * DRAWS_PER_BODY];
    for first in (0..count).step_by(BLOCK_LEN) {
        let drawn = BLOCK_LEN.min(count - first);
        rng.fill(RngStream::Bodies, &mut draws[..drawn * DRAWS_PER_BODY]);
        blocks.push_block(arch.dispatch(BlockFromDraws { draws: &draws, spread }), drawn);
    }
}

/// Builds one block of bodies from its draws.
struct BlockFromDraws<'a> {
    draws: &'a [f64; BLOCK_LEN * DRAWS_PER_BODY],
    spread: f64,
}

impl WithSimd for BlockFromDraws<'_> {
    type Output = BodyBlock;

    #[inline(always)]
    fn with_simd<S: Simd>(self, v: S) -> BodyBlock {
        let ((low, high), spread) = (DEBRIS_RADII, v.splat_f64s(self.spread));
        let (low, width) = (v.splat_f64s(low), v.splat_f64s(high - low));
        let (minus_one, two) = (v.splat_f64s(-1.0), v.splat_f64s(2.0));
        let mut block = BodyBlock::EMPTY;
        for (i, draw) in self.draws.as_chunks::<DRAWS_PER_BODY>().0.iter().enumerate() {
            [block.x[i], block.y[i], block.vx[i], block.vy[i]] = *draw;
        }
        let mut exact = true;
        let (xs, ys) = (S::as_mut_simd_f64s(&mut block.x).0, S::as_mut_simd_f64s(&mut block.y).0);
        let (vxs, vys) = (S::as_mut_simd_f64s(&mut block.vx).0, S::as_mut_simd_f64s(&mut block.vy).0);
        for (((x, y), vx), vy) in xs.iter_mut().zip(ys).zip(vxs).zip(vys) {
            let radius = v.add_f64s(low, v.mul_f64s(width, *x));
            let angle = sin_cos(v, v.mul_f64s(v.splat_f64s(TAU), *y));
            exact &= angle.exact;
            let speed = v.sqrt_f64s(v.div_f64s(v.splat_f64s(GM), radius));
            let off_x = mul(v, add(v, minus_one, mul(v, two, *vx)), spread);
            let off_y = mul(v, add(v, minus_one, mul(v, two, *vy)), spread);
            *x = v.mul_f64s(radius, angle.cos);
            *y = v.mul_f64s(radius, angle.sin);
            *vx = v.add_f64s(v.mul_f64s(v.neg_f64s(speed), angle.sin), off_x);
            *vy = v.add_f64s(v.mul_f64s(speed, angle.cos), off_y);
        }
        if !exact {
            for (i, draw) in self.draws.as_chunks::<DRAWS_PER_BODY>().0.iter().enumerate() {
                block.set(i, body_from_draws(*draw, self.spread));
            }
        }
        block
    }
}

/// Sine and cosine of several angles. `exact` is false if some angle is so near a multiple of π/2 that its
/// reduction needs more digits; the caller then uses the scalar function.
struct SinCos<S: Simd> {
    sin: S::f64s,
    cos: S::f64s,
    exact: bool,
}

/// Returns the f64 whose upper 32 bits are `word` and whose lower bits are zero.
const fn high(word: u64) -> f64 {
    f64::from_bits(word << 32)
}

/// First 33 bits of π/2.
const PIO2_1: f64 = f64::from_bits(0x3FF9_21FB_5440_0000);
/// Rest of π/2 after [`PIO2_1`].
const PIO2_1T: f64 = f64::from_bits(0x3DD0_B461_1A62_6331);
/// Angles from which the nearest multiple of π/2 is the first, second, third and fourth.
const QUADRANT_EDGES: [f64; 4] = [high(0x3fe9_21fc), high(0x4002_d97d), high(0x400f_6a7b), high(0x4015_fdbd)];
/// Upper halves of the angles whose reduction needs more digits.
const INEXACT_WORDS: [u64; 4] = [0x3ff9_21fb, 0x4009_21fb, 0x4012_d97c, 0x4019_21fb];
/// Angle below which the sine is the angle itself.
const TINY_ANGLE: f64 = high(0x3e46_a09e);
/// Coefficients of the sine polynomial of `k_sin`.
const SIN_POLY: [f64; 6] = [
    f64::from_bits(0xBFC5_5555_5555_5549),
    f64::from_bits(0x3F81_1111_1110_F8A6),
    f64::from_bits(0xBF2A_01A0_19C1_61D5),
    f64::from_bits(0x3EC7_1DE3_57B1_FE7D),
    f64::from_bits(0xBE5A_E5E6_8A2B_9CEB),
    f64::from_bits(0x3DE5_D93A_5ACF_D57C),
];
/// Coefficients of the cosine polynomial of `k_cos`.
const COS_POLY: [f64; 6] = [
    f64::from_bits(0x3FA5_5555_5555_554C),
    f64::from_bits(0xBF56_C16C_16C1_5177),
    f64::from_bits(0x3EFA_01A0_19CB_1590),
    f64::from_bits(0xBE92_7E4F_809C_52AD),
    f64::from_bits(0x3E21_EE9E_BDB4_B1C4),
    f64::from_bits(0xBDA8_FAE9_BE88_38D4),
];

/// Sine and cosine in [0, 2π), operation by operation those of `libm::sincos` (FreeBSD's `k_sin`,
/// `k_cos` and the short cases of `rem_pio2`; Ng, *Argument reduction for huge arguments*, 1992).
/// The bits are the same; a test checks that.
#[inline(always)]
fn sin_cos<V: Simd>(v: V, x: V::f64s) -> SinCos<V> {
    let mut n = v.splat_f64s(0.0);
    let mut number = 0.0;
    for at in QUADRANT_EDGES {
        number += 1.0;
        n = v.select_f64s(v.greater_than_or_equal_f64s(x, v.splat_f64s(at)), v.splat_f64s(number), n);
    }
    let mut inexact = v.less_than_f64s(x, v.splat_f64s(TINY_ANGLE));
    for word in INEXACT_WORDS {
        let from = v.greater_than_or_equal_f64s(x, v.splat_f64s(high(word)));
        let below = v.less_than_f64s(x, v.splat_f64s(high(word + 1)));
        inexact = v.or_m64s(inexact, v.and_m64s(from, below));
    }
    // Reduced angle: x − n·π/2 = y + t.
    let (head, tail) = (mul(v, n, v.splat_f64s(PIO2_1)), mul(v, n, v.splat_f64s(PIO2_1T)));
    let r = v.sub_f64s(x, head);
    let y = v.sub_f64s(r, tail);
    let t = v.sub_f64s(v.sub_f64s(r, y), tail);
    let first = v.equal_f64s(n, v.splat_f64s(1.0));
    let second = v.equal_f64s(n, v.splat_f64s(2.0));
    let third = v.equal_f64s(n, v.splat_f64s(3.0));
    let whole = v.equal_f64s(n, v.splat_f64s(0.0));
    let (s, c) = (sine(v, y, t, whole), cosine(v, y, t));
    let odd = v.or_m64s(first, third);
    let (sin, cos) = (v.select_f64s(odd, c, s), v.select_f64s(odd, s, c));
    let down = v.or_m64s(second, third);
    let left = v.or_m64s(first, second);
    SinCos {
        sin: v.select_f64s(down, v.neg_f64s(sin), sin),
        cos: v.select_f64s(left, v.neg_f64s(cos), cos),
        exact: v.first_true_m64s(inexact) >= V::F64_LANES,
    }
}

#[inline(always)]
fn add<V: Simd>(v: V, a: V::f64s, b: V::f64s) -> V::f64s {
    v.add_f64s(a, b)
}

#[inline(always)]
fn sub<V: Simd>(v: V, a: V::f64s, b: V::f64s) -> V::f64s {
    v.sub_f64s(a, b)
}

#[inline(always)]
fn mul<V: Simd>(v: V, a: V::f64s, b: V::f64s) -> V::f64s {
    v.mul_f64s(a, b)
}

/// Returns a + z·b.
#[inline(always)]
fn horner<V: Simd>(v: V, a: f64, z: V::f64s, b: V::f64s) -> V::f64s {
    v.add_f64s(v.splat_f64s(a), v.mul_f64s(z, b))
}

/// `k_sin` of y + t, or of y alone if the angle was not reduced (`whole`).
#[inline(always)]
fn sine<V: Simd>(v: V, y: V::f64s, t: V::f64s, whole: V::m64s) -> V::f64s {
    let z = mul(v, y, y);
    let w = mul(v, z, z);
    let near = horner(v, SIN_POLY[1], z, horner(v, SIN_POLY[2], z, v.splat_f64s(SIN_POLY[3])));
    let far = mul(v, mul(v, z, w), horner(v, SIN_POLY[4], z, v.splat_f64s(SIN_POLY[5])));
    let r = add(v, near, far);
    let zy = mul(v, z, y);
    let alone = add(v, y, mul(v, zy, horner(v, SIN_POLY[0], z, r)));
    let half = sub(v, mul(v, v.splat_f64s(0.5), t), mul(v, zy, r));
    let first = mul(v, zy, v.splat_f64s(SIN_POLY[0]));
    let reduced = sub(v, y, sub(v, sub(v, mul(v, z, half), t), first));
    v.select_f64s(whole, alone, reduced)
}

/// `k_cos` of y + t.
#[inline(always)]
fn cosine<V: Simd>(v: V, y: V::f64s, t: V::f64s) -> V::f64s {
    let actual = v.splat_f64s(1.0);
    let z = mul(v, y, y);
    let w = mul(v, z, z);
    let near = mul(v, z, horner(v, COS_POLY[0], z, horner(v, COS_POLY[1], z, v.splat_f64s(COS_POLY[2]))));
    let far =
        mul(v, mul(v, w, w), horner(v, COS_POLY[3], z, horner(v, COS_POLY[4], z, v.splat_f64s(COS_POLY[5]))));
    let r = add(v, near, far);
    let half = mul(v, v.splat_f64s(0.5), z);
    let w = sub(v, actual, half);
    let rest = sub(v, mul(v, z, r), mul(v, y, t));
    add(v, w, add(v, sub(v, sub(v, actual, w), half), rest))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::episode_rng::{ScriptedRng, SeededRng};
    use crate::seed::Seed;

    /// A million random bodies have the bits of the scalar formula, and so have angles on both
    /// sides of every case of the reduction.
    #[test]
    fn validate_libm_vector_bodies_equal_scalar_bodies() {
        let mut seeded = SeededRng::new(Seed::user(9).unwrap());
        let mut draws = vec![0.0; DRAWS_PER_BODY * 1_000_000];
        seeded.fill(RngStream::Bodies, &mut draws);
        for word in QUADRANT_EDGES.into_iter().chain(INEXACT_WORDS.map(high)).chain([TINY_ANGLE, 0.0]) {
            for bits in -3i64..4 {
                let angle = f64::from_bits(word.to_bits().saturating_add_signed(bits));
                for near in [angle, angle * (1.0 + 1e-9), angle * (1.0 - 1e-7)] {
                    draws.extend_from_slice(&[0.3, (near / TAU).clamp(0.0, 1.0 - f64::EPSILON), 0.1, 0.9]);
                }
            }
        }
        let mut scripted = ScriptedRng::new();
        for &draw in &draws {
            scripted.push_draw(RngStream::Bodies, draw);
        }
        let mut blocks = BodyBlocks::default();
        draw_bodies(&mut scripted, 0.7, draws.len() / DRAWS_PER_BODY, &mut blocks);
        assert_eq!((blocks.len(), scripted.missing_draws()), (draws.len() / DRAWS_PER_BODY, 0));
        for (actual, draw) in blocks.bodies().zip(draws.as_chunks::<DRAWS_PER_BODY>().0) {
            let expected = body_from_draws(*draw, 0.7);
            let bits = |b: &Body| [b.x, b.y, b.vx, b.vy].map(f64::to_bits);
            assert_eq!(bits(&actual), bits(&expected), "{draw:?}");
        }
    }
}
