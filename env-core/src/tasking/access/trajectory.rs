//! The trajectory that BSK-RL searches for windows: samples of a simulation of its own, and a cubic spline through them.

use super::ground_track::GroundTrack;
use super::spline::UniformSpline;
use crate::tasking::clock::TickLength;
use crate::tasking::orbit::propagator::STEP_S;
use crate::tasking::orbit::{Orbit, Sky};
use crate::tasking::vector3::Vector3;

/// Time between two samples.
pub const SAMPLE_TICK: TickLength = TickLength::THIRTY_SECONDS;
/// Time between two samples, s.
pub const SAMPLE_S: f64 = 30.0;
/// Samples of a node and of the middle of its arc.
pub(super) const SAMPLES_PER_ARC: usize = 2;
/// Time that BSK-RL's trajectory covers at least where it is searched, s.
pub const MIN_DURATION_S: f64 = 90.0;
/// Tolerance of the ends of a block of samples, s.
const BLOCK_TOLERANCE_S: f64 = 1e-9;

/// Trajectory in the planet-fixed frame that is searched for windows.
#[derive(Debug, Clone, PartialEq)]
pub struct SearchedTrajectory {
    track: GroundTrack,
    spline: UniformSpline,
}

/// Samples of a trajectory that one search covers: their first and last index.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SampleRange {
    /// Index of the first sample.
    pub first: usize,
    /// Index of the last sample.
    pub last: usize,
}

impl SampleRange {
    /// Time of the first sample, s.
    #[must_use]
    pub fn start_s(&self) -> f64 {
        SAMPLE_TICK.time_s(self.first as u64)
    }

    /// Time of the last sample, s.
    #[must_use]
    pub fn end_s(&self) -> f64 {
        SAMPLE_TICK.time_s(self.last as u64)
    }
}

impl Default for SearchedTrajectory {
    fn default() -> Self {
        Self { track: GroundTrack::searched(), spline: UniformSpline::new(SAMPLE_S) }
    }
}

impl SearchedTrajectory {
    /// Extends the trajectory to a number of samples, and the orbit below it.
    pub fn extend_to(&mut self, samples: usize, orbit: &mut Orbit, sky: &mut Sky) {
        let known = self.spline.samples().len();
        if samples <= known {
            return;
        }
        self.track.extend_to((samples - 1) as f64 * SAMPLE_S, orbit, sky);
        let track = &self.track;
        self.spline.extend((known..samples).map(|index| {
            let arc = index / SAMPLES_PER_ARC;
            if index.is_multiple_of(SAMPLES_PER_ARC) {
                track.nodes()[arc].position
            } else {
                track.arc(arc).position((arc as f64 + 0.5) * STEP_S)
            }
        }));
    }

    /// Positions at the samples, m.
    #[must_use]
    pub fn samples(&self) -> &[Vector3<f64>] {
        self.spline.samples()
    }

    /// Spline through the samples.
    pub(super) const fn spline(&self) -> &UniformSpline {
        &self.spline
    }

    /// Nodes of the trajectory, two samples apart, and the paths between them.
    #[must_use]
    pub const fn track(&self) -> &GroundTrack {
        &self.track
    }

    /// Samples in a block of time, s.
    #[must_use]
    pub fn block(&self, start_s: f64, end_s: f64) -> SampleRange {
        let time = |index: usize| SAMPLE_TICK.time_s(index as u64);
        let mut first = (start_s / SAMPLE_S) as usize;
        while time(first) < start_s - BLOCK_TOLERANCE_S {
            first += 1;
        }
        let mut last = ((end_s / SAMPLE_S) as usize + 1).min(self.samples().len() - 1);
        while last > first && time(last) > end_s + BLOCK_TOLERANCE_S {
            last -= 1;
        }
        SampleRange { first, last }
    }
}
