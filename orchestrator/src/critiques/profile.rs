//! Findings of critiques, and how they enter the failure profile of a task: as counts, and as weights that decay.
//!
//! Time is counted in criticised episodes of the task: a failure weighs 1 when it is added, and half of that [`HALF_LIFE`] criticised
//! episodes later. Each weight is stored with the episode of its last update, so that its current value follows from the two and no
//! row has to be updated only because time passes.

use store::critiques::{CritiqueCounters, DecayingSum};
use store::failure_sectors::InertialSectorRow;
use store::failures::{CellCounters, CellKey};

use clock::Millis;
use jobs::critique::{CritiqueFailure, CritiqueFindings, EncounterFinding};

/// Criticised episodes of a task after which a failure weighs half.
pub const HALF_LIFE: f64 = 2000.0;

/// Returns a weight after it decayed for some criticised episodes.
#[must_use]
pub fn decay(weight: f64, episodes: i64) -> f64 {
    weight * libm::exp2(-(episodes.max(0) as f64) / HALF_LIFE)
}

/// Returns the total weight of `criticised` episodes, the last of which weighs 1: the geometric sum Σ 2^(−i/H), i from 0 to n − 1.
#[must_use]
pub fn total_weight(criticised: i64) -> f64 {
    let faded = |episodes: f64| -libm::expm1(-episodes * std::f64::consts::LN_2 / HALF_LIFE);
    faded(criticised.max(0) as f64) / faded(1.0)
}

/// Findings of one critique.
#[derive(Debug, Clone, PartialEq)]
pub struct EpisodeFindings {
    /// Index of the episode in its lease.
    pub number: i64,
    /// Number of the layout, if the group was designed.
    pub layout: Option<i64>,
    /// Value that the deterministic judge gives the episode.
    pub judged: f64,
    /// Number of actions by verdict, in the order of [`jobs::critique::VERDICTS`].
    pub verdicts: [i64; 4],
    /// Failures: the reasons why score was lost.
    pub failures: Vec<FailureFinding>,
}

/// A failure and the cell of the profile it belongs to.
#[derive(Debug, Clone, PartialEq)]
pub struct FailureFinding {
    /// Key of the cell.
    pub key: CellKey,
    /// Index of the agent that failed.
    pub agent: u32,
    /// Step of the failure, from 1.
    pub step: u32,
    /// Angle whose sector the key has, in degrees.
    pub sector_deg: Option<f64>,
    /// The encounter behind the failure, if there was one.
    pub encounter: Option<EncounterFinding>,
    /// Inertial sector of the encounter, in a world with an inertial frame.
    pub inertial: Option<u32>,
}

impl EpisodeFindings {
    /// Builds the findings of an episode of a lease.
    #[must_use]
    pub fn new(number: i64, layout: Option<i64>, findings: CritiqueFindings) -> Self {
        let CritiqueFindings { judged, verdicts, failures } = findings;
        Self { number, layout, judged, verdicts, failures: failures.into_iter().map(Into::into).collect() }
    }
}

impl From<CritiqueFailure> for FailureFinding {
    fn from(failure: CritiqueFailure) -> Self {
        let CritiqueFailure { mode, sector, band, agent, step, sector_deg, encounter, inertial } = failure;
        let key = CellKey { mode, sector, band };
        Self { key, agent, step, sector_deg, encounter, inertial }
    }
}

/// Adds the findings of an episode to the counters of its task.
pub(crate) fn add_findings(sums: &mut CritiqueCounters, findings: &EpisodeFindings) {
    sums.criticised += 1;
    let DecayingSum { overall, recent } = &mut sums.judgement;
    *overall += findings.judged;
    *recent = decay(*recent, 1) + findings.judged;
    for (DecayingSum { overall, recent }, n) in sums.verdicts.iter_mut().zip(findings.verdicts) {
        *overall += n;
        *recent = decay(*recent, 1) + n as f64;
    }
}

