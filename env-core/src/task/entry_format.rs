//! Parser of one step of an action log in JSON: a list of entries, each a list of cells or an object.

use serde_json::Value;

use crate::error::LogError;
use crate::log::{ActionLog, MAX_ENTRIES};
use crate::text::shorten;

/// Longest name of an unknown field that an error repeats, in characters.
const MAX_FIELD_CHARS: usize = 40;

/// JSON format of a world's entries: the agent's number and the values of its action, `CELLS` in all.
pub(crate) struct EntryFormat<const CELLS: usize> {
    /// Noun of an entry, such as `burn`.
    pub(crate) entry: &'static str,
    /// Noun of an agent, such as `satellite`.
    pub(crate) agent: &'static str,
    /// Noun of a value with its article, such as `a change of speed`.
    pub(crate) value: &'static str,
    /// Description of the list form, such as `[satellite, dvx, dvy]`.
    pub(crate) list: &'static str,
    /// Names of the cells in the object form.
    pub(crate) fields: [&'static str; CELLS],
}

impl<const CELLS: usize> EntryFormat<CELLS> {
    /// Appends the entries of one step to `log`.
    ///
    /// # Errors
    /// Returns [`LogError::Malformed`] if `step` is not a list of entries or has too many. Its field path is relative to the
    /// step.
    pub(crate) fn read_entries(&self, step: &Value, log: &mut ActionLog) -> Result<(), LogError> {
        let Self { entry: noun, agent, value, fields, .. } = self;
        let Value::Array(entries) = step else {
            return Err(LogError::malformed("", format!("a step must be a list of {noun}s")));
        };
        if entries.len() > MAX_ENTRIES {
            return Err(LogError::malformed(
                "",
                format!("a step must have at most {MAX_ENTRIES} {noun}s, got {}", entries.len()),
            ));
        }
        for (i, entry) in entries.iter().enumerate() {
            let cells = self.cells(i, entry)?;
            let path = |cell: usize| match entry {
                Value::Array(_) => format!(".{i}.{cell}"),
                _ => format!(".{i}.{}", fields[cell]),
            };
            let number = cells[0].and_then(Value::as_u64).and_then(|id| u32::try_from(id).ok());
            let number = number.ok_or_else(|| {
                LogError::malformed(
                    path(0),
                    format!("the index of a {agent} must be an integer of at least 0"),
                )
            })?;
            let mut values = [0.0; CELLS];
            for cell in 1..CELLS {
                let finite = cells[cell].and_then(Value::as_f64).filter(|v| v.is_finite());
                values[cell] = finite.ok_or_else(|| {
                    LogError::malformed(path(cell), format!("{value} must be a finite number"))
                })?;
            }
            log.push_entry(number, &values[1..]);
        }
        Ok(())
    }

    /// The cells of entry `i` in order; `None` for those that are missing.
    fn cells<'a>(&self, i: usize, entry: &'a Value) -> Result<[Option<&'a Value>; CELLS], LogError> {
        let Self { entry: noun, list, fields, .. } = self;
        match entry {
            Value::Array(cells) => match <&[Value; CELLS]>::try_from(cells.as_slice()) {
                Ok(cells) => Ok(cells.each_ref().map(Some)),
                Err(_) => Err(LogError::malformed(
                    format!(".{i}"),
                    format!("{} {noun} must be {list}", article(noun)),
                )),
            },
            Value::Object(given) => match given.keys().find(|key| !fields.contains(&key.as_str())) {
                None => Ok(fields.map(|name| given.get(name))),
                Some(key) => Err(LogError::malformed(
                    format!(".{i}.{}", shorten(key, MAX_FIELD_CHARS)),
                    format!(
                        "unknown field of {} {noun}; the known fields are {}",
                        article(noun),
                        fields.join(", ")
                    ),
                )),
            },
            _ => Err(LogError::malformed(
                format!(".{i}"),
                format!("{} {noun} must be a list or an object", article(noun)),
            )),
        }
    }
}

/// Indefinite article of a noun.
fn article(noun: &str) -> &'static str {
    if noun.starts_with(['a', 'e', 'i', 'o', 'u']) { "an" } else { "a" }
}
