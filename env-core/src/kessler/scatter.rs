//! Where debris starts: from draws to bodies on circular orbits, in the machine's vector width.

use pulp::{Arch, Simd, WithSimd};

use super::cloud::{BLOCK, Block, Cloud};
use super::constants::{DEBRIS_RADII, GM};
use super::kernel::Body;
use crate::chance::{Chance, Stream};

const TAU: f64 = std::f64::consts::TAU;

/// Four draws a body, each uniform in [0, 1): radius, angle, and both velocity offsets.
pub(super) const DRAWS: usize = 4;

/// The body of four draws: at a radius of [`DEBRIS_RADII`] on the circular prograde orbit, each component of its velocity
/// off by U(−spread, spread).
pub(super) fn body([radius, angle, vx, vy]: [f64; DRAWS], spread: f64) -> Body {
    let radius = DEBRIS_RADII.0 + (DEBRIS_RADII.1 - DEBRIS_RADII.0) * radius;
    let mut body = Body::circular(radius, TAU * angle, 1.0);
    body.vx += (-1.0 + 2.0 * vx) * spread;
    body.vy += (-1.0 + 2.0 * vy) * spread;
    body
}

/// Draws so many bodies into a cloud: to the bit what [`body`] makes of each body's draws.
pub(super) fn bodies(chance: &mut impl Chance, spread: f64, count: usize, cloud: &mut Cloud) {
    let arch = Arch::new();
    let mut draws = [0.5; BLOCK * DRAWS];
    for first in (0..count).step_by(BLOCK) {
        let there = BLOCK.min(count - first);
        chance.fill(Stream::Bodies, &mut draws[..there * DRAWS]);
        cloud.push_block(arch.dispatch(Scatter { draws: &draws, spread }), there);
    }
}

struct Scatter<'a> {
    draws: &'a [f64; BLOCK * DRAWS],
    spread: f64,
}

impl WithSimd for Scatter<'_> {
    type Output = Block;

    #[inline(always)]
    fn with_simd<S: Simd>(self, v: S) -> Block {
        let ((low, high), spread) = (DEBRIS_RADII, v.splat_f64s(self.spread));
        let (low, width) = (v.splat_f64s(low), v.splat_f64s(high - low));
        let (one, two) = (v.splat_f64s(-1.0), v.splat_f64s(2.0));
        let mut block = Block::EMPTY;
        for (i, draw) in self.draws.as_chunks::<DRAWS>().0.iter().enumerate() {
            [block.x[i], block.y[i], block.vx[i], block.vy[i]] = *draw;
        }
        let mut plain = true;
        let (xs, ys) = (S::as_mut_simd_f64s(&mut block.x).0, S::as_mut_simd_f64s(&mut block.y).0);
        let (vxs, vys) = (S::as_mut_simd_f64s(&mut block.vx).0, S::as_mut_simd_f64s(&mut block.vy).0);
        for (((x, y), vx), vy) in xs.iter_mut().zip(ys).zip(vxs).zip(vys) {
            let radius = v.add_f64s(low, v.mul_f64s(width, *x));
            let turn = turn(v, v.mul_f64s(v.splat_f64s(TAU), *y));
            plain &= turn.plain;
            let speed = v.sqrt_f64s(v.div_f64s(v.splat_f64s(GM), radius));
            let off_x = mul(v, add(v, one, mul(v, two, *vx)), spread);
            let off_y = mul(v, add(v, one, mul(v, two, *vy)), spread);
            *x = v.mul_f64s(radius, turn.cos);
            *y = v.mul_f64s(radius, turn.sin);
            *vx = v.add_f64s(v.mul_f64s(v.neg_f64s(speed), turn.sin), off_x);
            *vy = v.add_f64s(v.mul_f64s(speed, turn.cos), off_y);
        }
        if !plain {
            for (i, draw) in self.draws.as_chunks::<DRAWS>().0.iter().enumerate() {
                block.set(i, body(*draw, self.spread));
            }
        }
        block
    }
}

/// Sine and cosine of some angles; not plain where one is so near to a multiple of π/2 that it takes more care.
struct Turn<S: Simd> {
    sin: S::f64s,
    cos: S::f64s,
    plain: bool,
}

/// A double by the upper half of its bits.
const fn high(word: u64) -> f64 {
    f64::from_bits(word << 32)
}

/// First 33 bits of π/2, and the rest.
const PIO2_1: f64 = f64::from_bits(0x3FF9_21FB_5440_0000);
const PIO2_1T: f64 = f64::from_bits(0x3DD0_B461_1A62_6331);
/// Where the nearest multiple of π/2 becomes the first, second, third, fourth.
const STEPS: [f64; 4] = [high(0x3fe9_21fc), high(0x4002_d97d), high(0x400f_6a7b), high(0x4015_fdbd)];
/// Upper halves of angles that take more care.
const CARE: [u64; 4] = [0x3ff9_21fb, 0x4009_21fb, 0x4012_d97c, 0x4019_21fb];
/// Below this the sine is the angle.
const TINY: f64 = high(0x3e46_a09e);
const S: [f64; 6] = [
    f64::from_bits(0xBFC5_5555_5555_5549),
    f64::from_bits(0x3F81_1111_1110_F8A6),
    f64::from_bits(0xBF2A_01A0_19C1_61D5),
    f64::from_bits(0x3EC7_1DE3_57B1_FE7D),
    f64::from_bits(0xBE5A_E5E6_8A2B_9CEB),
    f64::from_bits(0x3DE5_D93A_5ACF_D57C),
];
const C: [f64; 6] = [
    f64::from_bits(0x3FA5_5555_5555_554C),
    f64::from_bits(0xBF56_C16C_16C1_5177),
    f64::from_bits(0x3EFA_01A0_19CB_1590),
    f64::from_bits(0xBE92_7E4F_809C_52AD),
    f64::from_bits(0x3E21_EE9E_BDB4_B1C4),
    f64::from_bits(0xBDA8_FAE9_BE88_38D4),
];

