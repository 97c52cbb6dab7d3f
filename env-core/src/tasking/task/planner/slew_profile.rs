//! How the pointing error of a scanning satellite falls during a slew under `mrpFeedback`.

use crate::tasking::setup::SatelliteArgs;

/// Angle between two rows of the table, degrees.
const ANGLE_STEP_DEG: f64 = 10.0;
/// Rows of the table: from 0° to 180°.
const ANGLES: usize = 19;
/// Time between two columns of the table, s.
const TIME_STEP_S: usize = 5;
/// Columns of the table.
const TIMES: usize = 41;
/// Momentum of the wheels at which slews take √2 times as long as with wheels at rest, N·m·s. The feedback does not know the
/// wheels' momentum, which turns the body away from the shortest path. Measured from flown slews at 5 to 40 N·m·s.
const SLOWING_MOMENTUM: f64 = 10.0;
/// Largest torque of all wheels together over that of one: slews turn about a diagonal on average.
const TORQUE_FACTOR: f64 = 1.2;

/// Remaining angle of slews from rest, as a share of the first angle.
#[derive(Debug, Clone)]
pub(super) struct SlewProfile {
    shares: Vec<[f64; TIMES]>,
    /// Error below which the instrument scans, rad.
    tolerance_rad: f64,
}

impl SlewProfile {
    /// Integrates slews about one axis for the gains of a satellite.
    pub(super) fn new(args: &SatelliteArgs) -> Self {
        let inertia = args.inertia();
        let inertia = 0.5 * (inertia[0] + inertia[1]);
        let limit = args.u_max_n_m * TORQUE_FACTOR;
        let mut shares = vec![[0.0; TIMES]; ANGLES];
        for (row, shares) in shares.iter_mut().enumerate() {
            let first = (row.max(1) as f64 * ANGLE_STEP_DEG).to_radians();
            let (mut angle, mut rate) = (first, 0.0);
            for second in 0..TIMES * TIME_STEP_S {
                if second.is_multiple_of(TIME_STEP_S) {
                    shares[second / TIME_STEP_S] = (angle / first).max(0.0);
                }
                // tan(φ/4) by its first terms: its error is below 2 % up to 180°.
                let quarter = 0.25 * angle;
                let sigma = quarter + quarter * quarter * quarter / 3.0;
                let torque = (args.feedback_k * sigma + args.feedback_p * rate).clamp(-limit, limit);
                rate -= torque / inertia;
                angle += rate;
            }
        }
        Self { shares, tolerance_rad: 4.0 * libm::atan(args.attitude_tolerance) }
    }

    /// Factor by which the wheels' momentum, N·m·s, makes slews longer.
    pub(super) fn slowing(momentum: f64) -> f64 {
        let ratio = momentum / SLOWING_MOMENTUM;
        (1.0 + ratio * ratio).sqrt()
    }

    /// Remaining share of an angle, rad, after a time, s, with wheels at rest.
    pub(super) fn share(&self, angle_rad: f64, seconds: f64) -> f64 {
        let column = (seconds / TIME_STEP_S as f64).min((TIMES - 1) as f64);
        let at = (column as usize).min(TIMES - 2);
        let row = self.row(angle_rad);
        row[at] + (row[at + 1] - row[at]) * (column - at as f64)
    }

    /// Time until an angle, rad, is within the tolerance of the instrument, s, with wheels at rest.
    pub(super) fn settling_s(&self, angle_rad: f64) -> f64 {
        let row = self.row(angle_rad);
        let wanted = self.tolerance_rad / angle_rad.max(self.tolerance_rad);
        let column = row.iter().position(|share| *share <= wanted).unwrap_or(TIMES);
        if column == 0 {
            return 0.0;
        }
        let (before, after) = (row[column - 1], row.get(column).copied().unwrap_or(0.0));
        let part = (before - wanted) / (before - after).max(1e-9);
        (column as f64 - 1.0 + part) * TIME_STEP_S as f64
    }

    fn row(&self, angle_rad: f64) -> &[f64; TIMES] {
        let row = (angle_rad.to_degrees() / ANGLE_STEP_DEG + 0.5) as usize;
        &self.shares[row.min(ANGLES - 1)]
    }
}
