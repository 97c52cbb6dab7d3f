//! What came of runs over time, task by task: buckets of a minute for a week, of an hour for ever.

mod read;
mod write;

use std::collections::BTreeMap;

use crate::clock::Millis;

pub use self::read::{Point, Window, curve};
pub use self::write::{add, forget_minutes};

/// A minute.
pub const MINUTE: Millis = 60_000;
/// An hour.
pub const HOUR: Millis = 60 * MINUTE;
/// How long minutes are kept.
pub const MINUTES_KEPT: Millis = 7 * 24 * HOUR;

/// What came of a task in a bucket, or a part of one.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Part {
    /// Episodes that finished.
    pub episodes: i64,
    /// Of these, successes.
    pub successes: i64,
    /// Sum of their scores.
    pub score: f64,
    /// Of these, those that have a skill.
    pub skilled: i64,
    /// Sum of their skills.
    pub skill: f64,
    /// Episodes that failed.
    pub failed: i64,
    /// Episodes that never came back.
    pub expired: i64,
    /// Contested groups that were evidence.
    pub contested: i64,
    /// Sum of their success shares.
    pub solved: f64,
    /// Contested groups whose blind panel was looked at: some of all.
    pub panels: i64,
    /// Sum of the shares of blind plans that succeed there.
    pub panel: f64,
    /// Groups of several episodes that counted.
    pub groups: i64,
    /// Of these, those whose episodes all have the same score.
    pub flat: i64,
    /// Episodes of accepted claims.
    pub claimed: i64,
    /// The lowest level.
    pub low: Option<i64>,
    /// The highest.
    pub high: Option<i64>,
    /// Where the task stood when it was last looked.
    pub standing: Option<Standing>,
    /// The params of the scenarios that came back.
    pub params: BTreeMap<String, Spread>,
}

/// Where a task stood.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Standing {
    /// Its level; none where there are none.
    pub level: Option<i64>,
    /// The posterior over success on contested scenarios of that level: its mean.
    pub mean: f64,
    /// Its 10 % quantile.
    pub q10: f64,
    /// Its 90 % quantile.
    pub q90: f64,
}

/// The values a param had.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// How many.
    pub n: i64,
    /// Their sum.
    pub total: f64,
    /// The least.
    pub low: f64,
    /// The most.
    pub high: f64,
}

impl Spread {
    /// Of one value.
    #[must_use]
    pub const fn of(value: f64) -> Self {
        Self { n: 1, total: value, low: value, high: value }
    }

    /// Takes others, too.
    pub const fn join(&mut self, other: &Self) {
        self.n += other.n;
        self.total += other.total;
        self.low = self.low.min(other.low);
        self.high = self.high.max(other.high);
    }
}

impl Part {
    /// Takes what came after it, too.
    pub fn join(&mut self, other: &Self) {
        self.episodes += other.episodes;
        self.successes += other.successes;
        self.score += other.score;
        self.skilled += other.skilled;
        self.skill += other.skill;
        self.failed += other.failed;
        self.expired += other.expired;
        self.contested += other.contested;
        self.solved += other.solved;
        self.panels += other.panels;
        self.panel += other.panel;
        self.groups += other.groups;
        self.flat += other.flat;
        self.claimed += other.claimed;
        self.low = self.low.into_iter().chain(other.low).min();
        self.high = self.high.max(other.high);
        self.standing = other.standing.or(self.standing);
        for (name, spread) in &other.params {
            self.params.entry(name.clone()).and_modify(|known| known.join(spread)).or_insert(*spread);
        }
    }

    /// Notes the params of a scenario that came back.
    pub fn note(&mut self, params: &[(String, f64)]) {
        for (name, value) in params {
            let spread = Spread::of(*value);
            self.params.entry(name.clone()).and_modify(|known| known.join(&spread)).or_insert(spread);
        }
    }

    /// Notes a level.
    pub fn at_level(&mut self, level: Option<i64>) {
        self.low = self.low.into_iter().chain(level).min();
        self.high = self.high.max(level);
    }
}
