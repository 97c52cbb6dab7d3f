//! Decisions by chance outside the worlds: randomness as a function of who draws, a seed and a number, so that no
//! generator need be stored.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// The draws that one event may make. Asked twice, they are the same draws.
#[derive(Debug, Clone)]
pub struct Draws {
    generator: ChaCha8Rng,
}

/// Who draws: keeps streams of the same seed and number apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// What a curriculum proposes: (run seed, seq).
    Course,
    /// What a designer thinks of: (brief seed, number).
    Design,
    /// Which layouts a lease gets: (run seed, lease).
    Serving,
    /// What a simulated learner and its scenarios are like: (seed, seq).
    Synthetic,
}

impl Purpose {
    const fn key(self) -> &'static [u8; 16] {
        match self {
            Self::Course => b"sparring course1",
            Self::Design => b"sparring designs",
            Self::Serving => b"sparring serving",
            Self::Synthetic => b"sparring synthet",
        }
    }
}

impl Draws {
    /// The draws of this event, from the first.
    #[must_use]
    pub fn new(purpose: Purpose, seed: u64, number: u64) -> Self {
        let mut key = [0u8; 32];
        key[..8].copy_from_slice(&seed.to_le_bytes());
        key[8..16].copy_from_slice(&number.to_le_bytes());
        // Keeps these streams apart from those of scenarios too, which are keyed alike (`chance`).
        key[16..].copy_from_slice(purpose.key());
        Self { generator: ChaCha8Rng::from_seed(key) }
    }

    /// The next draw, uniform in [0, 1): the top 53 bits as a multiple of 2⁻⁵³, so the same on every platform.
    #[expect(clippy::cast_precision_loss, reason = "53 bits fit an f64 exactly")]
    pub fn uniform(&mut self) -> f64 {
        (self.generator.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// True with this probability: never at 0, always at 1.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.uniform() < probability
    }

    /// Uniform among 0 … count − 1 (0 where count is 0). Counts here are below 100: the bias of scaling a 53-bit draw
    /// is beyond any measurement.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a draw in [0, 1) times a u32 is a non-negative number below it"
    )]
    pub fn below(&mut self, count: u32) -> u32 {
        let scaled = (self.uniform() * f64::from(count)) as u32;
        scaled.min(count.saturating_sub(1))
    }

    /// Uniform from `min` to `max`, both included.
    pub fn between(&mut self, min: u32, max: u32) -> u32 {
        min + self.below(max.saturating_sub(min).saturating_add(1))
    }

    /// One of several, by weight; uniform where all weigh nothing. None of none.
    pub fn weighted(&mut self, weights: &[f64]) -> Option<usize> {
        let all: f64 = weights.iter().sum();
        if weights.is_empty() || all <= 0.0 {
            let count = u32::try_from(weights.len()).unwrap_or(u32::MAX);
            return (count > 0).then(|| self.below(count) as usize);
        }
        let mut left = self.uniform() * all;
        let fits = weights.iter().position(|weight| {
            left -= weight;
            left < 0.0
        });
        // Rounding can leave a crumb: it is the last that weighs something.
        fits.or_else(|| weights.iter().rposition(|weight| *weight > 0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Committed, so that no change of a dependency moves what a stored run proposes.
    #[test]
    fn regress_golden_first_draws() {
        let mut draws = Draws::new(Purpose::Course, 42, 7);
        let first = [draws.uniform(), draws.uniform(), draws.uniform()];
        assert_eq!(first, [0.505_635_777_426_857_1, 0.175_929_859_195_212_3, 0.465_055_703_390_647_4]);
    }

    #[test]
    fn each_event_has_its_own_draws_and_always_the_same() {
        assert_eq!(Draws::new(Purpose::Course, 1, 2).uniform(), Draws::new(Purpose::Course, 1, 2).uniform());
        assert_ne!(Draws::new(Purpose::Course, 1, 2).uniform(), Draws::new(Purpose::Course, 1, 3).uniform());
        assert_ne!(Draws::new(Purpose::Course, 1, 2).uniform(), Draws::new(Purpose::Course, 2, 2).uniform());
        assert_ne!(Draws::new(Purpose::Course, 1, 2).uniform(), Draws::new(Purpose::Course, 2, 1).uniform());
    }

    #[test]
    fn first_draws_of_consecutive_events_are_uniform() {
        let n = 20_000u32;
        let mut counts = [0u32; 10];
        for seq in 0..u64::from(n) {
            counts[Draws::new(Purpose::Course, 3, seq).below(10) as usize] += 1;
        }
        // A cell is binomial with mean 2 000 and standard deviation 42: five of them.
        assert!(counts.iter().all(|count| count.abs_diff(n / 10) < 212), "{counts:?}");
    }

    #[test]
    fn probabilities_of_zero_and_one_are_certain() {
        let mut draws = Draws::new(Purpose::Course, 0, 0);
        assert!((0..1000).all(|_| draws.chance(1.0) && !draws.chance(0.0)));
        assert_eq!(draws.below(0), 0);
        assert_eq!(draws.below(1), 0);
    }

    #[test]
    fn weights_decide_and_bounds_are_kept() {
        let mut draws = Draws::new(Purpose::Design, 0, 0);
        let many: Vec<u32> = (0..1000).map(|_| draws.between(3, 5)).collect();
        assert!((3..=5).all(|n| many.contains(&n)) && many.iter().all(|n| (3..=5).contains(n)));
        assert_eq!((draws.weighted(&[]), draws.weighted(&[0.0, 2.0, 0.0])), (None, Some(1)));
        assert!((0..50).all(|_| draws.weighted(&[0.0, 0.0]).is_some_and(|at| at < 2)));
        assert_eq!((draws.between(9, 9), draws.between(9, 3)), (9, 9));
    }
}
