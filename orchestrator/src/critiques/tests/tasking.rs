//! Critiques of a world without encounters, whose failures have orbit angles.

use std::collections::BTreeMap;
use std::sync::Arc;

use env_core::{SeedSpace, rollout};
use store::failures::CellKey;

use super::{EnqueueJobs, RUN, ReadProfile, criticise, open};
use crate::critiques::critique_input::{CritiqueEpisode, CritiqueInput, SelectedEpisode};
use crate::critiques::store_critiques::StoreCritiques;
use crate::designs::profile::CollectedProfile;
use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;
use jobs::seeds::seed_of;

/// The task of the criticised episodes.
pub(super) const TASK: &str = "tasking/scanning";

/// The failure profile as the API and designers read it.
struct CollectProfile(&'static str);

impl Change for CollectProfile {
    type Output = CollectedProfile;

    async fn apply(self, tx: &mut WriteTx) -> Result<CollectedProfile, ServiceError> {
        Ok(CollectedProfile::load(&mut tx.conn, RUN, self.0).await?)
    }
}

#[tokio::test]
async fn the_profile_of_tasking_is_by_orbit_angle() {
    let folder = tempfile::tempdir().unwrap();
    let writer = open(&folder.path().join("x.sqlite3")).await;
    let task = env_core::task(TASK).unwrap();
    // A small battery and a small storage, so that satellites die and lose data.
    let params = [("battery_wh", 60.0), ("storage_gbit", 2.0), ("time_limit_s", 12_000.0)];
    let recipe = Arc::new(env_core::Recipe::with_params(task, params.into_iter()).unwrap());
    let episode = |number: u64| {
        let scenario =
            env_core::Scenario::new(Arc::clone(&recipe), seed_of(SeedSpace::Training, 1, 2, number));
        let mut blind = task.policy("blind", &scenario, 0).unwrap();
        let log = rollout::roll_out(&scenario, &mut *blind).unwrap().log;
        CritiqueEpisode { scenario, layout: None, log }
    };
    let episodes: Vec<_> = (0..4).map(episode).collect();
    let critiques: Vec<_> =
        episodes.iter().map(|episode| task.critique(&episode.scenario, &episode.log).unwrap()).collect();
    let job = writer.change(EnqueueJobs { task: TASK, sizes: vec![4] }).await.unwrap().remove(0);
    let selected =
        (0..).zip(episodes).map(|(number, episode)| SelectedEpisode { number, episode: Ok(episode) });
    let input = CritiqueInput { job, selected: selected.collect(), skipped: 0 };
    writer.change(StoreCritiques(vec![criticise(input)])).await.unwrap();

    let mut wanted: BTreeMap<CellKey, i64> = BTreeMap::new();
    for failure in critiques.iter().flat_map(|critique| &critique.failures) {
        let sector = failure.orbit_angle_deg.map(env_core::critique::profile_sector);
        *wanted.entry(CellKey { mode: failure.mode.to_owned(), sector, band: None }).or_default() += 1;
    }
    assert!(wanted.keys().any(|key| key.mode == "power") && wanted.keys().any(|key| key.mode == "full"));
    assert!(wanted.keys().all(|key| key.sector.is_some_and(|sector| sector < 12)));
    let stored = writer.change(ReadProfile(TASK)).await.unwrap();
    let counts: BTreeMap<CellKey, i64> =
        stored.cells.iter().map(|(key, cell)| (key.clone(), cell.count)).collect();
    assert_eq!(counts, wanted);
    assert!(stored.inertial.is_empty() && stored.waiting == 0);
    let judged: f64 = critiques.iter().map(|critique| critique.assessment.value).sum();
    assert!(
        (stored.sums.judgement.overall - judged).abs() < 1e-12,
        "{} is not {judged}",
        stored.sums.judgement.overall
    );

    let profile = writer.change(CollectProfile(TASK)).await.unwrap().profile(TASK);
    for cell in profile.modes.iter().flat_map(|mode| &mode.cells) {
        // Without an encounter there is no speed, and nothing to be seen or avoided.
        assert_eq!((cell.band, cell.avoidable_share, cell.mean_steps_left), (None, None, None));
    }
    let power = profile.mode("power").unwrap();
    assert!((power.sector_weights().iter().sum::<f64>() - power.weight).abs() < 1e-12);
    assert_eq!(
        writer.change(ReadProfile(super::TASK)).await.unwrap().sums.criticised,
        0,
        "the other task has none"
    );
}
