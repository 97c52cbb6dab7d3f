//! Motion relative to a chief on a circular orbit.
//!
//! The equations are those of Clohessy & Wiltshire, "Terminal Guidance System for Satellite Rendezvous", Journal of the
//! Aerospace Sciences 27(9), 1960, p. 653–658, in Hill's frame (x radial out, y in-track, z cross-track). They are solved
//! exactly over a step in which the thrust is held.

use std::sync::LazyLock;

use nalgebra::SMatrix;

use super::constants::{
    DOCKING_RADIUS_M, DOCKING_SPEED_M_S, LIMIT_SLOPE_1_S, MASS_KG, MEAN_MOTION_RAD_S, STATE_DIM, STEP_S,
};

/// Position in m and velocity in m/s in Hill's frame.
pub type RelativeState = [f64; STATE_DIM];

/// Φ and Γ of a time span: `s(t) = Φ s(0) + Γ F` for a thrust F held over it.
#[derive(Debug, Clone, PartialEq)]
pub struct Transition {
    /// State transition matrix Φ, 6 × 6.
    pub phi: SMatrix<f64, STATE_DIM, STATE_DIM>,
    /// Input matrix Γ, 6 × 3: the change of state per thrust, m/N and m/s/N.
    pub gamma: SMatrix<f64, STATE_DIM, 3>,
}

impl Transition {
    /// The transition over `seconds`, which must not be negative.
    ///
    /// It is expressed in 1 − cos nt and nt − sin nt, which are computed without cancellation. Sines come from `libm`, so
    /// that the bits are the same on every platform.
    #[must_use]
    pub fn over(seconds: f64) -> Self {
        let (n, t) = (MEAN_MOTION_RAD_S, seconds);
        let (s, half) = (libm::sin(n * t), libm::sin(0.5 * n * t));
        let one_less_cos = 2.0 * half * half;
        let lag = x_minus_sin(n * t);
        let c = 1.0 - one_less_cos;
        #[rustfmt::skip]
        let phi = SMatrix::<f64, STATE_DIM, STATE_DIM>::from_row_slice(&[
            1.0 + 3.0 * one_less_cos, 0.0, 0.0, s / n, 2.0 * one_less_cos / n, 0.0,
            -6.0 * lag, 1.0, 0.0, -2.0 * one_less_cos / n, t - 4.0 * lag / n, 0.0,
            0.0, 0.0, c, 0.0, 0.0, s / n,
            3.0 * n * s, 0.0, 0.0, c, 2.0 * s, 0.0,
            -6.0 * n * one_less_cos, 0.0, 0.0, -2.0 * s, 1.0 - 4.0 * one_less_cos, 0.0,
            0.0, 0.0, -n * s, 0.0, 0.0, c,
        ]);
        #[rustfmt::skip]
        let held = SMatrix::<f64, STATE_DIM, 3>::from_row_slice(&[
            one_less_cos / (n * n), 2.0 * lag / (n * n), 0.0,
            -2.0 * lag / (n * n), 4.0 * one_less_cos / (n * n) - 1.5 * t * t, 0.0,
            0.0, 0.0, one_less_cos / (n * n),
            s / n, 2.0 * one_less_cos / n, 0.0,
            -2.0 * one_less_cos / n, t - 4.0 * lag / n, 0.0,
            0.0, 0.0, s / n,
        ]);
        Self { phi, gamma: held / MASS_KG }
    }
}

/// Computes x − sin x without cancellation.
fn x_minus_sin(x: f64) -> f64 {
    if x < 0.1 {
        let x2 = x * x;
        // The series up to x¹¹; the remainder is below 1e-17 of the sum.
        x * x2 / 6.0 * (1.0 - x2 / 20.0 * (1.0 - x2 / 42.0 * (1.0 - x2 / 72.0 * (1.0 - x2 / 110.0))))
    } else {
        x - libm::sin(x)
    }
}

/// The transition of one step in arrays, for the simulation loop.
#[derive(Debug)]
pub struct StepTransition {
    phi: [[f64; STATE_DIM]; STATE_DIM],
    gamma: [[f64; 3]; STATE_DIM],
}

static ONE_STEP: LazyLock<StepTransition> = LazyLock::new(|| {
    let Transition { phi, gamma } = Transition::over(STEP_S);
    StepTransition {
        phi: std::array::from_fn(|row| std::array::from_fn(|column| phi[(row, column)])),
        gamma: std::array::from_fn(|row| std::array::from_fn(|column| gamma[(row, column)])),
    }
});

impl StepTransition {
    /// The transition of the world's step of one second; it is computed once.
    #[must_use]
    pub fn world_step() -> &'static Self {
        &ONE_STEP
    }

    /// The state after one step under a thrust in N. Entries that are zero by the equations are left out; sums are
    /// evaluated from left to right.
    #[inline]
    #[must_use]
    pub fn advance(&self, s: &RelativeState, thrust: [f64; 3]) -> RelativeState {
        let (p, g) = (&self.phi, &self.gamma);
        let [x, y, z, vx, vy, vz] = *s;
        let [fx, fy, fz] = thrust;
        [
            p[0][0] * x + p[0][3] * vx + p[0][4] * vy + g[0][0] * fx + g[0][1] * fy,
            p[1][0] * x + y + p[1][3] * vx + p[1][4] * vy + g[1][0] * fx + g[1][1] * fy,
            p[2][2] * z + p[2][5] * vz + g[2][2] * fz,
            p[3][0] * x + p[3][3] * vx + p[3][4] * vy + g[3][0] * fx + g[3][1] * fy,
            p[4][0] * x + p[4][3] * vx + p[4][4] * vy + g[4][0] * fx + g[4][1] * fy,
            p[5][2] * z + p[5][5] * vz + g[5][2] * fz,
        ]
    }
}

/// Distance from the chief, m.
#[inline]
#[must_use]
pub fn distance(s: &RelativeState) -> f64 {
    (s[0] * s[0] + s[1] * s[1] + s[2] * s[2]).sqrt()
}

/// Speed relative to the chief, m/s.
#[inline]
#[must_use]
pub fn speed(s: &RelativeState) -> f64 {
    (s[3] * s[3] + s[4] * s[4] + s[5] * s[5]).sqrt()
}

/// Distance between two deputies, m.
#[inline]
#[must_use]
pub fn separation(a: &RelativeState, b: &RelativeState) -> f64 {
    let (dx, dy, dz) = (a[0] - b[0], a[1] - b[1], a[2] - b[2]);
    (dx * dx + dy * dy + dz * dz).sqrt()
}

/// Relative speed of two deputies, m/s.
#[must_use]
pub fn relative_speed(a: &RelativeState, b: &RelativeState) -> f64 {
    let (dx, dy, dz) = (a[3] - b[3], a[4] - b[4], a[5] - b[5]);
    (dx * dx + dy * dy + dz * dz).sqrt()
}

/// The linear part of the speed limit, extended to distances inside the docking radius, m/s. Observations contain it.
#[inline]
#[must_use]
pub fn extended_speed_limit(distance: f64) -> f64 {
    DOCKING_SPEED_M_S + LIMIT_SLOPE_1_S * (distance - DOCKING_RADIUS_M)
}

/// The speed limit at a distance, m/s; it is constant inside the docking radius.
#[inline]
#[must_use]
pub fn speed_limit(distance: f64) -> f64 {
    if distance > DOCKING_RADIUS_M { extended_speed_limit(distance) } else { DOCKING_SPEED_M_S }
}
