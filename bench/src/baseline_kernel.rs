//! Baseline kernel: the arithmetic of kessler's step without the rules.
//!
//! Three satellites and n debris per environment move by the same formulas with the same vector width. Contacts are
//! counted, and the same f32 columns are written. There are no burns, fuel, rewards, episode ends, resets or errors. The
//! ratio of the engine to this kernel is the cost of the rules.

use pulp::{Arch, Simd, WithSimd};

const GM: f64 = 1000.0;
const EARTH_RADIUS_SQUARED: f64 = 400.0;
const CONTACT_DISTANCE_SQUARED: f64 = 4.0;
const LANES: usize = 8;
const FAR_AWAY: f64 = 1e12;
/// Values of a satellite in an observation.
const SATELLITE_VALUES: usize = 6;
/// Columns of debris in an observation.
const DEBRIS_COLUMNS: usize = 5;

/// Environments of the baseline kernel.
pub(crate) struct BaselineKernel {
    envs: Vec<Env>,
    bodies: usize,
    arch: Arch,
}

struct Env {
    satellites: [[f64; 4]; 3],
    x: Vec<f64>,
    y: Vec<f64>,
    vx: Vec<f64>,
    vy: Vec<f64>,
}

impl BaselineKernel {
    /// Creates `envs` environments with `debris` pieces on circular orbits and observations of `bodies` pieces.
    pub(crate) fn new(envs: usize, debris: usize, bodies: usize) -> Self {
        let env = |e: usize| {
            let padded = bodies.next_multiple_of(LANES);
            let column = |absent| vec![absent; padded];
            let mut env = Env {
                satellites: std::array::from_fn(|i| {
                    circular_orbit(50.0 + 10.0 * i as f64, (e + 2 * i) as f64)
                }),
                x: column(FAR_AWAY),
                y: column(FAR_AWAY),
                vx: column(0.0),
                vy: column(0.0),
            };
            for i in 0..debris {
                let [x, y, vx, vy] =
                    circular_orbit(40.0 + 50.0 * (i as f64 + 0.5) / debris as f64, (7 * i + e) as f64);
                (env.x[i], env.y[i], env.vx[i], env.vy[i]) = (x, y, vx, vy);
            }
            env
        };
        Self { envs: (0..envs).map(env).collect(), bodies, arch: Arch::new() }
    }

    /// Steps all environments; returns how many had a contact or a body inside the Earth.
    pub(crate) fn step(&mut self, observations: &mut [f32]) -> u64 {
        let width = 3 * SATELLITE_VALUES + DEBRIS_COLUMNS * self.bodies;
        let (arch, bodies) = (self.arch, self.bodies);
        self.envs
            .iter_mut()
            .zip(observations.chunks_exact_mut(width))
            .map(|(env, out)| env.step(arch, out, bodies))
            .sum()
    }
}

fn circular_orbit(radius: f64, angle: f64) -> [f64; 4] {
    let (sin, cos) = libm::sincos(angle);
    let v = (GM / radius).sqrt();
    [radius * cos, radius * sin, -v * sin, v * cos]
}

impl Env {
    fn step(&mut self, arch: Arch, out: &mut [f32], bodies: usize) -> u64 {
        for s in &mut self.satellites {
            let r2 = s[0] * s[0] + s[1] * s[1];
            let k = GM / (r2 * r2.sqrt());
            s[2] -= k * s[0];
            s[3] -= k * s[1];
            s[0] += s[2];
            s[1] += s[3];
        }
        let (own, debris) = out.split_at_mut(3 * SATELLITE_VALUES);
        let has_event = arch.dispatch(DebrisPass {
            satellites: self.satellites,
            columns: [&mut self.x, &mut self.y, &mut self.vx, &mut self.vy],
            out: &mut *debris,
            bodies,
        });
        for (cells, s) in own.chunks_exact_mut(SATELLITE_VALUES).zip(&self.satellites) {
            write_f32(cells, s);
        }
        debris[4 * bodies..].fill(1.0);
        u64::from(has_event)
    }
}

#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "observations are single precision")]
fn write_f32(to: &mut [f32], from: &[f64]) {
    for (cell, value) in to.iter_mut().zip(from) {
        *cell = *value as f32;
    }
}

struct DebrisPass<'a> {
    satellites: [[f64; 4]; 3],
    columns: [&'a mut [f64]; 4],
    out: &'a mut [f32],
    bodies: usize,
}

impl WithSimd for DebrisPass<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, v: S) -> bool {
        let [xs, ys, vxs, vys] = self.columns;
        let square = |x, y| v.add_f64s(v.mul_f64s(x, x), v.mul_f64s(y, y));
        let gm = v.splat_f64s(GM);
        let (mut lowest, mut nearest) = (v.splat_f64s(f64::MAX), v.splat_f64s(f64::MAX));
        let [a, b, c] = self.satellites;
        let [ax, ay, bx, by, cx, cy] = [a[0], a[1], b[0], b[1], c[0], c[1]];
        let satellites = [
            (v.splat_f64s(ax), v.splat_f64s(ay)),
            (v.splat_f64s(bx), v.splat_f64s(by)),
            (v.splat_f64s(cx), v.splat_f64s(cy)),
        ];
        let (x, y) = (S::as_mut_simd_f64s(xs).0, S::as_mut_simd_f64s(ys).0);
        let (vx, vy) = (S::as_mut_simd_f64s(vxs).0, S::as_mut_simd_f64s(vys).0);
        for (((x, y), vx), vy) in x.iter_mut().zip(y).zip(vx).zip(vy) {
            let r2 = square(*x, *y);
            let k = v.div_f64s(gm, v.mul_f64s(r2, v.sqrt_f64s(r2)));
            *vx = v.sub_f64s(*vx, v.mul_f64s(k, *x));
            *vy = v.sub_f64s(*vy, v.mul_f64s(k, *y));
            *x = v.add_f64s(*x, *vx);
            *y = v.add_f64s(*y, *vy);
            lowest = v.min_f64s(lowest, square(*x, *y));
            for (sx, sy) in satellites {
                nearest = v.min_f64s(nearest, square(v.sub_f64s(sx, *x), v.sub_f64s(sy, *y)));
            }
        }
        for (column, source) in self.out.chunks_exact_mut(self.bodies).zip([xs, ys, vxs, vys]) {
            write_f32(column, source);
        }
        v.reduce_min_f64s(lowest) < EARTH_RADIUS_SQUARED
            || v.reduce_min_f64s(nearest) < CONTACT_DISTANCE_SQUARED
    }
}
