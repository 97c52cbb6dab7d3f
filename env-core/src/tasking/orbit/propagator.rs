//! Propagation of an orbit by an Adams–Bashforth–Moulton method of order 8 in PECE form (Montenbruck and Gill 2000, *Satellite
//! Orbits*, section 4.2), started by DOP853.
//!
//! The attitude does not act on the orbit, so an orbit is computed ahead of the simulation, only as far as something asks for
//! it. Positions between the nodes are quintic Hermite polynomials.

use super::dop853::{OrbitState, dop853_step};
use super::gravity::GravityModel;
use crate::tasking::constants::EARTH_MU;
use crate::tasking::earth::{EARTH_RATE_RAD_S, EarthFrame, EarthRotation};
use crate::tasking::sun::{NODE_S, SunArc};
use crate::tasking::vector3::{Vector3, add, dot, scale, sub};

/// Seconds between two nodes of an orbit.
pub const STEP_S: f64 = 60.0;
/// Order of the method, which is the number of derivatives that it keeps.
const ORDER: usize = 8;
/// Weights of the predictor, newest derivative first, times 120 960.
const PREDICTOR: [f64; ORDER] =
    [434_241.0, -1_152_169.0, 2_183_877.0, -2_664_477.0, 2_102_243.0, -1_041_723.0, 295_767.0, -36_799.0];
/// Weights of the corrector, predicted derivative first, times 120 960.
const CORRECTOR: [f64; ORDER] =
    [36_799.0, 139_849.0, -121_797.0, 123_133.0, -88_547.0, 41_499.0, -11_351.0, 1_375.0];
/// Common denominator of the weights.
const DENOMINATOR: f64 = 120_960.0;
/// Seconds that one arc of the Sun covers.
const ARC_S: f64 = 2.0 * NODE_S;

/// Nodes whose meridian is turned from the node before, so that rounding errors do not add up.
const TURNED_NODES: usize = 32;

/// State of the orbit at a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrbitNode {
    /// Position in the inertial frame, m.
    pub position: Vector3<f64>,
    /// Velocity in the inertial frame, m/s.
    pub velocity: Vector3<f64>,
    /// Acceleration in the inertial frame, m/s².
    pub acceleration: Vector3<f64>,
}

impl OrbitNode {
    const fn state(&self) -> OrbitState {
        let (r, v) = (self.position, self.velocity);
        [r[0], r[1], r[2], v[0], v[1], v[2]]
    }

    const fn derivative(&self) -> OrbitState {
        let (v, a) = (self.velocity, self.acceleration);
        [v[0], v[1], v[2], a[0], a[1], a[2]]
    }
}

/// The sky of an episode: the Earth's rotation and the Sun by seconds since the episode's start.
#[derive(Debug, Clone, PartialEq)]
pub struct Sky {
    start_tdb_s: f64,
    rotation: EarthRotation,
    /// Cosine and sine of the Earth's rotation between two nodes.
    node_turn: [f64; 2],
    /// Cosine and sine of the prime meridian's rotation at the nodes of orbits.
    meridians: Vec<[f64; 2]>,
    arcs: Vec<SunArc>,
}

impl Sky {
    /// Creates the sky of an episode that starts at a barycentric dynamical time, s since J2000.
    #[must_use]
    pub fn new(start_tdb_s: f64) -> Self {
        let (turn_sin, turn_cos) = libm::sincos(EARTH_RATE_RAD_S * STEP_S);
        Self {
            start_tdb_s,
            rotation: EarthRotation::new(start_tdb_s),
            node_turn: [turn_cos, turn_sin],
            meridians: Vec::new(),
            arcs: vec![SunArc::starting_at(start_tdb_s)],
        }
    }

    /// Computes the sky up to a time, s.
    pub fn extend_to(&mut self, seconds: f64) {
        let nodes = (seconds / STEP_S).ceil() as usize + 1;
        while self.meridians.len() < nodes {
            let node = self.meridians.len();
            let meridian = match self.meridians.last() {
                Some([cos, sin]) if !node.is_multiple_of(TURNED_NODES) => {
                    let [turn_cos, turn_sin] = self.node_turn;
                    [cos * turn_cos - sin * turn_sin, sin * turn_cos + cos * turn_sin]
                }
                _ => self.rotation.meridian(node as f64 * STEP_S),
            };
            self.meridians.push(meridian);
        }
        while self.arcs.len() as f64 * ARC_S < seconds {
            let start = self.start_tdb_s + self.arcs.len() as f64 * ARC_S;
            self.arcs.push(SunArc::starting_at(start));
        }
    }

