//! Trainers that report results of a run as fast as the server takes them.

use system_tests::ApiClient;
use tokio::task::JoinSet;

use crate::results;

/// Number of concurrent trainers.
const TRAINERS: usize = 3;

/// Reports at least `episodes` episodes of a run and returns their number.
pub(crate) async fn report_episodes(
    api: &ApiClient,
    run: &'static str,
    episodes: u64,
) -> anyhow::Result<u64> {
    let mut trainers: JoinSet<anyhow::Result<u64>> = JoinSet::new();
    for _ in 0..TRAINERS {
        let api = api.clone();
        trainers.spawn(async move {
            let mut done = 0;
            while done < episodes / TRAINERS as u64 {
                for body in results::lease_and_build_batches(&api, run).await? {
                    done += results::send_batch(&api, run, body).await?;
                }
            }
            Ok(done)
        });
    }
    let mut done = 0;
    while let Some(trainer) = trainers.join_next().await {
        done += trainer??;
    }
    Ok(done)
}
