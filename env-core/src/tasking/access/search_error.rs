//! The error of the trajectory that BSK-RL searches for windows, which Basilisk integrates with steps of 30 s: 60 m in an orbit
//! (see [`stretch_acceleration`](crate::tasking::orbit::gravity::stretch_acceleration)).
//!
//! The ends of windows end steps, so that their error decides whether a step is a second longer. The error hardly depends on other
//! perturbations: it is the difference of two orbits about a point mass with the same start, one with the error of 30 s and one
//! with that of a tick, turned into the Hill frame of the true orbit. The first one is an orbit with the mean attraction of a step,
//! and with the error that the Runge–Kutta method makes in a step, which hardly changes within minutes.

use crate::tasking::constants::EARTH_MU;
use crate::tasking::earth::EARTH_RATE_RAD_S;
use crate::tasking::orbit::dop853::{OrbitState, dop853_step};
use crate::tasking::orbit::gravity::mean_stretch;
use crate::tasking::orbit::propagator::STEP_S;
use crate::tasking::orbit::{OrbitNode, hill_frame};
use crate::tasking::vector3::{Matrix3, Vector3, add, cross, dot, norm, rotate, rotate_back, scale, sub};

/// Nodes between two computed differences, which cubic polynomials interpolate to a millimetre.
const NODES_PER_SPAN: usize = 4;
/// Seconds between two computed differences.
const SPAN_S: f64 = NODES_PER_SPAN as f64 * STEP_S;
/// Step of BSK-RL's trajectory, s.
const INTEGRATED_STEP_S: f64 = 30.0;
/// Steps of BSK-RL's trajectory between two computed differences.
const STEPS_PER_SPAN: f64 = SPAN_S / INTEGRATED_STEP_S;

/// Two orbits about a point mass from the same start: as the trajectory is integrated, and as the satellite moves.
#[derive(Debug, Clone, PartialEq)]
pub struct SearchError {
    integrated: OrbitState,
    exact: OrbitState,
    equator: Matrix3<f64>,
    basilisk_step_s: f64,
    /// Differences at the start and the end of the current span.
    span: [HillDifference; 2],
    /// Number of nodes since the start of the span.
    node: usize,
}

/// Difference of the two orbits in the turning Hill frame of the exact one.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct HillDifference {
    /// Difference of position, m.
    position: Vector3<f64>,
    /// Its rate of change in the turning frame, m/s.
    rate: Vector3<f64>,
    /// Angular velocity of the frame about the orbit normal, rad/s.
    turn: f64,
}

impl SearchError {
    /// Creates the pair of orbits from the state of the first node. `equator` are the axes of the Earth's equator, and
    /// `basilisk_step_s` is the step with which Basilisk integrates the satellite, s.
    #[must_use]
    pub fn new(start: &OrbitNode, equator: Matrix3<f64>, basilisk_step_s: f64) -> Self {
        let (r, v) = (start.position, start.velocity);
        let state = [r[0], r[1], r[2], v[0], v[1], v[2]];
        let first = HillDifference::of(&state, &state);
        let span = [first, first];
        Self { integrated: state, exact: state, equator, basilisk_step_s, span, node: NODES_PER_SPAN }
    }

    /// Advances the difference to the next node.
    pub fn advance(&mut self) {
        if self.node == NODES_PER_SPAN {
            self.compute_span();
            self.node = 0;
        }
        self.node += 1;
    }

    /// Advances both orbits by a span.
    fn compute_span(&mut self) {
        let stretch = |time: f64| EARTH_RATE_RAD_S * time * (EARTH_RATE_RAD_S * time);
        let rate = |time: f64, state: &OrbitState| derivative(state, &self.equator, stretch(time));
        let stepped = rk4_step(&self.integrated, INTEGRATED_STEP_S, rate);
        let ends = self.exact_ends();
        let (from, to) = (hill_axes(&ends[2]), hill_axes(&ends[0]));
        self.integrated = ends[0];
        self.exact = ends[1];
        for first in [0, 3] {
            let error = sub(&part(&stepped, first), &part(&ends[2], first));
            let error = rotate_back(&to, &rotate(&from, &error));
            (0..3).for_each(|i| self.integrated[first + i] += STEPS_PER_SPAN * error[i]);
        }
        self.span = [self.span[1], HillDifference::of(&self.integrated, &self.exact)];
    }

    /// States without the error of the Runge–Kutta method: of the integrated and the exact orbit after a span, and of the integrated
    /// one after one of its steps. The processor computes the three side by side.
    fn exact_ends(&self) -> [OrbitState; 3] {
        const DIM: usize = 6;
        let of_step = mean_stretch(INTEGRATED_STEP_S);
        let stretches = [of_step, mean_stretch(self.basilisk_step_s), of_step];
        let speeds = [1.0, 1.0, INTEGRATED_STEP_S / SPAN_S];
        let orbit = |all: &[f64; 3 * DIM], index: usize| -> OrbitState {
            std::array::from_fn(|i| all[DIM * index + i])
        };
        let mut all = [0.0; 3 * DIM];
        for (state, start) in all.chunks_exact_mut(DIM).zip([&self.integrated, &self.exact, &self.integrated])
        {
            state.copy_from_slice(start);
        }
        let ends = dop853_step(&all, SPAN_S, |_, all| {
            let mut rates = [0.0; 3 * DIM];
            for index in 0..3 {
                let rate = derivative(&orbit(all, index), &self.equator, stretches[index]);
                (0..DIM).for_each(|i| rates[DIM * index + i] = speeds[index] * rate[i]);
            }
            rates
        });
        [0, 1, 2].map(|index| orbit(&ends, index))
    }

