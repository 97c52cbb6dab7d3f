//! Attitude guidance: Basilisk's `locationPointing` and `hillPoint` with `attTrackingError`.

use crate::tasking::real::Real;
use crate::tasking::vector3::{Matrix3, Vector3, add, cross, dot, each_axis, rotate, scale, select, sub};

/// Errors of the attitude relative to a reference, and the reference's motion, in body axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Guidance<R> {
    /// MRP of the body relative to the reference.
    pub sigma_error: Vector3<R>,
    /// Angular velocity of the body relative to the reference, rad/s.
    pub omega_error: Vector3<R>,
    /// Angular velocity of the reference relative to the inertial frame, rad/s.
    pub omega_reference: Vector3<R>,
    /// Angular acceleration of the reference, rad/s².
    pub omega_rate_reference: Vector3<R>,
}

impl<R: Real> Guidance<R> {
    /// Selects the first guidance in lanes where the mask is true, else the second.
    #[inline(always)]
    pub fn select(mask: R::Mask, if_true: &Self, if_false: &Self) -> Self {
        Self {
            sigma_error: select(mask, &if_true.sigma_error, &if_false.sigma_error),
            omega_error: select(mask, &if_true.omega_error, &if_false.omega_error),
            omega_reference: select(mask, &if_true.omega_reference, &if_false.omega_reference),
            omega_rate_reference: select(mask, &if_true.omega_rate_reference, &if_false.omega_rate_reference),
        }
    }
}

/// Axis of the body that points at a location.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Boresight<R> {
    /// Unit vector in body axes.
    pub axis: Vector3<R>,
    /// Unit vector perpendicular to the axis, about which the body turns if the location is exactly opposite.
    pub opposite_axis: Vector3<R>,
}

/// Cosine below which a location counts as exactly opposite to the boresight: π less 1.4e-8 rad.
const OPPOSITE_COSINE: f64 = -1.0 + 1e-16;

/// Points a boresight at a location: `locationPointing` with boresight rate damping, then `attTrackingError`.
///
/// `to_location` is the vector from the satellite to the location in the inertial frame, m. `previous_sigma` is the error of the
/// last tick, from which the rate is a difference over `step` seconds; lanes of `is_first` have none yet.
#[inline(always)]
pub fn point_at<R: Real>(
    boresight: &Boresight<R>,
    to_location: &Vector3<R>,
    body: &Matrix3<R>,
    omega: &Vector3<R>,
    previous_sigma: &Vector3<R>,
    is_first: R::Mask,
    step: f64,
) -> Guidance<R> {
    let in_body = rotate(body, to_location);
    let one = in_body[0].constant(1.0);
    let heading = scale(&in_body, one / dot(&in_body, &in_body).sqrt());
    let cosine = dot(&boresight.axis, &heading).smaller(one).larger(-one);
    let normal = cross(&boresight.axis, &heading);
    // tan(φ/4) = sin φ/(2c(1 + c)) with c = cos(φ/2); the normal's length is sin φ.
    let half_cosine = (one + cosine).times(0.5).sqrt();
    let factor = one / (half_cosine * (one + half_cosine)).times(-2.0);
    let is_opposite = cosine.at_most(one.constant(OPPOSITE_COSINE));
    let sigma_error =
        select(is_opposite, &each_axis!(i => -boresight.opposite_axis[i]), &scale(&normal, factor));
    let change = sub(&sigma_error, previous_sigma);
    let square = dot(&sigma_error, &sigma_error);
    let above = one + square;
    let rate_factor = one.constant(4.0 / step) / (above * above);
    let rate_factor = R::select(is_first, one.constant(0.0), rate_factor);
    let (below, along) = (one - square, dot(&sigma_error, &change));
    let across = cross(&sigma_error, &change);
    let along = along + along;
    let measured = each_axis!(
        i => rate_factor * (below * change[i] + along * sigma_error[i] - (across[i] + across[i]))
    );
    let omega_error = add(&measured, &scale(&heading, dot(omega, &heading)));
    let zero = one.constant(0.0);
    Guidance {
        sigma_error,
        omega_error,
        omega_reference: sub(omega, &omega_error),
        omega_rate_reference: [zero; 3],
    }
}

