//! What comes in of an evaluation: groups that a trainer flew, and what the server flew by itself.

use crate::evaluation::flown::{Flown, Measures, measure};
use crate::evaluation::suite::Entry;
use crate::evaluation::suite::file;
use crate::store::brackets::StoredFlown;
use crate::store::groups::GroupRow;
use crate::store::leases::LeaseRow;
use crate::store::{StoreError, episodes, evaluations, from_json, to_json};
use crate::training::{Change, TrainingError, Work};

/// Takes a group that a trainer flew, where it is one of an evaluation: what is not complete is offered again.
pub(in crate::training) async fn take(
    work: &mut Work,
    lease: &LeaseRow,
    group: &GroupRow,
) -> Result<(), TrainingError> {
    let (now, conn) = (work.now, &mut work.conn);
    let Some((id, place)) = evaluations::of_group(conn, lease.id, group.number).await? else { return Ok(()) };
    if group.state != "complete" {
        return Ok(evaluations::offer_again(conn, id, place).await?);
    }
    let row = evaluations::get(conn, id).await?;
    let suite = row.and_then(|row| file::built_in(&row.suite));
    let entry: Option<&'static Entry> =
        suite.and_then(|of| of.suite.entries().nth(usize::try_from(place).ok()?));
    let Some(entry) = entry else {
        return Err(
            StoreError::unreadable("an evaluation", "its suite is not the one it was begun with").into()
        );
    };
    let first = group.number * lease.group_size;
    let rows = episodes::finished_of(conn, lease.id, (first, first + lease.group_size)).await?;
    let mut measured: Vec<Measures> = Vec::with_capacity(rows.len());
    for text in rows {
        let flown: StoredFlown = from_json("an episode", &text)?;
        measured.push(measure(entry, &flown.into()));
    }
    Ok(evaluations::flown(conn, (id, place), &to_json(&measured)?, now).await?)
}

/// Whether an episode's lease flies an evaluation.
pub(in crate::training) async fn is_of_one(
    work: &mut Work,
    lease: &LeaseRow,
    episode: i64,
) -> Result<bool, TrainingError> {
    let group = episode / lease.group_size.max(1);
    Ok(lease.purpose == "eval" && evaluations::of_group(&mut work.conn, lease.id, group).await?.is_some())
}

/// Writes what the server flew.
#[derive(Debug)]
pub struct Fly {
    /// The evaluation.
    pub id: i64,
    /// What was flown, or why it could not be.
    pub flown: Result<Flown, String>,
}

impl Change for Fly {
    type Answer = ();
    const BULK: bool = true;

    async fn apply(self, work: &mut Work) -> Result<(), TrainingError> {
        let (now, conn) = (work.now, &mut work.conn);
        match self.flown {
            Err(trouble) => evaluations::fail(conn, self.id, &trouble).await?,
            Ok(flown) => {
                for (place, episodes) in (0i64..).zip(&flown.episodes) {
                    evaluations::flown(conn, (self.id, place), &to_json(episodes)?, now).await?;
                }
            }
        }
        Ok(())
    }
}
