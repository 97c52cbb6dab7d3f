//! Rotation of a rigid body with three balanced reaction wheels along its axes (Schaub and Junkins 2018, *Analytical Mechanics of
//! Space Systems*, 4th ed., eqs. 3.152 and 4.94), in modified Rodrigues parameters (MRP).

use crate::tasking::constants::WHEEL_INERTIA_KG_M2;
use crate::tasking::real::Real;
use crate::tasking::vector3::{Matrix3, Vector3, add, cross, dot, each_axis, scale, sub};

/// Attitude, rate and wheels of a satellite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attitude<R> {
    /// MRP of the body relative to the inertial frame; its norm is at most 1.
    pub sigma: Vector3<R>,
    /// Angular velocity of the body relative to the inertial frame in body axes, rad/s.
    pub omega: Vector3<R>,
    /// Speeds of the wheels, rad/s.
    pub wheels: Vector3<R>,
}

/// Torques on a satellite during a tick, N·m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Torques<R> {
    /// Motor torques on the wheels.
    pub motor: Vector3<R>,
    /// Constant torque on the body.
    pub disturbance: Vector3<R>,
    /// Torque on the body at the start of the tick only: Basilisk's thrusters act in the first stage of RK4.
    pub initial: Vector3<R>,
}

/// Rates of change of MRP and angular velocity.
type Rates<R> = [Vector3<R>; 2];

impl<R: Real> Attitude<R> {
    /// Advances the attitude by `step` seconds with the classical Runge–Kutta method of order 4.
    ///
    /// `inertia` is the body's moment of inertia about its axes without that of the wheels, kg·m², and `inverse_inertia` its
    /// inverse.
    ///
    /// The momentum of a wheel, J(Ω + ω), changes by its motor torque only. So the speeds of the wheels follow from the
    /// rate of the body.
    #[inline(always)]
    pub fn advance(
        &mut self,
        torques: &Torques<R>,
        inertia: &Vector3<R>,
        inverse_inertia: &Vector3<R>,
        step: f64,
    ) {
        let half = step * 0.5;
        let motor = &torques.motor;
        let momentum = each_axis!(i => (self.wheels[i] + self.omega[i]).times(WHEEL_INERTIA_KG_M2));
        let half_change = each_axis!(i => motor[i].times(half));
        let at_half = add(&momentum, &half_change);
        let at_end = add(&at_half, &half_change);
        let later = sub(&torques.disturbance, motor);
        let first = add(&later, &torques.initial);
        let body = BodyInertia { inertia, inverse_inertia };
        let k1 = body.rates(&self.sigma, &self.omega, &momentum, &first);
        let k2 = body.rates(&self.stage(&k1[0], half), &self.stage_rate(&k1[1], half), &at_half, &later);
        let k3 = body.rates(&self.stage(&k2[0], half), &self.stage_rate(&k2[1], half), &at_half, &later);
        let k4 = body.rates(&self.stage(&k3[0], step), &self.stage_rate(&k3[1], step), &at_end, &later);
        let rotation = mean_rate(&k1[0], &k2[0], &k3[0], &k4[0], step);
        let change = mean_rate(&k1[1], &k2[1], &k3[1], &k4[1], step);
        self.wheels = each_axis!(i => {
            let spin = motor[i].times(step / WHEEL_INERTIA_KG_M2);
            self.wheels[i] + spin - change[i]
        });
        self.omega = add(&self.omega, &change);
        self.sigma = short_rotation(&add(&self.sigma, &rotation));
    }

    /// MRP of a stage, `step` seconds after the start at this rate.
    #[inline(always)]
    fn stage(&self, rate: &Vector3<R>, step: f64) -> Vector3<R> {
        each_axis!(i => self.sigma[i] + rate[i].times(step))
    }

    /// Angular velocity of a stage, `step` seconds after the start at this rate.
    #[inline(always)]
    fn stage_rate(&self, rate: &Vector3<R>, step: f64) -> Vector3<R> {
        each_axis!(i => self.omega[i] + rate[i].times(step))
    }
}

/// Change over a step by the rates of the four stages.
#[inline(always)]
fn mean_rate<R: Real>(
    k1: &Vector3<R>,
    k2: &Vector3<R>,
    k3: &Vector3<R>,
    k4: &Vector3<R>,
    step: f64,
) -> Vector3<R> {
    each_axis!(i => {
        let middle = k2[i] + k3[i];
        (k1[i] + k4[i] + middle + middle).times(step / 6.0)
    })
}

/// Moments of inertia of the body without the wheels, kg·m², and their inverse.
struct BodyInertia<'a, R> {
    inertia: &'a Vector3<R>,
    inverse_inertia: &'a Vector3<R>,
}

impl<R: Real> BodyInertia<'_, R> {
    /// Rates of change at a stage. `momentum` is that of the wheels about their axes: J(Ω + ω) at the step's start plus the motor
    /// torque since then. The part Jω of it that changes with the body is left out here as in `inertia`.
    #[inline(always)]
    fn rates(
        &self,
        sigma: &Vector3<R>,
        omega: &Vector3<R>,
        momentum: &Vector3<R>,
        torque: &Vector3<R>,
    ) -> Rates<R> {
        let square = dot(sigma, sigma);
        let along = dot(sigma, omega).times(0.5);
        let across = cross(sigma, omega);
        let quarter = (square.constant(1.0) - square).times(0.25);
        let total = each_axis!(i => self.inertia[i] * omega[i] + momentum[i]);
        let gyroscopic = cross(omega, &total);
        [
            each_axis!(i => quarter * omega[i] + across[i].times(0.5) + along * sigma[i]),
            each_axis!(i => (torque[i] - gyroscopic[i]) * self.inverse_inertia[i]),
        ]
    }
}

/// The MRP of the same attitude with a norm of at most 1 (the shadow set if needed).
#[inline(always)]
pub fn short_rotation<R: Real>(sigma: &Vector3<R>) -> Vector3<R> {
    let square = dot(sigma, sigma);
    let one = square.constant(1.0);
    scale(sigma, R::select(one.less_than(square), -(one / square), one))
}

/// Rotation matrix from the inertial frame to the body (Schaub and Junkins 2018, eq. 3.152).
#[inline(always)]
pub fn body_from_inertial<R: Real>(sigma: &Vector3<R>) -> Matrix3<R> {
    let square = dot(sigma, sigma);
    let one = square.constant(1.0);
    let (below, above) = (one - square, one + square);
    let inverse = one / (above * above);
    let eight = inverse.times(8.0);
    let scaled = scale(sigma, eight);
    let four = below * inverse.times(4.0);
    let diagonal = (below * below - square.times(4.0)) * inverse;
    let turn = scale(sigma, four);
    let (xy, xz, yz) = (scaled[0] * sigma[1], scaled[0] * sigma[2], scaled[1] * sigma[2]);
    [
        [diagonal + scaled[0] * sigma[0], xy + turn[2], xz - turn[1]],
        [xy - turn[2], diagonal + scaled[1] * sigma[1], yz + turn[0]],
        [xz + turn[1], yz - turn[0], diagonal + scaled[2] * sigma[2]],
    ]
}