    /// Position of the Sun relative to the Earth, m. The sky must extend to the time.
    #[must_use]
    pub fn sun(&self, seconds: f64) -> Vector3<f64> {
        let arc = ((seconds / ARC_S) as usize).min(self.arcs.len() - 1);
        self.arcs[arc].position(seconds - arc as f64 * ARC_S)
    }

    /// Orientation of the Earth.
    #[must_use]
    pub fn earth(&self, seconds: f64) -> EarthFrame {
        self.rotation.frame(seconds)
    }

    /// Direction of the Earth's pole in the inertial frame.
    #[must_use]
    pub fn earth_pole(&self, seconds: f64) -> Vector3<f64> {
        self.rotation.frame_at(seconds, [1.0, 0.0]).equator[2]
    }

    /// Orientation of the Earth at a node of orbits. The sky must extend to it.
    #[must_use]
    pub fn earth_at_node(&self, node: usize) -> EarthFrame {
        self.rotation.frame_at(node as f64 * STEP_S, self.meridians[node])
    }
}

/// An orbit, propagated lazily.
#[derive(Debug, Clone, PartialEq)]
pub struct Orbit {
    gravity: GravityModel,
    /// Step with which Basilisk would integrate, s.
    basilisk_step_s: f64,
    nodes: Vec<OrbitNode>,
}

impl Orbit {
    /// Creates an orbit from its state at the episode's start: position, m, and velocity, m/s, in the inertial frame.
    /// `basilisk_step_s` is the step with which Basilisk would integrate it, s.
    #[must_use]
    pub fn new(
        gravity: GravityModel,
        position: Vector3<f64>,
        velocity: Vector3<f64>,
        sky: &Sky,
        basilisk_step_s: f64,
    ) -> Self {
        let acceleration = gravity.acceleration(&position, &sky.earth(0.0), &sky.sun(0.0), basilisk_step_s);
        Self { gravity, basilisk_step_s, nodes: vec![OrbitNode { position, velocity, acceleration }] }
    }

    /// Propagates the orbit until its nodes cover a time, s.
    pub fn extend_to(&mut self, seconds: f64, sky: &mut Sky) {
        let needed = (seconds / STEP_S).ceil() as usize + 1;
        if self.nodes.len() >= needed.max(2) {
            return;
        }
        sky.extend_to(needed.max(ORDER) as f64 * STEP_S);
        while self.nodes.len() < needed.max(2) {
            let next = if self.nodes.len() < ORDER { self.start_node(sky) } else { self.next_node(sky) };
            self.nodes.push(next);
        }
    }

    /// Step with which Basilisk would integrate the orbit, s.
    #[must_use]
    pub const fn basilisk_step_s(&self) -> f64 {
        self.basilisk_step_s
    }

    /// Nodes so far, [`STEP_S`] apart.
    #[must_use]
    pub fn nodes(&self) -> &[OrbitNode] {
        &self.nodes
    }

    /// Path between the node at or before a time and the next one. The orbit must extend to the time.
    #[must_use]
    pub fn arc(&self, seconds: f64) -> HermiteArc {
        let index = ((seconds / STEP_S) as usize).min(self.nodes.len().saturating_sub(2));
        HermiteArc::new(index as f64 * STEP_S, &self.nodes[index], &self.nodes[index + 1])
    }

    /// Position after a number of halves of [`STEP_S`]: that of a node, or the middle of an arc. The orbit must extend to it.
    #[must_use]
    pub fn half_arc_position(&self, halves: usize) -> Vector3<f64> {
        const VELOCITY: f64 = STEP_S / 32.0 * 5.0;
        const ACCELERATION: f64 = STEP_S * STEP_S / 64.0;
        let from = &self.nodes[halves / 2];
        if halves.is_multiple_of(2) {
            return from.position;
        }
        let to = &self.nodes[halves / 2 + 1];
        [0, 1, 2].map(|i| {
            0.5 * (from.position[i] + to.position[i])
                + VELOCITY * (from.velocity[i] - to.velocity[i])
                + ACCELERATION * (from.acceleration[i] + to.acceleration[i])
        })
    }

    /// Acceleration at a state.
    fn acceleration(&self, state: &OrbitState, frame: &EarthFrame, sun: &Vector3<f64>) -> Vector3<f64> {
        self.gravity.acceleration(&[state[0], state[1], state[2]], frame, sun, self.basilisk_step_s)
    }

    /// The next node by one step of DOP853.
    fn start_node(&self, sky: &Sky) -> OrbitNode {
        let start = (self.nodes.len() - 1) as f64 * STEP_S;
        let last = self.nodes[self.nodes.len() - 1];
        let end = dop853_step(&last.state(), STEP_S, |since, state| {
            let time = start + since;
            let a = self.acceleration(state, &sky.earth(time), &sky.sun(time));
            [state[3], state[4], state[5], a[0], a[1], a[2]]
        });
        self.node_from(&end, &sky.earth(start + STEP_S), &sky.sun(start + STEP_S))
    }

