//! Options of an episode, read from bytes.

use env_core::Seed;
use env_core::episode_rng::{EpisodeRng, RngStream, SeededRng};

/// Number of bytes of a random input.
const BYTES: usize = 600;

/// Bytes from which options are read; zeros follow the last one.
pub(super) struct ByteOptions<'a>(pub &'a [u8]);

impl ByteOptions<'_> {
    pub(super) fn byte(&mut self) -> u8 {
        match self.0.split_first() {
            Some((first, rest)) => {
                self.0 = rest;
                *first
            }
            None => 0,
        }
    }

    /// An index below `count`, or 0.
    pub(super) fn index(&mut self, count: usize) -> usize {
        usize::from(self.byte()) % count.max(1)
    }

    /// A number from `low` to `high`.
    pub(super) fn number(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(self.byte()) / 255.0
    }

    pub(super) fn choose<T: Copy, const N: usize>(&mut self, choices: [T; N]) -> T {
        choices[self.index(N)]
    }

    pub(super) fn is_set(&mut self) -> bool {
        self.byte() % 2 == 1
    }
}

/// Bytes drawn from a seed.
///
/// # Panics
/// If the number is not a seed.
#[must_use]
pub fn random_bytes(seed: u64) -> Vec<u8> {
    let mut rng = SeededRng::new(Seed::new(seed).expect("the number is a seed"));
    (0..BYTES).map(|_| (rng.uniform(RngStream::Policy) * 256.0) as u8).collect()
}
