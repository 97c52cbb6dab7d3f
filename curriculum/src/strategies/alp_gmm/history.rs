//! History of groups of a task: their params and rewards, by which the nearest group is found.

use serde::{Deserialize, Serialize};

/// Number of groups in the history; a further one replaces the oldest.
const LEN: usize = 2500;
/// Distances that are compared at once.
const LANES: usize = 8;

/// Params and rewards of the latest groups of a task, column by column.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct GroupHistory {
    /// For each param, its values as fractions of the level table.
    fractions: Vec<Vec<f64>>,
    rewards: Vec<f64>,
}

impl GroupHistory {
    /// Stores a group as number `number`, counted from 0.
    pub(super) fn record(&mut self, number: u64, fractions: &[f64], reward: f64) {
        self.fractions.resize(fractions.len(), Vec::new());
        let place = (number % LEN as u64) as usize;
        for (column, fraction) in self.fractions.iter_mut().zip(fractions) {
            store(column, place, *fraction);
        }
        store(&mut self.rewards, place, reward);
    }

    /// Reward of the group whose params are nearest; of groups at the same distance, the one at the first place. `None`
    /// if there is no group.
    pub(super) fn nearest_reward(&self, fractions: &[f64]) -> Option<f64> {
        let mut squared_distances = vec![0.0; self.rewards.len()];
        for (column, fraction) in self.fractions.iter().zip(fractions) {
            for (squared_distance, earlier) in squared_distances.iter_mut().zip(column) {
                *squared_distance += (fraction - earlier) * (fraction - earlier);
            }
        }
        self.rewards.get(first_least(&squared_distances)).copied()
    }
}

/// Stores a value at a place, which is at most one past the end.
fn store(column: &mut Vec<f64>, place: usize, value: f64) {
    match column.get_mut(place) {
        Some(cell) => *cell = value,
        None => column.push(value),
    }
}

/// Place of the least value, the first of equal ones; 0 if there is none.
fn first_least(values: &[f64]) -> usize {
    let (chunks, rest) = values.as_chunks::<LANES>();
    let mut least = [f64::INFINITY; LANES];
    for chunk in chunks {
        for (least, value) in least.iter_mut().zip(chunk) {
            *least = if value < least { *value } else { *least };
        }
    }
    let least = least.iter().chain(rest).copied().fold(f64::INFINITY, f64::min);
    values.iter().position(|value| *value == least).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn nearest_group_is_found(
            groups in proptest::collection::vec((0u8..4, 0u8..4, 0u8..9), 0..60),
            at in (0u8..4, 0u8..4),
        ) {
            let mut history = GroupHistory::default();
            for (number, (a, b, reward)) in groups.iter().enumerate() {
                history.record(number as u64, &[f64::from(*a) / 4.0, f64::from(*b) / 4.0], f64::from(*reward));
            }
            let distance = |a: u8, b: u8| u32::from(a.abs_diff(at.0)).pow(2) + u32::from(b.abs_diff(at.1)).pow(2);
            let expected = groups.iter().min_by_key(|(a, b, _)| distance(*a, *b)).map(|(.., reward)| f64::from(*reward));
            let at = [f64::from(at.0) / 4.0, f64::from(at.1) / 4.0];
            prop_assert_eq!(history.nearest_reward(&at), expected);
        }
    }

    #[test]
    fn full_history_replaces_the_oldest_group() {
        let mut history = GroupHistory::default();
        for number in 0..=LEN as u64 {
            history.record(number, &[number as f64], number as f64);
        }
        assert_eq!(history.rewards.len(), LEN);
        assert_eq!(history.nearest_reward(&[0.0]), Some(1.0));
        assert_eq!(history.nearest_reward(&[1e9]), Some(LEN as f64));
    }
}
