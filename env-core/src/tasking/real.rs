//! Numbers of the simulation's formulas: one satellite's (`f64`) or those of several satellites side by side.
//!
//! A formula that is generic over [`Real`] applies the same operations in the same order to every lane. Therefore it gives the
//! same bits for one satellite as for eight, at every SIMD width.

use std::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

/// A number of each lane.
pub trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// A truth value of each lane.
    type Mask: Copy + BitAnd<Output = Self::Mask> + BitOr<Output = Self::Mask> + Not<Output = Self::Mask>;

    /// The same value in every lane. The receiver only determines the lanes.
    #[must_use]
    fn constant(self, value: f64) -> Self;

    /// Square root of each lane.
    #[must_use]
    fn sqrt(self) -> Self;

    /// True in lanes where this number is less than another.
    #[must_use]
    fn less_than(self, other: Self) -> Self::Mask;

    /// True in lanes where this number is at most another.
    #[must_use]
    fn at_most(self, other: Self) -> Self::Mask;

    /// Selects the first number in lanes where the mask is true, else the second.
    #[must_use]
    fn select(mask: Self::Mask, if_true: Self, if_false: Self) -> Self;

    /// True if the mask is true in any lane.
    #[must_use]
    fn any(self, mask: Self::Mask) -> bool;

    /// Multiplies by the same factor in every lane.
    #[must_use]
    #[inline(always)]
    fn times(self, factor: f64) -> Self {
        self * self.constant(factor)
    }

    /// Adds the same value in every lane.
    #[must_use]
    #[inline(always)]
    fn plus(self, value: f64) -> Self {
        self + self.constant(value)
    }

    /// The larger number; the first if one is NaN.
    #[must_use]
    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        Self::select(self.less_than(other), other, self)
    }

    /// The smaller number; the first if one is NaN.
    #[must_use]
    #[inline(always)]
    fn smaller(self, other: Self) -> Self {
        Self::select(other.less_than(self), other, self)
    }

    /// Absolute value of each lane.
    #[must_use]
    #[inline(always)]
    fn magnitude(self) -> Self {
        Self::select(self.less_than(self.constant(0.0)), -self, self)
    }
}

impl Real for f64 {
    type Mask = bool;

    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }

    #[inline(always)]
    fn less_than(self, other: Self) -> bool {
        self < other
    }

    #[inline(always)]
    fn at_most(self, other: Self) -> bool {
        self <= other
    }

    #[inline(always)]
    fn select(mask: bool, if_true: Self, if_false: Self) -> Self {
        if mask { if_true } else { if_false }
    }

    #[inline(always)]
    fn any(self, mask: bool) -> bool {
        mask
    }
}
