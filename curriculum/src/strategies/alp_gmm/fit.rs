//! A mixture fit in progress, which any thread may compute.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use env_core::KeyedRng;
use env_core::keyed_rng::RngPurpose;
use serde::{Deserialize, Serialize};

use super::mixture::{ComponentRange, Mixture};
use crate::core::strategy::BackgroundJob;

/// Inputs of a mixture fit, and its result once it is computed. The inputs determine the result.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct MixtureFit {
    points: Vec<Vec<f64>>,
    components: ComponentRange,
    rng_key: RngKey,
    #[serde(skip)]
    result: OnceLock<Option<Mixture>>,
    /// True once the fit was handed out as a background job.
    #[serde(skip)]
    is_taken: AtomicBool,
}

/// Key of the random draws of a fit. Stored as `[run_seed, seq]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "[u64; 2]", into = "[u64; 2]")]
pub(super) struct RngKey {
    pub(super) run_seed: u64,
    /// Seq of the event that started the fit.
    pub(super) seq: u64,
}

impl MixtureFit {
    /// A fit to `points`, not computed yet.
    pub(super) fn new(points: Vec<Vec<f64>>, components: ComponentRange, rng_key: RngKey) -> Self {
        Self { points, components, rng_key, result: OnceLock::new(), is_taken: AtomicBool::new(false) }
    }

    /// True if the points are enough for a mixture of the smallest number of components.
    pub(super) fn has_enough_points(&self) -> bool {
        self.points.len() > self.components.min as usize
    }

    /// True once a thread has computed the fit.
    pub(super) fn is_computed(&self) -> bool {
        self.result.get().is_some()
    }

    /// Result of the fit, computed now if no thread has done it. `None` if no mixture fits the points: a fit of enough
    /// points always has one, because covariances have a floor.
    pub(super) fn mixture(&self) -> Option<&Mixture> {
        let fit = || {
            let mut rng = KeyedRng::new(RngPurpose::Curriculum, self.rng_key.run_seed, self.rng_key.seq);
            Mixture::fit_best(&self.points, self.components, &mut rng)
        };
        self.result.get_or_init(fit).as_ref()
    }

    /// Marks the fit as handed out; true on the first call only.
    pub(super) fn take(&self) -> bool {
        !self.is_taken.swap(true, Ordering::Relaxed)
    }
}

impl BackgroundJob for MixtureFit {
    fn run(&self) {
        let _computed = self.mixture();
    }
}

impl From<[u64; 2]> for RngKey {
    fn from([run_seed, seq]: [u64; 2]) -> Self {
        Self { run_seed, seq }
    }
}

impl From<RngKey> for [u64; 2] {
    fn from(key: RngKey) -> Self {
        [key.run_seed, key.seq]
    }
}

/// Serialises a fit that other threads may hold: its inputs alone.
pub(super) mod shared_fit {
    use std::sync::Arc;

    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use super::MixtureFit;

    pub(crate) fn serialize<S: Serializer>(fit: &Option<Arc<MixtureFit>>, to: S) -> Result<S::Ok, S::Error> {
        fit.as_deref().serialize(to)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(
        from: D,
    ) -> Result<Option<Arc<MixtureFit>>, D::Error> {
        Ok(Option::<MixtureFit>::deserialize(from)?.map(Arc::new))
    }
}
