//! Finishes design requests: stores the layouts that the gate admitted or refused, and counts them.

use std::collections::BTreeMap;
use std::time::Duration;

use designer::{DesignUsage, JudgedLayout};
use env_core::text::shorten;
use serde_json::Value;
use sqlx::SqliteConnection;
use store::design_counters::{self, GateCount};
use store::design_requests::{self, DesignRequestResult, RequestState};
use store::ids::DesignRequestId;
use store::layout_transitions::{self, LayoutTransition};
use store::layouts::{self, LayoutKind, LayoutState, NewLayout};
use store::{StoreError, brackets, scenarios, to_i64};

use crate::designs::place::Place;
use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::event::RunEvent;
use crate::engine::write_tx::WriteTx;
use crate::metrics;
use clock::Millis;

/// Maximum number of admitted, and of refused, layouts of a request that are stored; all are counted.
const MAX_STORED_LAYOUTS: usize = 64;
/// Maximum size of a refused design that is stored, in bytes.
const MAX_REFUSED_BYTES: usize = 16 * 1024;
/// Maximum number of warnings of a request that are stored.
const MAX_WARNINGS: usize = 32;

/// Verdict under which admitted layouts are counted.
pub const ADMITTED: &str = "admitted";

/// A layout with the designer that made it.
#[derive(Debug, Clone)]
pub struct MadeLayout {
    /// Name of the designer.
    pub designer: &'static str,
    /// The layout and the gate's verdict.
    pub judged: JudgedLayout,
}

/// Finishes a design request. One that is not running is left unchanged.
#[derive(Debug, Clone)]
pub struct FinishDesignRequest {
    /// Number of the request.
    pub id: i64,
    /// Id of the run.
    pub run: String,
    /// Id of the task.
    pub task: String,
    /// Place on the rungs of the task that was designed for.
    pub place: Place,
    /// Layouts that were made.
    pub made: Vec<MadeLayout>,
    /// Tokens and cost of the language model.
    pub usage: DesignUsage,
    /// Errors that did not end the request.
    pub warnings: Vec<String>,
    /// Why the request failed, if it did.
    pub error: Option<String>,
    /// Time that the request took.
    pub elapsed: Duration,
}

impl Change for FinishDesignRequest {
    /// Number of admitted layouts.
    type Output = usize;

    async fn apply(self, tx: &mut WriteTx) -> Result<usize, ServiceError> {
        let (conn, now) = (&mut tx.conn, tx.now);
        let request = design_requests::get(conn, &self.run, self.id).await?;
        let Some(request) = request.filter(|request| request.state == RequestState::Running) else {
            return Ok(0);
        };
        let counts = self.store_layouts(conn, request.designer.as_str(), now).await?;
        let (id, run, task) = (self.id, self.run.clone(), self.task.clone());
        let result = self.into_result(&counts);
        design_requests::finish(conn, id, &result, now).await?;
        let event = RunEvent::Design {
            request: DesignRequestId(id).to_string(),
            task: &task,
            designer: request.designer,
            admitted: result.admitted,
            refused: result.refused,
            error: result.error.as_deref(),
        };
        tx.emit(&run, &event)?;
        Ok(counts.admitted)
    }
}

/// Layouts of a request by verdict.
#[derive(Debug, Default)]
struct LayoutCounts {
    admitted: usize,
    refused: usize,
    /// Admitted layouts of the designer that the request is for.
    own: i64,
}

impl FinishDesignRequest {
    /// Stores and counts the layouts.
    async fn store_layouts(
        &self,
        conn: &mut SqliteConnection,
        requested_designer: &str,
        now: Millis,
    ) -> Result<LayoutCounts, StoreError> {
        let train_groups_at = design_counters::groups(conn, &self.run).await?.all;
        let mut counts = LayoutCounts::default();
        let mut verdicts: BTreeMap<&str, i64> = BTreeMap::new();
        for MadeLayout { designer, judged } in &self.made {
            let is_admitted = judged.verdict.is_ok();
            let count = if is_admitted { &mut counts.admitted } else { &mut counts.refused };
            *count += 1;
            let is_stored = *count <= MAX_STORED_LAYOUTS;
            counts.own += i64::from(is_admitted && *designer == requested_designer);
            let verdict =
                judged.verdict.as_ref().map_or_else(|refusal| refusal.check().as_str(), |_| ADMITTED);
            *verdicts.entry(verdict).or_default() += 1;
            if is_stored {
                let row = self.row(designer, judged, train_groups_at);
                store_layout(conn, &row, judged, now).await?;
            }
        }
        for (verdict, count) in verdicts {
            metrics::record_layouts(verdict, count);
            let added = GateCount { task: self.task.clone(), verdict: verdict.to_owned(), count };
            design_counters::add_verdict(conn, &self.run, &added).await?;
        }
        Ok(counts)
    }

