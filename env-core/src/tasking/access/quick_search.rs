//! Quick search of a candidate for the times that BSK-RL's search finds there, where they are certain without it.
//!
//! A curve of elevation that rises from sample to sample and then falls has one maximum: two extrema of the elevation of a satellite
//! are minutes apart. If it does so in all of the interval that BSK-RL's search for the maximum begins with, that search finds it,
//! within its tolerance. All roots are unique then, and Newton's method finds them too.

use super::arc_search::{ArcSearch, ElevationExcess};
use super::candidates::{Candidate, Crossings};
use super::locations::Locations;
use super::minimum::{GROWTH, TOLERANCE};
use super::trajectory::{SAMPLE_S, SAMPLE_TICK, SAMPLES_PER_ARC, SampleRange, SearchedTrajectory};
use crate::tasking::vector3::{Vector3, dot, norm, sub};

/// Shortest window whose inside is certain to be found, as a multiple of the tolerance of the search for its maximum. The result of
/// that search is within twice the tolerance, and the maximum is near the middle.
const MIN_TOLERANCES: f64 = 10.0;
/// Differences of sines of elevations that are larger than rounding.
const MIN_DIFFERENCE: f64 = 1e-12;
/// Largest error of a crossing on the path between nodes, s.
const TIME_ERROR_S: f64 = 1e-3;
/// Share of the second difference of three samples by which the maximum may differ from their parabola's.
const PARABOLA_ERROR: f64 = 0.2;

/// Quick search of a candidate.
pub(super) struct QuickSearch<'a> {
    trajectory: &'a SearchedTrajectory,
    samples: SampleRange,
    excess: ElevationExcess,
}

impl<'a> QuickSearch<'a> {
    /// Prepares the search of a candidate.
    pub(super) fn new(
        locations: &Locations,
        trajectory: &'a SearchedTrajectory,
        candidate: &Candidate,
    ) -> Self {
        let excess = locations.elevation_excess(candidate.location);
        Self { trajectory, samples: candidate.samples, excess }
    }

    /// Times that BSK-RL's search finds in the candidate; `None` if they are not certain.
    pub(super) fn crossings(&self) -> Option<Crossings> {
        let SampleRange { first, last } = self.samples;
        let (start, end) = (self.sine(first), self.sine(last));
        let is_near = |sine: f64, other: f64| (sine - other).abs() < MIN_DIFFERENCE;
        if is_near(start, self.excess.sine) || is_near(end, self.excess.sine) || is_near(start, end) {
            return None;
        }
        match [start > self.excess.sine, end > self.excess.sine] {
            [true, true] => Some(Crossings::None),
            [false, false] => self.two_crossings(end > start),
            [false, true] => self.one_crossing(true),
            [true, false] => self.one_crossing(false),
        }
    }

    /// Sine of the elevation at a sample.
    fn sine(&self, sample: usize) -> f64 {
        let away: Vector3<f64> = sub(&self.trajectory.samples()[sample], &self.excess.position);
        dot(&away, &self.excess.heading) / norm(&away)
    }

    /// True if the elevation exceeds its minimum at a sample.
    fn is_open(&self, sample: usize) -> bool {
        self.sine(sample) > self.excess.sine
    }

    /// The highest sample of a range, if the elevation rises up to it, and falls after it.
    fn summit(&self, range: SampleRange) -> Option<usize> {
        let mut before = self.sine(range.first);
        let mut summit = None;
        for sample in range.first + 1..=range.last {
            let sine = self.sine(sample);
            match summit {
                None if sine < before => summit = Some(sample - 1),
                Some(_) if sine >= before => return None,
                _ => {}
            }
            before = sine;
        }
        Some(summit.unwrap_or(range.last))
    }

    /// The crossing of a candidate that is open at one end.
    fn one_crossing(&self, opens: bool) -> Option<Crossings> {
        let SampleRange { first, last } = self.samples;
        self.summit(self.samples)?;
        let after = (first + 1..=last).find(|sample| self.is_open(*sample) == opens)?;
        self.crossing(after - 1, opens).map(Crossings::One)
    }

    /// The crossings of a candidate that is closed at both ends. `is_upward` is true if the search for the maximum begins upwards.
    fn two_crossings(&self, is_upward: bool) -> Option<Crossings> {
        let SampleRange { first, last } = self.samples;
        let beyond = (GROWTH * (last - first) as f64).ceil() as usize;
        let searched = if is_upward {
            SampleRange { first, last: last + beyond }
        } else {
            SampleRange { first: first.checked_sub(beyond)?, last }
        };
        if searched.last >= self.trajectory.samples().len() {
            return None;
        }
        let summit = self.summit(searched)?;
        if summit <= first || summit >= last {
            return None;
        }
        if !self.is_open(summit) {
            return self.is_below(summit).then_some(Crossings::None);
        }
        let opening = (first..summit).rev().find(|sample| !self.is_open(*sample))?;
        let closing = (summit + 1..=last).find(|sample| !self.is_open(*sample))?;
        let open_s = self.crossing(opening, true)?;
        let close_s = self.crossing(closing - 1, false)?;
        (close_s - open_s > MIN_TOLERANCES * TOLERANCE * close_s).then_some(Crossings::Two([open_s, close_s]))
    }

    /// True if the elevation is certain to be below its minimum around the highest sample.
    fn is_below(&self, summit: usize) -> bool {
        let [before, top, after] = [summit - 1, summit, summit + 1].map(|sample| self.sine(sample));
        let bend = 2.0 * top - before - after;
        let rise = (after - before) * (after - before) / (8.0 * bend);
        top + rise + PARABOLA_ERROR * bend < self.excess.sine
    }

    /// The crossing after a sample and before the next one.
    fn crossing(&self, sample: usize, opens: bool) -> Option<f64> {
        let arc = sample / SAMPLES_PER_ARC;
        let track = self.trajectory.track();
        let search = ArcSearch::new(&self.excess, arc, track);
        let ends = [arc, arc + 1].map(|node| self.excess.value(&track.nodes()[node].position) > 0.0);
        let time = match ends {
            [false, true] if opens => Some(search.crossing()),
            [true, false] if !opens => Some(search.crossing()),
            [false, false] => search.crossings().map(|times| times[usize::from(!opens)]),
            _ => None,
        }?;
        let since = time - SAMPLE_TICK.time_s(sample as u64);
        (-TIME_ERROR_S..=SAMPLE_S + TIME_ERROR_S).contains(&since).then_some(time)
    }
}
