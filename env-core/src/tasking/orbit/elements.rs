//! Classical elements of an orbit.

use crate::tasking::vector3::{Vector3, cross, dot, norm, scale, sub};

/// Classical elements of an elliptic orbit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrbitalElements {
    /// Semi-major axis of the ellipse, m.
    pub semi_major_axis_m: f64,
    /// Eccentricity, 0 to less than 1.
    pub eccentricity: f64,
    /// Inclination to the equator, rad.
    pub inclination_rad: f64,
    /// Right ascension of the ascending node, rad.
    pub ascending_node_rad: f64,
    /// Argument of periapsis, rad.
    pub periapsis_rad: f64,
    /// True anomaly at the epoch, rad.
    pub true_anomaly_rad: f64,
}

impl OrbitalElements {
    /// Position, m, and velocity, m/s, under a gravitational parameter in m³/s² (Vallado 2013, algorithm 10).
    #[must_use]
    pub fn state(&self, mu: f64) -> (Vector3<f64>, Vector3<f64>) {
        let parameter = self.semi_major_axis_m * (1.0 - self.eccentricity * self.eccentricity);
        let radius = parameter / (1.0 + self.eccentricity * libm::cos(self.true_anomaly_rad));
        let (sin_latitude, cos_latitude) = libm::sincos(self.periapsis_rad + self.true_anomaly_rad);
        let (sin_node, cos_node) = libm::sincos(self.ascending_node_rad);
        let (sin_tilt, cos_tilt) = libm::sincos(self.inclination_rad);
        let (sin_periapsis, cos_periapsis) = libm::sincos(self.periapsis_rad);
        let position = [
            radius * (cos_latitude * cos_node - cos_tilt * sin_latitude * sin_node),
            radius * (cos_latitude * sin_node + cos_tilt * sin_latitude * cos_node),
            radius * (sin_latitude * sin_tilt),
        ];
        let momentum = (mu * parameter).sqrt();
        let along = self.eccentricity * sin_periapsis + sin_latitude;
        let across = self.eccentricity * cos_periapsis + cos_latitude;
        let velocity = [
            -mu / momentum * (cos_node * along + cos_tilt * across * sin_node),
            -mu / momentum * (sin_node * along - cos_tilt * across * cos_node),
            mu / momentum * across * sin_tilt,
        ];
        (position, velocity)
    }

    /// Elements of a state (Vallado 2013, algorithm 9). In a circular orbit the periapsis is at the ascending node, in an
    /// equatorial one the node is on the x axis.
    #[must_use]
    pub fn from_state(mu: f64, position: &Vector3<f64>, velocity: &Vector3<f64>) -> Self {
        const SMALL: f64 = 1e-12;
        let radius = norm(position);
        let momentum = cross(position, velocity);
        let h = norm(&momentum);
        let node = [-momentum[1], momentum[0], 0.0];
        let eccentricity_vector = sub(
            &scale(position, (dot(velocity, velocity) - mu / radius) / mu),
            &scale(velocity, dot(position, velocity) / mu),
        );
        let eccentricity = norm(&eccentricity_vector);
        let pole = scale(&momentum, 1.0 / h);
        let node_length = norm(&node);
        let to_node = if node_length > SMALL * h { scale(&node, 1.0 / node_length) } else { [1.0, 0.0, 0.0] };
        let to_periapsis =
            if eccentricity > SMALL { scale(&eccentricity_vector, 1.0 / eccentricity) } else { to_node };
        Self {
            semi_major_axis_m: 1.0 / (2.0 / radius - dot(velocity, velocity) / mu),
            eccentricity,
            inclination_rad: libm::acos(pole[2].clamp(-1.0, 1.0)),
            ascending_node_rad: positive_angle(libm::atan2(to_node[1], to_node[0])),
            periapsis_rad: angle_about(&pole, &to_node, &to_periapsis),
            true_anomaly_rad: angle_about(&pole, &to_periapsis, position),
        }
    }
}

/// Angle from one vector to another about an axis, from 0 to 2π.
fn angle_about(axis: &Vector3<f64>, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
    positive_angle(libm::atan2(dot(axis, &cross(from, to)), dot(from, to)))
}

fn positive_angle(angle: f64) -> f64 {
    if angle < 0.0 { angle + 2.0 * std::f64::consts::PI } else { angle }
}
