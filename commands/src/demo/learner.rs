//! The learner: the cross-entropy method (Rubinstein 1999) over the numbers of a task's reflex, each in [0, 1].
//!
//! [`CrossEntropy::sample`] samples a population. All members run the same scenarios, and [`CrossEntropy::update`] receives their
//! fitness. The fittest third gives the mean and spread from which the next population is drawn. Only the order of the
//! fitness values counts.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Share of a population that shapes the next one.
const ELITE: f64 = 1.0 / 3.0;
/// Step of the mean towards the elite's mean in one generation. It is below 1 because the fitness is noisy.
const PULL: f64 = 0.7;
/// Step of the spread towards the elite's spread in one generation.
const RELAX: f64 = 0.5;
/// Initial lower bound of the spread. Without a bound, the spread shrinks faster than the mean can travel.
const INITIAL_FLOOR: f64 = 0.2;
/// Final lower bound of the spread. The ladder judges the whole population, so in the end its members must be nearly as good
/// as its mean.
const FINAL_FLOOR: f64 = 0.025;
/// Factor by which the bound approaches [`FINAL_FLOOR`] in one generation.
const FLOOR_DECAY: f64 = 0.95;
/// Standard deviation of a uniform draw from [0, 1], 1/√12.
const UNIFORM_SPREAD: f64 = 0.288_675_134_594_812_9;

/// State of the cross-entropy method: the distribution of the next population.
#[derive(Debug, Clone)]
pub(super) struct CrossEntropy {
    mean: Vec<f64>,
    spread: Vec<f64>,
    floor: f64,
    generation: u32,
    rng: ChaCha8Rng,
}

impl CrossEntropy {
    /// Creates the initial state for `numbers` parameters. The first population is uniform, as the policy `frozen` is.
    pub(super) fn new(numbers: usize, seed: u64) -> Self {
        Self {
            mean: vec![0.5; numbers],
            spread: vec![UNIFORM_SPREAD; numbers],
            floor: INITIAL_FLOOR,
            generation: 0,
            rng: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    /// Returns the number of generations whose fitness was received.
    pub(super) const fn generation(&self) -> u32 {
        self.generation
    }

    /// Returns the mean of the current distribution.
    pub(super) fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// Samples a population of this size.
    pub(super) fn sample(&mut self, size: usize) -> Vec<Vec<f64>> {
        let numbers = self.mean.len();
        (0..size).map(|_| (0..numbers).map(|i| self.draw(i)).collect()).collect()
    }

    fn draw(&mut self, i: usize) -> f64 {
        if self.generation == 0 {
            return self.uniform();
        }
        // The sum of three uniform draws from [−1, 1] has variance 1: bell-shaped enough.
        let bell = 2.0 * (self.uniform() + self.uniform() + self.uniform()) - 3.0;
        (self.mean[i] + self.spread[i] * bell).clamp(0.0, 1.0)
    }

    #[expect(clippy::cast_precision_loss, reason = "53 bits fit an f64 exactly")]
    fn uniform(&mut self) -> f64 {
        (self.rng.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Updates the distribution by a population's fitness (higher is better). Returns the indices of the elite, best first.
    pub(super) fn update(&mut self, population: &[Vec<f64>], fitness: &[f64]) -> Vec<usize> {
        let mut elite: Vec<usize> = (0..population.len().min(fitness.len())).collect();
        elite.sort_by(|&a, &b| fitness[b].total_cmp(&fitness[a]));
        elite.truncate(elite_size(elite.len()));
        let pull = if self.generation == 0 { 1.0 } else { PULL };
        self.generation += 1;
        self.floor = FINAL_FLOOR + FLOOR_DECAY * (self.floor - FINAL_FLOOR);
        let count = elite.len() as f64;
        for (i, (centre, spread)) in self.mean.iter_mut().zip(&mut self.spread).enumerate() {
            let of_elite = || elite.iter().map(|&member| population[member][i]);
            let mean = of_elite().sum::<f64>() / count;
            let variance = of_elite().map(|x| (x - mean) * (x - mean)).sum::<f64>() / count;
            *centre += pull * (mean - *centre);
            *spread += RELAX * (variance.sqrt() - *spread);
            *spread = spread.max(self.floor);
        }
        elite
    }
}

/// Returns the size of the elite of a population of `size` members.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a third of a small count")]
fn elite_size(size: usize) -> usize {
    ((size as f64 * ELITE).round() as usize).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns minus the squared distance to a point near a corner.
    fn fitness(member: &[f64]) -> f64 {
        -member.iter().zip(TARGET).map(|(x, t)| (x - t) * (x - t)).sum::<f64>()
    }
    const TARGET: [f64; 12] = [0.9, 0.1, 0.3, 0.6, 0.0, 1.0, 0.8, 0.2, 0.5, 0.4, 0.7, 0.95];

    #[test]
    fn fitness_improves_on_a_known_function() {
        for seed in 0..5 {
            let mut method = CrossEntropy::new(TARGET.len(), seed);
            let mut means = Vec::new();
            for _ in 0..80 {
                let population = method.sample(12);
                let scores: Vec<f64> = population.iter().map(|p| fitness(p)).collect();
                means.push(scores.iter().sum::<f64>() / 12.0);
                method.update(&population, &scores);
            }
            // A uniform population is 1.9 away on average; one about the target at the floor's spread 12·0.025² = 0.01.
            assert!(means[0] < -1.0 && means[79] > -0.1, "seed {seed}: {} to {}", means[0], means[79]);
        }
    }

    #[test]
    fn only_the_order_of_fitness_counts_and_equal_seeds_are_equal() {
        let run = |scale: f64| {
            let mut method = CrossEntropy::new(TARGET.len(), 7);
            for _ in 0..5 {
                let population = method.sample(9);
                let scores: Vec<f64> = population.iter().map(|p| scale * fitness(p)).collect();
                assert_eq!(method.update(&population, &scores).len(), 3);
            }
            method.mean().to_vec()
        };
        assert_eq!(run(1.0), run(1000.0));
    }

    #[test]
    fn population_stays_in_range() {
        let mut method = CrossEntropy::new(6, 1);
        let population = method.sample(50);
        let scores: Vec<f64> = population.iter().map(|p| p[0]).collect();
        method.update(&population, &scores);
        assert!(method.sample(200).iter().flatten().all(|x| (0.0..=1.0).contains(x)));
        assert_eq!(elite_size(1), 1);
    }
}
