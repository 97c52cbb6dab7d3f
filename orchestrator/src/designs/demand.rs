//! When a designer is asked: the stock runs low, or the agent fails at something else than before.

use crate::designs::DesignerKind;
use crate::clock::Millis;

/// Criticised episodes below which nothing is designed.
pub const EPISODES: i64 = 32;
/// What failures must weigh together for anything to be designed.
pub const FAILURES: f64 = 8.0;
/// How far a profile must have moved to be designed for anew.
pub const MOVED: f64 = 0.2;
/// Criticised episodes after which it may have.
pub const MOVED_AFTER: i64 = 256;
/// Most layouts of one ask.
pub const MOST: u32 = 32;
/// Active layouts near the level, in stocks, above which a moved profile alone asks for no more.
const FULL: u32 = 4;
/// Shortest time between two asks of one run and task.
const PAUSE_MS: [(DesignerKind, Millis); 2] = [(DesignerKind::Llm, 60_000), (DesignerKind::Procedural, 5_000)];
/// How often that doubles while nothing comes of it.
const DOUBLINGS: u32 = 7;

/// How the last ask of a run's task went.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LastDesignRequest {
    /// When it was made.
    pub at: Millis,
    /// Criticised episodes that it rested on.
    pub criticised: i64,
    /// How far the profile has moved since.
    pub distance: f64,
    /// How many in a row, the last among them, brought no layout.
    pub barren: u32,
}

/// What the decision rests on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StockView {
    /// Who would be asked.
    pub which: DesignerKind,
    /// Whether the task's placement is over.
    pub placed: bool,
    /// Episodes criticised.
    pub criticised: i64,
    /// What failures weigh.
    pub failures: f64,
    /// Active layouts near the current level.
    pub held: u32,
    /// How many there should be.
    pub stock: u32,
    /// The last ask, if there was one.
    pub last: Option<LastDesignRequest>,
    /// Now.
    pub now: Millis,
}

/// How long after an ask the next may come, where so many in a row brought nothing.
#[must_use]
pub fn pause_ms(which: DesignerKind, barren: u32) -> Millis {
    let base = PAUSE_MS.iter().find(|(of, _)| *of == which).map_or(60_000, |(_, pause)| *pause);
    base << barren.min(DOUBLINGS)
}

/// How many layouts to ask for now, if any.
#[must_use]
pub fn wanted(view: &StockView) -> Option<u32> {
    if !view.placed || view.criticised < EPISODES || view.failures < FAILURES {
        return None;
    }
    let early = |last: LastDesignRequest| view.now < last.at.saturating_add(pause_ms(view.which, last.barren));
    if view.last.is_some_and(early) {
        return None;
    }
    let missing = view.stock.saturating_sub(view.held);
    let moved = |last: LastDesignRequest| {
        last.distance >= MOVED
            && view.criticised - last.criticised >= MOVED_AFTER
            && view.held < view.stock.saturating_mul(FULL)
    };
    let anew = if view.last.is_some_and(moved) { view.stock } else { 0 };
    Some(missing.max(anew).min(MOST)).filter(|wanted| *wanted > 0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const VIEW: StockView = StockView {
        which: DesignerKind::Procedural,
        placed: true,
        criticised: 1000,
        failures: 50.0,
        held: 8,
        stock: 8,
        last: None,
        now: 1_000_000,
    };

    fn last(distance: f64, criticised: i64) -> Option<LastDesignRequest> {
        Some(LastDesignRequest { at: 0, criticised, distance, barren: 0 })
    }

    #[test]
    fn asked_for_what_is_missing_or_when_the_profile_moved() {
        assert_eq!(wanted(&VIEW), None);
        assert_eq!(wanted(&StockView { held: 3, ..VIEW }), Some(5));
        assert_eq!(wanted(&StockView { held: 0, stock: 64, ..VIEW }), Some(MOST));
        assert_eq!(wanted(&StockView { last: last(0.2, 744), ..VIEW }), Some(8));
        assert_eq!(wanted(&StockView { last: last(0.2, 745), ..VIEW }), None);
        assert_eq!(wanted(&StockView { last: last(0.19, 0), ..VIEW }), None);
        assert_eq!(wanted(&StockView { last: last(1.0, 0), held: 32, ..VIEW }), None);
    }

    #[test]
    fn the_pause_doubles_while_nothing_comes_of_it() {
        assert_eq!(pause_ms(DesignerKind::Procedural, 0), 5_000);
        assert_eq!(pause_ms(DesignerKind::Procedural, 3), 40_000);
        assert_eq!(pause_ms(DesignerKind::Procedural, 99), 640_000);
        assert_eq!(pause_ms(DesignerKind::Llm, 0), 60_000);
    }

    proptest! {
        /// Nothing is asked without evidence, during placement, or too soon; never more than what is missing or a stock.
        #[test]
        fn laws(
            (placed, llm) in any::<(bool, bool)>(), criticised in 0i64..600, failures in 0.0f64..20.0, held in 0u32..40,
            stock in 1u32..=64, asked in any::<bool>(),
            (at, before, distance, barren) in (0i64..2_000_000, 0i64..600, 0.0f64..1.0, 0u32..10),
        ) {
            let which = if llm { DesignerKind::Llm } else { DesignerKind::Procedural };
            let last = asked.then_some(LastDesignRequest { at, criticised: before, distance, barren });
            let view = StockView { which, placed, criticised, failures, held, stock, last, now: 1_000_000 };
            if let Some(wanted) = wanted(&view) {
                prop_assert!(placed && criticised >= EPISODES && failures >= FAILURES);
                prop_assert!(last.is_none_or(|last| view.now - last.at >= pause_ms(which, barren)));
                prop_assert!((1..=MOST).contains(&wanted));
                prop_assert!(wanted <= stock);
                prop_assert!(held < stock || distance >= MOVED);
            } else if placed && criticised >= EPISODES && failures >= FAILURES && held < stock {
                prop_assert!(last.is_some_and(|last| view.now - last.at < pause_ms(which, barren)));
            }
        }
    }
}
