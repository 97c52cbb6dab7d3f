//! Access control: tokens, roles, rate limits, and the audit log of manual changes.
//!
//! [`middleware::authorize`] handles every request: it asks [`AccessControl`] whether the client may use the operation
//! (`permissions` has the list), passes the [`Caller`] on to the handler, and writes the audit log. The tokens themselves
//! are in `crate::tokens`, limits in `crate::limits`. Start reading at `middleware`.

mod control;
mod cross_site;
mod loopback;
pub(super) mod middleware;
mod permissions;
mod plan_access;

pub use self::control::{AccessConfig, AccessControl};
pub(super) use self::permissions::{Permission, find_operation};
pub(super) use self::plan_access::plan_denial;
use crate::leases::create::OwnerQuota;
use crate::ownership::Actor;
use crate::sessions::ClientIdentity;
use store::role::Role;

/// Client that sent a request.
#[derive(Debug, Clone)]
pub(super) struct Caller {
    /// Token or address of the client, as sessions identify it.
    pub(super) identity: ClientIdentity,
    /// Role of the client's token; `None` without a token.
    pub(super) role: Option<Role>,
}

impl Caller {
    /// Principal and rights of the client.
    pub(super) const fn actor(&self) -> Actor {
        self.identity.actor
    }

    /// Returns the owner of what the client creates, with its limit of `max`. `None` without a token.
    pub(super) fn owner_quota(&self, max: u32) -> Option<OwnerQuota> {
        self.actor().principal().map(|principal| OwnerQuota { principal, max: Some(max) })
    }
}
