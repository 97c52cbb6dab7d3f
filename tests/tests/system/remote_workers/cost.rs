//! CPU time of the server for an audited result, with and without workers.

use std::time::{Duration, Instant};

use serde_json::json;

use super::*;

/// Clock ticks of `/proc` a second: the value of all Linux systems.
const TICKS_PER_S: f64 = 100.0;
/// Groups of a measurement.
const GROUPS: usize = 12;

/// CPU time of a process so far, s.
fn cpu_s(pid: u32) -> f64 {
    let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
    let fields: Vec<&str> = text.rsplit_once(") ").unwrap().1.split(' ').collect();
    let ticks: f64 = [11, 12].map(|field: usize| fields[field].parse::<f64>().unwrap()).iter().sum();
    ticks / TICKS_PER_S
}

/// Cost of the results of a task.
struct MeasuredCost {
    /// CPU time of the server for each result, ms.
    cpu_ms: f64,
    /// Time of all results, s.
    duration_s: f64,
    /// Counters of the jobs.
    counters: Value,
}

/// Reports groups of eight episodes of a task, and measures their cost.
async fn measure(workers: usize, task: &str, policy: &str) -> MeasuredCost {
    let nats = if workers > 0 { NatsServer::start() } else { None };
    let cluster = Cluster::start(nats, workers).await;
    let api = cluster.api();
    let run =
        json!({"id": "run", "seed": 3, "group_size": 8, "design": {"designer": "off"}, "tasks": [task]});
    let _ = api.post("/v1/runs", run).await.expect(201);
    let lease = api.lease("run", json!({"groups": GROUPS})).await;
    let results = lease.results(policy);
    wait_until("the queue is prepared", async || is_prepared(&cluster.db()).await).await;
    let pid = cluster.server.as_ref().unwrap().pid();
    // Idle CPU, of heartbeats and checkpoints, is subtracted.
    let (idle, idle_from) = (cpu_s(pid), Instant::now());
    tokio::time::sleep(Duration::from_secs(2)).await;
    let idle_rate = (cpu_s(pid) - idle) / idle_from.elapsed().as_secs_f64();
    let (before, started) = (cpu_s(pid), Instant::now());
    for part in results.chunks(16) {
        api.report("run", part.to_vec()).await;
    }
    wait_until("critiques end", async || has_no_critiques(&api).await).await;
    let spent = cpu_s(pid) - before - idle_rate * started.elapsed().as_secs_f64();
    let list = cluster.list().await;
    let counters = &list["counters"];
    MeasuredCost {
        cpu_ms: 1000.0 * spent / results.len() as f64,
        duration_s: started.elapsed().as_secs_f64(),
        counters: counters.clone(),
    }
}

#[tokio::test(flavor = "multi_thread")]
#[ignore = "measures, on an otherwise idle machine"]
async fn cpu_of_the_server_falls_with_workers() {
    if NatsServer::start().is_none() {
        return;
    }
    for (task, policy) in [("tasking/scanning", "blind"), ("kessler/formation", "hold")] {
        let alone = measure(0, task, policy).await;
        let helped = measure(1, task, policy).await;
        println!("{task}: ratio {:.2}", helped.cpu_ms / alone.cpu_ms);
        for cost in [alone, helped] {
            println!("  {:.2} ms of CPU a result, {:.1} s, {}", cost.cpu_ms, cost.duration_s, cost.counters);
        }
    }
}
