//! Decides when a designer is asked: when the reserve of layouts runs low, or when the failure profile has changed.

use crate::designs::DesignerKind;
use clock::Millis;

/// Number of criticised episodes below which nothing is designed.
pub const MIN_CRITICISED: i64 = 32;
/// Total weight of failures below which nothing is designed.
pub const MIN_FAILURE_WEIGHT: f64 = 8.0;
/// Distance of the profile from that of the last request, from which a full reserve is designed again.
pub const MIN_PROFILE_DISTANCE: f64 = 0.2;
/// Number of episodes criticised since then, below which a changed profile does not count.
pub const MIN_NEW_CRITICISED: i64 = 256;
/// Maximum number of layouts in one request.
pub const MAX_LAYOUTS_PER_REQUEST: u32 = 32;
/// Active layouts near the level, as a multiple of the reserve, from which a changed profile requests no more.
const MAX_RESERVE_FACTOR: u32 = 4;
/// Minimum time between two requests to the language model for one task, in milliseconds.
const LLM_PAUSE_MS: Millis = 60_000;
/// Minimum time between two requests to the procedural designer for one task, in milliseconds.
const PROCEDURAL_PAUSE_MS: Millis = 5_000;
/// Maximum number of doublings of the pause while requests bring no layout.
const MAX_DOUBLINGS: u32 = 7;

/// Result of the last request for a run's task.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LastDesignRequest {
    /// When the request finished.
    pub at: Millis,
    /// Number of episodes criticised at that time.
    pub criticised: i64,
    /// Distance between the profile of that time and the current one.
    pub distance: f64,
    /// Number of consecutive requests up to this one that brought no layout.
    pub empty_streak: u32,
}

/// Inputs of the decision to design for a task.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DesignDemand {
    /// Designer that would be asked.
    pub designer: DesignerKind,
    /// True if the placement of the task is over.
    pub is_placed: bool,
    /// Number of criticised episodes.
    pub criticised: i64,
    /// Total weight of the failures.
    pub failure_weight: f64,
    /// Number of active layouts near the current level.
    pub active: u32,
    /// Number of active layouts that there should be.
    pub reserve: u32,
    /// The last request, if there was one.
    pub last: Option<LastDesignRequest>,
    /// Current time, in milliseconds since the epoch.
    pub now: Millis,
}

/// Returns the minimum time between two requests, in milliseconds, after a streak of requests without a layout.
#[must_use]
pub fn pause_ms(designer: DesignerKind, empty_streak: u32) -> Millis {
    let base = match designer {
        DesignerKind::Llm => LLM_PAUSE_MS,
        DesignerKind::Procedural => PROCEDURAL_PAUSE_MS,
    };
    base << empty_streak.min(MAX_DOUBLINGS)
}

/// Returns the number of layouts to request now; `None` if none are requested.
#[must_use]
pub fn layouts_wanted(demand: &DesignDemand) -> Option<u32> {
    if !demand.is_placed || demand.criticised < MIN_CRITICISED || demand.failure_weight < MIN_FAILURE_WEIGHT {
        return None;
    }
    let is_too_early = |last: LastDesignRequest| {
        demand.now < last.at.saturating_add(pause_ms(demand.designer, last.empty_streak))
    };
    if demand.last.is_some_and(is_too_early) {
        return None;
    }
    let missing = demand.reserve.saturating_sub(demand.active);
    let has_changed = |last: LastDesignRequest| {
        last.distance >= MIN_PROFILE_DISTANCE
            && demand.criticised - last.criticised >= MIN_NEW_CRITICISED
            && demand.active < demand.reserve.saturating_mul(MAX_RESERVE_FACTOR)
    };
    let replacements = if demand.last.is_some_and(has_changed) { demand.reserve } else { 0 };
    Some(missing.max(replacements).min(MAX_LAYOUTS_PER_REQUEST)).filter(|wanted| *wanted > 0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const DEMAND: DesignDemand = DesignDemand {
        designer: DesignerKind::Procedural,
        is_placed: true,
        criticised: 1000,
        failure_weight: 50.0,
        active: 8,
        reserve: 8,
        last: None,
        now: 1_000_000,
    };

    fn last(distance: f64, criticised: i64) -> Option<LastDesignRequest> {
        Some(LastDesignRequest { at: 0, criticised, distance, empty_streak: 0 })
    }

    #[test]
    fn missing_layouts_or_a_changed_profile_are_requested() {
        assert_eq!(layouts_wanted(&DEMAND), None);
        assert_eq!(layouts_wanted(&DesignDemand { active: 3, ..DEMAND }), Some(5));
        assert_eq!(
            layouts_wanted(&DesignDemand { active: 0, reserve: 64, ..DEMAND }),
            Some(MAX_LAYOUTS_PER_REQUEST)
        );
        assert_eq!(layouts_wanted(&DesignDemand { last: last(0.2, 744), ..DEMAND }), Some(8));
        assert_eq!(layouts_wanted(&DesignDemand { last: last(0.2, 745), ..DEMAND }), None);
        assert_eq!(layouts_wanted(&DesignDemand { last: last(0.19, 0), ..DEMAND }), None);
        assert_eq!(layouts_wanted(&DesignDemand { last: last(1.0, 0), active: 32, ..DEMAND }), None);
    }

    #[test]
    fn pause_doubles_while_requests_bring_no_layout() {
        assert_eq!(pause_ms(DesignerKind::Procedural, 0), 5_000);
        assert_eq!(pause_ms(DesignerKind::Procedural, 3), 40_000);
        assert_eq!(pause_ms(DesignerKind::Procedural, 99), 640_000);
        assert_eq!(pause_ms(DesignerKind::Llm, 0), 60_000);
    }

    proptest! {
        /// Nothing is requested without evidence, during placement, or too early; never more than what is missing or the reserve.
        #[test]
        fn requests_need_evidence_and_time(
            (is_placed, has_llm) in any::<(bool, bool)>(), criticised in 0i64..600, failure_weight in 0.0f64..20.0, active in 0u32..40,
            reserve in 1u32..=64, has_last in any::<bool>(),
            (at, before, distance, empty_streak) in (0i64..2_000_000, 0i64..600, 0.0f64..1.0, 0u32..10),
        ) {
            let designer = if has_llm { DesignerKind::Llm } else { DesignerKind::Procedural };
            let last = has_last.then_some(LastDesignRequest { at, criticised: before, distance, empty_streak });
            let demand = DesignDemand { designer, is_placed, criticised, failure_weight, active, reserve, last, now: 1_000_000 };
            if let Some(wanted) = layouts_wanted(&demand) {
                prop_assert!(is_placed && criticised >= MIN_CRITICISED && failure_weight >= MIN_FAILURE_WEIGHT);
                prop_assert!(last.is_none_or(|last| demand.now - last.at >= pause_ms(designer, empty_streak)));
                prop_assert!((1..=MAX_LAYOUTS_PER_REQUEST).contains(&wanted));
                prop_assert!(wanted <= reserve);
                prop_assert!(active < reserve || distance >= MIN_PROFILE_DISTANCE);
            } else if is_placed && criticised >= MIN_CRITICISED && failure_weight >= MIN_FAILURE_WEIGHT && active < reserve {
                prop_assert!(last.is_some_and(|last| demand.now - last.at < pause_ms(designer, empty_streak)));
            }
        }
    }
}
