//! The batch engine compared with the baseline kernel: cost of the rules, gain of a second core, cost per body.

use std::hint::black_box;
use std::time::{Duration, Instant};

use commands::bench::stepped_batch::SteppedBatch;

use crate::Row;
use crate::baseline_kernel::BaselineKernel;

/// Environments of a batch.
const ENVS: usize = 256;
/// Number of time slices of a measurement. Contestants alternate, and the best tenth of their slices counts, which is the
/// speed of a machine without other load.
const SLICES: usize = 80;
const SLICE: Duration = Duration::from_millis(8);
/// Environments of a batch that two cores share: a step takes half a millisecond, and the handover to a second core 30 µs.
const TWO_CORE_ENVS: usize = 8 * ENVS;
/// Largest burn per axis, in LU/TU.
const MAX_BURN: f64 = 0.05;

/// Runs the contestants in alternating time slices; returns the 90th percentile of each rate, in items a second.
pub(crate) fn measure_alternating(
    contestants: &mut [&mut dyn FnMut() -> anyhow::Result<usize>],
) -> anyhow::Result<Vec<f64>> {
    let mut rates = vec![Vec::new(); contestants.len()];
    for slice in 0..=SLICES {
        for (contestant, rates) in contestants.iter_mut().zip(&mut rates) {
            let (begun, mut done) = (Instant::now(), 0);
            while begun.elapsed() < SLICE {
                for _ in 0..4 {
                    done += contestant()?;
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
        let mut stepped = SteppedBatch::new("kessler/survival", &params, ENVS, MAX_BURN)?;
        let bodies = (stepped.shape().observation - 18) / 5;
        let mut baseline = BaselineKernel::new(ENVS, debris as usize, bodies);
        let mut observations = vec![0.0; ENVS * stepped.shape().observation];
        let rates = one.install(|| {
            measure_alternating(&mut [
                &mut || {
                    black_box(baseline.step(&mut observations));
                    Ok(ENVS)
                },
                &mut || stepped.step().map(|()| ENVS),
            ])
        })?;
        rows.push(Row {
            label: format!("kessler batch of {ENVS}, {debris} debris, one core, and the baseline kernel"),
            measured: format!("{:.2} of {:.2} M steps/s", rates[1] / 1e6, rates[0] / 1e6),
            goal: "≥ 0.6 of the kernel".into(),
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
    let mut alone = SteppedBatch::new("kessler/survival", &params, TWO_CORE_ENVS, MAX_BURN)?;
    let mut shared = SteppedBatch::new("kessler/survival", &params, TWO_CORE_ENVS, MAX_BURN)?;
    let rates = measure_alternating(&mut [
        &mut || one.install(|| alone.step()).map(|()| TWO_CORE_ENVS),
        &mut || two.install(|| shared.step()).map(|()| TWO_CORE_ENVS),
    ])?;
    Ok(Row {
        label: format!("kessler batch of {TWO_CORE_ENVS}, 50 debris, two cores and one"),
        measured: format!("{:.2} of {:.2} M steps/s", rates[1] / 1e6, rates[0] / 1e6),
        goal: "≥ 1.8 times".into(),
        ratio: Some(rates[1] / rates[0] / 1.8),
    })
}

/// Measures time per body and memory per environment, from few to very many bodies.
fn per_body(one: &rayon::ThreadPool) -> anyhow::Result<Vec<Row>> {
    let mut rows = Vec::new();
    for debris in [25usize, 50, 100, 250, 500, 1000] {
        let mut stepped = SteppedBatch::new("kessler/survival", &[("debris", debris as f64)], 64, MAX_BURN)?;
        let rate = one.install(|| measure_alternating(&mut [&mut || stepped.step().map(|()| 64)]))?[0];
        rows.push(Row {
            label: format!("kessler, {debris} debris: time a body and step; memory an environment"),
            measured: format!(
                "{:.2} ns; {} bytes",
                1e9 / rate / (debris + 3) as f64,
                stepped.bytes_per_env()
            ),
            goal: String::new(),
            ratio: None,
        });
    }
    Ok(rows)
}

/// Measures deputies with full random thrust; deputies that have left do not count.
fn docking(one: &rayon::ThreadPool) -> anyhow::Result<Row> {
    let mut stepped = SteppedBatch::new("docking/multiagent", &[("deputies", 3.0)], ENVS, 1.0)?;
    let rate = one.install(|| {
        measure_alternating(&mut [&mut || {
            stepped.step()?;
            Ok(stepped.agents())
        }])
    })?[0];
    Ok(Row {
        label: format!("docking batch of {ENVS}, three deputies, one core"),
        measured: format!("{:.1} M agent-steps/s; {} bytes", rate / 1e6, stepped.bytes_per_env()),
        goal: "≥ 5 M agent-steps/s".into(),
        ratio: Some(rate / 5e6),
    })
}
