//! The environments of the world: scenarios drawn from a seed.
//!
//! Each has params, whose defaults are those of a published environment of BSK-RL where there is one, and builds a
//! [`Setup`](super::setup::Setup) from them and the draws of an episode.

pub mod constellation;
mod draws;
pub mod imaging;
pub mod scanning;

pub use self::constellation::ConstellationParams;
pub use self::imaging::ImagingParams;
pub use self::scanning::ScanningParams;
use super::setup::Setup;
use crate::episode_rng::EpisodeRng;

/// Watt-seconds of a watt-hour.
const WS_PER_WH: f64 = 3600.0;
/// Longest duration of a step, s.
const MAX_STEP_S: f64 = 600.0;
/// Duration of an orbit by which observations are divided, s.
const ORBIT_S: f64 = 5700.0;

/// An environment whose scenarios are drawn from a seed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TaskingEnvironment {
    /// One satellite scans the ground (`tasking/scanning`).
    Scanning(ScanningParams),
    /// One satellite images targets (`tasking/imaging`).
    Imaging(ImagingParams),
    /// Several satellites image the same targets (`tasking/constellation`).
    Constellation(ConstellationParams),
}

impl TaskingEnvironment {
    /// The environments with their default params.
    #[must_use]
    pub fn defaults() -> [Self; 3] {
        [
            Self::Scanning(ScanningParams::default()),
            Self::Imaging(ImagingParams::default()),
            Self::Constellation(ConstellationParams::default()),
        ]
    }

    /// Id of the environment's task.
    #[must_use]
    pub const fn id(&self) -> &'static str {
        match self {
            Self::Scanning(_) => "tasking/scanning",
            Self::Imaging(_) => "tasking/imaging",
            Self::Constellation(_) => "tasking/constellation",
        }
    }

    /// Height of the orbits above the Earth, m.
    #[must_use]
    pub const fn altitude_m(&self) -> f64 {
        match self {
            Self::Scanning(_) | Self::Imaging(_) => draws::RANDOM_ALTITUDE_M,
            Self::Constellation(_) => constellation::ALTITUDE_M,
        }
    }

    /// Inclination of the orbits, degrees.
    #[must_use]
    pub const fn inclination_deg(&self) -> f64 {
        match self {
            Self::Scanning(_) | Self::Imaging(_) => draws::RANDOM_INCLINATION_DEG,
            Self::Constellation(_) => constellation::INCLINATION_DEG,
        }
    }

    /// The environment of a task's id, with its default params.
    #[must_use]
    pub fn from_id(id: &str) -> Option<Self> {
        Self::defaults().into_iter().find(|environment| environment.id() == id)
    }

    /// Draws a scenario of the environment.
    pub fn setup(&self, rng: &mut impl EpisodeRng) -> Setup {
        match self {
            Self::Scanning(params) => params.setup(rng),
            Self::Imaging(params) => params.setup(rng),
            Self::Constellation(params) => params.setup(rng),
        }
    }
}
