//! Selection of the most threatening debris of each satellite: candidates by the distances at the ends of steps, then the worst of them by
//! their closest approaches. There are hardly any branches, since which of fifty bodies are among the eight worst is unpredictable.

use pulp::{Arch, Simd, WithSimd};

use crate::kessler::constants::SATELLITES;
use crate::kessler::forecast::{ClosestApproaches, GROUP_LEN, NearestStep, TracksForecast};

/// Debris body that threatens a satellite.
#[derive(Debug, Clone, Copy)]
pub(super) struct SelectedThreat {
    /// Index of the body.
    pub body: u32,
    /// Squared distance of its closest approach, LU².
    pub distance_2: f32,
    /// Time of its closest approach, TU from now.
    pub time: f32,
}

impl SelectedThreat {
    const NONE: Self = Self { body: 0, distance_2: 0.0, time: 0.0 };

    /// Sort key: by miss distance, then by age. Squared misses are not negative, and the bits of such floats are in their order.
    const fn key(&self) -> u64 {
        (self.distance_2.to_bits() as u64) << 32 | self.body as u64
    }
}

/// Most threatening debris of each satellite, with memory that is used again.
#[derive(Debug, Default)]
pub(super) struct SelectedThreats {
    /// Most threatening bodies of each satellite, worst first.
    worst: [Vec<SelectedThreat>; SATELLITES],
    candidates: Vec<u32>,
}

impl SelectedThreats {
    /// Most threatening bodies of a satellite, worst first.
    pub(super) fn of(&self, satellite: usize) -> &[SelectedThreat] {
        &self.worst[satellite]
    }

    /// Selects the `count` bodies of the first `bodies` that come nearest to each satellite. Bodies that are never near, such as hidden
    /// ones, are left out.
    pub(super) fn select(&mut self, arch: Arch, forecast: &TracksForecast, count: usize, bodies: usize) {
        arch.dispatch(Selection { forecast, count, bodies, threats: self });
    }
}

/// Selection for all satellites.
struct Selection<'a> {
    forecast: &'a TracksForecast,
    count: usize,
    bodies: usize,
    threats: &'a mut SelectedThreats,
}

impl WithSimd for Selection<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { forecast, count, bodies, threats: SelectedThreats { worst, candidates } } = self;
        for (satellite, worst) in worst.iter_mut().enumerate() {
            let nearest = forecast.nearest_steps(satellite);
            // No body comes nearer within a step than it is at the end of one by more than the margin.
            let limit = NearestStep::limit(bound_of_rank(simd, nearest, count), forecast.margin(satellite));
            collect_up_to(limit, nearest, bodies, candidates);
            worst.clear();
            if candidates.len() <= GROUP_LEN {
                let bodies = &candidates[..];
                let approaches = forecast.closest_approaches(simd, satellite, bodies);
                worst.resize(bodies.len(), SelectedThreat::NONE);
                let ranks = ranks(simd, &approaches.distance_2, bodies.len());
                for (number, body) in bodies.iter().enumerate() {
                    let (distance_2, time) = (approaches.distance_2[number], approaches.time[number]);
                    worst[ranks[number] as usize] = SelectedThreat { body: *body, distance_2, time };
                }
            } else {
                for bodies in candidates.chunks(GROUP_LEN) {
                    let ClosestApproaches { distance_2, time } =
                        forecast.closest_approaches(simd, satellite, bodies);
                    let approaches = bodies.iter().zip(distance_2.iter().zip(time));
                    worst.extend(approaches.map(|(body, (distance_2, time))| SelectedThreat {
                        body: *body,
                        distance_2: *distance_2,
                        time,
                    }));
                }
                worst.sort_unstable_by_key(SelectedThreat::key);
            }
            worst.truncate(count);
        }
    }
}

/// A number that at least `rank` numbers do not exceed, and hardly more, if there are as many numbers.
///
/// The least numbers of each place of the groups are themselves as many numbers as a group has places.
#[inline(always)]
fn bound_of_rank<S: Simd>(simd: S, numbers: &[[u32; GROUP_LEN]], rank: usize) -> u32 {
    if rank > GROUP_LEN {
        return u32::MAX;
    }
    let mut least = [u32::MAX; GROUP_LEN];
    for (part, least) in S::as_mut_simd_u32s(&mut least).0.iter_mut().enumerate() {
        for group in numbers {
            let number = S::as_simd_u32s(group).0[part];
            *least = simd.select_u32s(simd.less_than_u32s(number, *least), number, *least);
        }
    }
    let (zero, one) = (simd.splat_u32s(0), simd.splat_u32s(1));
    let mut bounds = [0; GROUP_LEN];
    let parts = S::as_mut_simd_u32s(&mut bounds).0.iter_mut().zip(S::as_simd_u32s(&least).0);
    for (bound, number) in parts {
        let mut smaller = zero;
        for other in least {
            let is_smaller = simd.less_than_u32s(simd.splat_u32s(other), *number);
            smaller = simd.add_u32s(smaller, simd.select_u32s(is_smaller, one, zero));
        }
        let is_within = simd.less_than_u32s(smaller, simd.splat_u32s(rank as u32));
        *bound = simd.select_u32s(is_within, *number, zero);
    }
    bounds.into_iter().fold(0, u32::max)
}

/// Collects the indices of the numbers up to a limit among the first `count`.
#[inline(always)]
fn collect_up_to(limit: u32, numbers: &[[u32; GROUP_LEN]], count: usize, found: &mut Vec<u32>) {
    found.resize(count, 0);
    let mut length = 0;
    for (index, number) in numbers.as_flattened().iter().enumerate().take(count) {
        found[length] = index as u32;
        length += usize::from(*number <= limit);
    }
    found.truncate(length);
}

/// Rank of each of the first `count` numbers; of equal ones the first comes first.
#[inline(always)]
fn ranks<S: Simd>(simd: S, numbers: &[f32; GROUP_LEN], count: usize) -> [u32; GROUP_LEN] {
    let mut places = [0; GROUP_LEN];
    places.iter_mut().enumerate().for_each(|(place, number)| *number = place as u32);
    let (zero, one) = (simd.splat_u32s(0), simd.splat_u32s(1));
    let mut ranks = [0; GROUP_LEN];
    let parts = S::as_mut_simd_u32s(&mut ranks).0.iter_mut().enumerate();
    for (part, rank) in parts {
        let (mine, place) = (S::as_simd_f32s(numbers).0[part], S::as_simd_u32s(&places).0[part]);
        for (other, number) in numbers[..count].iter().enumerate() {
            let (number, other) = (simd.splat_f32s(*number), simd.splat_u32s(other as u32));
            let is_equal = simd.and_m32s(simd.equal_f32s(number, mine), simd.less_than_u32s(other, place));
            let is_before = simd.or_m32s(simd.less_than_f32s(number, mine), is_equal);
            *rank = simd.add_u32s(*rank, simd.select_u32s(is_before, one, zero));
        }
    }
    ranks
}
