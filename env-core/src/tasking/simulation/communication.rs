//! Communication of known images between satellites at the end of a step.

use super::agent::Agent;
use super::target_set::TargetSet;
use crate::tasking::clock::TickLength;
use crate::tasking::constants::EARTH_RADIUS_M;
use crate::tasking::orbit::Sky;
use crate::tasking::setup::environment::{Communicator, Links};
use crate::tasking::vector3::{Vector3, add, dot, norm, scale, sub};

/// Ratio of the polar to the equatorial radius of the Earth that blocks lines of sight, as in BSK-RL.
const POLAR_RATIO: f64 = 0.98;

/// Speed at which the distance of two satellites can change at most, m/s: twice the escape velocity at the Earth's surface. The
/// distance of the line between them from the Earth's centre changes more slowly.
const MAX_CLOSING_M_S: f64 = 22_400.0;

/// A pair of satellites of which the first sends to the second.
pub type Pair = [usize; 2];

/// Ticks of a step, of which the first is the last one of the step before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StepTicks {
    /// Tick at which the step began.
    pub start: u64,
    /// Tick at which the step ended.
    pub end: u64,
    /// Length of a tick.
    pub tick: TickLength,
}

/// Pairs of satellites that share data at the end of a step, in BSK-RL's order; a link by line of sight appears twice in each
/// direction.
pub(super) fn communication_pairs(
    communicator: &Communicator,
    agents: &mut [Agent],
    ticks: &StepTicks,
    sky: &mut Sky,
) -> Vec<Pair> {
    let count = agents.len();
    let all = || (0..count).flat_map(move |a| (0..count).filter(move |b| *b != a).map(move |b| [a, b]));
    let mut pairs: Vec<Pair> = match communicator.links {
        Links::None => Vec::new(),
        Links::Free => all().collect(),
        Links::LineOfSight => all()
            .filter(|[a, b]| are_linked(agents, *a, *b, ticks, sky))
            .flat_map(|[a, b]| [[a, b], [b, a]])
            .collect(),
    };
    if communicator.multi_degree {
        let component = components(count, &pairs);
        pairs = all().filter(|[a, b]| component[*a] == component[*b]).collect();
    }
    if communicator.broadcast {
        pairs.retain(|[sender, _]| agents[*sender].broadcast_pending);
        agents.iter_mut().for_each(|agent| agent.broadcast_pending = false);
    }
    pairs
}

/// Shares known images along pairs. If there are as many pairs as directions between all satellites, all of them share
/// everything, as in BSK-RL, which counts instead of comparing.
pub(super) fn share_images(agents: &mut [Agent], pairs: &[Pair]) {
    let before: Vec<TargetSet> = agents.iter().map(|agent| agent.imaged.clone()).collect();
    if pairs.len() == agents.len() * (agents.len() - 1) {
        for agent in agents {
            before.iter().for_each(|other| agent.imaged.union(other));
        }
        return;
    }
    for [sender, receiver] in pairs {
        agents[*receiver].imaged.union(&before[*sender]);
    }
}

/// Numbers of the connected components of the satellites.
fn components(count: usize, pairs: &[Pair]) -> Vec<usize> {
    let mut component: Vec<usize> = (0..count).collect();
    for [a, b] in pairs {
        let (from, to) = (component[*a], component[*b]);
        component.iter_mut().filter(|number| **number == from).for_each(|number| *number = to);
    }
    component
}

/// True if satellite `a` saw satellite `b` at any tick that the step recorded: from its first tick to the one before its last.
///
/// The satellites' dynamics run one after the other, so that a satellite sees those after it where they were one tick before.
fn are_linked(agents: &mut [Agent], a: usize, b: usize, ticks: &StepTicks, sky: &mut Sky) -> bool {
    let max_range = agents[a].satellite.spec().args.link_max_range_m;
    let end = ticks.tick.time_s(ticks.end);
    for index in [a, b] {
        agents[index].satellite.orbit_mut().extend_to(end, sky);
    }
    let mut tick = ticks.start;
    while tick < ticks.end {
        let time = ticks.tick.time_s(tick);
        let other_time = if b > a { ticks.tick.time_s(tick.saturating_sub(1)) } else { time };
        let at = |index: usize, time: f64| agents[index].satellite.orbit().arc(time).position(time);
        let missing_m =
            missing_line_of_sight(&at(a, time), &at(b, other_time), &sky.earth_pole(time), max_range);
        if missing_m <= 0.0 {
            return true;
        }
        // Ticks in which the satellites cannot come into sight are left out.
        tick += 1 + (missing_m / MAX_CLOSING_M_S / ticks.tick.seconds()) as u64;
    }
    false
}

