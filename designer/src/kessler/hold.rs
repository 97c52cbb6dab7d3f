//! Where satellites are if nobody burns.

use env_core::kessler::constants::{EARTH_RADIUS, HORIZON, SATELLITES};
use env_core::kessler::kernel::{Body, Gravity};

/// After each step, from the start on; a satellite that falls into the Earth stays where it fell.
#[derive(Debug, Clone)]
pub(super) struct Hold {
    paths: [Vec<Body>; SATELLITES],
    /// Radar range, LU, where it is limited.
    radar: Option<f64>,
}

impl Hold {
    pub(super) fn of(satellites: &[Body; SATELLITES], gravity: Gravity, radar: Option<f64>) -> Self {
        let path = |start: &Body| {
            let mut path = Vec::with_capacity(HORIZON as usize + 1);
            let mut body = *start;
            path.push(body);
            for _ in 0..HORIZON {
                if body.radius() >= EARTH_RADIUS {
                    body = body.coasted(gravity);
                }
                path.push(body);
            }
            path
        };
        Self { paths: satellites.each_ref().map(path), radar }
    }

    /// Where satellites start.
    pub(super) fn starts(&self) -> [Body; SATELLITES] {
        self.paths.each_ref().map(|path| path[0])
    }

    /// A satellite after a step.
    pub(super) fn at(&self, satellite: usize, step: u32) -> &Body {
        &self.paths[satellite][step as usize]
    }

    /// Whether something there is visible after a step.
    pub(super) fn sees(&self, step: u32, at: &Body) -> bool {
        self.radar.is_none_or(|range| {
            (0..SATELLITES).any(|satellite| {
                let of = self.at(satellite, step);
                let (dx, dy) = (of.x - at.x, of.y - at.y);
                dx * dx + dy * dy <= range * range
            })
        })
    }
}
