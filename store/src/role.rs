//! Roles of access tokens.

use crate::text_enum;

text_enum! {
    /// Rights of a token. Each role includes the rights of the roles before it.
    pub enum Role: "a token's role" {
        /// Reads: runs, mastery, episodes, events, metrics.
        Viewer = "viewer",
        /// Trains: creates runs, leases, reports, flies.
        Trainer = "trainer",
        /// Steers: pauses runs, sets what they keep, asks designers, reads the audit log.
        Admin = "admin",
    }
}
