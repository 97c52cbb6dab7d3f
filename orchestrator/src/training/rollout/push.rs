//! Counting a group that was flown and pushing it to the feed: both, or neither.

use super::body::Packed;
use super::take::LetGo;
use crate::counts;
use crate::ids::LeaseId;
use crate::store::trajectories::{self, NewGroup};
use crate::store::{policies, signed};
use crate::training::report::Report;
use crate::training::{Change, Happening, TrainingError, Work};

/// Milliseconds of a day.
const DAY: i64 = 86_400_000;

/// What a language model took.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Took {
    /// Prompt tokens.
    pub tokens_in: u64,
    /// Completion tokens.
    pub tokens_out: u64,
    /// What they cost.
    pub cost: f64,
}

/// A group that was flown.
#[derive(Debug)]
pub struct Push {
    /// Its lease.
    pub lease: LeaseId,
    /// The policy version it was taken for.
    pub policy_version: i64,
    /// Its episodes, replayed.
    pub report: Report,
    /// What is told of it; none where too few were flown.
    pub packed: Option<Packed>,
    /// Episodes flown, and lost.
    pub episodes: (usize, usize),
    /// What went wrong, where something did.
    pub trouble: Option<String>,
    /// What it took.
    pub took: Took,
}

impl Change for Push {
    /// Its id in the feed; none where it is not there: too few episodes were flown, or its lease was over.
    type Answer = Option<i64>;
    const BULK: bool = true;

    async fn apply(self, work: &mut Work) -> Result<Option<i64>, TrainingError> {
        let Self { lease, policy_version, report, packed, episodes, trouble, took } = self;
        let run = report.run.to_string();
        let (receipts, _) = report.apply(work).await?;
        let refused = receipts.iter().find(|receipt| receipt.status == "refused");
        if let Some(receipt) = refused {
            let detail = receipt.detail.clone().unwrap_or_default();
            return Err(TrainingError::invalid("rollout", format!("{}: {detail}", receipt.episode)));
        }
        // What comes when its lease is over counts for nothing, and its scenario is offered again.
        let late = receipts.iter().any(|receipt| receipt.status == "late");
        let (flown, lost) = (count(episodes.0), count(episodes.1));
        let (now, conn) = (work.now, &mut work.conn);
        let id = match packed.filter(|_| !late) {
            None => None,
            Some(Packed { bytes, body }) => {
                let (run, bytes) = (run.as_str(), count(bytes));
                let group =
                    NewGroup { run, lease: lease.number, number: 0, policy_version, bytes, body: &body };
                Some(trajectories::push(conn, &group, now).await?)
            }
        };
        let pushed = if id.is_some() { (1, flown, lost) } else { (0, 0, lost) };
        policies::count(conn, &run, pushed).await?;
        if took != Took::default() {
            let tokens = (signed(took.tokens_in), signed(took.tokens_out));
            policies::spend(conn, &run, now.div_euclid(DAY), tokens, took.cost).await?;
        }
        let late = late.then(|| "its lease was over before the group was flown".to_owned());
        if let Some(words) = trouble.or(late) {
            policies::trouble(conn, &run, &words, now).await?;
            work.tell(&run, &Happening::Health { task: None, words: &words })?;
        }
        LetGo(lease).apply(work).await?;
        if id.is_some() {
            counts::rollout_group();
            work.tell_feed();
        }
        Ok(id)
    }
}

fn count(value: usize) -> i64 {
    i64::try_from(value).unwrap_or(i64::MAX)
}
