//! `gravity: j2` against the secular apsidal rate.

use crate::kessler::constants::{EARTH_RADIUS, GM, J2};
use crate::kessler::kernel::{Body, Gravity};

/// Mean elements of an orbit over many revolutions.
struct MeanOrbit {
    /// Slope of the angle of the eccentricity vector, rad/TU, by least squares.
    apsidal_rate: f64,
    /// Semi-major axis: mean of GM/(−2E), LU.
    semi_major: f64,
    /// Semi-latus rectum: mean of h²/GM, LU.
    semi_latus: f64,
}

/// Propagates an orbit and averages its elements.
fn mean_orbit(start: Body, gravity: Gravity, steps: u32) -> MeanOrbit {
    let mut body = start;
    let (mut angle, mut last) = (0.0, None);
    let (mut a_sum, mut p_sum) = (0.0, 0.0);
    let mut ty = 0.0;
    let n = f64::from(steps);
    let middle = 0.5 * (n - 1.0);
    for t in 0..steps {
        let Body { x, y, vx, vy } = body;
        let (r, v_2, h) = (body.radius(), vx * vx + vy * vy, x * vy - y * vx);
        // e = v × h/GM − r/|r| (Vallado 2013, eq. 2-78).
        let (ex, ey) = (vy * h / GM - x / r, -vx * h / GM - y / r);
        let raw = libm::atan2(ey, ex);
        // Unwraps the angle: it changes by far less than half a turn per step.
        let turn = raw - last.replace(raw).unwrap_or(raw);
        angle += libm::atan2(libm::sin(turn), libm::cos(turn));
        a_sum += 1.0 / (2.0 / r - v_2 / GM);
        p_sum += h * h / GM;
        ty += (f64::from(t) - middle) * angle;
        body = body.coast(gravity);
    }
    MeanOrbit { apsidal_rate: ty / (n * (n * n - 1.0) / 12.0), semi_major: a_sum / n, semi_latus: p_sum / n }
}

/// The line of apsides turns by 1.5·n·J₂·(Re/p)² (Vallado 2013, eq. 9-41 and 9-39: ω̇ + Ω̇ at zero
/// inclination). The integrator turns it by itself, so the rate without J₂ is subtracted.
///
/// The bound is 2 %. The rest is O((Re/p)²·J₂), below 1e-5; the integrator's own O(n·1 TU) change of
/// elements, below 0.6 %; and the short-period oscillation of the angle, of amplitude J₂(Re/p)²/e, which a
/// fit over 300 revolutions reduces to below 0.2 % of the turn.
#[test]
fn validate_j2_apsidal_rate() {
    for (periapsis, e) in [(180.0f64, 0.4f64), (220.0, 0.25), (150.0, 0.6)] {
        let speed = (GM * (1.0 + e) / periapsis).sqrt();
        let start = Body { x: periapsis, y: 0.0, vx: 0.0, vy: speed };
        let a = periapsis / (1.0 - e);
        let period = std::f64::consts::TAU * (a * a * a / GM).sqrt();
        let steps = (300.0 * period) as u32;
        let (with, without) =
            (mean_orbit(start, Gravity::J2, steps), mean_orbit(start, Gravity::Point, steps));
        let measured = with.apsidal_rate - without.apsidal_rate;
        let motion = (GM / (with.semi_major * with.semi_major * with.semi_major)).sqrt();
        let ratio = EARTH_RADIUS / with.semi_latus;
        let expected = 1.5 * motion * J2 * ratio * ratio;
        println!(
            "e {e}: {measured:.4e} rad/TU, expected {expected:.4e}: {:+.2} %",
            100.0 * (measured / expected - 1.0)
        );
        assert!((measured / expected - 1.0).abs() < 0.02, "{measured} {expected}");
    }
}

/// One step against the formula, by hand: at radius 40 LU J₂ adds 1.5·J₂/4 to gravity, and nothing else
/// changes.
#[test]
fn validate_j2_term_of_one_step() {
    let body = Body { x: 24.0, y: -32.0, vx: 0.0, vy: 0.0 };
    let (plain, oblate) = (body.coast(Gravity::Point), body.coast(Gravity::J2));
    let ratio = oblate.vx.hypot(oblate.vy) / plain.vx.hypot(plain.vy);
    // Bound: rounding of a few operations.
    assert!((ratio - (1.0 + 1.5 * J2 * 0.25)).abs() < 1e-14, "{ratio}");
    assert!((oblate.vx * plain.vy - oblate.vy * plain.vx).abs() < 1e-14, "radial");
}
