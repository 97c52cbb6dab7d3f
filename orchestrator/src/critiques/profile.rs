//! What a critique adds to the failure profile of its run's task: counts, and the same counts fading.
//!
//! Time is counted in criticised episodes of the task: a failure weighs 1 when it is entered and half of that
//! [`HALF_LIFE`] criticised episodes later. Each sum is stored with the episode as of which it stands, so that nothing has
//! to be swept: its value now follows from the two.

use env_core::critique::{Critique, SpeedBands, Verdict, bearing_sector};

use crate::clock::Millis;
use crate::store::critiques::{CritiqueCounters, DecayingSum};
use crate::store::failures::{CellCounters, CellKey, EncounterBin};
use crate::store::failure_sectors::InertialSectorRow;

/// Criticised episodes of a task after which a failure weighs half.
pub const HALF_LIFE: f64 = 2000.0;

/// The verdicts in the order in which they are summed.
pub const VERDICTS: [Verdict; 4] = [Verdict::Needed, Verdict::Harmless, Verdict::Wasteful, Verdict::Harmful];

/// A weight, some criticised episodes later.
#[must_use]
pub fn fade(weight: f64, episodes: i64) -> f64 {
    weight * libm::exp2(-(episodes.max(0) as f64) / HALF_LIFE)
}

/// What criticised episodes weigh together, the last of them 1: the geometric sum Σ 2^(−i/H), i from 0 to n − 1.
#[must_use]
pub fn weight_of(criticised: i64) -> f64 {
    let faded = |episodes: f64| -libm::expm1(-episodes * std::f64::consts::LN_2 / HALF_LIFE);
    faded(criticised.max(0) as f64) / faded(1.0)
}

/// What one critique adds.
#[derive(Debug, Clone, PartialEq)]
pub struct EpisodeFindings {
    /// The episode's index in its lease.
    pub number: i64,
    /// The layout it was flown on, where its group was designed.
    pub layout: Option<i64>,
    /// The judge's value.
    pub judged: f64,
    /// Actions by verdict.
    pub verdicts: [i64; 4],
    /// Why score was lost.
    pub failures: Vec<FailureFinding>,
}

/// One failure, put in its cell.
#[derive(Debug, Clone, PartialEq)]
pub struct FailureFinding {
    /// The cell.
    pub key: CellKey,
    /// Whose.
    pub agent: u32,
    /// When, from 1.
    pub step: u32,
    /// What was met, if anything.
    pub met: Option<EncounterFinding>,
    /// The inertial sector it came from, in a world with such a frame.
    pub inertial: Option<u32>,
}

/// What of a meeting is kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EncounterFinding {
    /// From where, degrees.
    pub bearing_deg: f64,
    /// How fast, in the world's unit.
    pub relative_speed: f64,
    /// Steps that were left to act.
    pub steps_left: u32,
    /// Whether acting then would have helped; none if it was never seen.
    pub avoidable: Option<bool>,
}

impl EpisodeFindings {
    /// What is kept of a critique; an error where its judge gives no number.
    pub(crate) fn of(number: i64, critique: &Critique, bands: SpeedBands) -> Result<Self, String> {
        if !critique.judged.value.is_finite() {
            return Err(format!("its judge says {}", critique.judged.value));
        }
        let mut verdicts = [0; 4];
        for action in &critique.actions {
            verdicts[place(action.verdict)] += 1;
        }
        let failures = critique.failures.iter().map(|failure| {
            let met = failure.encounter.as_ref().map(|e| EncounterFinding {
                bearing_deg: e.bearing_deg,
                relative_speed: e.relative_speed,
                steps_left: e.steps_left,
                avoidable: e.avoidable,
            });
            let encounter = met.map(|m| EncounterBin {
                sector: bearing_sector(m.bearing_deg),
                band: bands.band(m.relative_speed),
            });
            let key = CellKey { mode: failure.mode.to_owned(), encounter };
            let inertial = failure.encounter.as_ref().and_then(|e| e.bearing_inertial_deg).map(bearing_sector);
            FailureFinding { key, agent: failure.agent, step: failure.step, met, inertial }
        });
        Ok(Self {
            number,
            layout: None,
            judged: critique.judged.value,
            verdicts,
            failures: failures.collect(),
        })
    }
}

const fn place(verdict: Verdict) -> usize {
    match verdict {
        Verdict::Needed => 0,
        Verdict::Harmless => 1,
        Verdict::Wasteful => 2,
        Verdict::Harmful => 3,
    }
}

