//! The bare kernel: the arithmetic of kessler's step and nothing else. Three satellites and n debris per environment move
//! by the same formulas in the same vector width, contacts are counted, and the same f32 columns are written. No burns,
//! no fuel, no rewards, no ends, no starts, no errors: what the engine's rules cost is the ratio to this.

use pulp::{Arch, Simd, WithSimd};

const GM: f64 = 1000.0;
const EARTH_2: f64 = 400.0;
const CONTACT_2: f64 = 4.0;
const LANES: usize = 8;
const NOWHERE: f64 = 1e12;
/// Values of a satellite in an observation, and columns of debris.
const SATELLITE_VALUES: usize = 6;
const COLUMNS: usize = 5;

/// Environments of the bare kernel.
pub(crate) struct Bare {
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

impl Bare {
    /// `envs` environments of `debris` pieces each on circular orbits; `bodies` columns are written.
    pub(crate) fn new(envs: usize, debris: usize, bodies: usize) -> Self {
        let env = |e: usize| {
            let padded = bodies.next_multiple_of(LANES);
            let column = |absent| vec![absent; padded];
            let mut env = Env {
                satellites: std::array::from_fn(|i| circular(50.0 + 10.0 * i as f64, (e + 2 * i) as f64)),
                x: column(NOWHERE),
                y: column(NOWHERE),
                vx: column(0.0),
                vy: column(0.0),
            };
            for i in 0..debris {
                let [x, y, vx, vy] =
                    circular(40.0 + 50.0 * (i as f64 + 0.5) / debris as f64, (7 * i + e) as f64);
                (env.x[i], env.y[i], env.vx[i], env.vy[i]) = (x, y, vx, vy);
            }
            env
        };
        Self { envs: (0..envs).map(env).collect(), bodies, arch: Arch::new() }
    }

    /// One step of all; how many environments had a contact or something inside the Earth.
    pub(crate) fn step(&mut self, observations: &mut [f32]) -> u64 {
        let width = 3 * SATELLITE_VALUES + COLUMNS * self.bodies;
        let (arch, bodies) = (self.arch, self.bodies);
        self.envs
            .iter_mut()
            .zip(observations.chunks_exact_mut(width))
            .map(|(env, out)| env.step(arch, out, bodies))
            .sum()
    }
}

fn circular(radius: f64, angle: f64) -> [f64; 4] {
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
        let flag = arch.dispatch(Pass {
            satellites: self.satellites,
            columns: [&mut self.x, &mut self.y, &mut self.vx, &mut self.vy],
            out: &mut *debris,
            bodies,
        });
        for (cells, s) in own.chunks_exact_mut(SATELLITE_VALUES).zip(&self.satellites) {
            narrow(cells, s);
        }
        debris[4 * bodies..].fill(1.0);
        u64::from(flag)
    }
}

#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "observations are single precision")]
fn narrow(to: &mut [f32], from: &[f64]) {
    for (cell, value) in to.iter_mut().zip(from) {
        *cell = *value as f32;
    }
}

struct Pass<'a> {
    satellites: [[f64; 4]; 3],
    columns: [&'a mut [f64]; 4],
    out: &'a mut [f32],
    bodies: usize,
}

impl WithSimd for Pass<'_> {
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
            narrow(column, source);
        }
        v.reduce_min_f64s(lowest) < EARTH_2 || v.reduce_min_f64s(nearest) < CONTACT_2
    }
}