/// Aligns the body with the Hill frame (radial, along track, orbit normal): `hillPoint`, then `attTrackingError`.
///
/// `sigma` is the MRP of the body; position and velocity are in the inertial frame, m and m/s.
#[inline(always)]
pub fn align_with_hill<R: Real>(
    sigma: &Vector3<R>,
    body: &Matrix3<R>,
    omega: &Vector3<R>,
    position: &Vector3<R>,
    velocity: &Vector3<R>,
) -> Guidance<R> {
    let one = sigma[0].constant(1.0);
    let radius_2 = dot(position, position);
    let inverse_radius = one / radius_2.sqrt();
    let momentum = cross(position, velocity);
    let momentum_length = dot(&momentum, &momentum).sqrt();
    let radial = scale(position, inverse_radius);
    let normal = scale(&momentum, one / momentum_length);
    let hill = [radial, cross(&normal, &radial), normal];
    let rate = momentum_length / radius_2;
    let acceleration = (dot(velocity, &radial) * inverse_radius * rate).times(-2.0);
    let normal_in_body = rotate(body, &normal);
    let omega_reference = scale(&normal_in_body, rate);
    Guidance {
        sigma_error: relative_rotation(sigma, &hill),
        omega_error: sub(omega, &omega_reference),
        omega_reference,
        omega_rate_reference: scale(&normal_in_body, acceleration),
    }
}

/// MRP of the shorter rotation from a frame, given by its axes as rows, to the body.
///
/// The frame's quaternion is taken from the largest of its four components (Shepperd 1978, *J. Guidance and Control* 1(3), 223–224).
#[inline(always)]
fn relative_rotation<R: Real>(sigma: &Vector3<R>, frame: &Matrix3<R>) -> Vector3<R> {
    let [w, x, y, z] = quaternion(frame);
    let square = dot(sigma, sigma);
    let one = square.constant(1.0);
    // The quaternion of the body, times its norm 1 + σ².
    let (scalar, vector) = (one - square, add(sigma, sigma));
    let frame_vector = [x, y, z];
    let product_scalar = scalar * w + dot(&vector, &frame_vector);
    let turned = cross(&vector, &frame_vector);
    let product = each_axis!(i => w * vector[i] - scalar * frame_vector[i] + turned[i]);
    let norm = (one + square) * (w * w + dot(&frame_vector, &frame_vector)).sqrt();
    let is_negative = product_scalar.less_than(one.constant(0.0));
    let sign = R::select(is_negative, -one, one);
    scale(&product, sign / (norm + product_scalar * sign))
}

/// Quaternion of a rotation matrix, times a positive factor.
#[inline(always)]
fn quaternion<R: Real>(m: &Matrix3<R>) -> [R; 4] {
    let one = m[0][0].constant(1.0);
    let trace = m[0][0] + m[1][1] + m[2][2];
    let w = one + trace;
    let [x, y, z] = each_axis!(i => one + m[i][i] + m[i][i] - trace);
    let (wx, wy, wz) = (m[1][2] - m[2][1], m[2][0] - m[0][2], m[0][1] - m[1][0]);
    let (xy, xz, yz) = (m[0][1] + m[1][0], m[2][0] + m[0][2], m[1][2] + m[2][1]);
    let by_w = [w, wx, wy, wz];
    let by_x = [wx, x, xy, xz];
    let by_y = [wy, xy, y, yz];
    let by_z = [wz, xz, yz, z];
    let wx_wins = x.at_most(w);
    let yz_wins = z.at_most(y);
    let (first, second) = (w.larger(x), y.larger(z));
    pick(second.at_most(first), &pick(wx_wins, &by_w, &by_x), &pick(yz_wins, &by_y, &by_z))
}

/// Selects the first quaternion in lanes where the mask is true, else the second.
#[inline(always)]
fn pick<R: Real>(mask: R::Mask, a: &[R; 4], b: &[R; 4]) -> [R; 4] {
    [
        R::select(mask, a[0], b[0]),
        R::select(mask, a[1], b[1]),
        R::select(mask, a[2], b[2]),
        R::select(mask, a[3], b[3]),
    ]
}
