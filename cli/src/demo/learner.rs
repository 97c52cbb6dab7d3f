//! The learner: the cross-entropy method (Rubinstein 1999) over the numbers of a task's reflex, each in [0, 1].
//!
//! Ask for a population, fly all of it on the same scenarios, tell how each member fared: the fittest third gives the
//! mean and spread from which the next population is drawn. Only the order of the fitness counts.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Members of a population that shape the next, as a share of it.
const ELITE: f64 = 1.0 / 3.0;
/// How far the mean goes towards the elite's in one generation. Below 1: a generation's fitness is noisy.
const PULL: f64 = 0.7;
/// How far the spread goes towards the elite's.
const RELAX: f64 = 0.5;
/// The spread never falls below a floor (else it shrinks faster than the mean can travel), which itself goes down by
/// generations from the first number to the second: the ladder judges the whole population, so in the end its members
/// must be nearly as good as its mean.
const FLOOR: (f64, f64) = (0.2, 0.025);
const FLOOR_DECAY: f64 = 0.95;
/// Standard deviation of a uniform draw from [0, 1], 1/√12.
const UNIFORM_SPREAD: f64 = 0.288_675_134_594_812_9;

/// The cross-entropy method: where the next population is drawn.
#[derive(Debug, Clone)]
pub(super) struct CrossEntropy {
    mean: Vec<f64>,
    spread: Vec<f64>,
    floor: f64,
    generation: u32,
    chance: ChaCha8Rng,
}

impl CrossEntropy {
    /// Over so many numbers, at its start: the first population is uniform, as the policy `frozen` is.
    pub(super) fn new(numbers: usize, seed: u64) -> Self {
        Self {
            mean: vec![0.5; numbers],
            spread: vec![UNIFORM_SPREAD; numbers],
            floor: FLOOR.0,
            generation: 0,
            chance: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    /// Generations told.
    pub(super) const fn generation(&self) -> u32 {
        self.generation
    }

    /// The centre of what is asked for now.
    pub(super) fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// A population of this size.
    pub(super) fn ask(&mut self, size: usize) -> Vec<Vec<f64>> {
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
        (self.chance.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Takes a population's fitness (higher is better); the places of its elite, best first.
    pub(super) fn tell(&mut self, population: &[Vec<f64>], fitness: &[f64]) -> Vec<usize> {
        let mut places: Vec<usize> = (0..population.len().min(fitness.len())).collect();
        places.sort_by(|&a, &b| fitness[b].total_cmp(&fitness[a]));
        places.truncate(elite(places.len()));
        let pull = if self.generation == 0 { 1.0 } else { PULL };
        self.generation += 1;
        self.floor = FLOOR.1 + FLOOR_DECAY * (self.floor - FLOOR.1);
        let count = places.len() as f64;
        for (i, (centre, spread)) in self.mean.iter_mut().zip(&mut self.spread).enumerate() {
            let of_elite = || places.iter().map(|&place| population[place][i]);
            let mean = of_elite().sum::<f64>() / count;
            let variance = of_elite().map(|x| (x - mean) * (x - mean)).sum::<f64>() / count;
            *centre += pull * (mean - *centre);
            *spread += RELAX * (variance.sqrt() - *spread);
            *spread = spread.max(self.floor);
        }
        places
    }
}

/// Members of the elite of a population of this size.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a third of a small count")]
fn elite(size: usize) -> usize {
    ((size as f64 * ELITE).round() as usize).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Minus the squared distance to a point near a corner.
    fn fitness(member: &[f64]) -> f64 {
        -member.iter().zip(TARGET).map(|(x, t)| (x - t) * (x - t)).sum::<f64>()
    }
    const TARGET: [f64; 12] = [0.9, 0.1, 0.3, 0.6, 0.0, 1.0, 0.8, 0.2, 0.5, 0.4, 0.7, 0.95];

    #[test]
    fn it_improves_on_a_known_function() {
        for seed in 0..5 {
            let mut method = CrossEntropy::new(TARGET.len(), seed);
            let mut means = Vec::new();
            for _ in 0..80 {
                let population = method.ask(12);
                let scores: Vec<f64> = population.iter().map(|p| fitness(p)).collect();
                means.push(scores.iter().sum::<f64>() / 12.0);
                method.tell(&population, &scores);
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
                let population = method.ask(9);
                let scores: Vec<f64> = population.iter().map(|p| scale * fitness(p)).collect();
                assert_eq!(method.tell(&population, &scores).len(), 3);
            }
            method.mean().to_vec()
        };
        assert_eq!(run(1.0), run(1000.0));
    }

    #[test]
    fn a_population_stays_in_range() {
        let mut method = CrossEntropy::new(6, 1);
        let population = method.ask(50);
        let scores: Vec<f64> = population.iter().map(|p| p[0]).collect();
        method.tell(&population, &scores);
        assert!(method.ask(200).iter().flatten().all(|x| (0.0..=1.0).contains(x)));
        assert_eq!(elite(1), 1);
    }
}
