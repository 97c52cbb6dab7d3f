//! Replaces the members of a run, and sets its owner.

use std::collections::BTreeSet;

use api_types::RunMembersRequest;
use env_core::text::{MAX_QUOTED_CHARS, shorten};
use sqlx::SqliteConnection;
use store::ids::RunId;
use store::principals::{self, PrincipalId};
use store::runs::{self, RunRow};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;
use crate::ownership::Actor;

/// Maximum number of members of a run.
const MAX_MEMBERS: usize = 100;

/// Replaces the members of a run. An admin can also set the owner.
#[derive(Debug)]
pub struct SetMembers {
    run: RunId,
    request: RunMembersRequest,
}

impl SetMembers {
    /// Checks a request.
    ///
    /// # Errors
    /// Returns [`ServiceError::OwnerNeedsAdmin`] if the request sets the owner and `actor` is no admin, and an error that names
    /// `members` if there are too many.
    pub fn from_request(run: RunId, actor: Actor, request: RunMembersRequest) -> Result<Self, ServiceError> {
        if request.owner.is_some() && !actor.is_admin() {
            return Err(ServiceError::OwnerNeedsAdmin);
        }
        if request.members.len() > MAX_MEMBERS {
            let reason = format!("must have at most {MAX_MEMBERS} names, got {}", request.members.len());
            return Err(ServiceError::invalid("members", reason));
        }
        Ok(Self { run, request })
    }
}

impl Change for SetMembers {
    type Output = RunRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<RunRow, ServiceError> {
        let Self { run, request: RunMembersRequest { members, owner } } = self;
        let (id, conn) = (run.as_str(), tx.run(run.as_str()).await?.conn);
        if let Some(owner) = &owner {
            let owner = find_principal(conn, "owner", owner).await?;
            principals::set_owner(conn, id, owner).await?;
        }
        let mut numbers = BTreeSet::new();
        for (at, name) in members.iter().enumerate() {
            numbers.insert(find_principal(conn, &format!("members.{at}"), name).await?);
        }
        principals::replace_members(conn, id, &numbers).await?;
        let row = runs::get(conn, id).await?.ok_or_else(|| ServiceError::UnknownRun(id.to_owned()))?;
        if row.owner.is_none() && !numbers.is_empty() {
            let reason = "is required with `members`: the run has no owner yet, so every trainer is a member";
            return Err(ServiceError::invalid("owner", reason));
        }
        Ok(row)
    }
}

async fn find_principal(
    conn: &mut SqliteConnection,
    field: &str,
    name: &str,
) -> Result<PrincipalId, ServiceError> {
    principals::find(conn, name).await?.ok_or_else(|| {
        let name = shorten(name, MAX_QUOTED_CHARS);
        let reason = format!(
            "must be the principal of a token, got {name:?}; `sparring token list` shows the principals"
        );
        ServiceError::invalid(field, reason)
    })
}
