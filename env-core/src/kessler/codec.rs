//! One step of an action log in kessler's wire form: a list of burns, each `[satellite, dvx, dvy]` or, as the public
//! kessler-env writes it, `{"satellite_id": 0, "delta_vx": 0.1, "delta_vy": 0.0}`.

use serde_json::Value;

use crate::error::LogError;
use crate::log::{ActionLog, MAX_ENTRIES};

/// Reads one step.
///
/// # Errors
/// What is not a list of burns; the field is relative to the step.
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
                if let Some(key) =
                    fields.keys().find(|k| !["satellite_id", "delta_vx", "delta_vy"].contains(&k.as_str()))
                {
                    let key: String = key.chars().take(40).collect();
                    return Err(LogError::malformed(
                        format!(".{i}.{key}"),
                        "it is not known; a burn has satellite_id, delta_vx, delta_vy",
                    ));
                }
                (fields.get("satellite_id"), fields.get("delta_vx"), fields.get("delta_vy"))
            }
            _ => return Err(LogError::malformed(format!(".{i}"), "a burn is a list or an object")),
        };
        let satellite = satellite
            .and_then(Value::as_u64)
            .and_then(|id| u32::try_from(id).ok())
            .ok_or_else(|| LogError::malformed(format!(".{i}.satellite_id"), "it must be a whole number"))?;
        let number = |name: &str, value: Option<&Value>| {
            value
                .and_then(Value::as_f64)
                .filter(|v| v.is_finite())
                .ok_or_else(|| LogError::malformed(format!(".{i}.{name}"), "it must be a finite number"))
        };
        log.act(satellite, &[number("delta_vx", dvx)?, number("delta_vy", dvy)?]);
    }
    Ok(())
}
