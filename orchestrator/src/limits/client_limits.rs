//! Limits that the operator sets for each client.

use std::num::NonZeroU32;

/// Limits for each token or address.
#[derive(Debug, Clone, Copy)]
pub struct ClientLimits {
    /// Maximum number of requests per second of one token.
    pub requests: NonZeroU32,
    /// Maximum number of requests per second of one address without a token.
    pub anonymous: NonZeroU32,
    /// Maximum number of runs that one principal may own.
    pub runs: u32,
    /// Maximum number of active leases of one principal.
    pub leases: u32,
}

impl Default for ClientLimits {
    fn default() -> Self {
        const fn positive(n: u32) -> NonZeroU32 {
            NonZeroU32::MIN.saturating_add(n - 1)
        }
        Self { requests: positive(1000), anonymous: positive(50), runs: 1000, leases: 4096 }
    }
}
