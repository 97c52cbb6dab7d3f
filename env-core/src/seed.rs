//! Seeds: integers below 2⁵³, so that every JSON reader keeps them whole, split into disjoint spaces.

use crate::error::ScenarioError;

/// Bits 52–51 of a seed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SeedSpace {
    /// `00`: chosen by people and their programs.
    User,
    /// `01`: drawn by a curriculum.
    Training,
    /// `10`: held out; no run can be given one.
    Evaluation,
}

/// A seed below 2⁵³ whose bits 52–51 are not `11`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Seed(u64);

/// Bits of a seed that are free within its space.
const FREE_BITS: u32 = 51;
/// The largest seed of each space, its tag left out: 2^51 − 1.
pub const FREE_MASK: u64 = (1 << FREE_BITS) - 1;
/// Largest valid seed: the last evaluation seed.
const MAX: u64 = (0b11 << FREE_BITS) - 1;

impl Seed {
    /// Any valid seed.
    ///
    /// # Errors
    /// At 2⁵³ and above, and where bits 52–51 are `11`.
    pub fn new(value: u64) -> Result<Self, ScenarioError> {
        if value <= MAX { Ok(Self(value)) } else { Err(no_seed(value.to_string())) }
    }

    /// A seed that a caller may choose.
    ///
    /// # Errors
    /// A training or evaluation seed.
    pub fn user(value: u64) -> Result<Self, ScenarioError> {
        if value <= FREE_MASK { Ok(Self(value)) } else { Err(no_seed(value.to_string())) }
    }

    /// The seed of `space` with these free bits; higher bits of `bits` are dropped.
    #[must_use]
    pub const fn in_space(space: SeedSpace, bits: u64) -> Self {
        let tag = match space {
            SeedSpace::User => 0b00,
            SeedSpace::Training => 0b01,
            SeedSpace::Evaluation => 0b10,
        };
        Self((tag << FREE_BITS) | (bits & FREE_MASK))
    }

    /// Which space this seed is of.
    #[must_use]
    pub const fn space(self) -> SeedSpace {
        match self.0 >> FREE_BITS {
            0 => SeedSpace::User,
            1 => SeedSpace::Training,
            _ => SeedSpace::Evaluation,
        }
    }

    /// The integer.
    #[must_use]
    pub const fn get(self) -> u64 {
        self.0
    }
}

/// What a seed must be, in every message: the one bound there is for people and their programs, 2⁵¹ − 1.
pub const SEED_WANTED: &str =
    "a whole number from 0 to 2251799813685247 (larger ones are kept for training and evaluation)";

fn no_seed(found: String) -> ScenarioError {
    ScenarioError::WrongType { field: "seed".to_owned(), found, wanted: SEED_WANTED.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spaces_are_disjoint_and_the_fourth_is_refused() {
        for (space, tag) in [(SeedSpace::User, 0u64), (SeedSpace::Training, 1), (SeedSpace::Evaluation, 2)] {
            let seed = Seed::in_space(space, u64::MAX);
            assert_eq!(seed.space(), space);
            assert_eq!(seed.get() >> 51, tag);
            assert_eq!(Seed::new(seed.get()), Ok(seed));
        }
        assert!(SEED_WANTED.contains(&FREE_MASK.to_string()));
        assert!(Seed::new(3 << 51).is_err());
        assert!(Seed::new(1 << 53).is_err());
        assert!(Seed::user(1 << 51).is_err());
        assert!(Seed::user((1 << 51) - 1).is_ok());
    }
}
