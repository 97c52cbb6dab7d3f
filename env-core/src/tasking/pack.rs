//! Lanes side by side in SIMD registers.
#![expect(
    clippy::needless_range_loop,
    reason = "iterators take closures, which the compiler does not inline into code of an instruction set"
)]

use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

use pulp::Simd;

use super::real::Real;

/// Numbers of `N` registers of an instruction set, one number a lane.
#[derive(Clone, Copy)]
pub struct Pack<S: Simd, const N: usize> {
    /// Proof that the machine has the instruction set; it has no size.
    simd: S,
    registers: [S::f64s; N],
}

impl<S: Simd, const N: usize> Pack<S, N> {
    /// The same value in every lane.
    #[inline(always)]
    pub fn splat(simd: S, value: f64) -> Self {
        Self { simd, registers: [simd.splat_f64s(value); N] }
    }

    /// Loads one number a lane. Lanes beyond the slice are zero.
    #[inline(always)]
    pub fn load(simd: S, values: &[f64]) -> Self {
        let mut registers = [simd.splat_f64s(0.0); N];
        let (whole, _) = S::as_simd_f64s(values);
        let count = N.min(whole.len());
        registers[..count].copy_from_slice(&whole[..count]);
        Self { simd, registers }
    }

    /// The same lanes, followed by lanes that are zero.
    #[inline(always)]
    pub fn widened<const M: usize>(&self) -> Pack<S, M> {
        let mut wide = Pack::<S, M>::splat(self.simd, 0.0);
        wide.registers[..N].copy_from_slice(&self.registers);
        wide
    }

    /// Stores one number a lane.
    #[inline(always)]
    pub fn store(self, values: &mut [f64]) {
        let (whole, _) = S::as_mut_simd_f64s(values);
        let count = N.min(whole.len());
        whole[..count].copy_from_slice(&self.registers[..count]);
    }
}

/// Implements an operator of two packs by the instruction of the same name.
macro_rules! operator {
    ($trait:ident, $method:ident, $instruction:ident) => {
        impl<S: Simd, const N: usize> $trait for Pack<S, N> {
            type Output = Self;

            #[inline(always)]
            fn $method(mut self, other: Self) -> Self {
                for i in 0..N {
                    self.registers[i] = self.simd.$instruction(self.registers[i], other.registers[i]);
                }
                self
            }
        }
    };
}

operator!(Add, add, add_f64s);
operator!(Sub, sub, sub_f64s);
operator!(Mul, mul, mul_f64s);
operator!(Div, div, div_f64s);

impl<S: Simd, const N: usize> Neg for Pack<S, N> {
    type Output = Self;

    #[inline(always)]
    fn neg(mut self) -> Self {
        for i in 0..N {
            self.registers[i] = self.simd.neg_f64s(self.registers[i]);
        }
        self
    }
}

/// Implements a comparison of two packs by an instruction.
macro_rules! comparison {
    ($method:ident, $instruction:ident) => {
        #[inline(always)]
        fn $method(self, other: Self) -> PackMask<S, N> {
            let first = self.simd.$instruction(self.registers[0], other.registers[0]);
            let mut masks = [first; N];
            for i in 1..N {
                masks[i] = self.simd.$instruction(self.registers[i], other.registers[i]);
            }
            PackMask { simd: self.simd, masks }
        }
    };
}

impl<S: Simd, const N: usize> Real for Pack<S, N> {
    type Mask = PackMask<S, N>;

    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        Self::splat(self.simd, value)
    }

    #[inline(always)]
    fn sqrt(mut self) -> Self {
        for i in 0..N {
            self.registers[i] = self.simd.sqrt_f64s(self.registers[i]);
        }
        self
    }

    comparison!(less_than, less_than_f64s);
    comparison!(at_most, less_than_or_equal_f64s);

    #[inline(always)]
    fn select(mask: PackMask<S, N>, if_true: Self, if_false: Self) -> Self {
        let simd = if_true.simd;
        let mut registers = if_false.registers;
        for i in 0..N {
            registers[i] = simd.select_f64s(mask.masks[i], if_true.registers[i], registers[i]);
        }
        Self { simd, registers }
    }

    #[inline(always)]
    fn any(self, mask: PackMask<S, N>) -> bool {
        let mut any = false;
        for i in 0..N {
            any |= self.simd.first_true_m64s(mask.masks[i]) < S::F64_LANES;
        }
        any
    }
}

/// Truth values of lanes.
#[derive(Clone, Copy)]
pub struct PackMask<S: Simd, const N: usize> {
    simd: S,
    masks: [S::m64s; N],
}

impl<S: Simd, const N: usize> BitAnd for PackMask<S, N> {
    type Output = Self;

    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        let mut masks = self.masks;
        for i in 0..N {
            masks[i] = self.simd.and_m64s(masks[i], other.masks[i]);
        }
        Self { simd: self.simd, masks }
    }
}

impl<S: Simd, const N: usize> BitOr for PackMask<S, N> {
    type Output = Self;

    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        let mut masks = self.masks;
        for i in 0..N {
            masks[i] = self.simd.or_m64s(masks[i], other.masks[i]);
        }
        Self { simd: self.simd, masks }
    }
}

impl<S: Simd, const N: usize> Not for PackMask<S, N> {
    type Output = Self;

    #[inline(always)]
    fn not(self) -> Self {
        let mut masks = self.masks;
        for i in 0..N {
            masks[i] = self.simd.not_m64s(masks[i]);
        }
        Self { simd: self.simd, masks }
    }
}
