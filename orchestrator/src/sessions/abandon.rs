//! Records episodes that sessions began and left: their first attempts have no result, whatever a later attempt reaches.

use store::groups;
use store::keys::GroupKey;

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;

/// Counts episodes as abandoned, each in its group.
#[derive(Debug, Clone)]
pub(super) struct AbandonEpisodes {
    /// Number of the lease.
    pub(super) lease: i64,
    /// Numbers of the groups, one for each episode.
    pub(super) groups: Vec<i64>,
}

impl Change for AbandonEpisodes {
    type Output = ();

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        for number in self.groups {
            groups::add_abandoned(&mut tx.conn, GroupKey { lease: self.lease, number }).await?;
        }
        Ok(())
    }
}
