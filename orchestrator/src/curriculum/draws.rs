//! Randomness as a function of (run seed, seq).

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// The draws that one event of one run may make. Asked twice, they are the same draws.
#[derive(Debug, Clone)]
pub struct Draws {
    generator: ChaCha8Rng,
}

impl Draws {
    /// The draws of this event, from the first.
    #[must_use]
    pub fn new(run_seed: u64, seq: u64) -> Self {
        let mut key = [0u8; 32];
        key[..8].copy_from_slice(&run_seed.to_le_bytes());
        key[8..16].copy_from_slice(&seq.to_le_bytes());
        // Keeps these streams apart from those of scenarios, which are keyed alike (`env_core::chance`).
        key[16..].copy_from_slice(b"sparring course1");
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
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Committed, so that no change of a dependency moves what a stored run proposes.
    #[test]
    fn regress_golden_first_draws() {
        let mut draws = Draws::new(42, 7);
        let first = [draws.uniform(), draws.uniform(), draws.uniform()];
        assert_eq!(first, [0.505_635_777_426_857_1, 0.175_929_859_195_212_3, 0.465_055_703_390_647_4]);
    }

    #[test]
    fn each_event_has_its_own_draws_and_always_the_same() {
        assert_eq!(Draws::new(1, 2).uniform(), Draws::new(1, 2).uniform());
        assert_ne!(Draws::new(1, 2).uniform(), Draws::new(1, 3).uniform());
        assert_ne!(Draws::new(1, 2).uniform(), Draws::new(2, 2).uniform());
        assert_ne!(Draws::new(1, 2).uniform(), Draws::new(2, 1).uniform());
    }

    #[test]
    fn first_draws_of_consecutive_events_are_uniform() {
        let n = 20_000u32;
        let mut counts = [0u32; 10];
        for seq in 0..u64::from(n) {
            counts[Draws::new(3, seq).below(10) as usize] += 1;
        }
        // A cell is binomial with mean 2 000 and standard deviation 42: five of them.
        assert!(counts.iter().all(|count| count.abs_diff(n / 10) < 212), "{counts:?}");
    }

    #[test]
    fn probabilities_of_zero_and_one_are_certain() {
        let mut draws = Draws::new(0, 0);
        assert!((0..1000).all(|_| draws.chance(1.0) && !draws.chance(0.0)));
        assert_eq!(draws.below(0), 0);
        assert_eq!(draws.below(1), 0);
    }
}
