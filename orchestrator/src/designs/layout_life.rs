//! When a layout retires, and when it comes back: decided from its last outcomes alone.

use crate::store::layouts::{LayoutState, RetirementReason};

/// Outcomes that are remembered.
pub const WINDOW: usize = 16;
/// Outcomes from which on a layout can be mastered.
pub const MASTERED_FROM: usize = 8;
/// Their mean at which it is.
pub const MASTERED: f64 = 0.9;
/// Outcomes in a row without any success after which it is hopeless.
pub const HOPELESS_FROM: u32 = 24;
/// An outcome of a mastered layout below this says that the agent has forgotten.
pub const FORGOTTEN: f64 = 0.5;

/// Whether a layout serves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LayoutStatus {
    /// It serves.
    Active,
    /// The agent has mastered it; it is served now and then to see whether that is still so.
    Mastered,
    /// The agent never succeeds on it; it is served now and then to see whether it has learnt.
    Hopeless,
    /// Somebody took it out: it is never served.
    Hand,
}

impl LayoutStatus {
    /// From (state, why) as they are stored; none for what was refused.
    #[must_use]
    pub const fn of(state: LayoutState, why: Option<RetirementReason>) -> Option<Self> {
        match (state, why) {
            (LayoutState::Refused, _) => None,
            (LayoutState::Active, _) => Some(Self::Active),
            (LayoutState::Retired, Some(RetirementReason::Mastered)) => Some(Self::Mastered),
            (LayoutState::Retired, Some(RetirementReason::Hopeless)) => Some(Self::Hopeless),
            (LayoutState::Retired, Some(RetirementReason::Hand) | None) => Some(Self::Hand),
        }
    }

    /// (state, why) as they are stored.
    #[must_use]
    pub const fn words(self) -> (LayoutState, Option<RetirementReason>) {
        match self {
            Self::Active => (LayoutState::Active, None),
            Self::Mastered => (LayoutState::Retired, Some(RetirementReason::Mastered)),
            Self::Hopeless => (LayoutState::Retired, Some(RetirementReason::Hopeless)),
            Self::Hand => (LayoutState::Retired, Some(RetirementReason::Hand)),
        }
    }
}

/// A layout's life so far.
#[derive(Debug, Clone, PartialEq)]
pub struct LayoutLife {
    /// Whether it serves.
    pub standing: LayoutStatus,
    /// Its last outcomes, the oldest first: shares of success.
    pub recent: Vec<f64>,
    /// Outcomes in a row without any success.
    pub barren: u32,
}

impl LayoutLife {
    /// One that begins.
    #[must_use]
    pub const fn new() -> Self {
        Self { standing: LayoutStatus::Active, recent: Vec::new(), barren: 0 }
    }

    /// Takes an outcome, a share of success; the sentence where it changes the standing.
    pub fn take(&mut self, value: f64) -> Option<String> {
        let value = if value.is_finite() { value.clamp(0.0, 1.0) } else { 0.0 };
        let (standing, sentence) = match self.standing {
            LayoutStatus::Mastered if value < FORGOTTEN => {
                let sentence = format!("it was mastered, and {value:.2} of a group succeeded: forgotten");
                *self = Self::new();
                (LayoutStatus::Active, Some(sentence))
            }
            LayoutStatus::Hopeless if value > 0.0 => {
                let sentence = format!("it was hopeless, and {value:.2} of a group succeeded: learnt");
                *self = Self::new();
                (LayoutStatus::Active, Some(sentence))
            }
            standing => (standing, None),
        };
        self.enter(value);
        if sentence.is_some() {
            return sentence;
        }
        if standing != LayoutStatus::Active {
            return None;
        }
        let (standing, sentence) = self.end()?;
        self.standing = standing;
        Some(sentence)
    }

    /// Puts it back, with a fresh window.
    pub fn revive(&mut self) {
        *self = Self::new();
    }

    fn enter(&mut self, value: f64) {
        if self.recent.len() >= WINDOW {
            self.recent.drain(..=self.recent.len() - WINDOW);
        }
        self.recent.push(value);
        self.barren = if value > 0.0 { 0 } else { self.barren.saturating_add(1) };
    }

    /// Whether an active one is to retire.
    fn end(&self) -> Option<(LayoutStatus, String)> {
        let n = self.recent.len();
        let mean = self.recent.iter().sum::<f64>() / n.max(1) as f64;
        if n >= MASTERED_FROM && mean >= MASTERED {
            let sentence = format!("mastered: {mean:.2} of its last {n} groups succeeded");
            return Some((LayoutStatus::Mastered, sentence));
        }
        (self.barren >= HOPELESS_FROM)
            .then(|| (LayoutStatus::Hopeless, format!("hopeless: none of its last {} groups", self.barren)))
    }
}

