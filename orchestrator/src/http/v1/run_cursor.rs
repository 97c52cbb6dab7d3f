//! Cursors of the list of runs. A cursor is a position in an order, so that it is valid for the servers of all shards.

use store::ids::RunId;
use store::run_list::{RunOrder, RunPosition, RunSortKey, RunSortValue};

use crate::http::problem::Problem;

/// First part of the cursors of an order.
fn order_word(RunOrder { key, is_descending }: RunOrder) -> String {
    format!("{key}.{}", if is_descending { "desc" } else { "asc" })
}

/// Formats a cursor: `key.direction.run.value`. A real value has its bits, a missing value is empty. The shard of the run ends with
/// a `~`.
pub(super) fn format_cursor(order: RunOrder, position: &RunPosition) -> String {
    let value = match &position.value {
        RunSortValue::Integer(value) => value.to_string(),
        RunSortValue::Real(value) => format!("{:016x}", value.to_bits()),
        RunSortValue::Text(value) => value.clone(),
        RunSortValue::Missing => String::new(),
    };
    format!("{}.{}.{value}", order_word(order), position.id.replace('.', "~"))
}

/// Parses the cursor of a page in this order.
///
/// # Errors
/// Returns a problem if the text is no cursor, or is of another order.
pub(super) fn parse_cursor(order: RunOrder, cursor: &str) -> Result<RunPosition, Problem> {
    let malformed = || Problem::invalid("cursor", "must be the `next` of a previous page");
    let mut parts = cursor.splitn(4, '.');
    let mut next = || parts.next().ok_or_else(malformed);
    let (key, direction, id, value) = (next()?, next()?, next()?, next()?);
    let id = id.replace('~', ".");
    let is_known = key.parse::<RunSortKey>().is_ok() && ["asc", "desc"].contains(&direction);
    if !is_known || id.parse::<RunId>().is_err() {
        return Err(malformed());
    }
    if format!("{key}.{direction}") != order_word(order) {
        let reason = format!("is of a page with `sort={key}&order={direction}`; send it with that order");
        return Err(Problem::invalid("cursor", reason));
    }
    let value = match order.key {
        RunSortKey::Name => Some(RunSortValue::Text(value.to_owned())),
        RunSortKey::LastResults | RunSortKey::Skill if value.is_empty() => Some(RunSortValue::Missing),
        RunSortKey::Created | RunSortKey::Episodes | RunSortKey::LastResults => {
            value.parse().ok().map(RunSortValue::Integer)
        }
        RunSortKey::Skill => {
            let real = u64::from_str_radix(value, 16).ok().map(f64::from_bits);
            real.filter(|real| real.is_finite()).map(RunSortValue::Real)
        }
    };
    Ok(RunPosition { value: value.ok_or_else(malformed)?, id })
}
