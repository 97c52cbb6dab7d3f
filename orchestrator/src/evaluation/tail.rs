//! The worst of it: the mean score over the tenth of the scenarios on which a policy does worst (conditional value at risk).
//!
//! Where a policy's episodes differ by chance, the scenarios with the lowest means are in part those with the worst luck, and their
//! mean says too little of the policy. So scenarios are ranked by one half of their episodes and the other half is reported; then
//! the other way round, and the mean of both.

use super::bootstrap::{Estimate, estimate_by};
use super::flown::{Flown, Measures};

/// The share of scenarios that are the worst.
pub const TAIL: f64 = 0.1;
/// Episodes of a scenario without which nothing is said where they differ by chance: four in each half.
pub const LEAST: usize = 8;

/// The mean score over the worst tenth of the scenarios, with a 95 % percentile bootstrap interval over scenarios; none where a
/// policy with chance in it flew fewer than eight episodes of some.
#[must_use]
pub fn cvar(flown: &Flown, seed: u64) -> Option<Estimate> {
    let enough =
        |episodes: &Vec<Measures>| !episodes.is_empty() && (!flown.chance || episodes.len() >= LEAST);
    if flown.episodes.is_empty() || !flown.episodes.iter().all(enough) {
        return None;
    }
    let halves: Vec<(f64, f64)> = flown.episodes.iter().map(|episodes| halves(episodes)).collect();
    estimate_by(&halves, seed, |drawn| Some(0.5 * (worst(drawn.clone()) + worst(drawn.map(|(a, b)| (b, a))))))
}

/// The mean scores of the two halves; the same twice of a single episode.
fn halves(episodes: &[Measures]) -> (f64, f64) {
    let mean = |of: &mut dyn Iterator<Item = &Measures>| {
        let (sum, n) =
            of.filter_map(|measures| measures[0]).fold((0.0, 0u32), |(sum, n), score| (sum + score, n + 1));
        (n > 0).then(|| sum / f64::from(n))
    };
    let even = mean(&mut episodes.iter().step_by(2));
    let odd = mean(&mut episodes.iter().skip(1).step_by(2));
    let even = even.unwrap_or(0.0);
    (even, odd.unwrap_or(even))
}

/// The mean of the second numbers of the tenth with the lowest first ones; ties share their places.
fn worst(scenarios: impl Iterator<Item = (f64, f64)>) -> f64 {
    let all: Vec<(f64, f64)> = scenarios.collect();
    let mut scores: Vec<f64> = all.iter().map(|(score, _)| *score).collect();
    // A part of a scenario counts in part.
    let places = TAIL * all.len() as f64;
    let Some(last) = (places.ceil() as usize).checked_sub(1) else { return 0.0 };
    let (_, &mut edge, _) = scores.select_nth_unstable_by(last, f64::total_cmp);
    let of = |which: &dyn Fn(f64) -> bool| {
        let told = all.iter().filter(|(score, _)| which(*score)).map(|(_, told)| told);
        told.fold((0.0, 0.0), |(sum, n), told| (sum + told, n + 1.0))
    };
    let ((below, n), (tied, ties)) = (of(&|score| score < edge), of(&|score| score == edge));
    let share = (places - n) / ties;
    (below + share * tied) / places
}

#[cfg(test)]
mod tests {
    use env_core::Draws;
    use env_core::draws::Purpose;

    use super::*;

    fn flown(chance: bool, scores: Vec<Vec<f64>>) -> Flown {
        let episode = |score: f64| [Some(score), None, None, None, None];
        let episodes = scores.into_iter().map(|of| of.into_iter().map(episode).collect()).collect();
        Flown { policy: "one".to_owned(), chance, episodes }
    }

    #[test]
    fn validate_without_chance_it_is_the_mean_of_the_lowest_tenth() {
        let scores = (0..50).map(|n| vec![f64::from(n) / 50.0]).collect();
        let found = cvar(&flown(false, scores), 0).unwrap();
        assert!((found.mean - (0.0 + 1.0 + 2.0 + 3.0 + 4.0) / 250.0).abs() < 1e-12, "{found:?}");
        assert!(found.low <= found.mean && found.mean <= found.high);
        // Two and a half scenarios of 25: the third counts half.
        let scores = (0..25).map(|n| vec![f64::from(n)]).collect();
        assert!((cvar(&flown(false, scores), 0).unwrap().mean - (0.0 + 1.0 + 0.5 * 2.0) / 2.5).abs() < 1e-12);
    }

    /// All scenarios are alike and only luck differs: the worst tenth is as good as all. Ranked and reported by the same episodes it
    /// would seem worse by 1.75 standard deviations of the mean of eight, 0.31 here (the mean of the lowest tenth of a normal).
    #[test]
    fn luck_is_not_taken_for_weakness() {
        let mut draws = Draws::new(Purpose::Synthetic, 1, 2);
        let scores: Vec<Vec<f64>> =
            (0..400).map(|_| (0..8).map(|_| f64::from(u8::from(draws.chance(0.5)))).collect()).collect();
        let naive = {
            let mut means: Vec<f64> = scores.iter().map(|of| of.iter().sum::<f64>() / 8.0).collect();
            means.sort_by(f64::total_cmp);
            means[..40].iter().sum::<f64>() / 40.0
        };
        let found = cvar(&flown(true, scores), 0).unwrap();
        assert!(naive < 0.25, "{naive}");
        // 40 scenarios of four episodes, twice: a standard deviation of 0.5/√320 = 0.028, three of them.
        assert!((found.mean - 0.5).abs() < 0.085, "{found:?}");
        assert!(found.low <= 0.5 && 0.5 <= found.high, "{found:?}");
    }

    #[test]
    fn too_few_episodes_say_nothing() {
        assert_eq!(cvar(&flown(true, vec![vec![0.5; 7]; 30]), 0), None);
        assert!(cvar(&flown(true, vec![vec![0.5; 8]; 30]), 0).is_some());
        assert_eq!(cvar(&flown(false, Vec::new()), 0), None);
    }
}
