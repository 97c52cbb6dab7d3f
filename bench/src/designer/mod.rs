//! The designer: whether its layouts hit what an agent is weak at, whether anything unfair gets through, and how fast it is.

mod again;
pub(crate) mod learner;
mod rates;
mod spots;

pub(crate) use self::again::check as check_again;

use crate::Row;

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    let mut rows = rates::measure()?;
    rows.extend(spots::measure()?);
    rows.extend(again::measure()?);
    Ok(rows)
}
