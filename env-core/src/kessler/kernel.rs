//! The arithmetic of motion and burns, in one place: engine, generator, planner and look-ahead policies all call it, so
//! that a trajectory has the same bits whoever computes it. Only `+ − × ÷ √`.

use super::constants::{CONTACT_DISTANCE, FUEL_PER_SPEED, GM, J2_PULL, MAX_BURN};

/// What pulls bodies towards the Earth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gravity {
    /// A point mass: a = −GM/r².
    Point,
    /// With the Earth's oblateness, in the equatorial plane: a = −GM/r²·(1 + 1.5·J₂·(Re/r)²) (Vallado 2013,
    /// *Fundamentals of Astrodynamics*, 4th ed., eq. 8-25 with the out-of-plane coordinate at zero).
    J2,
}

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
    #[inline]
    pub fn coasted(mut self, gravity: Gravity) -> Self {
        match gravity {
            Gravity::Point => coast::<false>(&mut self.x, &mut self.y, &mut self.vx, &mut self.vy),
            Gravity::J2 => coast::<true>(&mut self.x, &mut self.y, &mut self.vx, &mut self.vy),
        }
        self
    }

    /// One step of free flight backwards: explicit, since `p_k = p_{k+1} − v_{k+1}` and `v_k = v_{k+1} − a(p_k)`.
    #[must_use]
    pub fn uncoasted(self, gravity: Gravity) -> Self {
        let (x, y) = (self.x - self.vx, self.y - self.vy);
        let r2 = x * x + y * y;
        let k = match gravity {
            Gravity::Point => pull::<false>(r2),
            Gravity::J2 => pull::<true>(r2),
        };
        Self { x, y, vx: self.vx + k * x, vy: self.vy + k * y }
    }
}

/// GM/r³ from r², with J₂'s part where it counts.
#[inline(always)]
fn pull<const OBLATE: bool>(r2: f64) -> f64 {
    let k = GM / (r2 * r2.sqrt());
    if OBLATE { k * (1.0 + J2_PULL / r2) } else { k }
}

/// Semi-implicit Euler over 1 TU: `v += a(p); p += v` with `a = −GM/r² · p/r`.
#[inline(always)]
pub(crate) fn coast<const OBLATE: bool>(x: &mut f64, y: &mut f64, vx: &mut f64, vy: &mut f64) {
    let k = pull::<OBLATE>(*x * *x + *y * *y);
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

/// Least distance squared, LU², of two bodies within the step that ends now. Both have moved on straight lines, since
/// `p += v` is all the motion of a step: their distance squared is quadratic in time, and its least value within the step
/// is closed form. `d` and `w` are relative position and velocity at the end.
#[inline(always)]
pub(crate) fn swept_2(dx: f64, dy: f64, wx: f64, wy: f64) -> f64 {
    // Time before the end at which they were nearest; where nothing moves any time will do.
    let back = ((dx * wx + dy * wy) / (wx * wx + wy * wy).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    let (mx, my) = (dx - wx * back, dy - wy * back);
    mx * mx + my * my
}

/// The miss distance squared, LU², if the two were at their closest approach in the step that ends now: relative
/// position `d` and velocity `w` at its end; `approaching` says whether they were at the end of the step before.
#[inline(always)]
pub(crate) fn passing_2(dx: f64, dy: f64, wx: f64, wy: f64, approaching: bool) -> Option<f64> {
    let end = dx * wx + dy * wy;
    let start = end - (wx * wx + wy * wy);
    if start < 0.0 && end >= 0.0 {
        Some(swept_2(dx, dy, wx, wy))
    } else if start >= 0.0 && approaching {
        // The course changed at the step's start: nearest there.
        let (sx, sy) = (dx - wx, dy - wy);
        Some(sx * sx + sy * sy)
    } else {
        None
    }
}

/// Probability that two bodies pass nearer than contact distance, from the miss distance of their nominal courses: the
/// miss along the normal to the relative velocity is normal with standard deviation `sigma`, so
/// Pc = Φ((R − m)/σ) − Φ((−R − m)/σ). The planar case of the short-term encounter (Foster and Estes 1992; Chan 2008,
/// *Spacecraft Collision Probability*, ch. 3): along the velocity uncertainty only shifts the time.
#[must_use]
pub fn collision_probability(miss: f64, sigma: f64) -> f64 {
    let scale = sigma * std::f64::consts::SQRT_2;
    0.5 * (libm::erf((CONTACT_DISTANCE - miss) / scale) + libm::erf((CONTACT_DISTANCE + miss) / scale))
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
            body = body.coasted(Gravity::Point);
        }
        for _ in 0..50 {
            body = body.uncoasted(Gravity::Point);
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
            body = body.coasted(Gravity::Point);
            // n·dt/2 with n = √(GM/r³) = 0.068: about 3.4 % of |E|; twice that as bound.
            assert!((energy(&body) - first).abs() < 0.07 * first.abs());
        }
    }
}