/// Distance by which the line between two positions misses being clear of the Earth, an ellipsoid about its pole, and within range,
/// m; zero or less if there is a line of sight (Basilisk's `spacecraftLocation`).
fn missing_line_of_sight(
    from: &Vector3<f64>,
    to: &Vector3<f64>,
    pole: &Vector3<f64>,
    max_range_m: f64,
) -> f64 {
    let on_sphere = |v: &Vector3<f64>| add(v, &scale(pole, dot(v, pole) * (1.0 / POLAR_RATIO - 1.0)));
    let (start, end) = (on_sphere(from), on_sphere(to));
    let line = sub(&end, &start);
    if dot(&line, &line) == 0.0 {
        return f64::MIN_POSITIVE; // Basilisk divides by zero, and finds no access.
    }
    let share = (-dot(&start, &line) / dot(&line, &line)).clamp(0.0, 1.0);
    let nearest = [0, 1, 2].map(|i| start[i] + share * line[i]);
    let beyond = if max_range_m > 0.0 { norm(&sub(to, from)) - max_range_m } else { f64::NEG_INFINITY };
    let distance = norm(&nearest);
    // A line that touches the Earth is not clear.
    let below = if distance > EARTH_RADIUS_M { f64::NEG_INFINITY } else { EARTH_RADIUS_M - distance };
    if below == 0.0 { f64::MIN_POSITIVE } else { below.max(beyond) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POLE: Vector3<f64> = [0.0, 0.0, 1.0];

    /// A position on the equator at a distance from the centre, m, and a longitude, degrees.
    fn equator(radius: f64, longitude_deg: f64) -> Vector3<f64> {
        let (sin, cos) = libm::sincos(longitude_deg.to_radians());
        [radius * cos, radius * sin, 0.0]
    }

    #[test]
    fn lines_of_sight_are_those_of_geometry() {
        for (from, to) in [(7e6, 7e6), (6.9e6, 8e6), (7.2e6, 42e6)] {
            // The line touches the equator where the angle between the satellites is the sum of two dips.
            let dip = |radius: f64| libm::acos(EARTH_RADIUS_M / radius).to_degrees();
            let limit = dip(from) + dip(to);
            let misses = |angle: f64| {
                missing_line_of_sight(&equator(from, 20.0), &equator(to, 20.0 + angle), &POLE, -1.0)
            };
            assert!(misses(limit - 1e-6) <= 0.0 && misses(limit + 1e-6) > 0.0, "{from} {to}");
            assert!(misses(180.0) > 6e6, "{from} {to}");
        }
    }

    #[test]
    fn the_earth_is_flatter_at_the_poles() {
        // A line across the pole at a height is clear if it is above the polar radius.
        let misses =
            |height: f64| missing_line_of_sight(&[3e6, 0.0, height], &[-3e6, 0.0, height], &POLE, -1.0);
        let polar = EARTH_RADIUS_M * POLAR_RATIO;
        assert!(misses(polar + 1.0) <= 0.0 && misses(polar - 1.0) > 0.0);
    }

    #[test]
    fn links_have_a_range() {
        let apart = norm(&sub(&equator(7e6, 0.0), &equator(7e6, 10.0)));
        let misses =
            |range: f64| missing_line_of_sight(&equator(7e6, 0.0), &equator(7e6, 10.0), &POLE, range);
        assert!(misses(apart + 1.0) <= 0.0);
        assert!((misses(apart - 100.0) - 100.0).abs() < 1e-3);
    }
}
