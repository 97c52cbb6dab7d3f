//! A satellite's path in the planet-fixed frame.

use super::search_error::SearchError;
use crate::tasking::earth::EARTH_RATE_RAD_S;
use crate::tasking::orbit::propagator::STEP_S;
use crate::tasking::orbit::{HermiteArc, Orbit, OrbitNode, Sky};
use crate::tasking::vector3::{Vector3, norm, rotate};

/// Nodes of an orbit in the planet-fixed frame, computed lazily.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GroundTrack {
    nodes: Vec<OrbitNode>,
    /// Largest distance of the nodes from the Earth's centre, m.
    max_radius_m: f64,
    /// True for the trajectory that BSK-RL searches for windows, false for the true one.
    is_searched: bool,
    error: Option<SearchError>,
}

impl GroundTrack {
    /// Extends the track, and the orbit below it, until the nodes cover a time, s.
    pub fn extend_to(&mut self, seconds: f64, orbit: &mut Orbit, sky: &mut Sky) {
        let needed = (seconds / STEP_S).ceil() as usize + 1;
        if self.nodes.len() >= needed {
            return;
        }
        orbit.extend_to(seconds, sky);
        for index in self.nodes.len()..needed.min(orbit.nodes().len()) {
            let node = self.searched_node(&orbit.nodes()[index], orbit.basilisk_step_s(), sky);
            let node = to_planet_fixed(&node, index, sky);
            let radius = norm(&node.position);
            self.max_radius_m = self.max_radius_m.max(radius);
            self.nodes.push(node);
        }
    }

    /// The trajectory that BSK-RL searches for windows.
    #[must_use]
    pub fn searched() -> Self {
        Self { is_searched: true, ..Self::default() }
    }

    /// The next node of the trajectory that belongs to a node of the orbit.
    fn searched_node(&mut self, node: &OrbitNode, basilisk_step_s: f64, sky: &Sky) -> OrbitNode {
        if !self.is_searched {
            return *node;
        }
        match &mut self.error {
            None => {
                self.error = Some(SearchError::new(node, sky.earth(0.0).equator, basilisk_step_s));
                *node
            }
            Some(error) => {
                error.advance();
                error.apply(node)
            }
        }
    }

    /// Nodes so far, [`STEP_S`] apart.
    #[must_use]
    pub fn nodes(&self) -> &[OrbitNode] {
        &self.nodes
    }

    /// Largest distance of the nodes from the Earth's centre, m.
    #[must_use]
    pub const fn max_radius_m(&self) -> f64 {
        self.max_radius_m
    }

    /// Planet-fixed position at a time, m. The track must extend to it.
    #[must_use]
    pub fn position(&self, seconds: f64) -> Vector3<f64> {
        let index = ((seconds / STEP_S) as usize).min(self.nodes.len().saturating_sub(2));
        self.arc(index).position(seconds)
    }

    /// Path from a node to the next.
    #[must_use]
    pub fn arc(&self, index: usize) -> HermiteArc {
        HermiteArc::new(index as f64 * STEP_S, &self.nodes[index], &self.nodes[index + 1])
    }
}

/// State of the node of an index relative to the turning Earth (Vallado 2013, eq. 3-57 and its derivative).
fn to_planet_fixed(node: &OrbitNode, index: usize, sky: &Sky) -> OrbitNode {
    const RATE: f64 = EARTH_RATE_RAD_S;
    let matrix = sky.earth_at_node(index).planet_from_inertial();
    let position = rotate(&matrix, &node.position);
    let turned: Vector3<f64> = rotate(&matrix, &node.velocity);
    let velocity = [turned[0] + RATE * position[1], turned[1] - RATE * position[0], turned[2]];
    let turned = rotate(&matrix, &node.acceleration);
    let acceleration = [
        turned[0] + RATE * (2.0 * velocity[1] + RATE * position[0]),
        turned[1] - RATE * (2.0 * velocity[0] - RATE * position[1]),
        turned[2],
    ];
    OrbitNode { position, velocity, acceleration }
}
