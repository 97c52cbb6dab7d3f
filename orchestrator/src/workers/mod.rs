//! Background jobs. Each is idempotent: what it does twice is done once.

pub mod critique;
pub mod design;
pub mod expire;
pub mod fold;
pub mod prepare;
pub mod rollout;

/// Puts this thread at the lowest priority, where the system has one for threads (Linux): results are replayed and
/// answered first.
fn yield_to_others() {
    #[cfg(target_os = "linux")]
    if let Err(error) = rustix::process::nice(19) {
        tracing::debug!(error = %error, "Background work runs at the usual priority.");
    }
}
