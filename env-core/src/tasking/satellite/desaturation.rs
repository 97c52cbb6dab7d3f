//! Desaturation of the wheels by thrusters: Basilisk's `thrMomentumManagement`, `thrForceMapping`, `thrMomentumDumping` and
//! `thrusterDynamicEffector`.
//!
//! The momentum to be removed is determined at the first tick of an action. Pulses follow from the second tick on, every
//! `maxCounterValue` + 1 ticks, until their impulse is delivered or another action begins.

use std::sync::LazyLock;

use crate::tasking::constants::{THRUST_N, THRUSTERS, WHEEL_INERTIA_KG_M2};
use crate::tasking::vector3::{Vector3, add, cross, dot, norm, scale};

/// Positions of the thrusters in body axes, m (BSK-RL's `idealMonarc1Octet`).
const POSITIONS: [Vector3<f64>; THRUSTERS] = [
    [3.874_945_160_902_288e-2, -1.206_182_747_348_013, 0.85245],
    [3.874_945_160_902_288e-2, -1.206_182_747_348_013, -0.85245],
    [-3.874_945_160_902_266e-2, -1.206_182_747_348_013, 0.85245],
    [-3.874_945_160_902_266e-2, -1.206_182_747_348_013, -0.85245],
    [-3.874_945_160_902_288e-2, 1.206_182_747_348_013, 0.85245],
    [-3.874_945_160_902_288e-2, 1.206_182_747_348_013, -0.85245],
    [3.874_945_160_902_266e-2, 1.206_182_747_348_013, 0.85245],
    [3.874_945_160_902_266e-2, 1.206_182_747_348_013, -0.85245],
];
/// Components of the thrusters' directions: they are diagonals of the x–y plane.
const DIAGONAL: f64 = std::f64::consts::FRAC_1_SQRT_2;
const DIRECTIONS: [Vector3<f64>; THRUSTERS] = [
    [-DIAGONAL, DIAGONAL, 0.0],
    [-DIAGONAL, DIAGONAL, 0.0],
    [DIAGONAL, DIAGONAL, 0.0],
    [DIAGONAL, DIAGONAL, 0.0],
    [DIAGONAL, -DIAGONAL, 0.0],
    [DIAGONAL, -DIAGONAL, 0.0],
    [-DIAGONAL, -DIAGONAL, 0.0],
    [-DIAGONAL, -DIAGONAL, 0.0],
];
/// Shortest time for which a Monarc-1 fires, s.
const MIN_ON_TIME_S: f64 = 0.02;

/// Torque of each thruster per force, m, and the inverse of D·Dᵀ, 1/m².
struct Geometry {
    arms: [Vector3<f64>; THRUSTERS],
    inverse: [Vector3<f64>; 3],
}

static GEOMETRY: LazyLock<Geometry> = LazyLock::new(|| {
    let arms: [Vector3<f64>; THRUSTERS] = std::array::from_fn(|i| cross(&POSITIONS[i], &DIRECTIONS[i]));
    let mut product = [[0.0; 3]; 3];
    for arm in &arms {
        for (row, a) in product.iter_mut().zip(arm) {
            row.iter_mut().zip(arm).for_each(|(cell, b)| *cell += a * b);
        }
    }
    Geometry { arms, inverse: invert(&product) }
});

/// Inverse of a symmetric matrix by cofactors.
fn invert(m: &[Vector3<f64>; 3]) -> [Vector3<f64>; 3] {
    let cofactors = [cross(&m[1], &m[2]), cross(&m[2], &m[0]), cross(&m[0], &m[1])];
    let determinant = dot(&m[0], &cofactors[0]);
    cofactors.map(|row| scale(&row, 1.0 / determinant))
}

/// Settings of the desaturation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DesaturationSettings {
    /// Momentum below which nothing is done, N·m·s.
    pub min_momentum: f64,
    /// Ticks without firing between two pulses.
    pub max_counter: u32,
    /// Shortest pulse of a thruster, s.
    pub min_fire_s: f64,
    /// True if a pulse delivers its whole impulse; false for Basilisk's first stage only.
    pub full_thrust: bool,
}