    /// Returns the result of the request as it is stored.
    fn into_result(self, counts: &LayoutCounts) -> DesignRequestResult {
        let DesignUsage { model, prompt, rounds, tokens_in, tokens_out, cost, .. } = self.usage;
        let mut warnings: Vec<String> =
            self.warnings.iter().take(MAX_WARNINGS).map(|warning| shorten(warning, 500)).collect();
        if counts.admitted > MAX_STORED_LAYOUTS {
            let admitted = counts.admitted;
            warnings
                .push(format!("{admitted} layouts were admitted; the first {MAX_STORED_LAYOUTS} are stored"));
        }
        DesignRequestResult {
            admitted: counts.admitted as i64,
            admitted_without_fallback: counts.own,
            refused: counts.refused as i64,
            model: model.map(|model| shorten(&model, 200)),
            prompt_version: prompt.map(|prompt| shorten(&prompt, 200)),
            rounds: i64::from(rounds),
            tokens_in: to_i64(tokens_in),
            tokens_out: to_i64(tokens_out),
            // SQLite would store a NaN as NULL.
            cost: if cost.is_finite() { cost } else { 0.0 },
            latency_ms: i64::try_from(self.elapsed.as_millis()).unwrap_or(i64::MAX),
            warnings,
            error: self.error.map(|error| shorten(&error, 1000)),
        }
    }

    /// Returns the row of a layout.
    fn row(&self, designer: &str, judged: &JudgedLayout, train_groups_at: i64) -> NewLayout {
        let submitted = judged.design.as_ref();
        let admitted = judged.verdict.as_ref().ok();
        // The provenance of an admitted layout is the design as the gate parsed it.
        let parsed = admitted.and_then(|a| a.scenario().recipe().layout()?.provenance.as_ref());
        let design = parsed.or(submitted);
        let text =
            design.map(Value::to_string).filter(|text| admitted.is_some() || text.len() <= MAX_REFUSED_BYTES);
        let at = |path: &str| design.and_then(|design| design.pointer(path));
        let word = |path: &str| at(path).and_then(Value::as_str).map(|word| shorten(word, 60));
        let refusal = judged.verdict.as_ref().err();
        NewLayout {
            request: self.id,
            run: self.run.clone(),
            task: self.task.clone(),
            level: self.place.level.map(i64::from),
            start_rung: self.place.start_rung.map(i64::from),
            designer: designer.to_owned(),
            name: shorten(&judged.name, 200),
            design: text,
            mode: word("/aim/mode"),
            bearing_deg: at("/aim/bearing_deg").and_then(Value::as_i64).filter(|b| (0..360).contains(b)),
            frame: word("/frame"),
            round: i64::from(judged.round),
            state: state_of(judged),
            gate_check: refusal.map(|refusal| refusal.check().as_str().to_owned()),
            refusal_reason: refusal.map(|refusal| shorten(&refusal.to_string(), 1000)),
            kind: admitted.map(|a| stored_kind(a.kind())),
            novelty: admitted
                .and_then(designer::AdmittedLayout::novelty)
                .filter(|novelty| novelty.is_finite()),
            scenario: admitted.map(|a| a.scenario().id().0.to_vec()),
            training_groups_at_creation: train_groups_at,
        }
    }
}

/// Returns the state of a layout after the gate.
const fn state_of(judged: &JudgedLayout) -> LayoutState {
    if judged.verdict.is_ok() { LayoutState::Active } else { LayoutState::Refused }
}

/// Returns the kind of a layout as it is stored.
const fn stored_kind(kind: designer::LayoutKind) -> LayoutKind {
    match kind {
        designer::LayoutKind::Threat => LayoutKind::Threat,
        designer::LayoutKind::Decoy => LayoutKind::Decoy,
    }
}

/// Stores a layout, with its scenario and bracket if it was admitted.
async fn store_layout(
    conn: &mut SqliteConnection,
    row: &NewLayout,
    judged: &JudgedLayout,
    now: Millis,
) -> Result<(), StoreError> {
    if let (Ok(admitted), Some(id)) = (&judged.verdict, &row.scenario) {
        scenarios::insert(conn, &[admitted.scenario()]).await?;
        brackets::insert(conn, &[(id, admitted.bracket())]).await?;
    }
    let id = layouts::insert(conn, row, now).await?;
    let reason = row.refusal_reason.clone().unwrap_or_else(|| "the gate admitted it".to_owned());
    layout_transitions::change_state(
        conn,
        id,
        &LayoutTransition { state: state_of(judged), retirement_reason: None, reason },
        now,
    )
    .await
}
