//! The next eclipse, as BSK-RL's `TrajectorySimulator` finds it: sampled every 30 s, one sample late. Transitions on the seam of two
//! searches are lost.

use crate::tasking::access::trajectory::{SAMPLE_S, SAMPLE_TICK};
use crate::tasking::orbit::{Orbit, Sky};
use crate::tasking::satellite::eclipse::illumination;

/// Time by which each further search extends, s.
const SEARCH_S: f64 = 6000.0;
/// Largest number of searches.
const SEARCHES: usize = 3;
/// Result if there is no eclipse, as BSK-RL has it.
pub const NO_ECLIPSE: [f64; 2] = [1.0, 1.0];

/// Transitions into and out of the Earth's shadow that were found so far.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EclipseForecast {
    /// Illuminated or not, for each sample.
    samples: Vec<bool>,
    /// Times of the last sample in light, s.
    starts: Vec<f64>,
    /// Times of the last sample in shadow, s.
    ends: Vec<f64>,
    /// Samples up to this time are not searched again, s.
    searched_s: f64,
    /// End of the first search, s, if the ends of searches do not depend on the times at which eclipses are asked for.
    first_search_s: Option<f64>,
}

impl EclipseForecast {
    /// Samples the trajectory up to a time, s, as computing opportunities does.
    pub fn extend_to(&mut self, seconds: f64, orbit: &mut Orbit, sky: &mut Sky) {
        let needed = (seconds / SAMPLE_S + 1e-9).floor() as usize + 1;
        if self.samples.len() >= needed {
            return;
        }
        orbit.extend_to(seconds, sky);
        while self.samples.len() < needed {
            self.samples.push(sampled_illumination(self.samples.len(), orbit, sky) > 0.0);
        }
    }

    /// Number of samples of the trajectory.
    #[must_use]
    pub const fn sample_count(&self) -> usize {
        self.samples.len()
    }

    /// Makes the times of eclipses independent of when they are asked for, unlike in BSK-RL: the first search ends at a time, s.
    pub const fn search_first_to(&mut self, seconds: f64) {
        self.first_search_s = Some(seconds);
    }

    /// Start and end of the next eclipse after a time, s; not necessarily of the same one.
    pub fn next(&mut self, now_s: f64, orbit: &mut Orbit, sky: &mut Sky) -> [f64; 2] {
        let checks = SEARCHES + usize::from(self.first_search_s.is_some());
        for search in 0..checks {
            // Searches overlap, so that the lists are not in order.
            let next = |times: &[f64]| times.iter().copied().find(|time| *time > now_s);
            if let (Some(start), Some(end)) = (next(&self.starts), next(&self.ends)) {
                return [start, end];
            }
            let until_s = match self.first_search_s {
                None => now_s + search as f64 * SEARCH_S,
                Some(first_s) if self.searched_s < first_s => first_s,
                Some(first_s) if self.searched_s < first_s + (SEARCHES - 1) as f64 * SEARCH_S => {
                    self.searched_s + SEARCH_S
                }
                Some(_) => break,
            };
            self.search(until_s, orbit, sky);
        }
        NO_ECLIPSE
    }

    /// Searches the samples after the last search up to all that exist, at least to one sample after a time, s.
    fn search(&mut self, until_s: f64, orbit: &mut Orbit, sky: &mut Sky) {
        self.extend_to(until_s + SAMPLE_S, orbit, sky);
        // Near a sample, the rounding of its time decides whether it was searched.
        let near = (self.searched_s / SAMPLE_S).floor() as usize;
        for sample in near..self.samples.len().saturating_sub(1) {
            let time = SAMPLE_TICK.time_s(sample as u64);
            if time <= self.searched_s {
                continue;
            }
            match (self.samples[sample], self.samples[sample + 1]) {
                (true, false) => self.starts.push(time),
                (false, true) => self.ends.push(time),
                _ => {}
            }
        }
        self.searched_s = until_s;
    }
}

/// Share of the Sun that a sample of the trajectory sees, 0 to 1. The orbit must extend to it.
///
/// The eclipse model runs before the states are updated: its first sample has no state, later ones are late.
pub fn sampled_illumination(sample: usize, orbit: &Orbit, sky: &Sky) -> f64 {
    let Some(before) = sample.checked_sub(1) else { return 1.0 };
    illumination(&orbit.half_arc_position(before), &sky.sun(before as f64 * SAMPLE_S))
}
