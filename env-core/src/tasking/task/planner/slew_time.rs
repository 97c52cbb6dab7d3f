//! Time and energy of the slews of an imager, as fitted to flown ones.
//!
//! The time until an image depends on more than the angle: on the motion at the start, the wheels' momentum and the state of the rate
//! servo. The model errs by 11 s rms at the default params and by 22 s with weak wheels and small tolerances. The planner therefore
//! flies the first actions of its plans before it chooses one.

use crate::tasking::setup::SatelliteArgs;

/// Shortest time of an image, s.
const MIN_S: f64 = 20.0;
/// Time of an image without a slew at the reference values below, s.
const FIRST_S: f64 = 36.8;
/// Time by which each degree adds, s.
const PER_DEGREE_S: f64 = 0.34;
/// Time by which a tolerance that is smaller by a factor of e adds, s.
const PER_TOLERANCE_S: f64 = 27.9;
/// Reference tolerance, as the norm of an MRP.
const TOLERANCE: f64 = 0.01;
/// Time by which an inverse torque that is larger by 1/(N·m) adds, s.
const PER_INVERSE_TORQUE_S: f64 = 2.86;
/// Inverse of the reference torque, 1/(N·m).
const INVERSE_TORQUE: f64 = 2.5;
/// Electric energy of a slew, J: constant, by momentum squared, by angle and momentum (degrees, N·m·s).
const ENERGY: [f64; 3] = [210.0, 4.0, 1.3];

/// Slews of one satellite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::tasking::task) struct SlewTime {
    first_s: f64,
}

impl SlewTime {
    pub(in crate::tasking::task) fn new(args: &SatelliteArgs) -> Self {
        let tolerance = PER_TOLERANCE_S * libm::log(TOLERANCE / args.attitude_tolerance);
        let torque = PER_INVERSE_TORQUE_S * (1.0 / args.u_max_n_m - INVERSE_TORQUE);
        Self { first_s: FIRST_S + tolerance + torque }
    }

    /// Time from the command to the image, s, of a target at this angle from the boresight, degrees.
    pub(in crate::tasking::task) fn seconds(&self, angle_deg: f64) -> f64 {
        (self.first_s + PER_DEGREE_S * angle_deg).max(MIN_S)
    }

    /// Electric energy of the wheels for a slew, J, with this momentum of the wheels, N·m·s.
    pub(super) fn energy_ws(angle_deg: f64, momentum: f64) -> f64 {
        ENERGY[0] + momentum * (ENERGY[1] * momentum + ENERGY[2] * angle_deg)
    }
}
