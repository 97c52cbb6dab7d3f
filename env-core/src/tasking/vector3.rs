//! Vectors of three components and rotation matrices, generic over lanes.

use super::real::Real;

/// An array of three values of an expression, for the indices 0, 1 and 2.
///
/// Closures would not do: code of an instruction set is only fast where the compiler inlines all of it, and it does not inline
/// large closures.
macro_rules! each_axis {
    ($i:ident => $value:expr) => {
        [
            {
                let $i = 0_usize;
                $value
            },
            {
                let $i = 1_usize;
                $value
            },
            {
                let $i = 2_usize;
                $value
            },
        ]
    };
}
pub(crate) use each_axis;

/// A vector of three components.
pub type Vector3<R> = [R; 3];

/// A 3 × 3 matrix by rows.
pub type Matrix3<R> = [[R; 3]; 3];

/// Scalar product of two vectors.
#[inline(always)]
pub fn dot<R: Real>(a: &Vector3<R>, b: &Vector3<R>) -> R {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Vector product a × b.
#[inline(always)]
pub fn cross<R: Real>(a: &Vector3<R>, b: &Vector3<R>) -> Vector3<R> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Sum a + b.
#[inline(always)]
pub fn add<R: Real>(a: &Vector3<R>, b: &Vector3<R>) -> Vector3<R> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Difference a − b.
#[inline(always)]
pub fn sub<R: Real>(a: &Vector3<R>, b: &Vector3<R>) -> Vector3<R> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// The vector multiplied by a number.
#[inline(always)]
pub fn scale<R: Real>(a: &Vector3<R>, factor: R) -> Vector3<R> {
    [a[0] * factor, a[1] * factor, a[2] * factor]
}

/// Length of the vector.
#[inline(always)]
pub fn norm<R: Real>(a: &Vector3<R>) -> R {
    dot(a, a).sqrt()
}

/// Product of a matrix and a vector.
#[inline(always)]
pub fn rotate<R: Real>(m: &Matrix3<R>, v: &Vector3<R>) -> Vector3<R> {
    [dot(&m[0], v), dot(&m[1], v), dot(&m[2], v)]
}

/// Product of the transposed matrix and a vector: the inverse rotation.
#[inline(always)]
pub fn rotate_back<R: Real>(m: &Matrix3<R>, v: &Vector3<R>) -> Vector3<R> {
    each_axis!(i => m[0][i] * v[0] + m[1][i] * v[1] + m[2][i] * v[2])
}

/// Selects the first vector in lanes where the mask is true, else the second.
#[inline(always)]
pub fn select<R: Real>(mask: R::Mask, if_true: &Vector3<R>, if_false: &Vector3<R>) -> Vector3<R> {
    each_axis!(i => R::select(mask, if_true[i], if_false[i]))
}
