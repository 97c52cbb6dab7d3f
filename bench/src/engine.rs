//! The batch engine beside the bare kernel, in turns: what the rules cost, and what a second core gives.

use std::hint::black_box;
use std::time::{Duration, Instant};

use env_core::batch::{Autoreset, Batch, BatchConfig, Observe, Output, Seeds, Shape};
use env_core::chance::{Chance, Seeded, Stream};
use env_core::{Recipe, Seed, SeedSpace};

use crate::Row;
use crate::bare::Bare;

/// Environments of a batch.
const ENVS: usize = 256;
/// Slices a measurement is cut into; rivals take turns, and of each the best tenth is
/// told: what the machine gives when nothing else runs on it.
const SLICES: usize = 80;
const SLICE: Duration = Duration::from_millis(8);
/// Joint actions drawn beforehand.
const ACTIONS: usize = 13;
/// Largest burn per axis, LU/TU.
const BURN: f32 = 0.05;

/// A batch with its buffers.
pub(crate) struct Flying {
    batch: Box<dyn Batch>,
    shape: Shape,
    actions: Vec<Vec<f32>>,
    next: usize,
    observations: Vec<f32>,
    last: Vec<f32>,
    rewards: Vec<f32>,
    team_rewards: Vec<f32>,
    terminated: Vec<bool>,
    truncated: Vec<bool>,
    done: Vec<bool>,
}

impl Flying {
    pub(crate) fn new(task: &str, params: &[(&str, f64)], envs: usize, action: f32) -> anyhow::Result<Self> {
        let spec = env_core::task(task).ok_or_else(|| anyhow::anyhow!("{task} is gone"))?;
        let recipe = Recipe::with_params(spec, params.iter().copied())?;
        let config =
            BatchConfig { envs, autoreset: Autoreset::SameStep, observe: Observe::All { bodies: None } };
        let mut batch = spec.batch(Box::new(Seeds::new(recipe, 1)), config)?;
        let shape = batch.shape();
        let width = shape.agents * shape.action;
        let mut observations = vec![0.0; envs * shape.observation];
        batch.reset(None, &mut observations)?;
        Ok(Self {
            batch,
            shape,
            actions: (0..ACTIONS as u64).map(|i| draw(i, envs * width, shape.action, action)).collect(),
            next: 0,
            last: observations.clone(),
            observations,
            rewards: vec![0.0; envs * shape.agents],
            team_rewards: vec![0.0; envs],
            terminated: vec![false; envs * shape.agents],
            truncated: vec![false; envs * shape.agents],
            done: vec![false; envs],
        })
    }

    /// One step of all; how many.
    pub(crate) fn step(&mut self) -> anyhow::Result<usize> {
        self.next = (self.next + 1) % ACTIONS;
        let out = Output {
            observations: &mut self.observations,
            final_observations: &mut self.last,
            rewards: &mut self.rewards,
            team_rewards: &mut self.team_rewards,
            terminated: &mut self.terminated,
            truncated: &mut self.truncated,
            done: &mut self.done,
        };
        self.batch.step(black_box(&self.actions[self.next]), out)?;
        black_box(&self.observations);
        Ok(self.shape.envs)
    }

    pub(crate) fn shape(&self) -> Shape {
        self.shape
    }

    pub(crate) fn bytes_per_env(&self) -> usize {
        self.batch.bytes_per_env()
    }
}

/// Small actions by about half of the agents, drawn beforehand so that drawing is not measured.
#[expect(clippy::cast_possible_truncation, reason = "actions are single precision")]
fn draw(seed: u64, values: usize, action: usize, most: f32) -> Vec<f32> {
    let mut chance = Seeded::new(Seed::in_space(SeedSpace::User, seed));
    let mut actions = Vec::with_capacity(values);
    while actions.len() < values {
        let acts = chance.uniform(Stream::Policy) < 0.5;
        for _ in 0..action {
            let value = chance.between(Stream::Policy, -1.0, 1.0) as f32 * most;
            actions.push(if acts { value } else { 0.0 });
        }
    }
    actions
}

/// Rates of rivals that take turns: of each, what its best tenth of slices reaches.
pub(crate) fn race(rivals: &mut [&mut dyn FnMut() -> anyhow::Result<usize>]) -> anyhow::Result<Vec<f64>> {
    let mut rates = vec![Vec::new(); rivals.len()];
    for slice in 0..=SLICES {
        for (rival, rates) in rivals.iter_mut().zip(&mut rates) {
            let (begun, mut done) = (Instant::now(), 0);
            while begun.elapsed() < SLICE {
                for _ in 0..4 {
                    done += rival()?;
                }
            }
            if slice > 0 {
                rates.push(done as f64 / begun.elapsed().as_secs_f64());
            }
        }
    }
    Ok(rates
        .into_iter()
        .map(|mut rates| {
            rates.sort_by(f64::total_cmp);
            rates[rates.len() * 9 / 10]
        })
        .collect())
}

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let two = rayon::ThreadPoolBuilder::new().num_threads(2).build()?;
    let mut rows = Vec::new();
    for debris in [25, 50, 150] {
        let params = [("debris", f64::from(debris))];
        let mut flying = Flying::new("kessler/survival", &params, ENVS, BURN)?;
        let bodies = (flying.shape().observation - 18) / 5;
        let mut bare = Bare::new(ENVS, debris as usize, bodies);
        let mut seen = vec![0.0; ENVS * flying.shape().observation];
        let rates = one.install(|| {
            race(&mut [
                &mut || {
                    black_box(bare.step(&mut seen));
                    Ok(ENVS)
                },
                &mut || flying.step(),
            ])
        })?;
        rows.push(Row {
            what: format!("kessler batch of {ENVS}, {debris} debris, one core, beside the bare kernel"),
            measured: format!("{:.2} of {:.2} M steps/s", rates[1] / 1e6, rates[0] / 1e6),
            goal: "≥ 0.6 of it".into(),
            ratio: Some(rates[1] / rates[0] / 0.6),
        });
    }
    rows.push(second_core(&one, &two)?);
    rows.extend(per_body(&one)?);
    Ok(rows)
}

fn second_core(one: &rayon::ThreadPool, two: &rayon::ThreadPool) -> anyhow::Result<Row> {
    let params = [("debris", 50.0)];
    let mut alone = Flying::new("kessler/survival", &params, 4 * ENVS, BURN)?;
    let mut shared = Flying::new("kessler/survival", &params, 4 * ENVS, BURN)?;
    let rates = race(&mut [&mut || one.install(|| alone.step()), &mut || two.install(|| shared.step())])?;
    Ok(Row {
        what: format!("kessler batch of {}, 50 debris, two cores beside one", 4 * ENVS),
        measured: format!("{:.2} of {:.2} M steps/s", rates[1] / 1e6, rates[0] / 1e6),
        goal: "≥ 1.8 times".into(),
        ratio: Some(rates[1] / rates[0] / 1.8),
    })
}

/// Cost per body from few to very many, and memory.
fn per_body(one: &rayon::ThreadPool) -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    for debris in [25usize, 50, 100, 200, 300] {
        let mut flying = Flying::new("kessler/survival", &[("debris", debris as f64)], 64, BURN)?;
        let rate = one.install(|| race(&mut [&mut || flying.step()]))?[0];
        rows.push(Row {
            what: format!("kessler, {debris} debris: time a body and step; memory an environment"),
            measured: format!("{:.2} ns; {} bytes", 1e9 / rate / (debris + 3) as f64, flying.bytes_per_env()),
            goal: String::new(),
            ratio: None,
        });
    }
    Ok(rows)
}