impl Default for LayoutLife {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn flown(values: &[f64]) -> LayoutLife {
        let mut life = LayoutLife::new();
        for &value in values {
            life.take(value);
        }
        life
    }

    #[test]
    fn it_retires_when_mastered_or_hopeless_and_not_before() {
        assert_eq!(flown(&[1.0; 7]).standing, LayoutStatus::Active);
        assert_eq!(flown(&[1.0; 8]).standing, LayoutStatus::Mastered);
        assert_eq!(flown(&[0.875; 40]).standing, LayoutStatus::Active);
        assert_eq!(flown(&[0.0; 23]).standing, LayoutStatus::Active);
        assert_eq!(flown(&[0.0; 24]).standing, LayoutStatus::Hopeless);
        let mut one_success = vec![0.0; 23];
        one_success.push(0.25);
        one_success.extend([0.0; 23]);
        assert_eq!(flown(&one_success).standing, LayoutStatus::Active);
    }

    #[test]
    fn a_probe_that_contradicts_brings_it_back_with_a_fresh_window() {
        let mut mastered = flown(&[1.0; 12]);
        assert_eq!(mastered.take(0.5), None);
        assert_eq!(mastered.standing, LayoutStatus::Mastered);
        assert!(mastered.take(0.25).unwrap().contains("forgotten"));
        assert_eq!((mastered.standing, mastered.recent.as_slice()), (LayoutStatus::Active, &[0.25][..]));

        let mut hopeless = flown(&[0.0; 30]);
        assert_eq!(hopeless.take(0.0), None);
        assert!(hopeless.take(0.125).unwrap().contains("learnt"));
        assert_eq!((hopeless.standing, hopeless.barren), (LayoutStatus::Active, 0));
    }

    #[test]
    fn what_somebody_took_out_stays_out() {
        let mut life = LayoutLife { standing: LayoutStatus::Hand, ..flown(&[0.5; 4]) };
        for value in [0.0, 1.0].into_iter().cycle().take(200) {
            assert_eq!(life.take(value), None);
        }
        assert_eq!(life.standing, LayoutStatus::Hand);
    }

    #[test]
    fn standings_read_back() {
        for standing in [LayoutStatus::Active, LayoutStatus::Mastered, LayoutStatus::Hopeless, LayoutStatus::Hand] {
            let (state, why) = standing.words();
            assert_eq!(LayoutStatus::of(state, why), Some(standing));
        }
        assert_eq!(LayoutStatus::of(LayoutState::Refused, None), None);
    }

    proptest! {
        /// Whatever it is flown: the window is the last values since it began or came back, at most 16; it stands
        /// retired only with the evidence for it; and what is told is a change.
        #[test]
        fn laws(values in proptest::collection::vec((0u32..=4).prop_map(|n| f64::from(n) / 4.0), 0..120)) {
            let mut life = LayoutLife::new();
            let mut since = 0;
            for (at, &value) in values.iter().enumerate() {
                let before = life.standing;
                let told = life.take(value);
                prop_assert_eq!(told.is_some(), life.standing != before);
                if before != LayoutStatus::Active && life.standing == LayoutStatus::Active {
                    since = at;
                }
                let window = &values[since.max((at + 1).saturating_sub(WINDOW))..=at];
                prop_assert_eq!(life.recent.as_slice(), window);
                let barren = values[since..=at].iter().rev().take_while(|v| **v == 0.0).count();
                prop_assert_eq!(life.barren as usize, barren);
                match (before, life.standing) {
                    (LayoutStatus::Active, LayoutStatus::Mastered) => {
                        let mean = window.iter().sum::<f64>() / window.len() as f64;
                        prop_assert!(window.len() >= MASTERED_FROM && mean >= MASTERED);
                    }
                    (LayoutStatus::Active, LayoutStatus::Hopeless) => prop_assert!(life.barren >= HOPELESS_FROM),
                    (LayoutStatus::Mastered, LayoutStatus::Active) => prop_assert!(value < FORGOTTEN),
                    (LayoutStatus::Hopeless, LayoutStatus::Active) => prop_assert!(value > 0.0),
                    (before, after) => prop_assert_eq!(before, after),
                }
            }
        }

        /// Nonsense is no success.
        #[test]
        fn any_number_is_taken(bits in proptest::collection::vec(any::<u64>(), 0..60)) {
            let mut life = LayoutLife::new();
            for bits in bits {
                life.take(f64::from_bits(bits));
                prop_assert!(life.recent.iter().all(|v| (0.0..=1.0).contains(v)));
            }
        }
    }
}