/// Adds a failure of the task's `nth` criticised episode to its cell.
pub(crate) fn add_failure(cell: &mut CellCounters, nth: i64, at: Millis, failure: &FailureFinding) {
    cell.count += 1;
    cell.weight = decay(cell.weight, nth - cell.as_of) + 1.0;
    cell.as_of = nth;
    cell.last_at = at;
    if let Some(encounter) = failure.encounter {
        cell.avoidable += i64::from(encounter.avoidable == Some(true));
        cell.unavoidable += i64::from(encounter.avoidable == Some(false));
        cell.steps_left += i64::from(encounter.steps_left);
    }
}

/// Adds a failure of the task's `nth` criticised episode to the inertial sector of its encounter.
pub(crate) fn add_sector(row: &mut InertialSectorRow, nth: i64) {
    row.count += 1;
    row.weight = decay(row.weight, nth - row.as_of) + 1.0;
    row.as_of = nth;
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn failure(mode: &str) -> FailureFinding {
        let encounter = EncounterFinding { relative_speed: 2.0, steps_left: 7, avoidable: Some(true) };
        FailureFinding {
            key: CellKey { mode: mode.to_owned(), sector: Some(3), band: Some(1) },
            agent: 0,
            step: 9,
            sector_deg: Some(90.0),
            encounter: Some(encounter),
            inertial: Some(3),
        }
    }

    #[test]
    fn weight_halves_every_half_life() {
        assert_eq!(decay(8.0, 0), 8.0);
        assert_eq!(decay(8.0, 2000), 4.0);
        assert_eq!(decay(8.0, 6000), 1.0);
        assert_eq!(decay(8.0, -5), 8.0, "a weight never grows by itself");
    }

    #[test]
    fn total_weight_is_the_geometric_sum() {
        for n in [0, 1, 2, 999, 20_000] {
            let sum: f64 = (0..n).map(|i| decay(1.0, i)).sum();
            // 20 000 additions, each off by at most half a unit in the last place of 3 000.
            assert!((total_weight(n) - sum).abs() < 1e-8, "{n}: {} is not {sum}", total_weight(n));
        }
        // In the long run: 1/(1 − 2^(−1/H)) ≈ H/ln 2 + 1/2.
        assert!((total_weight(10_000_000) - (HALF_LIFE / std::f64::consts::LN_2 + 0.5)).abs() < 1e-4);
    }

    #[test]
    fn failure_in_every_episode_has_the_total_weight() {
        let (mut sums, mut cell) = (CritiqueCounters::default(), CellCounters::default());
        for _ in 0..5000 {
            add_findings(
                &mut sums,
                &EpisodeFindings {
                    number: 0,
                    layout: None,
                    judged: 1.0,
                    verdicts: [1, 0, 2, 0],
                    failures: Vec::new(),
                },
            );
            add_failure(&mut cell, sums.criticised, 5, &failure("collision"));
        }
        let all = total_weight(5000);
        // 5 000 multiplications and additions, each off by at most half a unit in the last place of 3 000.
        for now in
            [sums.judgement.recent, sums.verdicts[0].recent, sums.verdicts[2].recent / 2.0, cell.weight]
        {
            assert!((now - all).abs() < 1e-8, "{now} is not {all}");
        }
        assert_eq!((cell.count, cell.avoidable, cell.steps_left), (5000, 5000, 35_000));
        assert_eq!((sums.judgement.overall, sums.verdicts[2].overall), (5000.0, 10_000));
    }

    proptest! {
        /// The weight depends on the failed episodes alone, not on when it was updated.
        #[test]
        fn cell_weight_is_the_sum_over_its_failures(failed in proptest::collection::btree_set(1i64..9000, 0..60)) {
            let mut cell = CellCounters::default();
            for &nth in &failed {
                add_failure(&mut cell, nth, 0, &failure("decay"));
            }
            let now = 9000;
            let closed: f64 = failed.iter().map(|nth| decay(1.0, now - nth)).sum();
            prop_assert!((decay(cell.weight, now - cell.as_of) - closed).abs() < 1e-11);
            prop_assert_eq!(cell.count, failed.len() as i64);
        }
    }
}