/// Enters an episode into the sums of its task.
pub(crate) fn enter(sums: &mut CritiqueCounters, note: &EpisodeFindings) {
    sums.criticised += 1;
    let DecayingSum { all, now } = &mut sums.judged;
    *all += note.judged;
    *now = fade(*now, 1) + note.judged;
    for (DecayingSum { all, now }, n) in sums.verdicts.iter_mut().zip(note.verdicts) {
        *all += n;
        *now = fade(*now, 1) + n as f64;
    }
}

/// Enters a failure of the task's `place`-th criticised episode into its cell.
pub(crate) fn enter_failure(cell: &mut CellCounters, place: i64, at: Millis, failing: &FailureFinding) {
    cell.count += 1;
    cell.weight = fade(cell.weight, place - cell.as_of) + 1.0;
    cell.as_of = place;
    cell.last_at = at;
    if let Some(met) = failing.met {
        cell.avoidable += i64::from(met.avoidable == Some(true));
        cell.unavoidable += i64::from(met.avoidable == Some(false));
        cell.steps_left += i64::from(met.steps_left);
    }
}

/// Enters a failure of the task's `place`-th criticised episode by the inertial sector it came from.
pub(crate) fn enter_sector(row: &mut InertialSectorRow, place: i64) {
    row.count += 1;
    row.weight = fade(row.weight, place - row.as_of) + 1.0;
    row.as_of = place;
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn failing(mode: &str) -> FailureFinding {
        let met = EncounterFinding { bearing_deg: 90.0, relative_speed: 2.0, steps_left: 7, avoidable: Some(true) };
        FailureFinding {
            key: CellKey { mode: mode.to_owned(), encounter: Some(EncounterBin { sector: 3, band: 1 }) },
            agent: 0,
            step: 9,
            met: Some(met),
            inertial: Some(3),
        }
    }

    #[test]
    fn a_weight_halves_every_half_life() {
        assert_eq!(fade(8.0, 0), 8.0);
        assert_eq!(fade(8.0, 2000), 4.0);
        assert_eq!(fade(8.0, 6000), 1.0);
        assert_eq!(fade(8.0, -5), 8.0, "nothing grows by itself");
    }

    #[test]
    fn the_weight_of_all_episodes_is_the_geometric_sum() {
        for n in [0, 1, 2, 999, 20_000] {
            let sum: f64 = (0..n).map(|i| fade(1.0, i)).sum();
            // 20 000 additions, each off by at most half a unit in the last place of 3 000.
            assert!((weight_of(n) - sum).abs() < 1e-8, "{n}: {} is not {sum}", weight_of(n));
        }
        // In the long run: 1/(1 − 2^(−1/H)) ≈ H/ln 2 + 1/2.
        assert!((weight_of(10_000_000) - (HALF_LIFE / std::f64::consts::LN_2 + 0.5)).abs() < 1e-4);
    }

    #[test]
    fn what_happens_in_every_episode_weighs_as_much_as_all_episodes() {
        let (mut sums, mut cell) = (CritiqueCounters::default(), CellCounters::default());
        for _ in 0..5000 {
            enter(
                &mut sums,
                &EpisodeFindings { number: 0, layout: None, judged: 1.0, verdicts: [1, 0, 2, 0], failures: Vec::new() },
            );
            enter_failure(&mut cell, sums.criticised, 5, &failing("collision"));
        }
        let all = weight_of(5000);
        // 5 000 multiplications and additions, each off by at most half a unit in the last place of 3 000.
        for now in [sums.judged.now, sums.verdicts[0].now, sums.verdicts[2].now / 2.0, cell.weight] {
            assert!((now - all).abs() < 1e-8, "{now} is not {all}");
        }
        assert_eq!((cell.count, cell.avoidable, cell.steps_left), (5000, 5000, 35_000));
        assert_eq!((sums.judged.all, sums.verdicts[2].all), (5000.0, 10_000));
    }

    proptest! {
        /// Which episodes failed fixes the weight, however many failures came between two looks.
        #[test]
        fn a_weight_is_the_sum_over_its_failures(failed in proptest::collection::btree_set(1i64..9000, 0..60)) {
            let mut cell = CellCounters::default();
            for &place in &failed {
                enter_failure(&mut cell, place, 0, &failing("decay"));
            }
            let now = 9000;
            let closed: f64 = failed.iter().map(|place| fade(1.0, now - place)).sum();
            prop_assert!((fade(cell.weight, now - cell.as_of) - closed).abs() < 1e-11);
            prop_assert_eq!(cell.count, failed.len() as i64);
        }
    }
}
