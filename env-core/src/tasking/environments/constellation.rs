//! `tasking/constellation`: satellites of one orbital plane image the same targets, and may share which are imaged.

use super::ORBIT_S;
use super::draws::circular_orbit;
use super::imaging::ImagingParams;
use crate::episode_rng::EpisodeRng;
use crate::tasking::orbit::OrbitalElements;
use crate::tasking::setup::Setup;
use crate::tasking::setup::environment::{Communicator, Links};

/// Altitude of the orbit, m.
pub(super) const ALTITUDE_M: f64 = 800e3;
/// Inclination of the orbit, degrees.
pub(super) const INCLINATION_DEG: f64 = 60.0;

/// Params of a constellation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConstellationParams {
    /// Number of satellites, 1 to 8.
    pub satellites: u32,
    /// Angle between neighbours along the orbit, degrees.
    pub spacing_deg: f64,
    /// Links along which satellites share which targets are imaged.
    pub links: Links,
    /// True if data travel along paths of links within a step.
    pub multi_degree: bool,
    /// Params of the targets and of each satellite.
    pub imaging: ImagingParams,
}

impl Default for ConstellationParams {
    fn default() -> Self {
        Self {
            satellites: 3,
            spacing_deg: 120.0,
            links: Links::LineOfSight,
            multi_degree: false,
            imaging: ImagingParams { targets: 1000, time_limit_s: 2.0 * ORBIT_S, ..ImagingParams::default() },
        }
    }
}

impl ConstellationParams {
    /// Draws a scenario of the environment.
    pub fn setup(&self, rng: &mut impl EpisodeRng) -> Setup {
        let first = circular_orbit(rng, ALTITUDE_M, INCLINATION_DEG);
        let agents = (0..self.satellites)
            .map(|index| {
                let ahead = f64::from(index) * self.spacing_deg.to_radians();
                let true_anomaly_rad = (first.true_anomaly_rad + ahead) % std::f64::consts::TAU;
                let orbit = OrbitalElements { true_anomaly_rad, ..first };
                self.imaging.agent(format!("Imager-{}", index + 1), orbit, rng)
            })
            .collect();
        let communicator =
            Communicator { links: self.links, multi_degree: self.multi_degree, ..Communicator::default() };
        self.imaging.setup_of(agents, communicator, rng)
    }
}
