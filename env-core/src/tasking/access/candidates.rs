//! Candidates of windows, as BSK-RL selects them: runs of samples of the trajectory that are near a location.
//!
//! Near is a distance that depends on the minimum elevation only. A run begins with the sample before the first one that is near, and
//! ends with the sample after the last one, unless the block ends there.

use super::finder::HALF_ARC_RAD;
use super::locations::Locations;
use super::trajectory::{SAMPLES_PER_ARC, SampleRange, SearchedTrajectory};
use crate::tasking::vector3::{Vector3, dot, norm, sub};

/// Factor of the distance within which BSK-RL searches for a window.
const NEAR_FACTOR: f64 = 1.1;

/// A run of samples in which a location may have a window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Candidate {
    /// Index of the location.
    pub location: usize,
    /// Samples of the run.
    pub samples: SampleRange,
}

/// Times in a candidate at which the elevation equals its minimum, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Crossings {
    /// No time was found.
    None,
    /// One time was found.
    One(f64),
    /// An opening and a closing were found.
    Two([f64; 2]),
}

/// Selects the candidates of locations in a block, location by location, in the order of time.
#[must_use]
pub fn find_candidates(
    locations: &Locations,
    trajectory: &SearchedTrajectory,
    block: SampleRange,
) -> Vec<Candidate> {
    let mut search = CandidateSearch::new(locations, trajectory, block);
    search.run(trajectory);
    search.finish()
}

/// Search of a block for candidates.
struct CandidateSearch<'a> {
    locations: &'a Locations,
    samples: &'a [Vector3<f64>],
    block: SampleRange,
    /// Largest distance of the samples from the Earth's centre, m.
    highest_m: f64,
    /// Least distance of the samples from the Earth's centre, m.
    lowest_m: f64,
    /// Run of near samples of each location that may go on.
    runs: Vec<Option<SampleRange>>,
    found: Vec<Candidate>,
}

impl<'a> CandidateSearch<'a> {
    fn new(locations: &'a Locations, trajectory: &'a SearchedTrajectory, block: SampleRange) -> Self {
        let samples = trajectory.samples();
        let (mut highest_m, mut lowest_m) = (0.0_f64, f64::INFINITY);
        for radius in samples[block.first..=block.last].iter().map(norm) {
            highest_m = highest_m.max(radius);
            lowest_m = lowest_m.min(radius);
        }
        let runs = vec![None; locations.len()];
        Self { locations, samples, block, highest_m, lowest_m, runs, found: Vec::new() }
    }

    /// Square of the distance within which a sample is near a location, m². The distance is infinite at a minimum elevation of 0, and
    /// negative below, where no sample is near.
    fn near_square(&self, location: usize) -> f64 {
        let above_m = self.highest_m - self.locations.radii_m()[location];
        let distance = NEAR_FACTOR * above_m / self.locations.sine(location);
        distance * distance.max(0.0)
    }

    /// Cosine of the largest central angle at a sample from which this one or the next is near a location.
    fn cosine_threshold(&self) -> f64 {
        let squares = (0..self.locations.len()).map(|location| self.near_square(location));
        let largest = squares.fold(0.0, f64::max).sqrt();
        let radii = self.locations.radii_m();
        let lowest = radii.iter().copied().fold(self.lowest_m, f64::min);
        let gap = (self.lowest_m - radii.iter().copied().fold(0.0, f64::max)).max(0.0);
        // The square of a distance is that of the heights, and 4 r₁ r₂ sin²(ψ/2).
        let chord = (largest * largest - gap * gap).max(0.0).sqrt();
        let angle = 2.0 * libm::asin((0.5 * chord / lowest).min(1.0));
        libm::cos((angle + HALF_ARC_RAD).min(std::f64::consts::PI)) - 1e-9
    }

    fn run(&mut self, trajectory: &SearchedTrajectory) {
        let SampleRange { first, last } = self.block;
        let threshold = self.cosine_threshold();
        let arcs = first / SAMPLES_PER_ARC..=last / SAMPLES_PER_ARC;
        let mut near = Vec::new();
        for (arc, node) in arcs.clone().zip(&trajectory.track().nodes()[arcs]) {
            self.locations.find_near(&node.position, threshold, &mut near);
            let start = SAMPLES_PER_ARC * arc;
            for &location in &near {
                let near_square = self.near_square(location);
                for sample in start.max(first)..=(start + SAMPLES_PER_ARC - 1).min(last) {
                    let away = sub(&self.samples[sample], self.locations.position(location));
                    if dot(&away, &away) < near_square {
                        self.add(location, sample);
                    }
                }
            }
        }
    }

    /// Adds a near sample to the run of its location.
    fn add(&mut self, location: usize, sample: usize) {
        match &mut self.runs[location] {
            Some(run) if run.last + 1 == sample => run.last = sample,
            run => {
                if let Some(run) = run.replace(SampleRange { first: sample, last: sample }) {
                    self.found.push(Candidate { location, samples: run });
                }
            }
        }
    }

    fn finish(mut self) -> Vec<Candidate> {
        for (location, run) in self.runs.iter().enumerate() {
            self.found.extend(run.map(|samples| Candidate { location, samples }));
        }
        self.found.sort_unstable_by_key(|candidate| (candidate.location, candidate.samples.first));
        for Candidate { samples, .. } in &mut self.found {
            samples.first = samples.first.saturating_sub(1).max(self.block.first);
            samples.last = (samples.last + 1).min(self.block.last);
        }
        self.found
    }
}
