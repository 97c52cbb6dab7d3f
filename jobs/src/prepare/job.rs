//! Payload and result of a job that prepares proposals of a run, in order.

use std::panic::AssertUnwindSafe;
use std::time::{Duration, Instant};

use curriculum::Proposal;
use env_core::SeedSpace;
use env_core::space::Levels;
use serde::{Deserialize, Serialize};

use super::{DrawContext, ParentScenario, PrepareError, PreparedScenario, SeedSource, prepare};
use crate::wire::{
    MAX_ENTRIES, RecipeTable, ScenarioReader, ScenarioWriter, WireBracket, WireError, WireScenario,
    from_bytes, list, to_bytes,
};

/// Time after which a job begins no further proposal, so that those behind a slow one are not delayed by it.
const MAX_JOB_TIME: Duration = Duration::from_millis(10);

/// Largest number of levels, and of their params, in a message.
const MAX_LEVELS: usize = 1024;

/// A proposal with everything that its preparation needs.
#[derive(Debug, Clone)]
pub struct PendingProposal {
    /// Seed of the run.
    pub run_seed: u64,
    /// Sequence number of the proposal in its run.
    pub seq: u64,
    /// The proposal that needs a scenario.
    pub proposal: Proposal,
    /// The scenario that it derives from, if it derives from one that is still stored.
    pub parent: Option<ParentScenario>,
}

/// Proposals to prepare, in order.
#[derive(Debug, Clone, Default)]
pub struct PreparePayload(pub Vec<PendingProposal>);

/// Result of preparing a proposal.
#[derive(Debug, Clone, PartialEq)]
pub enum PrepareOutcome {
    /// The proposal has a scenario.
    Scenario(Box<PreparedScenario>),
    /// The proposal has no scenario, for this reason; `None` if its result is not wanted any more.
    Failed(Option<String>),
    /// The job ended before it; another one prepares it.
    Untried,
}

/// One result for each proposal of the payload.
#[derive(Debug, Clone, PartialEq)]
pub struct PrepareOutput(pub Vec<PrepareOutcome>);

impl PreparePayload {
    /// Prepares the proposals until the time is up; the first one is always tried.
    #[must_use]
    pub fn run(&self, context: DrawContext<'_>) -> PrepareOutput {
        let started = Instant::now();
        let outcomes = self.0.iter().enumerate().map(|(number, pending)| {
            if number == 0 || started.elapsed() < MAX_JOB_TIME {
                pending.prepare(context)
            } else {
                PrepareOutcome::Untried
            }
        });
        PrepareOutput(outcomes.collect())
    }
}

impl PendingProposal {
    /// Prepares the proposal. A panic fails this proposal, and no other.
    #[must_use]
    pub fn prepare(&self, context: DrawContext<'_>) -> PrepareOutcome {
        let Self { run_seed, seq, proposal, parent } = self;
        let seeds = SeedSource { space: SeedSpace::Training, run_seed: *run_seed, seq: *seq };
        let prepared =
            std::panic::catch_unwind(AssertUnwindSafe(|| prepare(seeds, proposal, parent.as_ref(), context)));
        match prepared {
            Ok(Ok(scenario)) => PrepareOutcome::Scenario(Box::new(scenario)),
            Ok(Err(PrepareError::Abandoned)) => PrepareOutcome::Failed(None),
            Ok(Err(error)) => PrepareOutcome::Failed(Some(error.to_string())),
            Err(_) => PrepareOutcome::Failed(Some("preparing the proposal panicked".to_owned())),
        }
    }
}

#[derive(Serialize, Deserialize)]
struct WireProposals {
    recipes: RecipeTable,
    #[serde(deserialize_with = "list::<_, _, MAX_ENTRIES>")]
    proposals: Vec<WireProposal>,
}

#[derive(Serialize, Deserialize)]
struct WireProposal {
    run_seed: u64,
    seq: u64,
    /// The proposal as JSON.
    proposal: String,
    parent: Option<WireParent>,
}

#[derive(Serialize, Deserialize)]
struct WireParent {
    scenario: WireScenario,
    bracket: WireBracket,
    is_contested: bool,
    #[serde(deserialize_with = "list::<_, _, MAX_LEVELS>")]
    columns: Vec<String>,
    #[serde(deserialize_with = "list::<_, _, MAX_LEVELS>")]
    rows: Vec<Vec<f64>>,
}

