//! Roles of access tokens.

use crate::text_enum;

text_enum! {
    /// Rights of a token. Each role includes the rights of the roles before it.
    pub enum Role: "a token's role" {
        /// May read runs, mastery, episodes, events and metrics.
        Viewer = "viewer",
        /// May also create runs, lease scenarios, report results and open sessions.
        Trainer = "trainer",
        /// May also change and pause runs, set their retention, request designs and read the audit log.
        Admin = "admin",
    }
}
