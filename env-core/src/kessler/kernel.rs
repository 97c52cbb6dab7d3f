//! Arithmetic of motion and burns. The engine, the generator, the planner and the look-ahead
//! policies all call this module, so a trajectory has the same bits in each of them. It uses only
//! `+ − × ÷ √` (and `libm` functions outside the dynamics).

use super::constants::{CONTACT_DISTANCE, FUEL_PER_SPEED, GM, J2_PULL, MAX_BURN};

/// Gravity model of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Gravity {
    /// Point mass: a = −GM/r².
    Point,
    /// Point mass with the Earth's oblateness, in the equatorial plane: a = −GM/r²·(1 +
    /// 1.5·J₂·(Re/r)²) (Vallado 2013, *Fundamentals of Astrodynamics*, 4th ed., eq. 8-25 with the
    /// out-of-plane coordinate at zero).
    J2,
}

/// State vector of a body in the plane: position in LU, velocity in LU/TU.
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
    /// Squared distance from the Earth's centre, LU².
    #[must_use]
    pub const fn radius_squared(&self) -> f64 {
        self.x * self.x + self.y * self.y
    }

    /// Distance from the Earth's centre, LU.
    #[must_use]
    pub fn radius(&self) -> f64 {
        self.radius_squared().sqrt()
    }

    /// Returns a body on a circular prograde orbit of `radius` LU at `angle` radians from +X, with
    /// its speed multiplied by `speed`.
    #[must_use]
    pub fn circular(radius: f64, angle: f64, speed: f64) -> Self {
        let (sin, cos) = libm::sincos(angle);
        let v = (GM / radius).sqrt() * speed;
        Self { x: radius * cos, y: radius * sin, vx: -v * sin, vy: v * cos }
    }

    /// Returns the unit vectors radial out and in-track. In-track is the radial direction turned a
    /// quarter turn to the left (prograde).
    #[must_use]
    pub fn local_axes(&self) -> ((f64, f64), (f64, f64)) {
        let r = self.radius().max(f64::MIN_POSITIVE);
        let (x, y) = (self.x / r, self.y / r);
        ((x, y), (-y, x))
    }

    /// Returns the body after one step (1 TU) of free flight.
    #[must_use]
    #[inline]
    pub fn coast(mut self, gravity: Gravity) -> Self {
        match gravity {
            Gravity::Point => euler_step::<false>(&mut self.x, &mut self.y, &mut self.vx, &mut self.vy),
            Gravity::J2 => euler_step::<true>(&mut self.x, &mut self.y, &mut self.vx, &mut self.vy),
        }
        self
    }

    /// Returns the body one step earlier. The inverse of a step is explicit: `p_k = p_{k+1} − v_{k+1}` and
    /// `v_k = v_{k+1} − a(p_k)`.
    #[must_use]
    pub fn coast_back(self, gravity: Gravity) -> Self {
        let (x, y) = (self.x - self.vx, self.y - self.vy);
        let r2 = x * x + y * y;
        let k = match gravity {
            Gravity::Point => gravity_factor::<false>(r2),
            Gravity::J2 => gravity_factor::<true>(r2),
        };
        Self { x, y, vx: self.vx + k * x, vy: self.vy + k * y }
    }
}

/// Returns GM/r³ for a squared radius `r2`, with the J₂ term if `OBLATE`.
#[inline(always)]
fn gravity_factor<const OBLATE: bool>(r2: f64) -> f64 {
    let k = GM / (r2 * r2.sqrt());
    if OBLATE { k * (1.0 + J2_PULL / r2) } else { k }
}

/// Advances a body by 1 TU with semi-implicit Euler: `v += a(p); p += v` with `a = −GM/r² · p/r`.
#[inline(always)]
pub(crate) fn euler_step<const OBLATE: bool>(x: &mut f64, y: &mut f64, vx: &mut f64, vy: &mut f64) {
    let k = gravity_factor::<OBLATE>(*x * *x + *y * *y);
    *vx -= k * *x;
    *vy -= k * *y;
    *x += *vx;
    *y += *vy;
}

/// Squared distance of two points, LU².
#[inline(always)]
pub(crate) fn distance_squared(ax: f64, ay: f64, bx: f64, by: f64) -> f64 {
    let (dx, dy) = (ax - bx, ay - by);
    dx * dx + dy * dy
}