    /// The node of the searched trajectory that belongs to a node of the true orbit.
    #[must_use]
    pub fn apply(&self, node: &OrbitNode) -> OrbitNode {
        let (position, velocity) = self.difference();
        let frame = hill_frame(&node.position, &node.velocity);
        let (position, velocity) = (rotate_back(&frame, &position), rotate_back(&frame, &velocity));
        // The gradient of gravity at the difference of position.
        let radius = norm(&node.position);
        let radial = scale(&node.position, 1.0 / radius);
        let rate_2 = EARTH_MU / (radius * radius * radius);
        let tidal = sub(&scale(&radial, 3.0 * dot(&radial, &position)), &position);
        OrbitNode {
            position: add(&node.position, &position),
            velocity: add(&node.velocity, &velocity),
            acceleration: add(&node.acceleration, &scale(&tidal, rate_2)),
        }
    }

    /// Differences of position, m, and of inertial velocity, m/s, at the current node, in Hill axes.
    fn difference(&self) -> (Vector3<f64>, Vector3<f64>) {
        let [from, to] = &self.span;
        let share = self.node as f64 / NODES_PER_SPAN as f64;
        let mut position = [0.0; 3];
        let mut rate = [0.0; 3];
        for i in 0..3 {
            // Cubic Hermite polynomial of the share of the span.
            let (start, slope) = (from.position[i], SPAN_S * from.rate[i]);
            let rise = to.position[i] - start - slope;
            let turn = SPAN_S * to.rate[i] - slope;
            let (square, cube) = (3.0 * rise - turn, turn - 2.0 * rise);
            position[i] = start + share * (slope + share * (square + share * cube));
            rate[i] = (slope + share * (2.0 * square + share * (3.0 * cube))) / SPAN_S;
        }
        let turn = from.turn + share * (to.turn - from.turn);
        (position, [rate[0] - turn * position[1], rate[1] + turn * position[0], rate[2]])
    }
}

impl HillDifference {
    fn of(integrated: &OrbitState, exact: &OrbitState) -> Self {
        let (r, v) = (part(exact, 0), part(exact, 3));
        let frame = hill_frame(&r, &v);
        let position = rotate(&frame, &sub(&part(integrated, 0), &r));
        let velocity = rotate(&frame, &sub(&part(integrated, 3), &v));
        let turn = norm(&cross(&r, &v)) / dot(&r, &r);
        let rate = [velocity[0] + turn * position[1], velocity[1] - turn * position[0], velocity[2]];
        Self { position, rate, turn }
    }
}

/// Three components of a state: its position from index 0, or its velocity from index 3.
const fn part(state: &OrbitState, first: usize) -> Vector3<f64> {
    [state[first], state[first + 1], state[first + 2]]
}

/// Axes of the Hill frame of a state.
fn hill_axes(state: &OrbitState) -> Matrix3<f64> {
    hill_frame(&part(state, 0), &part(state, 3))
}

/// Motion about a point mass whose attraction is computed at a stretched position.
fn derivative(state: &OrbitState, equator: &Matrix3<f64>, stretch: f64) -> OrbitState {
    let [x, y, z, vx, vy, vz] = *state;
    let (position, pole) = ([x, y, z], &equator[2]);
    let square = dot(&position, &position);
    let inverse = 1.0 / square;
    let strength = -EARTH_MU * (inverse * inverse * square.sqrt());
    let height = dot(pole, &position);
    let along = strength * (1.0 + stretch * (1.0 - 1.5 * (1.0 - height * height * inverse)));
    let up = strength * stretch * height;
    [vx, vy, vz, along * x - up * pole[0], along * y - up * pole[1], along * z - up * pole[2]]
}

/// One step of the classical Runge–Kutta method. The derivative takes the time since the start of the step, s.
fn rk4_step(state: &OrbitState, step: f64, rate: impl Fn(f64, &OrbitState) -> OrbitState) -> OrbitState {
    let at =
        |rate: &OrbitState, time: f64| -> OrbitState { std::array::from_fn(|i| state[i] + time * rate[i]) };
    let k1 = rate(0.0, state);
    let k2 = rate(0.5 * step, &at(&k1, 0.5 * step));
    let k3 = rate(0.5 * step, &at(&k2, 0.5 * step));
    let k4 = rate(step, &at(&k3, step));
    std::array::from_fn(|i| state[i] + step / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]))
}
