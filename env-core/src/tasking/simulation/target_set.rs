//! Sets of targets, one bit a target.

/// A set of targets.
#[derive(Debug, PartialEq, Eq, Default)]
pub struct TargetSet {
    words: Vec<u64>,
}

impl Clone for TargetSet {
    fn clone(&self) -> Self {
        Self { words: self.words.clone() }
    }

    /// Keeps the memory of the set.
    fn clone_from(&mut self, source: &Self) {
        self.words.clone_from(&source.words);
    }
}

impl TargetSet {
    /// Creates an empty set for a number of targets.
    #[must_use]
    pub fn new(targets: usize) -> Self {
        Self { words: vec![0; targets.div_ceil(64)] }
    }

    /// True if the set contains a target.
    #[must_use]
    pub fn contains(&self, target: usize) -> bool {
        self.words.get(target / 64).is_some_and(|word| word >> (target % 64) & 1 == 1)
    }

    /// Adds a target to the set.
    pub fn insert(&mut self, target: usize) {
        if let Some(word) = self.words.get_mut(target / 64) {
            *word |= 1 << (target % 64);
        }
    }

    /// Adds all targets of another set.
    pub fn union(&mut self, other: &Self) {
        self.words.iter_mut().zip(&other.words).for_each(|(a, b)| *a |= b);
    }

    /// Number of targets in the set.
    #[must_use]
    pub fn len(&self) -> usize {
        self.words.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// True if the set is empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.words.iter().all(|word| *word == 0)
    }
}
