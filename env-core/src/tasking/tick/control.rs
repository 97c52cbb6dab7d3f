//! Attitude control laws: Basilisk's `mrpFeedback`, and `mrpSteering` with `rateServoFullNonlinear` (Schaub and Piggott 2018,
//! *Advances in the Astronautical Sciences* 162). They return motor torques of the three wheels.

use std::f64::consts::FRAC_PI_2;

use super::arctangent::arctangent;
use super::guidance::Guidance;
use crate::tasking::constants::WHEEL_INERTIA_KG_M2;
use crate::tasking::real::Real;
use crate::tasking::vector3::{Vector3, add, cross, dot, each_axis, scale, sub};

/// Gains of a control law. The fields have the meaning of one of the laws; the other law's are unused.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gains<R> {
    /// Proportional gain: K of the feedback, K₁ of the steering.
    pub proportional: R,
    /// Cubic gain K₃ of the steering.
    pub cubic: R,
    /// Largest commanded rate of the steering, rad/s.
    pub max_rate: R,
    /// Gain P of the rate error.
    pub rate: R,
    /// Gain Kᵢ of the integral; zero or less turns it off.
    pub integral: R,
    /// Largest magnitude of each component of the integral.
    pub integral_limit: R,
}

/// Motor torques of `mrpFeedback` without wheel momentum, which BSK-RL does not connect, N·m.
///
/// `step` is the time since the last control, s; `integral` is ∫Kσ dt.
#[inline(always)]
pub fn feedback<R: Real>(
    gains: &Gains<R>,
    guidance: &Guidance<R>,
    omega: &Vector3<R>,
    inertia: &Vector3<R>,
    integral: &mut Vector3<R>,
    step: R,
) -> Vector3<R> {
    let Guidance { sigma_error, omega_error, omega_reference, omega_rate_reference } = guidance;
    let zero = step.constant(0.0);
    let is_integrating = zero.less_than(gains.integral);
    let mut reference = *omega_reference;
    let mut torque = each_axis!(i => gains.proportional * sigma_error[i] + gains.rate * omega_error[i]);
    if step.any(is_integrating) {
        for i in 0..3 {
            let sum = clamp(integral[i] + gains.proportional * step * sigma_error[i], gains.integral_limit);
            integral[i] = R::select(is_integrating, sum, integral[i]);
            let z = gains.integral * (sum + inertia[i] * omega_error[i]);
            torque[i] = torque[i] + R::select(is_integrating, gains.rate * z, zero);
            reference[i] = reference[i] + R::select(is_integrating, z, zero);
        }
    }
    let momentum = each_axis!(i => inertia[i] * omega[i]);
    let gyroscopic = cross(&reference, &momentum);
    let transport = cross(omega, omega_reference);
    each_axis!(i => torque[i] - gyroscopic[i] + inertia[i] * (transport[i] - omega_rate_reference[i]))
}

/// Motor torques of `mrpSteering` and `rateServoFullNonlinear`, N·m.
///
/// `step` is the time since the last control, s; `integral` is the integral of the rate error, which outlives actions.
#[inline(always)]
pub fn steering<R: Real>(
    gains: &Gains<R>,
    guidance: &Guidance<R>,
    omega: &Vector3<R>,
    wheels: &Vector3<R>,
    inertia: &Vector3<R>,
    integral: &mut Vector3<R>,
    step: R,
) -> Vector3<R> {
    let Guidance { sigma_error: sigma, omega_reference, omega_rate_reference, .. } = guidance;
    let one = step.constant(1.0);
    let inverse_max = one / gains.max_rate;
    let mut command = *sigma;
    let mut slope = *sigma;
    for i in 0..3 {
        let square = sigma[i] * sigma[i];
        let shaped = (gains.proportional + gains.cubic * square) * sigma[i];
        let argument = (shaped * inverse_max).times(FRAC_PI_2);
        command[i] = -((arctangent(argument) * gains.max_rate).times(1.0 / FRAC_PI_2));
        slope[i] = (gains.cubic.times(3.0) * square + gains.proportional) / (argument * argument + one);
    }
    // MRP rates at the commanded body rate (Schaub and Junkins 2018, eq. 3.152), and the rate of the command.
    let square = dot(sigma, sigma);
    let (below, along) = ((one - square).times(0.25), dot(sigma, &command).times(0.5));
    let across = cross(sigma, &command);
    let command_rate = each_axis!(
        i => -(slope[i] * (below * command[i] + across[i].times(0.5) + along * sigma[i]))
    );
    let desired = add(&command, omega_reference);
    let error = sub(omega, &desired);
    let zero = step.constant(0.0);
    let is_integrating = zero.less_than(gains.integral);
    for i in 0..3 {
        let sum = clamp(integral[i] + step * error[i], gains.integral_limit);
        integral[i] = R::select(is_integrating, sum, zero);
    }
    let momentum = each_axis!(i => inertia[i] * omega[i] + (omega[i] + wheels[i]).times(WHEEL_INERTIA_KG_M2));
    let gyroscopic = cross(&desired, &momentum);
    let transport = cross(omega, omega_reference);
    let feedback = add(&scale(&error, gains.rate), &scale(integral, gains.integral));
    each_axis!(i => {
        let acceleration = omega_rate_reference[i] - transport[i] + command_rate[i];
        feedback[i] - gyroscopic[i] - inertia[i] * acceleration
    })
}

/// Limits the magnitude of a number.
#[inline(always)]
pub fn clamp<R: Real>(value: R, limit: R) -> R {
    value.smaller(limit).larger(-limit)
}
