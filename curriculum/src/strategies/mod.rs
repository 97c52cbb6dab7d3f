//! Strategies, one file or folder each, and the factory that builds them by kind.
//!
//! Each strategy implements `core::strategy::Strategy`. A folder keeps the decisions in `mod.rs` and the text for
//! status and explanation in `explain.rs`. The hyperparameters of all strategies are declared in
//! `core/settings/hyperparameters`, because settings are checked against them.
//!
//! - `samplers`: react to every group: staircase, controller, bandit, and `auto`, which chooses one of them.
//! - `ladder`: moves up and down a task's level table on evidence; the default.
//! - `uniform`, `fixed`: the baselines.
//! - `adr`: automatic domain randomisation, a moving bound for each param.
//! - `alp_gmm`: params sampled where success has been changing.
//! - `learnability`: scenarios that succeed sometimes.
//! - `replay`: prioritized level replay (plr, plr_robust, accel) over a buffer of scenarios.

mod adr;
mod alp_gmm;
mod fixed;
mod ladder;
mod learnability;
mod replay;
mod samplers;
#[cfg(test)]
mod tests;
mod uniform;

use serde_json::Value;

use self::adr::Adr;
use self::alp_gmm::AlpGmm;
use self::fixed::Fixed;
use self::ladder::Ladder;
use self::learnability::Learnability;
use self::replay::Replay;
use self::samplers::{Auto, Bandit, Controller, Sampled, Staircase};
use self::uniform::Uniform;
use crate::core::settings::{Settings, StrategyKind};
use crate::core::snapshot::RestoreError;
use crate::core::strategy::{Strategy, StrategyState};

/// Creates the strategy of these settings, before its first event.
pub(crate) fn create(settings: &Settings) -> Box<dyn Strategy> {
    match settings.strategy {
        StrategyKind::Auto => Box::new(Sampled::<Auto>::new(settings)),
        StrategyKind::Staircase => Box::new(Sampled::<Staircase>::new(settings)),
        StrategyKind::Controller => Box::new(Sampled::<Controller>::new(settings)),
        StrategyKind::Bandit => Box::new(Sampled::<Bandit>::new(settings)),
        StrategyKind::Ladder => Box::new(Ladder::new(settings)),
        StrategyKind::Uniform => Box::new(Uniform::new(settings)),
        StrategyKind::Fixed => Box::new(Fixed::new(settings)),
        StrategyKind::Adr => Box::new(Adr::new(settings)),
        StrategyKind::Learnability => Box::new(Learnability::new(settings)),
        StrategyKind::Plr | StrategyKind::PlrRobust | StrategyKind::Accel => Box::new(Replay::new(settings)),
        StrategyKind::AlpGmm => Box::new(AlpGmm::new(settings)),
    }
}

/// Restores the strategy of these settings from its snapshot.
///
/// # Errors
/// Returns [`RestoreError::OtherVersion`] if another version wrote the snapshot, and [`RestoreError::State`] if the
/// state cannot be parsed or does not fit the settings.
pub(crate) fn restore(
    settings: &Settings,
    version: u32,
    state: &Value,
) -> Result<Box<dyn Strategy>, RestoreError> {
    match settings.strategy {
        StrategyKind::Auto => restore_as::<Sampled<Auto>>(settings, version, state),
        StrategyKind::Staircase => restore_as::<Sampled<Staircase>>(settings, version, state),
        StrategyKind::Controller => restore_as::<Sampled<Controller>>(settings, version, state),
        StrategyKind::Bandit => restore_as::<Sampled<Bandit>>(settings, version, state),
        StrategyKind::Ladder => restore_as::<Ladder>(settings, version, state),
        StrategyKind::Uniform => restore_as::<Uniform>(settings, version, state),
        StrategyKind::Fixed => restore_as::<Fixed>(settings, version, state),
        StrategyKind::Adr => restore_as::<Adr>(settings, version, state),
        StrategyKind::Learnability => restore_as::<Learnability>(settings, version, state),
        StrategyKind::Plr | StrategyKind::PlrRobust | StrategyKind::Accel => {
            restore_as::<Replay>(settings, version, state)
        }
        StrategyKind::AlpGmm => restore_as::<AlpGmm>(settings, version, state),
    }
}

fn restore_as<S: StrategyState>(
    settings: &Settings,
    version: u32,
    state: &Value,
) -> Result<Box<dyn Strategy>, RestoreError> {
    let strategy = settings.strategy;
    if version != S::VERSION {
        return Err(RestoreError::OtherVersion { strategy, found: version, wanted: S::VERSION });
    }
    let restored =
        S::deserialize(state).map_err(|error| error.to_string()).and_then(|state| state.resume(settings));
    match restored {
        Ok(restored) => Ok(Box::new(restored)),
        Err(reason) => Err(RestoreError::State { strategy, reason }),
    }
}
