//! Seeds: integers below 2⁵³, which every JSON parser represents exactly, divided into disjoint spaces.

use crate::error::ScenarioError;

/// Space of a seed, encoded in its bits 52–51.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SeedSpace {
    /// `00`: seeds that users choose.
    User,
    /// `01`: seeds that a curriculum draws.
    Training,
    /// `10`: held-out seeds, which no run accepts.
    Evaluation,
}

/// A seed below 2⁵³ whose bits 52–51 are not `11`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Seed(u64);

/// Number of free bits of a seed within its space.
const FREE_BITS: u32 = 51;
/// Largest user seed, 2⁵¹ − 1; also the mask of the free bits of a seed.
pub const MAX_USER_SEED: u64 = (1 << FREE_BITS) - 1;
/// Largest valid seed: the last evaluation seed.
const MAX_SEED: u64 = (0b11 << FREE_BITS) - 1;

impl Seed {
    /// Creates a seed of any space.
    ///
    /// # Errors
    /// Returns [`ScenarioError::WrongType`] if the value is 2⁵³ or more, or if its bits 52–51 are `11`.
    pub fn new(value: u64) -> Result<Self, ScenarioError> {
        if value <= MAX_SEED { Ok(Self(value)) } else { Err(invalid_seed(value.to_string())) }
    }

    /// Creates a user seed.
    ///
    /// # Errors
    /// Returns [`ScenarioError::WrongType`] if the value is above [`MAX_USER_SEED`].
    pub fn user(value: u64) -> Result<Self, ScenarioError> {
        if value <= MAX_USER_SEED { Ok(Self(value)) } else { Err(invalid_seed(value.to_string())) }
    }

    /// Creates the seed of `space` with these free bits; higher bits are dropped.
    #[must_use]
    pub const fn in_space(space: SeedSpace, bits: u64) -> Self {
        let tag = match space {
            SeedSpace::User => 0b00,
            SeedSpace::Training => 0b01,
            SeedSpace::Evaluation => 0b10,
        };
        Self((tag << FREE_BITS) | (bits & MAX_USER_SEED))
    }

    /// Space of the seed.
    #[must_use]
    pub const fn space(self) -> SeedSpace {
        match self.0 >> FREE_BITS {
            0 => SeedSpace::User,
            1 => SeedSpace::Training,
            _ => SeedSpace::Evaluation,
        }
    }

    /// The seed as an integer.
    #[must_use]
    pub const fn get(self) -> u64 {
        self.0
    }
}

/// Description of a valid user seed in messages.
pub const SEED_REQUIREMENT: &str =
    "an integer from 0 to 2251799813685247 (larger seeds are reserved for training and evaluation)";

fn invalid_seed(found: String) -> ScenarioError {
    ScenarioError::WrongType { field: "seed".to_owned(), found, wanted: SEED_REQUIREMENT.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spaces_are_disjoint_and_the_fourth_is_invalid() {
        for (space, tag) in [(SeedSpace::User, 0u64), (SeedSpace::Training, 1), (SeedSpace::Evaluation, 2)] {
            let seed = Seed::in_space(space, u64::MAX);
            assert_eq!(seed.space(), space);
            assert_eq!(seed.get() >> 51, tag);
            assert_eq!(Seed::new(seed.get()), Ok(seed));
        }
        assert!(SEED_REQUIREMENT.contains(&MAX_USER_SEED.to_string()));
        assert!(Seed::new(3 << 51).is_err());
        assert!(Seed::new(1 << 53).is_err());
        assert!(Seed::user(1 << 51).is_err());
        assert!(Seed::user((1 << 51) - 1).is_ok());
    }
}