#[derive(Serialize, Deserialize)]
struct WireOutcomes {
    recipes: RecipeTable,
    #[serde(deserialize_with = "list::<_, _, MAX_ENTRIES>")]
    outcomes: Vec<WirePrepared>,
}

#[derive(Serialize, Deserialize)]
enum WirePrepared {
    Scenario(WireScenario, WireBracket, bool, bool),
    Failed(Option<String>),
    Untried,
}

impl PreparePayload {
    pub(crate) fn encode(&self) -> Result<Vec<u8>, WireError> {
        let mut writer = ScenarioWriter::default();
        let write = |pending: &PendingProposal| -> Result<_, WireError> {
            Ok(WireProposal {
                run_seed: pending.run_seed,
                seq: pending.seq,
                proposal: serde_json::to_string(&pending.proposal)?,
                parent: pending.parent.as_ref().map(|parent| WireParent::of(parent, &mut writer)),
            })
        };
        let proposals = self.0.iter().map(write).collect::<Result<_, _>>()?;
        to_bytes(&WireProposals { recipes: writer.table(), proposals })
    }

    pub(crate) fn decode(bytes: &[u8]) -> Result<Self, WireError> {
        let WireProposals { recipes, proposals } = from_bytes(bytes)?;
        let reader = ScenarioReader::new(&recipes)?;
        let read = |wire: WireProposal| -> Result<_, WireError> {
            Ok(PendingProposal {
                run_seed: wire.run_seed,
                seq: wire.seq,
                proposal: serde_json::from_str(&wire.proposal)?,
                parent: wire.parent.map(|parent| parent.read(&reader)).transpose()?,
            })
        };
        proposals.into_iter().map(read).collect::<Result<_, _>>().map(Self)
    }
}

impl WireParent {
    fn of(parent: &ParentScenario, writer: &mut ScenarioWriter) -> Self {
        let levels = &parent.levels;
        let row = |level| levels.params(level).map(|(_, value)| value).collect();
        Self {
            scenario: writer.add(&parent.scenario),
            bracket: (&parent.bracket).into(),
            is_contested: parent.is_contested,
            columns: levels.columns().to_vec(),
            rows: (0..levels.len()).map(row).collect(),
        }
    }

    fn read(self, reader: &ScenarioReader) -> Result<ParentScenario, WireError> {
        let scenario = reader.get(self.scenario)?;
        let levels = Levels::new(scenario.task().params(), self.columns, self.rows)?;
        Ok(ParentScenario {
            bracket: self.bracket.read()?,
            is_contested: self.is_contested,
            levels,
            scenario,
        })
    }
}

impl PrepareOutput {
    pub(crate) fn encode(&self) -> Result<Vec<u8>, WireError> {
        let mut writer = ScenarioWriter::default();
        let write = |outcome: &PrepareOutcome| match outcome {
            PrepareOutcome::Scenario(prepared) => WirePrepared::Scenario(
                writer.add(&prepared.scenario),
                (&prepared.bracket).into(),
                prepared.is_contested,
                prepared.is_planted,
            ),
            PrepareOutcome::Failed(reason) => WirePrepared::Failed(reason.clone()),
            PrepareOutcome::Untried => WirePrepared::Untried,
        };
        let outcomes = self.0.iter().map(write).collect();
        to_bytes(&WireOutcomes { recipes: writer.table(), outcomes })
    }

    pub(crate) fn decode(bytes: &[u8]) -> Result<Self, WireError> {
        let WireOutcomes { recipes, outcomes } = from_bytes(bytes)?;
        let reader = ScenarioReader::new(&recipes)?;
        let read = |wire: WirePrepared| -> Result<_, WireError> {
            Ok(match wire {
                WirePrepared::Scenario(scenario, bracket, is_contested, is_planted) => {
                    let (scenario, bracket) = (reader.get(scenario)?, bracket.read()?);
                    PrepareOutcome::Scenario(Box::new(PreparedScenario {
                        scenario,
                        bracket,
                        is_contested,
                        is_planted,
                    }))
                }
                WirePrepared::Failed(reason) => PrepareOutcome::Failed(reason),
                WirePrepared::Untried => PrepareOutcome::Untried,
            })
        };
        outcomes.into_iter().map(read).collect::<Result<_, _>>().map(Self)
    }
}
