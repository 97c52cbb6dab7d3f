//! The exponential atmosphere of Basilisk, whose drag this world leaves out.

use super::satellite_args::SatelliteArgs;
use crate::tasking::constants::EARTH_RADIUS_M;
use crate::tasking::error::TaskingError;
use crate::tasking::vector3::{cross, dot, norm};

/// Density above which drag would move a satellite by more than a few centimetres in five orbits, kg/m³.
const NEGLIGIBLE_KG_M3: f64 = 1e-16;

/// An atmosphere whose density falls exponentially with height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Atmosphere {
    /// Radius of the planet, m.
    pub planet_radius_m: f64,
    /// Density at the ground, kg/m³.
    pub base_density_kg_m3: f64,
    /// Height over which the density falls by a factor of e, m.
    pub scale_height_m: f64,
}

impl Default for Atmosphere {
    /// The atmosphere of BSK-RL.
    fn default() -> Self {
        Self { planet_radius_m: EARTH_RADIUS_M, base_density_kg_m3: 1.22, scale_height_m: 8e3 }
    }
}

impl Atmosphere {
    /// Density at a distance from the planet's centre, kg/m³.
    #[must_use]
    pub fn density(&self, radius_m: f64) -> f64 {
        self.base_density_kg_m3 * libm::exp((self.planet_radius_m - radius_m) / self.scale_height_m)
    }

    /// Checks that a satellite's drag is negligible at its perigee.
    ///
    /// # Errors
    /// Returns [`TaskingError::NotSupported`] if it is not.
    pub fn check_negligible(&self, name: &str, args: &SatelliteArgs) -> Result<(), TaskingError> {
        let density = self.density(perigee_radius(args));
        if density <= NEGLIGIBLE_KG_M3 {
            return Ok(());
        }
        Err(TaskingError::NotSupported(format!(
            "the drag of satellite {name}, whose orbit has a density of {density:.1e} kg/m³ at its perigee (at most \
             {NEGLIGIBLE_KG_M3:e}; raise the orbit, or lower `baseDensity` or `scaleHeight`),"
        )))
    }
}

/// Distance of the orbit's perigee from the planet's centre, m (Vallado 2013, section 2.4).
fn perigee_radius(args: &SatelliteArgs) -> f64 {
    let (position, velocity) = args.orbit.state(args.mu);
    let momentum = cross(&position, &velocity);
    let parameter = dot(&momentum, &momentum) / args.mu;
    let energy = 0.5 * dot(&velocity, &velocity) - args.mu / norm(&position);
    let eccentricity = (1.0 + 2.0 * energy * parameter / args.mu).max(0.0).sqrt();
    parameter / (1.0 + eccentricity)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tasking::orbit::OrbitalElements;
    use crate::tasking::setup::InitialOrbit;

    fn args(semi_major_axis_m: f64, eccentricity: f64) -> SatelliteArgs {
        SatelliteArgs::new(InitialOrbit::Elements(OrbitalElements {
            semi_major_axis_m,
            eccentricity,
            inclination_rad: 0.7,
            ascending_node_rad: 1.0,
            periapsis_rad: 2.0,
            true_anomaly_rad: 3.0,
        }))
    }

    #[test]
    fn perigee_is_that_of_the_elements() {
        assert!((perigee_radius(&args(7.2e6, 0.05)) - 6.84e6).abs() < 1e-2);
        assert!((perigee_radius(&args(6.9e6, 0.0)) - 6.9e6).abs() < 1.0);
    }

    #[test]
    fn dense_air_at_the_perigee_is_refused() {
        let atmosphere = Atmosphere::default();
        assert!(atmosphere.check_negligible("A", &args(EARTH_RADIUS_M + 300e3, 0.0)).is_ok());
        assert!(atmosphere.check_negligible("A", &args(EARTH_RADIUS_M + 290e3, 0.0)).is_err());
        assert!(atmosphere.check_negligible("A", &args(EARTH_RADIUS_M + 500e3, 0.04)).is_err());
        let thick = Atmosphere { scale_height_m: 16e3, ..atmosphere };
        let error = thick.check_negligible("A", &args(EARTH_RADIUS_M + 500e3, 0.0)).unwrap_err().to_string();
        assert!(error.contains("satellite A") && error.contains("3.3e-14"), "{error}");
    }
}
