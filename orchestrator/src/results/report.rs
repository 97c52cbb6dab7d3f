//! Stores audited results: each episode once, by its replay. Groups that become whole are closed in the same change.

use api_types::ResultReceipt;
use store::ids::RunId;
use store::{brackets, groups};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;
use crate::metrics;
use crate::results::audit_outcome::AuditedReport;
use crate::results::report_batch::ReportBatch;
use crate::results::report_summary::ReportSummary;

/// Stores the audited episodes of a report.
#[derive(Debug)]
pub struct StoreResults {
    /// Id of the run.
    pub run: RunId,
    /// Version of the policy that acted, if an episode does not name one and it is not the lease's.
    pub policy_version: Option<u32>,
    /// The audited episodes, and the brackets that their audit computed.
    pub report: AuditedReport,
}

/// Answer to a stored report.
#[derive(Debug, Default)]
pub struct ReportReceipts {
    /// One receipt for each reported episode, in the order of the report.
    pub receipts: Vec<ResultReceipt>,
    /// Effects of the groups that the report closed.
    pub summary: ReportSummary,
}

impl Change for StoreResults {
    type Output = ReportReceipts;
    const IS_BULK: bool = true;

    async fn apply(self, tx: &mut WriteTx) -> Result<Self::Output, ServiceError> {
        tx.run(self.run.as_str()).await?; // it may have been deleted since the replay
        let AuditedReport { episodes, brackets } = self.report;
        for deferred in &brackets {
            let group = deferred.group;
            // The lease may have been compacted after the lookup.
            if groups::get(&mut tx.conn, group.lease, group.number).await?.is_some() {
                let id = deferred.scenario.id();
                brackets::insert(&mut tx.conn, &[(id.0.as_slice(), &deferred.bracket)]).await?;
                groups::set_contested(&mut tx.conn, group, deferred.is_contested).await?;
            }
        }
        let mut batch = ReportBatch::open(tx, &self.run, &episodes).await?;
        let mut receipts = Vec::with_capacity(episodes.len());
        for episode in episodes {
            receipts.push(batch.add(tx, self.policy_version, episode).await?);
        }
        let summary = batch.finish(tx).await?;
        receipts.iter().for_each(|receipt| metrics::record_result(receipt.status, receipt.code));
        Ok(ReportReceipts { receipts, summary })
    }
}
