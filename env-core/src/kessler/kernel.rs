//! The arithmetic of motion and burns, in one place: engine, generator, planner and look-ahead policies all call it, so
//! that a trajectory has the same bits whoever computes it. Only `+ − × ÷ √`.

use super::constants::{FUEL_PER_SPEED, GM, MAX_BURN};

/// Position, LU, and velocity, LU/TU.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Body {
    /// Position along x, LU.
    pub x: f64,
    /// Position along y, LU.
    pub y: f64,
    /// Velocity along x, LU/TU.
    pub vx: f64,
    /// Velocity along y, LU/TU.
    pub vy: f64,
}

impl Body {
    /// Radius squared, LU².
    #[must_use]
    pub const fn radius_2(&self) -> f64 {
        self.x * self.x + self.y * self.y
    }

    /// Radius, LU.
    #[must_use]
    pub fn radius(&self) -> f64 {
        self.radius_2().sqrt()
    }

    /// The body on a circular prograde orbit of radius `radius` at angle `angle`, its speed scaled by `speed`.
    #[must_use]
    pub fn circular(radius: f64, angle: f64, speed: f64) -> Self {
        let (sin, cos) = libm::sincos(angle);
        let v = (GM / radius).sqrt() * speed;
        Self { x: radius * cos, y: radius * sin, vx: -v * sin, vy: v * cos }
    }

    /// Unit vectors radial out and in-track (prograde by position: radial turned a quarter left).
    #[must_use]
    pub fn frame(&self) -> ((f64, f64), (f64, f64)) {
        let r = self.radius().max(f64::MIN_POSITIVE);
        let (x, y) = (self.x / r, self.y / r);
        ((x, y), (-y, x))
    }

    /// One step of free flight.
    #[must_use]
    pub fn coasted(mut self) -> Self {
        coast(&mut self.x, &mut self.y, &mut self.vx, &mut self.vy);
        self
    }

    /// One step of free flight backwards: explicit, since `p_k = p_{k+1} − v_{k+1}` and `v_k = v_{k+1} − a(p_k)`.
    #[must_use]
    pub fn uncoasted(self) -> Self {
        let (x, y) = (self.x - self.vx, self.y - self.vy);
        let k = pull(x * x + y * y);
        Self { x, y, vx: self.vx + k * x, vy: self.vy + k * y }
    }
}

/// GM/r³ from r².
#[inline(always)]
fn pull(r2: f64) -> f64 {
    GM / (r2 * r2.sqrt())
}

/// Semi-implicit Euler over 1 TU: `v += a(p); p += v` with `a = −GM/r² · p/r`.
#[inline(always)]
pub(crate) fn coast(x: &mut f64, y: &mut f64, vx: &mut f64, vy: &mut f64) {
    let k = pull(*x * *x + *y * *y);
    *vx -= k * *x;
    *vy -= k * *y;
    *x += *vx;
    *y += *vy;
}

/// Distance squared, LU².
#[inline(always)]
pub(crate) fn distance_2(ax: f64, ay: f64, bx: f64, by: f64) -> f64 {
    let (dx, dy) = (ax - bx, ay - by);
    dx * dx + dy * dy
}

/// A burn after clamping each axis, and what it costs.
#[inline]
pub(crate) fn clamped_burn(dvx: f64, dvy: f64) -> (f64, f64, f64) {
    let dvx = dvx.clamp(-MAX_BURN, MAX_BURN);
    let dvy = dvy.clamp(-MAX_BURN, MAX_BURN);
    (dvx, dvy, FUEL_PER_SPEED * (dvx * dvx + dvy * dvy).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn backward_undoes_forward() {
        let start = Body::circular(60.0, 1.0, 0.8);
        let mut body = start;
        for _ in 0..50 {
            body = body.coasted();
        }
        for _ in 0..50 {
            body = body.uncoasted();
        }
        // Rounding of ~1e-16 relative per step, amplified by at most ~1e3 over 50 steps.
        for (a, b) in [(start.x, body.x), (start.y, body.y), (start.vx, body.vx), (start.vy, body.vy)] {
            assert!((a - b).abs() < 1e-9, "{a} {b}");
        }
    }

    /// Semi-implicit Euler is symplectic: the energy of a circular orbit stays within O(dt) of its start for ever.
    #[test]
    fn validate_energy_stays_bounded() {
        let mut body = Body::circular(60.0, 0.0, 1.0);
        let energy = |b: &Body| 0.5 * (b.vx * b.vx + b.vy * b.vy) - GM / b.radius();
        let first = energy(&body);
        for _ in 0..10_000 {
            body = body.coasted();
            // n·dt/2 with n = √(GM/r³) = 0.068: about 3.4 % of |E|; twice that as bound.
            assert!((energy(&body) - first).abs() < 0.07 * first.abs());
        }
    }
}
