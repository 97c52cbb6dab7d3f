//! Bound on the step by which a request may raise the newest policy version of a run.

use crate::engine::error::ServiceError;

/// Largest step above the newest policy version. A wrong version far above would make all later results stale.
pub const MAX_VERSION_STEP: i64 = 1_000_000;

/// Checks a policy version of a request against the newest one of the run.
///
/// # Errors
/// Returns an error that names `field` if the version is more than [`MAX_VERSION_STEP`] above the newest one.
pub fn check_version_step(field: &str, version: u32, newest: i64) -> Result<(), ServiceError> {
    let max = newest + MAX_VERSION_STEP;
    if i64::from(version) <= max {
        return Ok(());
    }
    let reason = format!(
        "must be at most {max}: the newest version of the run is {newest}, and a request raises it by at most \
         {MAX_VERSION_STEP}; got {version}; an admin can set a higher newest version with PUT /v1/runs/{{run}}/policy_version"
    );
    Err(ServiceError::invalid(field, reason))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn version_may_step_up_to_the_bound() {
        for (version, newest, is_accepted) in [
            (0, 0, true),
            (1_000_000, 0, true),
            (1_000_001, 0, false),
            (1_000_007, 7, true),
            (3, 9, true),
            (u32::MAX, 9, false),
        ] {
            assert_eq!(
                check_version_step("policy_version", version, newest).is_ok(),
                is_accepted,
                "{version} {newest}"
            );
        }
    }
}