/// Sine and cosine in [0, 2π), operation by operation those of `libm::sincos` (FreeBSD's `k_sin`, `k_cos` and the short
/// cases of `rem_pio2`; Ng, *Argument reduction for huge arguments*, 1992), so that the bits are the same: a test holds
/// them to that.
#[inline(always)]
fn turn<V: Simd>(v: V, x: V::f64s) -> Turn<V> {
    let mut n = v.splat_f64s(0.0);
    let mut number = 0.0;
    for at in STEPS {
        number += 1.0;
        n = v.select_f64s(v.greater_than_or_equal_f64s(x, v.splat_f64s(at)), v.splat_f64s(number), n);
    }
    let mut care = v.less_than_f64s(x, v.splat_f64s(TINY));
    for word in CARE {
        let from = v.greater_than_or_equal_f64s(x, v.splat_f64s(high(word)));
        let below = v.less_than_f64s(x, v.splat_f64s(high(word + 1)));
        care = v.or_m64s(care, v.and_m64s(from, below));
    }
    // x less n·π/2, as y + t.
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
    Turn {
        sin: v.select_f64s(down, v.neg_f64s(sin), sin),
        cos: v.select_f64s(left, v.neg_f64s(cos), cos),
        plain: v.first_true_m64s(care) >= V::F64_LANES,
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

/// a + z·b.
#[inline(always)]
fn horner<V: Simd>(v: V, a: f64, z: V::f64s, b: V::f64s) -> V::f64s {
    v.add_f64s(v.splat_f64s(a), v.mul_f64s(z, b))
}

/// `k_sin`: of y + t, or of y alone where it was not reduced.
#[inline(always)]
fn sine<V: Simd>(v: V, y: V::f64s, t: V::f64s, whole: V::m64s) -> V::f64s {
    let z = mul(v, y, y);
    let w = mul(v, z, z);
    let near = horner(v, S[1], z, horner(v, S[2], z, v.splat_f64s(S[3])));
    let far = mul(v, mul(v, z, w), horner(v, S[4], z, v.splat_f64s(S[5])));
    let r = add(v, near, far);
    let zy = mul(v, z, y);
    let alone = add(v, y, mul(v, zy, horner(v, S[0], z, r)));
    let half = sub(v, mul(v, v.splat_f64s(0.5), t), mul(v, zy, r));
    let first = mul(v, zy, v.splat_f64s(S[0]));
    let reduced = sub(v, y, sub(v, sub(v, mul(v, z, half), t), first));
    v.select_f64s(whole, alone, reduced)
}

/// `k_cos` of y + t.
#[inline(always)]
fn cosine<V: Simd>(v: V, y: V::f64s, t: V::f64s) -> V::f64s {
    let one = v.splat_f64s(1.0);
    let z = mul(v, y, y);
    let w = mul(v, z, z);
    let near = mul(v, z, horner(v, C[0], z, horner(v, C[1], z, v.splat_f64s(C[2]))));
    let far = mul(v, mul(v, w, w), horner(v, C[3], z, horner(v, C[4], z, v.splat_f64s(C[5]))));
    let r = add(v, near, far);
    let half = mul(v, v.splat_f64s(0.5), z);
    let w = sub(v, one, half);
    let rest = sub(v, mul(v, z, r), mul(v, y, t));
    add(v, w, add(v, sub(v, sub(v, one, w), half), rest))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chance::{Scripted, Seeded};
    use crate::seed::Seed;

    /// A million random bodies, and angles on both sides of every case of the reduction, are those of the plain formula.
    #[test]
    fn validate_libm_many_bodies_are_each_body_to_the_bit() {
        let mut seeded = Seeded::new(Seed::user(9).unwrap());
        let mut draws = vec![0.0; DRAWS * 1_000_000];
        seeded.fill(Stream::Bodies, &mut draws);
        for word in STEPS.into_iter().chain(CARE.map(high)).chain([TINY, 0.0]) {
            for bits in -3i64..4 {
                let angle = f64::from_bits(word.to_bits().saturating_add_signed(bits));
                for near in [angle, angle * (1.0 + 1e-9), angle * (1.0 - 1e-7)] {
                    draws.extend_from_slice(&[0.3, (near / TAU).clamp(0.0, 1.0 - f64::EPSILON), 0.1, 0.9]);
                }
            }
        }
        let mut scripted = Scripted::new();
        for &draw in &draws {
            scripted.push(Stream::Bodies, draw);
        }
        let mut cloud = Cloud::default();
        bodies(&mut scripted, 0.7, draws.len() / DRAWS, &mut cloud);
        assert_eq!((cloud.len(), scripted.missing()), (draws.len() / DRAWS, 0));
        for (one, draw) in cloud.bodies().zip(draws.as_chunks::<DRAWS>().0) {
            let plain = body(*draw, 0.7);
            let bits = |b: &Body| [b.x, b.y, b.vx, b.vy].map(f64::to_bits);
            assert_eq!(bits(&one), bits(&plain), "{draw:?}");
        }
    }
}
