//! Random decisions outside the worlds: a generator keyed by purpose, seed and number, so that no generator state is
//! stored.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Random number generator of one event. The same key gives the same draws.
#[derive(Debug, Clone)]
pub struct KeyedRng {
    generator: ChaCha8Rng,
}

/// Purpose of a generator: separates streams with the same seed and number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RngPurpose {
    /// Proposals of a curriculum, keyed by (run seed, event number).
    Curriculum,
    /// Layouts of a designer, keyed by (brief seed, layout number).
    Design,
    /// Places on the rungs that a designer is asked for, keyed by (run seed, number of criticised episodes).
    DesignPlace,
    /// Selection of a lease's layouts, keyed by (run seed, lease number).
    LayoutSelection,
    /// Simulated learners and their scenarios, keyed by (seed, event number).
    Simulation,
}

impl RngPurpose {
    const fn key(self) -> &'static [u8; 16] {
        match self {
            Self::Curriculum => b"sparring course1",
            Self::Design => b"sparring designs",
            Self::DesignPlace => b"sparring placing",
            Self::LayoutSelection => b"sparring serving",
            Self::Simulation => b"sparring synthet",
        }
    }
}

impl KeyedRng {
    /// Creates the generator of an event at its first draw.
    #[must_use]
    pub fn new(purpose: RngPurpose, seed: u64, number: u64) -> Self {
        let mut key = [0u8; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        key[8..16].copy_from_slice(&number.to_le_bytes());
        // The purpose also separates these streams from those of `episode_rng`, which have similar keys.
        key[16..].copy_from_slice(purpose.key());
        Self { generator: ChaCha8Rng::from_seed(key) }
    }

    /// The next draw, uniform in [0, 1): the top 53 bits as a multiple of 2⁻⁵³, so the same on every platform.
    #[expect(clippy::cast_precision_loss, reason = "53 bits fit an f64 exactly")]
    pub fn uniform(&mut self) -> f64 {
        (self.generator.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// True with this probability: never at 0, always at 1.
    pub fn bernoulli(&mut self, probability: f64) -> bool {
        self.uniform() < probability
    }

    /// Uniform among 0 … count − 1 (0 if count is 0). Counts are below 100, so the bias of scaling a 53-bit draw is
    /// negligible.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a draw in [0, 1) times a u32 is a non-negative number below it"
    )]
    pub fn below(&mut self, count: u32) -> u32 {
        let scaled = (self.uniform() * f64::from(count)) as u32;
        scaled.min(count.saturating_sub(1))
    }

    /// Uniform from `min` to `max`, both inclusive.
    pub fn range_inclusive(&mut self, min: u32, max: u32) -> u32 {
        min + self.below(max.saturating_sub(min).saturating_add(1))
    }

    /// Random index with these weights; uniform if all are zero, `None` if there are none.
    pub fn weighted_index(&mut self, weights: &[f64]) -> Option<usize> {
        if weights.is_empty() || weights.iter().sum::<f64>() <= 0.0 {
            let count = u32::try_from(weights.len()).unwrap_or(u32::MAX);
            return (count > 0).then(|| self.below(count) as usize);
        }
        index_at(weights, self.uniform())
    }
}

/// Index with these weights for a uniform draw in [0, 1); `None` if no weight is positive.
#[must_use]
pub fn index_at(weights: &[f64], draw: f64) -> Option<usize> {
    let mut left = draw * weights.iter().sum::<f64>();
    let fits = weights.iter().position(|weight| {
        left -= weight;
        left < 0.0
    });
    // Rounding can leave a remainder: then it is the last index with a positive weight.
    fits.or_else(|| weights.iter().rposition(|weight| *weight > 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first draws are committed, so that no change of a dependency changes the proposals of a stored run.
    #[test]
    fn regress_golden_first_draws() {
        let mut rng = KeyedRng::new(RngPurpose::Curriculum, 42, 7);
        let first = [rng.uniform(), rng.uniform(), rng.uniform()];
        assert_eq!(first, [0.505_635_777_426_857_1, 0.175_929_859_195_212_3, 0.465_055_703_390_647_4]);
    }

    #[test]
    fn draws_are_a_function_of_the_key() {
        assert_eq!(
            KeyedRng::new(RngPurpose::Curriculum, 1, 2).uniform(),
            KeyedRng::new(RngPurpose::Curriculum, 1, 2).uniform()
        );
        assert_ne!(
            KeyedRng::new(RngPurpose::Curriculum, 1, 2).uniform(),
            KeyedRng::new(RngPurpose::Curriculum, 1, 3).uniform()
        );
        assert_ne!(
            KeyedRng::new(RngPurpose::Curriculum, 1, 2).uniform(),
            KeyedRng::new(RngPurpose::Curriculum, 2, 2).uniform()
        );
        assert_ne!(
            KeyedRng::new(RngPurpose::Curriculum, 1, 2).uniform(),
            KeyedRng::new(RngPurpose::Curriculum, 2, 1).uniform()
        );
    }

    #[test]
    fn first_draws_of_consecutive_events_are_uniform() {
        let n = 20_000u32;
        let mut counts = [0u32; 10];
        for seq in 0..u64::from(n) {
            counts[KeyedRng::new(RngPurpose::Curriculum, 3, seq).below(10) as usize] += 1;
        }
        // A cell is binomial with mean 2 000 and standard deviation 42; the bound is five of them.
        assert!(counts.iter().all(|count| count.abs_diff(n / 10) < 212), "{counts:?}");
    }

    #[test]
    fn probabilities_of_zero_and_one_are_certain() {
        let mut rng = KeyedRng::new(RngPurpose::Curriculum, 0, 0);
        assert!((0..1000).all(|_| rng.bernoulli(1.0) && !rng.bernoulli(0.0)));
        assert_eq!(rng.below(0), 0);
        assert_eq!(rng.below(1), 0);
    }

    #[test]
    fn weights_and_bounds_are_respected() {
        let mut rng = KeyedRng::new(RngPurpose::Design, 0, 0);
        let many: Vec<u32> = (0..1000).map(|_| rng.range_inclusive(3, 5)).collect();
        assert!((3..=5).all(|n| many.contains(&n)) && many.iter().all(|n| (3..=5).contains(n)));
        assert_eq!((rng.weighted_index(&[]), rng.weighted_index(&[0.0, 2.0, 0.0])), (None, Some(1)));
        assert!((0..50).all(|_| rng.weighted_index(&[0.0, 0.0]).is_some_and(|at| at < 2)));
        assert_eq!((rng.range_inclusive(9, 9), rng.range_inclusive(9, 3)), (9, 9));
        let of_draw = |draw| index_at(&[1.0, 0.0, 3.0, 0.0], draw);
        assert_eq!([0.0, 0.249, 0.25, 1.0 - f64::EPSILON, 1.0].map(of_draw), [0, 0, 2, 2, 2].map(Some));
        assert_eq!((index_at(&[], 0.5), index_at(&[0.0, 0.0], 0.5)), (None, None));
    }
}