/// Times for which each thruster still has to fire, s.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Request {
    remaining_s: [f64; THRUSTERS],
}

/// A torque that acts in one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pulse {
    /// Tick in which the torque acts.
    pub tick: u64,
    /// Torque on the body, N·m.
    pub torque: Vector3<f64>,
}

/// State of the desaturation of a satellite.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Desaturation {
    /// Tick of the flight software at which the request is determined, while an action runs that has none yet.
    request_tick: Option<u64>,
    /// The request, and the tick of the flight software that commands the next pulse.
    request: Option<(Request, u64)>,
    /// A pulse that was commanded and has not acted yet.
    pending: Option<Pulse>,
    /// The last command to the thrusters: its tick, and the time for which each fires, s.
    commanded: Option<(u64, [f64; THRUSTERS])>,
}

impl Desaturation {
    /// Begins a desaturation after the tick `now`.
    pub const fn start(&mut self, now: u64) {
        self.request_tick = Some(now + 1);
        self.request = None;
    }

    /// Ends the desaturation. A pulse that was commanded still acts.
    pub const fn stop(&mut self) {
        self.request_tick = None;
        self.request = None;
    }

    /// The pulse that acts in the next tick or later, if one was commanded.
    #[must_use]
    pub const fn pending(&self) -> Option<Pulse> {
        self.pending
    }

    /// Times for which the thrusters were commanded to fire at a tick, s.
    #[must_use]
    pub fn commanded_at(&self, tick: u64) -> [f64; THRUSTERS] {
        self.commanded.filter(|(at, _)| *at == tick).map_or([0.0; THRUSTERS], |(_, on_times)| on_times)
    }

    /// The next tick after which [`Desaturation::update`] must be called.
    #[must_use]
    pub fn next_tick(&self) -> Option<u64> {
        let command = self.request.map(|(_, tick)| tick);
        [self.request_tick, command, self.pending.map(|pulse| pulse.tick)].into_iter().flatten().min()
    }

    /// Runs the flight software's tasks of tick `now`, whose length is `step_s`.
    pub fn update(
        &mut self,
        now: u64,
        step_s: f64,
        wheels_rad_s: &Vector3<f64>,
        settings: &DesaturationSettings,
    ) {
        if self.pending.is_some_and(|pulse| pulse.tick <= now) {
            self.pending = None;
        }
        if self.request_tick == Some(now) {
            self.request_tick = None;
            self.request = Some((Request::new(wheels_rad_s, settings), now + 1));
        } else if let Some((mut request, tick)) = self.request
            && tick == now
        {
            let on_times = request.fire(step_s, settings);
            self.commanded = Some((now, on_times));
            self.pending = pulse(now, step_s, &on_times, settings);
            self.request = Some((request, now + u64::from(settings.max_counter) + 1));
        }
    }
}

/// Impulse on the body of the first `pulses` pulses of a desaturation with the wheels at these speeds, N·m·s, for ticks of 1 s.
pub(crate) fn planned_impulse(
    wheels_rad_s: &Vector3<f64>,
    settings: &DesaturationSettings,
    pulses: u32,
) -> Vector3<f64> {
    /// Share of a pulse's impulse that its first stage of RK4 delivers.
    const FIRST_STAGE: f64 = 1.0 / 6.0;
    let request = Request::new(wheels_rad_s, settings);
    let share = if settings.full_thrust { 1.0 } else { FIRST_STAGE };
    let mut impulse = [0.0; 3];
    for (arm, remaining_s) in GEOMETRY.arms.iter().zip(request.remaining_s) {
        let fired_s = remaining_s.min(f64::from(pulses));
        let fired_s = if settings.full_thrust { fired_s } else { fired_s.trunc() };
        impulse = add(&impulse, &scale(arm, THRUST_N * share * fired_s));
    }
    impulse
}