    /// The next node by one step of the multistep method: predict, evaluate, correct, evaluate.
    ///
    /// The corrector moves the satellite by less than a millimetre, over which only the attraction of a point mass changes.
    fn next_node(&self, sky: &Sky) -> OrbitNode {
        let index = self.nodes.len();
        let (frame, sun) = (sky.earth_at_node(index), sky.sun(index as f64 * STEP_S));
        let recent = &self.nodes[self.nodes.len() - ORDER..];
        let last = recent[ORDER - 1].state();
        let mut predicted = last;
        for (weight, node) in PREDICTOR.iter().zip(recent.iter().rev()) {
            accumulate(&mut predicted, *weight, &node.derivative());
        }
        let predicted = self.node_from(&predicted, &frame, &sun);
        let mut corrected = last;
        let known = recent.iter().rev().map(OrbitNode::derivative);
        for (weight, derivative) in CORRECTOR.iter().zip(std::iter::once(predicted.derivative()).chain(known))
        {
            accumulate(&mut corrected, *weight, &derivative);
        }
        let [x, y, z, vx, vy, vz] = corrected;
        let position = [x, y, z];
        let change = sub(&point_attraction(&position), &point_attraction(&predicted.position));
        let acceleration = add(&predicted.acceleration, &change);
        OrbitNode { position, velocity: [vx, vy, vz], acceleration }
    }

    fn node_from(&self, state: &OrbitState, frame: &EarthFrame, sun: &Vector3<f64>) -> OrbitNode {
        let [x, y, z, vx, vy, vz] = *state;
        let acceleration = self.acceleration(state, frame, sun);
        OrbitNode { position: [x, y, z], velocity: [vx, vy, vz], acceleration }
    }
}

/// Attraction of the Earth as a point mass, m/s².
fn point_attraction(position: &Vector3<f64>) -> Vector3<f64> {
    let square = dot(position, position);
    scale(position, -EARTH_MU / (square * square.sqrt()))
}

/// Adds a derivative with a weight of the method to a state.
fn accumulate(state: &mut OrbitState, weight: f64, derivative: &OrbitState) {
    let factor = STEP_S / DENOMINATOR * weight;
    state.iter_mut().zip(derivative).for_each(|(x, k)| *x += factor * k);
}

/// Path between two nodes: a quintic polynomial in the time since the first node for each component.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HermiteArc {
    /// Time of the first node, s since the episode's start.
    pub start_s: f64,
    /// Coefficients of each component by power of the time, m/s^power.
    pub coefficients: [[f64; 6]; 3],
}

impl HermiteArc {
    /// Interpolates position, velocity and acceleration of two nodes (quintic Hermite).
    #[must_use]
    pub fn new(start_s: f64, from: &OrbitNode, to: &OrbitNode) -> Self {
        const H: f64 = STEP_S;
        const PER_S: f64 = 1.0 / H;
        const PER_S2: f64 = PER_S * PER_S;
        const PER_S3: f64 = PER_S2 * PER_S;
        let coefficients = [0, 1, 2].map(|i| {
            let (r, v, a) = (from.position[i], from.velocity[i], from.acceleration[i]);
            // Errors of the parabola through the first node at the second one, as velocities.
            let position = (to.position[i] - (r + H * (v + H * (0.5 * a)))) * PER_S;
            let velocity = to.velocity[i] - (v + H * a);
            let acceleration = (to.acceleration[i] - a) * H;
            let cubic = (10.0 * position - 4.0 * velocity + 0.5 * acceleration) * PER_S2;
            let quartic = (-15.0 * position + 7.0 * velocity - acceleration) * PER_S3;
            let quintic = (6.0 * position - 3.0 * velocity + 0.5 * acceleration) * (PER_S3 * PER_S);
            [r, v, 0.5 * a, cubic, quartic, quintic]
        });
        Self { start_s, coefficients }
    }

    /// Position at a time, m.
    #[must_use]
    pub fn position(&self, seconds: f64) -> Vector3<f64> {
        let t = seconds - self.start_s;
        self.coefficients.map(|c| c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * c[5])))))
    }

    /// Velocity at a time, m/s.
    #[must_use]
    pub fn velocity(&self, seconds: f64) -> Vector3<f64> {
        let t = seconds - self.start_s;
        self.coefficients
            .map(|c| c[1] + t * (2.0 * c[2] + t * (3.0 * c[3] + t * (4.0 * c[4] + t * (5.0 * c[5])))))
    }
}
