//! What people do with designs: ask for some, take one out, put it back.

use designer::design_language;
use sqlx::SqliteConnection;

use crate::designs::layout_life::{LayoutLife, LayoutStatus};
use crate::designs::profile::CollectedProfile;
use crate::designs::demand::MOST;
use crate::designs::{DesignerChoice, DesignerKind};
use crate::ids::{DesignRequestId, LayoutId, RunId};
use crate::store::design_requests::{self, DesignRequestRow, NewDesignRequest, RequestOrigin};
use crate::store::layout_transitions::{self, LayoutTransition};
use crate::store::layouts::{self, LayoutRow};
use crate::store::{design_queue, layout_outcomes, to_json};
use crate::runs::settings::within;
use crate::engine::error::ServiceError;
use crate::engine::run_state::RunState;
use crate::engine::signals::Signal;
use crate::engine::run_tx::RunTx;
use crate::engine::write_tx::WriteTx;
use crate::engine::change::Change;

/// Asks of a run that may wait.
const WAITING: i64 = 16;

/// Asks a designer by hand.
#[derive(Debug)]
pub struct RequestDesign {
    /// For which run.
    pub run: RunId,
    /// For which task; none: the one that fails most.
    pub task: Option<String>,
    /// How many layouts: 1 to 32; none: the run's stock.
    pub n: Option<u32>,
    /// Who is asked; none: who designs for the run.
    pub designer: Option<DesignerChoice>,
    /// Whether there is a language model.
    pub has_llm: bool,
}

impl Change for RequestDesign {
    type Output = DesignRequestRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<DesignRequestRow, ServiceError> {
        let now = tx.now;
        let RunTx { state: mind, conn, .. } = tx.run(self.run.as_str()).await?;
        let wanted = self.n.unwrap_or(mind.settings.design.stock.min(MOST));
        within("n", wanted, 1, MOST)?;
        let which = self.which(mind)?;
        let task = self.task(conn, mind).await?;
        let open = design_queue::count_open(conn, self.run.as_str()).await?;
        if open >= WAITING {
            return Err(ServiceError::TooManyAsks(open));
        }
        let ask = NewDesignRequest {
            run: self.run.to_string(),
            task,
            designer: which,
            origin: RequestOrigin::Hand,
            wanted: i64::from(wanted),
        };
        let id = design_requests::insert(conn, &ask, now).await?;
        let row = design_requests::get(conn, self.run.as_str(), id).await?;
        tx.outbox.signal(Signal::Design);
        row.ok_or_else(|| ServiceError::UnknownAsk(DesignRequestId(id).to_string()))
    }
}

impl RequestDesign {
    fn which(&self, mind: &RunState) -> Result<DesignerKind, ServiceError> {
        let choice = self.designer.unwrap_or(mind.settings.design.designer);
        let fault = |words: &str| ServiceError::invalid("designer", words);
        let which = choice.which(self.has_llm).ok_or_else(|| match self.designer {
            Some(_) => fault("nobody designs then; choose auto, llm or procedural"),
            None => fault("nothing is designed for this run by itself: name one, auto, llm or procedural"),
        })?;
        if self.designer == Some(DesignerChoice::Llm) && !self.has_llm {
            return Err(fault("this server has no language model; procedural needs none"));
        }
        Ok(which)
    }

    async fn task(&self, conn: &mut SqliteConnection, mind: &RunState) -> Result<String, ServiceError> {
        let tasks = mind.settings.curriculum.tasks.iter().map(|plan| plan.task.as_str());
        let designable: Vec<&str> =
            tasks.filter(|id| env_core::task(id).is_some_and(|task| design_language(task).is_some())).collect();
        if let Some(wanted) = &self.task {
            return match designable.iter().find(|id| **id == wanted) {
                Some(id) => Ok((*id).to_owned()),
                None => {
                    let known = designable.join(", ");
                    let known = if known.is_empty() { "it has none".to_owned() } else { known };
                    let words = format!("it is none of the run's tasks that can be designed for: {known}");
                    Err(ServiceError::invalid("task", words))
                }
            };
        }
        let mut most: Option<(&str, f64)> = None;
        for id in designable {
            let failures = CollectedProfile::read(conn, &mind.run, id).await?.profile(id).total_weight();
            if most.is_none_or(|(_, held)| failures > held) {
                most = Some((id, failures));
            }
        }
        let none = || ServiceError::invalid("task", "none of the run's tasks can be designed for yet");
        most.map(|(id, _)| id.to_owned()).ok_or_else(none)
    }
}

/// Takes a layout out for good, or puts it back with a fresh window. Twice is the same as once.
#[derive(Debug)]
pub struct SetLayoutRetired {
    /// Of which run.
    pub run: RunId,
    /// Which.
    pub layout: LayoutId,
    /// Whether it should be out.
    pub retired: bool,
}

impl Change for SetLayoutRetired {
    type Output = LayoutRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<LayoutRow, ServiceError> {
        let now = tx.now;
        let conn = &mut tx.conn;
        let row = find(conn, &self.run, self.layout).await?;
        let standing = LayoutStatus::of(row.state, row.why)
            .ok_or_else(|| ServiceError::Refused(self.layout.to_string()))?;
        let done = if self.retired { standing == LayoutStatus::Hand } else { standing == LayoutStatus::Active };
        if done {
            return Ok(row);
        }
        let (standing, reason) = if self.retired {
            (LayoutStatus::Hand, "taken out by hand")
        } else {
            layout_outcomes::reset_recent(conn, row.id, &to_json(&LayoutLife::new().recent)?).await?;
            (LayoutStatus::Active, "put back by hand")
        };
        let (state, why) = standing.words();
        layout_transitions::change_state(conn, row.id, &LayoutTransition { state, why, reason: reason.to_owned() }, now).await?;
        find(conn, &self.run, self.layout).await
    }
}

/// A layout of this run.
///
/// # Errors
/// No such layout, or one of another run.
pub async fn find(
    conn: &mut SqliteConnection,
    run: &RunId,
    id: LayoutId,
) -> Result<LayoutRow, ServiceError> {
    let row = layouts::get(conn, id.0).await?.filter(|row| row.run == run.as_str());
    row.ok_or_else(|| ServiceError::UnknownLayout(id.to_string()))
}
