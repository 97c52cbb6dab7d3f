//! Stores the last use of tokens and the lines of the audit log.

use store::audit_log::{self, AuditRing, AuditRow};
use store::tokens;

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;

/// Stores that a token was used now.
#[derive(Debug)]
pub struct TouchToken(pub i64);

impl Change for TouchToken {
    type Output = ();
    const IS_BULK: bool = true;

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        Ok(tokens::set_used(&mut tx.conn, self.0, tx.now).await?)
    }
}

/// Writes a line of the audit log.
#[derive(Debug, Clone)]
pub struct WriteAuditLine {
    /// Row of the access log.
    pub line: AuditRow,
    /// True if the request was denied.
    pub is_denied: bool,
}

impl Change for WriteAuditLine {
    type Output = ();

    async fn apply(self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        let ring = if self.is_denied { AuditRing::Denials } else { AuditRing::Changes };
        Ok(audit_log::append(&mut tx.conn, ring, &self.line).await?)
    }
}
