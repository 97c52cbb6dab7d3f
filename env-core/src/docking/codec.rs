//! Parses one step of an action log: a list of thrusts, each `[deputy, fx, fy, fz]` or
//! `{"deputy": 0, "fx": 0.5, "fy": 0.0, "fz": -0.2}`, in N.

use serde_json::Value;

use crate::error::LogError;
use crate::log::{ActionLog, MAX_ENTRIES};

const FIELDS: [&str; 4] = ["deputy", "fx", "fy", "fz"];

/// Reads one step.
///
/// # Errors
/// Returns [`LogError::Malformed`] if the value is not a list of thrusts; its field is relative to the step.
pub(super) fn read_step(step: &Value, log: &mut ActionLog) -> Result<(), LogError> {
    let Value::Array(thrusts) = step else {
        return Err(LogError::malformed("", "a step is a list of thrusts"));
    };
    if thrusts.len() > MAX_ENTRIES {
        return Err(LogError::malformed(
            "",
            format!("{} thrusts in one step; at most {MAX_ENTRIES} are taken", thrusts.len()),
        ));
    }
    for (i, thrust) in thrusts.iter().enumerate() {
        let cells = cells(i, thrust)?;
        let field = |cell: usize| match thrust {
            Value::Array(_) => format!(".{i}.{cell}"),
            _ => format!(".{i}.{}", FIELDS[cell]),
        };
        let deputy =
            cells[0].and_then(Value::as_u64).and_then(|id| u32::try_from(id).ok()).ok_or_else(|| {
                LogError::malformed(field(0), "a deputy's number must be a whole number, 0 or more")
            })?;
        let mut values = [0.0; 3];
        for (axis, value) in values.iter_mut().enumerate() {
            *value = cells[axis + 1]
                .and_then(Value::as_f64)
                .filter(|v| v.is_finite())
                .ok_or_else(|| LogError::malformed(field(axis + 1), "a thrust must be a finite number"))?;
        }
        log.push_entry(deputy, &values);
    }
    Ok(())
}

/// The four cells of one thrust in order; `None` for those that are missing.
fn cells(i: usize, thrust: &Value) -> Result<[Option<&Value>; 4], LogError> {
    match thrust {
        Value::Array(cells) => match cells.as_slice() {
            [deputy, fx, fy, fz] => Ok([Some(deputy), Some(fx), Some(fy), Some(fz)]),
            _ => Err(LogError::malformed(format!(".{i}"), "a thrust is [deputy, fx, fy, fz]")),
        },
        Value::Object(fields) => {
            if let Some(key) = fields.keys().find(|key| !FIELDS.contains(&key.as_str())) {
                let key: String = key.chars().take(40).collect();
                return Err(LogError::malformed(
                    format!(".{i}.{key}"),
                    "it is not known; a thrust has deputy, fx, fy, fz",
                ));
            }
            Ok(FIELDS.map(|name| fields.get(name)))
        }
        _ => Err(LogError::malformed(format!(".{i}"), "a thrust is a list or an object")),
    }
}
