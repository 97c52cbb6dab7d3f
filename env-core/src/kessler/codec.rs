//! Steps of an action log as JSON: a list of burns, each `[satellite, dvx, dvy]` or, as in the public
//! kessler-env, `{"satellite_id": 0, "delta_vx": 0.1, "delta_vy": 0.0}`.

use serde_json::Value;

use crate::error::LogError;
use crate::log::{ActionLog, MAX_ENTRIES};

/// Fields of a burn in its object form.
const BURN_FIELDS: [&str; 3] = ["satellite_id", "delta_vx", "delta_vy"];

/// Appends the burns of one step to `log`.
///
/// # Errors
/// Returns [`LogError`] if `step` is not a list of burns or has too many. Its field path is relative to the
/// step.
pub(super) fn read_step(step: &Value, log: &mut ActionLog) -> Result<(), LogError> {
    let burns = match step {
        Value::Array(burns) => burns,
        _ => return Err(LogError::malformed("", "a step is a list of burns")),
    };
    if burns.len() > MAX_ENTRIES {
        return Err(LogError::malformed(
            "",
            format!("{} burns in one step; at most {MAX_ENTRIES} are taken", burns.len()),
        ));
    }
    for (i, burn) in burns.iter().enumerate() {
        let (satellite, dvx, dvy) = match burn {
            Value::Array(cells) => match cells.as_slice() {
                [satellite, dvx, dvy] => (Some(satellite), Some(dvx), Some(dvy)),
                _ => return Err(LogError::malformed(format!(".{i}"), "a burn is [satellite, dvx, dvy]")),
            },
            Value::Object(fields) => {
                if let Some(key) = fields.keys().find(|key| !BURN_FIELDS.contains(&key.as_str())) {
                    let key: String = key.chars().take(40).collect();
                    return Err(LogError::malformed(
                        format!(".{i}.{key}"),
                        "it is not known; a burn has satellite_id, delta_vx, delta_vy",
                    ));
                }
                let [satellite, dvx, dvy] = BURN_FIELDS.map(|name| fields.get(name));
                (satellite, dvx, dvy)
            }
            _ => return Err(LogError::malformed(format!(".{i}"), "a burn is a list or an object")),
        };
        let path = |cell: usize| match burn {
            Value::Array(_) => format!(".{i}.{cell}"),
            _ => format!(".{i}.{}", BURN_FIELDS[cell]),
        };
        let satellite =
            satellite.and_then(Value::as_u64).and_then(|id| u32::try_from(id).ok()).ok_or_else(|| {
                LogError::malformed(path(0), "a satellite's number must be a whole number, 0 or more")
            })?;
        let number = |cell: usize, value: Option<&Value>| {
            value
                .and_then(Value::as_f64)
                .filter(|v| v.is_finite())
                .ok_or_else(|| LogError::malformed(path(cell), "a change of speed must be a finite number"))
        };
        log.push_entry(satellite, &[number(1, dvx)?, number(2, dvy)?]);
    }
    Ok(())
}
