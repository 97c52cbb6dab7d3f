//! Selection of the most threatening debris of each satellite, without data-dependent branches.

use pulp::{Arch, Simd, WithSimd};

use crate::kessler::constants::SATELLITES;

/// Largest number of threats that the narrow pass selects.
const NARROW_CAPACITY: usize = 8;
/// Largest number of threats that the wide pass selects.
const WIDE_CAPACITY: usize = 16;

/// Sort key of a debris body: by miss distance, then by age. Squared misses are not negative, and the bits of
/// such floats are in their order.
pub(super) const fn threat_key(miss_2: f32, index: usize) -> u64 {
    (miss_2.to_bits() as u64) << 32 | index as u64
}

/// Index of the debris body of a key.
#[expect(clippy::cast_possible_truncation, reason = "the lower half is the index")]
pub(super) const fn index_of(key: u64) -> usize {
    key as u32 as usize
}

/// Stores the keys of the `count` bodies with the least miss of each satellite in `worst`, worst first.
/// Bodies with an infinite miss or NaN are left out.
pub(super) fn select_worst(
    arch: Arch,
    misses_2: [&[f32]; SATELLITES],
    count: usize,
    worst: &mut [Vec<u64>; SATELLITES],
) {
    if count <= NARROW_CAPACITY {
        arch.dispatch(SelectWorst::<NARROW_CAPACITY> { misses_2, count, worst });
    } else if count <= WIDE_CAPACITY {
        arch.dispatch(SelectWorst::<WIDE_CAPACITY> { misses_2, count, worst });
    } else {
        misses_2.into_iter().zip(worst).for_each(|(misses_2, worst)| sort_worst(misses_2, count, worst));
    }
}

/// Branch-free selection of at most `CAPACITY` bodies per satellite.
///
/// The worst bodies so far are kept in order; each further body is inserted at its place and moves the rest
/// on. There is no branch, since which of fifty bodies are among the eight worst is unpredictable. All
/// satellites are processed at once, since each insertion waits for the one before it.
struct SelectWorst<'a, const CAPACITY: usize> {
    misses_2: [&'a [f32]; SATELLITES],
    count: usize,
    worst: &'a mut [Vec<u64>; SATELLITES],
}

impl<const CAPACITY: usize> WithSimd for SelectWorst<'_, CAPACITY> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let mut least = [[u64::MAX; CAPACITY]; SATELLITES];
        let [a, b, c] = self.misses_2;
        for (index, ((a, b), c)) in a.iter().zip(b).zip(c).enumerate() {
            insert(&mut least[0], threat_key(*a, index));
            insert(&mut least[1], threat_key(*b, index));
            insert(&mut least[2], threat_key(*c, index));
        }
        for (least, worst) in least.iter().zip(self.worst) {
            store_finite(worst, least[..self.count].iter().copied());
        }
    }
}

/// Inserts a key into an ordered list of the least keys.
#[inline(always)]
fn insert<const CAPACITY: usize>(least: &mut [u64; CAPACITY], key: u64) {
    let mut before = [0; CAPACITY];
    before[1..].copy_from_slice(&least[..CAPACITY - 1]);
    for place in 0..CAPACITY {
        least[place] = least[place].min(key.max(before[place]));
    }
}

/// Selects the `count` worst bodies by sorting.
fn sort_worst(misses_2: &[f32], count: usize, worst: &mut Vec<u64>) {
    store_finite(worst, misses_2.iter().enumerate().map(|(index, miss_2)| threat_key(*miss_2, index)));
    if worst.len() > count {
        worst.select_nth_unstable(count);
        worst.truncate(count);
    }
    worst.sort_unstable();
}

/// Stores the keys with a finite miss.
fn store_finite(worst: &mut Vec<u64>, keys: impl Iterator<Item = u64>) {
    worst.clear();
    worst.extend(keys.filter(|key| *key < threat_key(f32::INFINITY, 0)));
}
