//! The designer: speed, whether layouts hit the weaknesses of agents, and whether unfair layouts are admitted.

pub(crate) mod learner;
mod rates;
mod replay_check;
mod weaknesses;

pub(crate) use self::replay_check::check_layouts;

use crate::Row;

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    let mut rows = rates::measure()?;
    rows.extend(weaknesses::measure()?);
    rows.extend(replay_check::measure()?);
    Ok(rows)
}
