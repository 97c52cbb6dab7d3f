//! Ownership: which client may use a lease, and which may take part in a run or change it.
//!
//! A lease belongs to the principal that took it. A run has an owner and members. Admins may do everything, and so may every client
//! of a server without tokens. The decisions are pure functions of [`Actor`]; [`check_run`] and [`check_lease`] apply them.

use sqlx::SqliteConnection;
use store::ids::RunId;
use store::leases::LeaseRow;
use store::principals::{self, PrincipalId, RunRelation};

use crate::engine::error::ServiceError;

/// Client, or part of the server, on whose behalf a use case works.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Actor {
    /// The server itself: its workers, and its sessions while they run episodes.
    Server,
    /// Any client of a server without tokens.
    Local,
    /// Client with an admin's token, whose principal owns what the client creates.
    Admin(PrincipalId),
    /// Client with another token, which acts for this principal.
    Principal(PrincipalId),
    /// Client without a token, of a server that serves OpenEnv's routes to everyone.
    Anonymous,
}

/// Permission that an operation on a run requires.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RunPermission {
    /// Lease, report results, open sessions and pull trajectories: for the owner and the members.
    TakePart,
    /// Change tags, members, policy and policy versions, and evaluate the run: for the owner.
    Change,
}

impl Actor {
    /// Owner of what the actor creates; `None` without authentication.
    #[must_use]
    pub const fn principal(self) -> Option<PrincipalId> {
        match self {
            Self::Server => Some(PrincipalId::SERVER),
            Self::Admin(principal) | Self::Principal(principal) => Some(principal),
            Self::Local | Self::Anonymous => None,
        }
    }

    /// True if the actor may do everything, whatever the owner is.
    #[must_use]
    pub const fn is_admin(self) -> bool {
        matches!(self, Self::Server | Self::Local | Self::Admin(_))
    }

    /// True if the actor is the owner or an admin. Only an admin has the rights of an owner where there is none.
    #[must_use]
    pub fn owns(self, owner: Option<PrincipalId>) -> bool {
        self.is_admin() || (owner.is_some() && self.principal() == owner)
    }

    /// True if the actor may read, renew, release and report a lease of this owner.
    ///
    /// A lease without an owner was taken before the server had tokens, and is for every trainer.
    #[must_use]
    pub fn may_use_lease(self, owner: Option<PrincipalId>) -> bool {
        self.owns(owner) || (owner.is_none() && self != Self::Anonymous)
    }

    /// True if the actor has a permission for a run. In a run without an owner, every trainer is a member.
    #[must_use]
    pub fn may(self, permission: RunPermission, relation: &RunRelation) -> bool {
        self.owns(relation.owner)
            || match permission {
                RunPermission::Change => false,
                RunPermission::TakePart => {
                    self != Self::Anonymous && (relation.owner.is_none() || relation.is_listed)
                }
            }
    }
}

/// Checks that an actor has a permission for a run. A run that does not exist passes, because the use case reports it.
///
/// # Errors
/// Returns [`ServiceError::NotRunMember`] or [`ServiceError::NotRunOwner`] without the permission, and an error of the store if the
/// query fails.
pub async fn check_run(
    conn: &mut SqliteConnection,
    actor: Actor,
    run: &RunId,
    permission: RunPermission,
) -> Result<(), ServiceError> {
    if actor.is_admin() {
        return Ok(());
    }
    // No run has the principal 0 as a member.
    let principal = actor.principal().unwrap_or(PrincipalId::SERVER);
    let relation = principals::relation(conn, run.as_str(), principal).await?;
    let Some(relation) = relation.filter(|relation| !actor.may(permission, relation)) else { return Ok(()) };
    let (run, owner) = (run.to_string(), relation.owner_name);
    Err(match permission {
        RunPermission::TakePart => ServiceError::NotRunMember { run, owner: owner.unwrap_or_default() },
        RunPermission::Change => match owner {
            Some(owner) => ServiceError::NotRunOwner { run, owner },
            None => ServiceError::RunWithoutOwner(run),
        },
    })
}

/// Checks that an actor may use a lease.
///
/// # Errors
/// Returns [`ServiceError::ForeignLease`] if the lease belongs to another principal.
pub fn check_lease(actor: Actor, lease: &LeaseRow) -> Result<(), ServiceError> {
    if actor.may_use_lease(lease.owner) { Ok(()) } else { Err(ServiceError::ForeignLease(lease.name())) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OWNER: PrincipalId = PrincipalId(1);
    const OTHER: PrincipalId = PrincipalId(2);

    #[test]
    fn lease_is_for_its_principal_and_for_admins() {
        for (actor, own, foreign, of_server, without_owner) in [
            (Actor::Principal(OWNER), true, false, false, true),
            (Actor::Anonymous, false, false, false, false),
            (Actor::Admin(OTHER), true, true, true, true),
            (Actor::Local, true, true, true, true),
            (Actor::Server, true, true, true, true),
        ] {
            let may =
                [Some(OWNER), Some(OTHER), Some(PrincipalId::SERVER), None].map(|o| actor.may_use_lease(o));
            assert_eq!(may, [own, foreign, of_server, without_owner], "{actor:?}");
        }
    }

    #[test]
    fn run_is_changed_by_its_owner_and_used_by_members() {
        let relation = |owner, is_listed| RunRelation { owner, owner_name: None, is_listed };
        for (actor, relation, takes_part, changes) in [
            (Actor::Principal(OWNER), relation(Some(OWNER), false), true, true),
            (Actor::Principal(OTHER), relation(Some(OWNER), true), true, false),
            (Actor::Principal(OTHER), relation(Some(OWNER), false), false, false),
            (Actor::Principal(OTHER), relation(None, false), true, false),
            (Actor::Anonymous, relation(Some(OWNER), false), false, false),
            (Actor::Anonymous, relation(None, false), false, false),
            (Actor::Admin(OTHER), relation(Some(OWNER), false), true, true),
            (Actor::Local, relation(Some(OWNER), false), true, true),
        ] {
            let may = [RunPermission::TakePart, RunPermission::Change].map(|p| actor.may(p, &relation));
            assert_eq!(may, [takes_part, changes], "{actor:?} {relation:?}");
        }
    }
}
