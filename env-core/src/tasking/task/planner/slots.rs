//! The sky of a scanning satellite in slots of a minute: what the coarse model needs of orbit, Sun and ground stations.

use super::light::{dark_times, panel_cosine};
use super::slew_profile::SlewProfile;
use crate::tasking::access::OpportunityKind;
use crate::tasking::orbit::{Orbit, Sky, hill_frame};
use crate::tasking::satellite::desaturation::DesaturationSettings;
use crate::tasking::satellite::eclipse::illumination;
use crate::tasking::setup::SatelliteArgs;
use crate::tasking::task::run::TaskRun;
use crate::tasking::vector3::{Matrix3, Vector3, norm, scale, sub};

/// Length of a slot, s: the duration of the shortest action.
pub(super) const SLOT_S: f64 = 60.0;
/// Number of slots of a scan.
pub(super) const SCAN_SLOTS: usize = 3;
/// Samples of the sunlight in a slot.
const LIGHT_SAMPLES: usize = 4;

/// A slot of the sky. Directions are those at its end, in the inertial frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SkySlot {
    /// Direction from the satellite to the Earth's centre.
    pub(super) nadir: Vector3<f64>,
    /// Direction from the satellite to the Sun.
    pub(super) sun: Vector3<f64>,
    /// Axes of the Hill frame: radial, along track, orbit normal.
    pub(super) hill: Matrix3<f64>,
    /// Power of a panel that faces the Sun, mean over the slot, W.
    pub(super) panel_w: f64,
    /// Seconds of the slot in which a ground station can be reached.
    pub(super) access_s: f64,
    /// Power that the panel lacks while the satellite scans instead of charging, mean over a scan that begins with the slot, W.
    pub(super) scan_loss_w: f64,
    /// Seconds from the start of the slot until the Sun shines again; 0 in sunlight.
    pub(super) dark_s: f64,
}

impl SkySlot {
    /// Power that the panel lacks while the satellite scans instead of charging, W.
    fn panel_loss_w(&self) -> f64 {
        self.panel_w * (1.0 - panel_cosine(&self.nadir, &self.sun))
    }
}

/// The sky of an episode, and the constants of its satellite.
#[derive(Debug, Clone)]
pub(super) struct SlotTable {
    pub(super) slots: Vec<SkySlot>,
    pub(super) args: SatelliteArgs,
    pub(super) profile: SlewProfile,
    pub(super) desaturation: DesaturationSettings,
    /// Time limit of the episode, s.
    pub(super) limit_s: f64,
}

impl SlotTable {
    /// Samples the sky of the first satellite from the start of the episode to its time limit.
    pub(super) fn new(start: &TaskRun) -> Self {
        let sim = &start.sim;
        let satellite = sim.satellite(0);
        let args = satellite.spec().args.clone();
        let limit_s = sim.time_limit_s();
        let count = (limit_s / SLOT_S).ceil() as usize;
        let (orbit, sky) = (satellite.orbit(), sim.sky());
        let mut slots: Vec<SkySlot> = (0..count).map(|index| slot(index, orbit, sky, &args)).collect();
        for window in sim.opportunities(0).upcoming(OpportunityKind::GroundStation, 0.0) {
            let first = ((window.open_s / SLOT_S) as usize).min(count);
            let end = ((window.close_s / SLOT_S).ceil() as usize).clamp(first, count);
            for (index, slot) in (first..end).zip(&mut slots[first..end]) {
                let begin = index as f64 * SLOT_S;
                let shared = window.close_s.min(begin + SLOT_S) - window.open_s.max(begin);
                slot.access_s = (slot.access_s + shared.max(0.0)).min(SLOT_S);
            }
        }
        let dark_times = dark_times(slots.iter().map(|slot| slot.panel_w), SLOT_S);
        slots.iter_mut().zip(dark_times).for_each(|(slot, dark_s)| slot.dark_s = dark_s);
        let losses: Vec<f64> = slots.iter().map(SkySlot::panel_loss_w).collect();
        for (index, slot) in slots.iter_mut().enumerate() {
            let scan = &losses[index..(index + SCAN_SLOTS).min(count)];
            slot.scan_loss_w = scan.iter().sum::<f64>() / scan.len() as f64;
        }
        let profile = SlewProfile::new(&args);
        Self { slots, args, profile, desaturation: satellite.desaturation_settings(), limit_s }
    }
}

fn slot(index: usize, orbit: &Orbit, sky: &Sky, args: &SatelliteArgs) -> SkySlot {
    let begin = index as f64 * SLOT_S;
    let end = begin + SLOT_S;
    let path = orbit.arc(begin);
    let (position, velocity, sun) = (path.position(end), path.velocity(end), sky.sun(end));
    let to_sun = sub(&sun, &position);
    let distance = norm(&to_sun);
    let light: f64 = (0..LIGHT_SAMPLES)
        .map(|sample| {
            let time = begin + (sample as f64 + 0.5) * SLOT_S / LIGHT_SAMPLES as f64;
            illumination(&path.position(time), &sun)
        })
        .sum();
    let hill = hill_frame(&position, &velocity);
    SkySlot {
        nadir: scale(&hill[0], -1.0),
        sun: scale(&to_sun, 1.0 / distance),
        hill,
        panel_w: args.facing_panel_w(distance) * light / LIGHT_SAMPLES as f64,
        access_s: 0.0,
        scan_loss_w: 0.0,
        dark_s: 0.0,
    }
}
