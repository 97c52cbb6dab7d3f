//! The built-in learner: the cross-entropy method over the dozen numbers of [`Parameters`].

use env_core::kessler::policies::learner::{PARAMETERS, Parameters};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

pub struct Config {
    pub members: usize,
    pub elite: usize,
    pub pull: f64,
    pub relax: f64,
    pub floor0: f64,
    pub floor1: f64,
    pub decay: f64,
}

#[derive(Debug, Clone)]
pub struct Cem {
    pub mean: [f64; PARAMETERS],
    pub spread: [f64; PARAMETERS],
    pub generation: u32,
    rng: ChaCha8Rng,
}

impl Cem {
    pub fn new(seed: u64) -> Self {
        Self {
            mean: [0.5; PARAMETERS],
            spread: [0.2887; PARAMETERS],
            generation: 0,
            rng: ChaCha8Rng::seed_from_u64(seed),
        }
    }
    fn uniform(&mut self) -> f64 {
        (self.rng.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }
    pub fn ask(&mut self, n: usize) -> Vec<Parameters> {
        (0..n)
            .map(|_| {
                let mut p = [0.0; PARAMETERS];
                for i in 0..PARAMETERS {
                    p[i] = if self.generation == 0 {
                        self.uniform()
                    } else {
                        let bell: f64 = (0..3).map(|_| 2.0 * self.uniform() - 1.0).sum();
                        (self.mean[i] + self.spread[i] * bell).clamp(0.0, 1.0)
                    };
                }
                Parameters(p)
            })
            .collect()
    }
    pub fn tell(&mut self, cfg: &Config, population: &[Parameters], fitness: &[f64]) {
        let mut order: Vec<usize> = (0..population.len()).collect();
        order.sort_by(|a, b| fitness[*b].total_cmp(&fitness[*a]));
        let elite = &order[..cfg.elite];
        self.generation += 1;
        let floor = cfg.floor1 + (cfg.floor0 - cfg.floor1) * cfg.decay.powi(self.generation as i32);
        let k = elite.len() as f64;
        for i in 0..PARAMETERS {
            let m = elite.iter().map(|e| population[*e].0[i]).sum::<f64>() / k;
            let v = elite.iter().map(|e| (population[*e].0[i] - m).powi(2)).sum::<f64>() / k;
            let pull = if self.generation == 1 { 1.0 } else { cfg.pull };
            self.mean[i] += pull * (m - self.mean[i]);
            self.spread[i] += cfg.relax * (v.sqrt() - self.spread[i]);
            self.spread[i] = self.spread[i].max(floor);
        }
    }
}
