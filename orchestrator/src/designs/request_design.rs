//! Requests layouts from a designer, on request of a user.

use designer::design_language;
use sqlx::SqliteConnection;
use store::design_queue;
use store::design_requests::{self, DesignRequestRow, NewDesignRequest, RequestOrigin};
use store::ids::{DesignRequestId, RunId};

use crate::designs::demand::MAX_LAYOUTS_PER_REQUEST;
use crate::designs::profile::CollectedProfile;
use crate::designs::{DesignerChoice, DesignerKind, designer_kind};
use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::run_state::RunState;
use crate::engine::signals::Signal;
use crate::engine::write_tx::WriteTx;
use crate::runs::validate::check_range;

/// Maximum number of unfinished requests of a run.
const MAX_OPEN_REQUESTS: i64 = 16;
/// Reason why no design can be requested for a run.
const NO_DESIGNABLE_TASK: &str = "the run has no task with a design language";

/// Requests layouts from a designer. A worker runs the request.
#[derive(Debug)]
pub struct RequestDesign {
    /// Id of the run.
    pub run: RunId,
    /// Id of the task; by default the one with the largest failure weight.
    pub task: Option<String>,
    /// Number of layouts, 1 to 32; by default the run's reserve.
    pub count: Option<u32>,
    /// The designer; by default the run's.
    pub designer: Option<DesignerChoice>,
    /// True if the server or a connected worker has a language model for designs.
    pub has_llm: bool,
}

impl Change for RequestDesign {
    type Output = DesignRequestRow;

    async fn apply(self, tx: &mut WriteTx) -> Result<DesignRequestRow, ServiceError> {
        let run = tx.run(self.run.as_str()).await?;
        let wanted = self.count.unwrap_or(run.state.settings.design.reserve.min(MAX_LAYOUTS_PER_REQUEST));
        check_range("count", wanted, 1, MAX_LAYOUTS_PER_REQUEST)?;
        let designer = self.designer_kind(&run.state)?;
        let task = self.task_id(run.conn, &run.state).await?;
        let open = design_queue::count_open(run.conn, self.run.as_str()).await?;
        if open >= MAX_OPEN_REQUESTS {
            return Err(ServiceError::TooManyDesignRequests(open));
        }
        let request = NewDesignRequest {
            run: self.run.to_string(),
            task,
            designer,
            requested_by: RequestOrigin::User,
            wanted: i64::from(wanted),
        };
        let id = design_requests::insert(run.conn, &request, run.now).await?;
        let row = design_requests::get(run.conn, self.run.as_str(), id).await?;
        run.outbox.signal(Signal::Design);
        row.ok_or_else(|| ServiceError::UnknownDesignRequest(DesignRequestId(id).to_string()))
    }
}

impl RequestDesign {
    /// Returns the designer that is asked.
    fn designer_kind(&self, state: &RunState) -> Result<DesignerKind, ServiceError> {
        let choice = self.designer.unwrap_or(state.settings.design.designer);
        let invalid = |reason: &str| ServiceError::invalid("designer", reason);
        let designer = designer_kind(choice, self.has_llm).ok_or_else(|| match self.designer {
            Some(_) => invalid("must be auto, llm or procedural, got \"off\""),
            None => {
                invalid("is required, because the run has designs off; set it to auto, llm or procedural")
            }
        })?;
        if self.designer == Some(DesignerChoice::Llm) && !self.has_llm {
            return Err(invalid(
                "must be procedural, because neither the server nor a connected worker has a language model for designs; start one of them with --llm-url for llm",
            ));
        }
        Ok(designer)
    }

    /// Returns the task that is designed for.
    async fn task_id(&self, conn: &mut SqliteConnection, state: &RunState) -> Result<String, ServiceError> {
        let tasks = state.settings.curriculum.tasks.iter().map(|plan| plan.task.as_str());
        let designable: Vec<&str> = tasks
            .filter(|id| env_core::task(id).is_some_and(|task| design_language(task).is_some()))
            .collect();
        if let Some(wanted) = &self.task {
            return match designable.iter().find(|id| **id == wanted) {
                Some(id) => Ok((*id).to_owned()),
                None => {
                    let known = designable.join(", ");
                    let reason = if known.is_empty() {
                        NO_DESIGNABLE_TASK.to_owned()
                    } else {
                        format!("must be a task of the run with a design language: {known}")
                    };
                    Err(ServiceError::invalid("task", reason))
                }
            };
        }
        let mut worst: Option<(&str, f64)> = None;
        for id in designable {
            let failures = CollectedProfile::load(conn, &state.run, id).await?.profile(id).total_weight();
            if worst.is_none_or(|(_, weight)| failures > weight) {
                worst = Some((id, failures));
            }
        }
        let no_task = || ServiceError::invalid("task", NO_DESIGNABLE_TASK);
        worst.map(|(id, _)| id.to_owned()).ok_or_else(no_task)
    }
}
