//! Stores prepared scenarios, and drops proposals that have none.

use std::collections::BTreeSet;

use sqlx::SqliteConnection;
use store::StoreError;
use store::proposals::{self, PreparedProposal, ProposalKey};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;
use crate::leases::refill;
use jobs::prepare::PreparedScenario;

/// Stores scenarios with their brackets, each once.
pub(crate) async fn store_scenarios(
    conn: &mut SqliteConnection,
    prepared: impl Iterator<Item = &PreparedScenario>,
) -> Result<(), StoreError> {
    let prepared: Vec<_> = prepared.collect();
    let scenarios: Vec<_> = prepared.iter().map(|prepared| &prepared.scenario).collect();
    let ids: Vec<_> = scenarios.iter().map(|scenario| scenario.id()).collect();
    store::scenarios::insert(conn, &scenarios).await?;
    let brackets: Vec<_> =
        ids.iter().zip(&prepared).map(|(id, prepared)| (id.0.as_slice(), &prepared.bracket)).collect();
    store::brackets::insert(conn, &brackets).await
}

/// The scenario of a proposal.
#[derive(Debug)]
pub struct ScenarioOfProposal {
    /// The proposal that the scenario is for.
    pub proposal: ProposalKey,
    /// The scenario with its bracket.
    pub scenario: PreparedScenario,
}

/// Stores the scenarios of proposals.
#[derive(Debug, Default)]
pub struct StorePrepared {
    /// Proposals with their scenarios.
    pub prepared: Vec<ScenarioOfProposal>,
    /// Proposals that have no scenario; they are dropped.
    pub failed: Vec<ProposalKey>,
}

impl Change for StorePrepared {
    type Output = ();
    const IS_BULK: bool = true;

    async fn apply(mut self, tx: &mut WriteTx) -> Result<(), ServiceError> {
        // A proposal that was dropped meanwhile needs no scenario, which would never be deleted.
        let keys: Vec<_> = self.prepared.iter().map(|prepared| prepared.proposal.clone()).collect();
        let unprepared = proposals::unprepared_among(&mut tx.conn, &keys).await?;
        self.prepared.retain(|prepared| unprepared.contains(&prepared.proposal));
        store_scenarios(&mut tx.conn, self.prepared.iter().map(|prepared| &prepared.scenario)).await?;
        let rows = self.prepared.iter().map(|ScenarioOfProposal { proposal, scenario }| PreparedProposal {
            run: &proposal.run,
            seq: proposal.seq,
            scenario: scenario.scenario.id().0,
            is_contested: scenario.is_contested,
            is_planted: scenario.is_planted,
        });
        proposals::set_prepared(&mut tx.conn, &rows.collect::<Vec<_>>()).await?;
        for ProposalKey { run, seq } in &self.failed {
            proposals::drop_all(&mut tx.conn, run, &[*seq]).await?;
        }
        // Leases that were promised more groups get them now.
        let runs: BTreeSet<&String> = self.prepared.iter().map(|prepared| &prepared.proposal.run).collect();
        for run in runs {
            refill::grant_refills(&mut tx.run(run).await?).await?;
        }
        Ok(())
    }
}
