//! The arctangent of several lanes at once.
#![expect(clippy::excessive_precision, reason = "the constants are those of fdlibm")]

use crate::tasking::real::Real;

/// Coefficients of the approximation (fdlibm `s_atan.c`, Sun Microsystems 1993), as in the crate `libm`.
const COEFFICIENTS: [f64; 11] = [
    3.333_333_333_333_293_180_27e-01,
    -1.999_999_999_987_648_324_76e-01,
    1.428_571_427_250_346_637_11e-01,
    -1.111_111_040_546_235_578_80e-01,
    9.090_887_133_436_506_561_96e-02,
    -7.691_876_205_044_829_994_95e-02,
    6.661_073_137_387_531_206_69e-02,
    -5.833_570_133_790_573_486_45e-02,
    4.976_877_994_615_932_360_17e-02,
    -3.653_157_274_421_691_552_70e-02,
    1.628_582_011_536_578_236_23e-02,
];

/// Arctangents of the points about which the argument is reduced, in two parts: 0.5, 1, 1.5 and infinity.
const HIGH: [f64; 4] = [
    4.636_476_090_008_060_935_15e-01,
    std::f64::consts::FRAC_PI_4,
    9.827_937_232_473_290_540_82e-01,
    std::f64::consts::FRAC_PI_2,
];
/// Lower parts of these arctangents.
const LOW: [f64; 4] = [
    2.269_877_745_296_168_709_24e-17,
    3.061_616_997_868_383_017_93e-17,
    1.390_331_103_123_099_845_16e-17,
    6.123_233_995_736_766_035_87e-17,
];
/// Bounds of the intervals of the argument's magnitude.
const BOUNDS: [f64; 4] = [0.4375, 0.6875, 1.1875, 2.4375];

/// Arctangent with the bits of `libm::atan`, without branches.
#[inline(always)]
pub fn arctangent<R: Real>(argument: R) -> R {
    let zero = argument.constant(0.0);
    let one = argument.constant(1.0);
    let x = argument.magnitude();
    // The argument is reduced by nothing, about 0.5, 1 or 1.5, or about infinity.
    let above = [x.times(2.0) - one, x - one, x.plus(-1.5), -one];
    let below = [x.plus(2.0), x + one, one + x.times(1.5), x];
    let (mut numerator, mut denominator, mut high, mut low) = (x, one, zero, zero);
    for i in 0..4 {
        let is_beyond = x.constant(BOUNDS[i]).at_most(x);
        numerator = R::select(is_beyond, above[i], numerator);
        denominator = R::select(is_beyond, below[i], denominator);
        high = R::select(is_beyond, x.constant(HIGH[i]), high);
        low = R::select(is_beyond, x.constant(LOW[i]), low);
    }
    let reduced = numerator / denominator;
    let z = reduced * reduced;
    let w = z * z;
    let mut odd = x.constant(COEFFICIENTS[10]);
    let mut even = x.constant(COEFFICIENTS[9]);
    for i in [8, 6, 4, 2, 0] {
        odd = (w * odd).plus(COEFFICIENTS[i]);
    }
    for i in [7, 5, 3, 1] {
        even = (w * even).plus(COEFFICIENTS[i]);
    }
    let (odd, even) = (z * odd, w * even);
    let magnitude = high - (reduced * (odd + even) - low - reduced);
    R::select(argument.less_than(zero), -magnitude, magnitude)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arctangent_has_the_bits_of_libm() {
        let mut bits = 0x9E37_79B9_7F4A_7C15_u64;
        for i in 0..10_000_000 {
            bits = bits.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let share = (bits >> 11) as f64 / (1_u64 << 53) as f64;
            // Magnitudes from 1e-12 to 1e12, and all of the intervals about one.
            let x = if i % 2 == 0 { 4.0 * share } else { libm::exp((share - 0.5) * 55.0) };
            let x = if bits & 1 == 0 { x } else { -x };
            assert_eq!(arctangent(x).to_bits(), libm::atan(x).to_bits(), "{x:e}");
        }
        for x in [0.4375, 0.6875, 1.1875, 2.4375, 1e300, 1e-300, 0.0] {
            assert_eq!(arctangent(x).to_bits(), libm::atan(x).to_bits(), "{x:e}");
        }
    }
}
