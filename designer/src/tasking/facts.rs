//! [`DesignFacts`]: what a design leads to, in closed form: shadow, passes, windows and the resources at the start.

use std::collections::BTreeMap;

use env_core::tasking::access::Opportunity;
use env_core::tasking::task::forecast::{SatelliteForecast, TaskingForecast};

use super::design::TaskingDesign;
use super::units::S_PER_MINUTE;

/// Shortest pass over a station that counts, s: half of a downlink.
pub(super) const MIN_PASS_S: f64 = 30.0;
/// Largest time between the middle of a window and the minute of its field, s. Later passes over the field do not count.
const SAME_PASS_S: f64 = 900.0;

/// A design with the sky in which only the targets of its fields exist.
pub(super) struct DesignFacts<'a> {
    pub(super) design: &'a TaskingDesign,
    pub(super) forecast: &'a TaskingForecast,
    /// True if the task has targets.
    pub(super) has_targets: bool,
}

/// Targets of a field in one pass of its satellite.
pub(super) struct FieldPass {
    /// Number of targets that the satellite sees.
    pub(super) seen: usize,
    /// Number of images that fit into the pass.
    pub(super) images: usize,
}

impl DesignFacts<'_> {
    /// The sky of each satellite, with its index.
    pub(super) fn satellites(&self) -> impl Iterator<Item = (usize, &SatelliteForecast)> {
        self.forecast.satellites.iter().enumerate()
    }

    /// Passes over stations in the order of their opening, without short ones.
    pub(super) fn passes(satellite: &SatelliteForecast) -> Vec<Opportunity> {
        let mut passes: Vec<_> = satellite
            .passes
            .iter()
            .filter(|pass| pass.close_s - pass.open_s >= MIN_PASS_S)
            .copied()
            .collect();
        passes.sort_by(|a, b| a.open_s.total_cmp(&b.open_s));
        passes
    }

    /// Times between two passes in which no station is in reach, from the start to the time limit, s.
    pub(super) fn gaps(&self, satellite: &SatelliteForecast) -> Vec<[f64; 2]> {
        let (mut gaps, mut free_s) = (Vec::new(), 0.0_f64);
        for pass in Self::passes(satellite) {
            if pass.open_s > free_s {
                gaps.push([free_s, pass.open_s]);
            }
            free_s = free_s.max(pass.close_s);
        }
        if free_s < self.forecast.time_limit_s {
            gaps.push([free_s, self.forecast.time_limit_s]);
        }
        gaps
    }

    /// Time at which the storage is full if the satellite works without a break and sends nothing, s; `None` if that is after the time
    /// limit. An imager takes an image of each target of the fields as its first window opens.
    pub(super) fn full_at_s(&self, satellite: &SatelliteForecast) -> Option<f64> {
        let resources = &satellite.resources;
        let room = (resources.storage_bits - resources.stored_bits).max(0.0) / resources.work_bits;
        let full_s = if self.has_targets {
            // A target may be seen on several orbits; its image is taken once.
            let mut first_opens: BTreeMap<usize, f64> = BTreeMap::new();
            for window in &satellite.windows {
                let open = first_opens.entry(window.object).or_insert(window.open_s);
                *open = open.min(window.open_s);
            }
            let mut opens: Vec<f64> = first_opens.into_values().collect();
            opens.sort_by(f64::total_cmp);
            *opens.get(libm::floor(room) as usize)?
        } else {
            room
        };
        (full_s < self.forecast.time_limit_s).then_some(full_s)
    }

    /// Indices of the targets of a field among all targets.
    fn targets_of(&self, field: usize) -> std::ops::Range<usize> {
        let count = |fields: &[super::TargetField]| -> usize {
            fields.iter().map(|field| usize::try_from(field.targets).unwrap_or(0)).sum()
        };
        let first = self.forecast.drawn_targets + count(&self.design.fields[..field]);
        first..first + count(&self.design.fields[field..=field])
    }

    /// Windows of the targets of a field in the pass of its satellite.
    pub(super) fn windows_of(&self, field: usize) -> Vec<Opportunity> {
        let TargetedPass { satellite, minute } = self.pass_of(field);
        let targets = self.targets_of(field);
        let in_pass = |window: &&Opportunity| {
            let middle_s = 0.5 * (window.open_s + window.close_s);
            targets.contains(&window.object) && (middle_s - minute * S_PER_MINUTE).abs() < SAME_PASS_S
        };
        let path = self.forecast.satellites.get(satellite);
        path.map_or_else(Vec::new, |path| path.windows.iter().filter(in_pass).copied().collect())
    }

    fn pass_of(&self, field: usize) -> TargetedPass {
        let field = &self.design.fields[field];
        TargetedPass {
            satellite: usize::try_from(field.satellite).unwrap_or(0),
            minute: f64::from(field.minute),
        }
    }

    /// Compares the targets of a field that its satellite sees with the images that fit into the pass.
    pub(super) fn field_pass(&self, field: usize) -> FieldPass {
        let windows = self.windows_of(field);
        let open_s = windows.iter().map(|window| window.open_s).fold(f64::INFINITY, f64::min);
        let close_s = windows.iter().map(|window| window.close_s).fold(0.0, f64::max);
        let image_s = self.forecast.satellites.first().map_or(1.0, |path| path.resources.image_s.max(1.0));
        let images = if windows.is_empty() { 0 } else { 1 + ((close_s - open_s) / image_s) as usize };
        FieldPass { seen: windows.len(), images }
    }

    /// Targets that two or more satellites see, with the time at which the second one begins to see it, s.
    pub(super) fn shared_targets(&self) -> Vec<(usize, f64)> {
        let mut shared = Vec::new();
        for target in 0..self.forecast.targets.len() {
            let first_open = |(index, path): (usize, &SatelliteForecast)| {
                let window = path.windows.iter().find(|window| window.object == target)?;
                Some((index, window.open_s))
            };
            let mut opens: Vec<(usize, f64)> = self.satellites().filter_map(first_open).collect();
            opens.sort_by(|a, b| a.1.total_cmp(&b.1));
            shared.extend(opens.get(1).copied());
        }
        shared
    }
}

/// Satellite and minute of a field's pass.
struct TargetedPass {
    satellite: usize,
    minute: f64,
}
