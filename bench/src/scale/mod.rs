//! Scale of a server: many runs, many slow connections, a large database.

pub(crate) mod large_database;
pub(crate) mod many_runs;
pub(crate) mod slow_clients;

use std::time::Instant;

use system_tests::ApiClient;

/// Number of requests of a list; their median counts.
const REQUESTS: usize = 5;

/// Median duration of a GET request, milliseconds.
async fn median_ms(api: &ApiClient, path: &str) -> anyhow::Result<f64> {
    let mut times = Vec::with_capacity(REQUESTS);
    for _ in 0..REQUESTS {
        let start = Instant::now();
        let response = api.get(path).await;
        anyhow::ensure!(response.status == 200, "{path}: {} {}", response.status, response.body);
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    Ok(times[REQUESTS / 2])
}