/// Least squared distance, LU², of two bodies within the step that ends now.
///
/// `dx`, `dy` is the relative position and `wx`, `wy` the relative velocity at the end of the step.
/// Bodies move on straight lines within a step, since `p += v` is all its motion. Their squared
/// distance is therefore quadratic in time, and its minimum has a closed form.
#[inline(always)]
pub(crate) fn min_distance_squared(dx: f64, dy: f64, wx: f64, wy: f64) -> f64 {
    // Time from the closest approach to the end of the step. Any value will do if nothing moves.
    let back = ((dx * wx + dy * wy) / (wx * wx + wy * wy).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    let (mx, my) = (dx - wx * back, dy - wy * back);
    mx * mx + my * my
}

/// Squared miss distance, LU², if two bodies had their closest approach in the step that ends now.
///
/// `dx`, `dy` is the relative position and `wx`, `wy` the relative velocity at the end of the step.
/// `approaching` says if the bodies were approaching at the end of the step before.
#[inline(always)]
pub(crate) fn closest_approach_squared(dx: f64, dy: f64, wx: f64, wy: f64, approaching: bool) -> Option<f64> {
    let end = dx * wx + dy * wy;
    let start = end - (wx * wx + wy * wy);
    if start < 0.0 && end >= 0.0 {
        Some(min_distance_squared(dx, dy, wx, wy))
    } else if start >= 0.0 && approaching {
        // A burn changed the course at the start of the step: the bodies were closest there.
        let (sx, sy) = (dx - wx, dy - wy);
        Some(sx * sx + sy * sy)
    } else {
        None
    }
}

/// Probability that two bodies pass closer than the contact distance, given the miss distance
/// `miss` of their nominal courses and the standard deviation `sigma` of the relative position
/// (both LU).
///
/// The miss along the normal to the relative velocity is normally distributed, so Pc = Φ((R − m)/σ)
/// − Φ((−R − m)/σ). This is the planar case of the short-term encounter (Foster and Estes 1992;
/// Chan 2008, *Spacecraft Collision Probability*, ch. 3). Uncertainty along the velocity only
/// shifts the time of the encounter.
#[must_use]
pub fn collision_probability(miss: f64, sigma: f64) -> f64 {
    let scale = sigma * std::f64::consts::SQRT_2;
    0.5 * (libm::erf((CONTACT_DISTANCE - miss) / scale) + libm::erf((CONTACT_DISTANCE + miss) / scale))
}

/// A burn within the limit of each axis.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ClampedBurn {
    /// Change of velocity along x, LU/TU.
    pub dvx: f64,
    /// Change of velocity along y, LU/TU.
    pub dvy: f64,
    /// Fuel that the burn takes, in fuel units.
    pub cost: f64,
}

/// Clamps each axis of a burn to ±[`MAX_BURN`] and computes its fuel cost.
#[inline]
pub(crate) fn clamp_burn(dvx: f64, dvy: f64) -> ClampedBurn {
    let dvx = dvx.clamp(-MAX_BURN, MAX_BURN);
    let dvy = dvy.clamp(-MAX_BURN, MAX_BURN);
    ClampedBurn { dvx, dvy, cost: FUEL_PER_SPEED * (dvx * dvx + dvy * dvy).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coast_back_inverts_coast() {
        let start = Body::circular(60.0, 1.0, 0.8);
        let mut body = start;
        for _ in 0..50 {
            body = body.coast(Gravity::Point);
        }
        for _ in 0..50 {
            body = body.coast_back(Gravity::Point);
        }
        // Rounding of ~1e-16 relative per step, amplified by at most ~1e3 over 50 steps.
        for (a, b) in [(start.x, body.x), (start.y, body.y), (start.vx, body.vx), (start.vy, body.vy)] {
            assert!((a - b).abs() < 1e-9, "{a} {b}");
        }
    }

    /// Semi-implicit Euler is symplectic: the energy of a circular orbit stays within O(dt) of its
    /// initial value.
    #[test]
    fn validate_energy_stays_bounded() {
        let mut body = Body::circular(60.0, 0.0, 1.0);
        let energy = |b: &Body| 0.5 * (b.vx * b.vx + b.vy * b.vy) - GM / b.radius();
        let first = energy(&body);
        for _ in 0..10_000 {
            body = body.coast(Gravity::Point);
            // Expected: n·dt/2 with n = √(GM/r³) = 0.068, about 3.4 % of |E|. The bound is twice
            // that.
            assert!((energy(&body) - first).abs() < 0.07 * first.abs());
        }
    }
}