impl Request {
    /// Times for which the thrusters must fire to remove the wheels' momentum, with the least forces (`thrForceMapping`).
    fn new(wheels_rad_s: &Vector3<f64>, settings: &DesaturationSettings) -> Self {
        let momentum = scale(wheels_rad_s, WHEEL_INERTIA_KG_M2);
        let size = norm(&momentum);
        if size < settings.min_momentum || size == 0.0 {
            return Self { remaining_s: [0.0; THRUSTERS] };
        }
        let change = scale(&momentum, -(size - settings.min_momentum) / size);
        let weights = GEOMETRY.inverse.map(|row| dot(&row, &change));
        let impulses: [f64; THRUSTERS] = std::array::from_fn(|i| dot(&GEOMETRY.arms[i], &weights));
        let least = impulses.iter().fold(0.0_f64, |least, x| least.min(*x));
        Self { remaining_s: impulses.map(|x| (x - least) / THRUST_N) }
    }

    /// Commands a pulse: how long each thruster fires, s.
    fn fire(&mut self, step_s: f64, settings: &DesaturationSettings) -> [f64; THRUSTERS] {
        let on_times = self.remaining_s.map(|time| {
            let is_long_enough = time >= settings.min_fire_s && time >= MIN_ON_TIME_S.min(step_s);
            if is_long_enough { time.min(step_s) } else { 0.0 }
        });
        self.remaining_s = self.remaining_s.map(|time| (time - step_s).max(0.0));
        on_times
    }
}

/// Torque of a pulse that the flight software commands at tick `now`; it acts two ticks later.
fn pulse(
    now: u64,
    step_s: f64,
    on_times: &[f64; THRUSTERS],
    settings: &DesaturationSettings,
) -> Option<Pulse> {
    let mut torque = [0.0; 3];
    for (arm, on_time) in GEOMETRY.arms.iter().zip(on_times) {
        let share = if settings.full_thrust {
            6.0 * (on_time / step_s)
        } else {
            f64::from(u8::from(is_on_at_start(now, step_s, *on_time)))
        };
        torque = add(&torque, &scale(arm, THRUST_N * share));
    }
    (torque != [0.0; 3]).then_some(Pulse { tick: now + 2, torque })
}

/// True if a pulse is still on at the start of the tick in which it acts, which is the only stage of RK4 that Basilisk's
/// thrusters act in. The comparison is Basilisk's, in seconds from nanoseconds: its rounding lets some pulses vanish.
fn is_on_at_start(now: u64, step_s: f64, on_time: f64) -> bool {
    let nanoseconds = (step_s * 1e9).round();
    let seconds = |tick: u64| (tick as f64 * nanoseconds) * 1e-9;
    on_time > 0.0 && on_time + seconds(now) - seconds(now + 1) >= 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Impulse of a pulse by the first stage of RK4, whose weight is a sixth, N·m·s.
    fn impulse(step_s: f64, on_times: [f64; THRUSTERS], full_thrust: bool) -> Vector3<f64> {
        let settings =
            DesaturationSettings { min_momentum: 0.0, max_counter: 4, min_fire_s: 0.0, full_thrust };
        let torque = pulse(0, step_s, &on_times, &settings).map_or([0.0; 3], |pulse| pulse.torque);
        scale(&torque, step_s / 6.0)
    }

    #[test]
    fn full_pulses_deliver_force_times_duration() {
        let on_times: [f64; THRUSTERS] = std::array::from_fn(|i| [0.0, 0.3, 1.0][i % 3]);
        for step_s in [1.0, 2.0] {
            let mut wanted = [0.0; 3];
            for (arm, on_time) in GEOMETRY.arms.iter().zip(on_times) {
                wanted = add(&wanted, &scale(arm, THRUST_N * on_time));
            }
            let error = norm(&add(&impulse(step_s, on_times, true), &scale(&wanted, -1.0)));
            assert!(error < 1e-12 * norm(&wanted), "{error}");
        }
    }

    #[test]
    fn pulses_of_basilisk_deliver_a_sixth_or_nothing() {
        let one = |on_time: f64| std::array::from_fn(|i| if i == 2 { on_time } else { 0.0 });
        let whole = norm(&scale(&GEOMETRY.arms[2], THRUST_N));
        assert!((norm(&impulse(1.0, one(1.0), false)) - whole / 6.0).abs() < 1e-12);
        assert_eq!(impulse(1.0, one(0.9), false), [0.0; 3]);
    }
}
