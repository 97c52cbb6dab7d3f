//! The batch engine beside the bare kernel, in turns: what the rules cost, and what a second core gives.

use std::hint::black_box;
use std::time::{Duration, Instant};

use orchestrator::cli::bench::flying::Flying;

use crate::Row;
use crate::bare::Bare;

/// Environments of a batch.
const ENVS: usize = 256;
/// Slices a measurement is cut into; rivals take turns, and of each the best tenth is
/// told: what the machine gives when nothing else runs on it.
const SLICES: usize = 80;
const SLICE: Duration = Duration::from_millis(8);
/// Environments of a batch that two cores share: a step of them takes half a millisecond, and handing half of it over costs
/// some 30 µs.
const MANY: usize = 8 * ENVS;
/// Largest burn per axis, LU/TU.
const BURN: f64 = 0.05;

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
                &mut || flying.step().map(|()| ENVS),
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
    rows.push(docking(&one)?);
    Ok(rows)
}

fn second_core(one: &rayon::ThreadPool, two: &rayon::ThreadPool) -> anyhow::Result<Row> {
    let params = [("debris", 50.0)];
    let mut alone = Flying::new("kessler/survival", &params, MANY, BURN)?;
    let mut shared = Flying::new("kessler/survival", &params, MANY, BURN)?;
    let rates = race(&mut [&mut || one.install(|| alone.step()).map(|()| MANY), &mut || {
        two.install(|| shared.step()).map(|()| MANY)
    }])?;
    Ok(Row {
        what: format!("kessler batch of {MANY}, 50 debris, two cores beside one"),
        measured: format!("{:.2} of {:.2} M steps/s", rates[1] / 1e6, rates[0] / 1e6),
        goal: "≥ 1.8 times".into(),
        ratio: Some(rates[1] / rates[0] / 1.8),
    })
}

/// Cost per body from few to very many, and memory.
fn per_body(one: &rayon::ThreadPool) -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    for debris in [25usize, 50, 100, 250, 500, 1000] {
        let mut flying = Flying::new("kessler/survival", &[("debris", debris as f64)], 64, BURN)?;
        let rate = one.install(|| race(&mut [&mut || flying.step().map(|()| 64)]))?[0];
        rows.push(Row {
            what: format!("kessler, {debris} debris: time a body and step; memory an environment"),
            measured: format!("{:.2} ns; {} bytes", 1e9 / rate / (debris + 3) as f64, flying.bytes_per_env()),
            goal: String::new(),
            ratio: None,
        });
    }
    Ok(rows)
}

/// Deputies flown by full random thrust; those that have left do not count.
fn docking(one: &rayon::ThreadPool) -> anyhow::Result<Row> {
    let mut flying = Flying::new("docking/multiagent", &[("deputies", 3.0)], ENVS, 1.0)?;
    let rate = one.install(|| {
        race(&mut [&mut || {
            flying.step()?;
            Ok(flying.agents())
        }])
    })?[0];
    Ok(Row {
        what: format!("docking batch of {ENVS}, three deputies, one core"),
        measured: format!("{:.1} M agent-steps/s; {} bytes", rate / 1e6, flying.bytes_per_env()),
        goal: "≥ 5 M agent-steps/s".into(),
        ratio: Some(rate / 5e6),
    })
}
