//! Where satellites are if nobody burns.

use env_core::kessler::constants::{EARTH_RADIUS, HORIZON, SATELLITES};
use env_core::kessler::kernel::{Body, Gravity};
use env_core::kessler::least_distances;

/// After each step, from the start on; a satellite that falls into the Earth stays where it fell.
#[derive(Debug, Clone)]
pub(super) struct Hold {
    paths: Vec<[Body; SATELLITES]>,
    gravity: Gravity,
    /// Radar range, LU, where it is limited.
    radar: Option<f64>,
}

impl Hold {
    pub(super) fn of(satellites: &[Body; SATELLITES], gravity: Gravity, radar: Option<f64>) -> Self {
        let mut paths = Vec::with_capacity(HORIZON as usize + 1);
        let mut now = *satellites;
        paths.push(now);
        for _ in 0..HORIZON {
            now = now.map(|body| if body.radius() >= EARTH_RADIUS { body.coasted(gravity) } else { body });
            paths.push(now);
        }
        Self { paths, gravity, radar }
    }

    /// Where satellites start.
    pub(super) fn starts(&self) -> &[Body; SATELLITES] {
        &self.paths[0]
    }

    /// A satellite after a step.
    pub(super) fn at(&self, satellite: usize, step: u32) -> &Body {
        &self.paths[step as usize][satellite]
    }

    /// Whether something there is visible after a step.
    pub(super) fn sees(&self, step: u32, at: &Body) -> bool {
        self.radar.is_none_or(|range| {
            self.paths[step as usize].iter().any(|of| {
                let (dx, dy) = (of.x - at.x, of.y - at.y);
                dx * dx + dy * dy <= range * range
            })
        })
    }

    /// How near each of these bodies, which are there after step `from`, comes to any satellite from then on, LU.
    pub(super) fn least_distances(&self, from: u32, bodies: &[Body], swept: bool) -> Vec<f64> {
        least_distances(bodies, &self.paths[from as usize..], self.gravity, swept)
    }
}
