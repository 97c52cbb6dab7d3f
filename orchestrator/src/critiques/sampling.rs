//! Selects the episodes to criticise when more are reported than can be criticised.

/// Episodes of a run that may wait before some of them are skipped.
pub const MAX_WAITING: i64 = 2000;

/// Returns how often the share of criticised episodes is halved when this many episodes of the run wait: not at all up to
/// [`MAX_WAITING`], once up to twice that number, twice up to four times, and so on. However long the queue is, it stands for about
/// [`MAX_WAITING`] critiques, and the share recovers as the queue drains.
#[must_use]
pub fn halvings(waiting: i64) -> u32 {
    let over = waiting.max(0) / MAX_WAITING;
    if waiting <= MAX_WAITING { 0 } else { over.ilog2() + 1 }
}

/// Returns the share of episodes that is criticised.
#[must_use]
pub fn share(halvings: u32) -> f64 {
    libm::exp2(-f64::from(halvings))
}

/// True if an episode is selected. The choice depends on its key alone, so that its content has no influence, and an episode that is
/// selected under more halvings is selected under fewer.
#[must_use]
pub fn is_selected(lease: i64, number: i64, halvings: u32) -> bool {
    let mut hasher = blake3::Hasher::new_derive_key("sparring 2026 critique sample");
    hasher.update(&lease.to_le_bytes()).update(&number.to_le_bytes());
    let mut word = [0; 8];
    word.copy_from_slice(&hasher.finalize().as_bytes()[..8]);
    u64::from_le_bytes(word).trailing_zeros() >= halvings
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn share_is_halved_only_when_too_many_episodes_wait() {
        let at = [
            (-1, 0),
            (0, 0),
            (2000, 0),
            (2001, 1),
            (3999, 1),
            (4000, 2),
            (7999, 2),
            (8000, 3),
            (2_000_000, 10),
        ];
        for (waiting, wanted) in at {
            assert_eq!(halvings(waiting), wanted, "{waiting}");
        }
        assert_eq!([0, 1, 3].map(share), [1.0, 0.5, 0.125]);
        assert_eq!(halvings(i64::MAX), 53);
    }

    #[test]
    fn samples_are_nested_and_of_the_expected_size() {
        let all: Vec<(i64, i64)> = (1..=40).flat_map(|lease| (0..500).map(move |n| (lease, n))).collect();
        for h in 0..6 {
            let n = all.iter().filter(|(l, n)| is_selected(*l, *n, h)).count() as f64;
            let wanted = all.len() as f64 * share(h);
            // Binomial: four standard deviations, one draw in 16 000 would be outside.
            assert!((n - wanted).abs() <= 4.0 * (wanted * (1.0 - share(h))).sqrt(), "{h}: {n}, not {wanted}");
            assert!(all.iter().all(|(l, n)| !is_selected(*l, *n, h + 1) || is_selected(*l, *n, h)), "nested");
        }
    }
}
