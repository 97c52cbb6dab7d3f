//! What people do with designs: ask for some, take one out, put it back.

use designer::language;
use sqlx::SqliteConnection;

use super::life::{Life, Standing};
use super::profile::Collected;
use super::stock::MOST;
use super::{DesignerChoice, Which};
use crate::ids::{AskId, LayoutId, RunId};
use crate::store::asks::{self, AskRow};
use crate::store::layouts::{self, LayoutRow, Turn};
use crate::store::to_json;
use crate::training::settings::within;
use crate::training::{Change, Mind, TrainingError, Work};

/// Asks of a run that may wait.
const WAITING: i64 = 16;

/// Asks a designer by hand.
#[derive(Debug)]
pub struct AskByHand {
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

impl Change for AskByHand {
    type Answer = AskRow;

    async fn apply(self, work: &mut Work) -> Result<AskRow, TrainingError> {
        let now = work.now;
        let (mind, conn) = work.mind(self.run.as_str()).await?;
        let wanted = self.n.unwrap_or(mind.settings.design.stock.min(MOST));
        within("n", wanted, 1, MOST)?;
        let which = self.which(mind)?;
        let task = self.task(conn, mind).await?;
        let open = asks::open(conn, self.run.as_str()).await?;
        if open >= WAITING {
            return Err(TrainingError::TooManyAsks(open));
        }
        let ask = AskRow {
            run: self.run.to_string(),
            task,
            designer: which.word().to_owned(),
            asked_by: "hand".to_owned(),
            wanted: i64::from(wanted),
            ..AskRow::default()
        };
        let id = asks::insert(conn, &ask, now).await?;
        let row = asks::get(conn, self.run.as_str(), id).await?;
        work.wake_design();
        row.ok_or_else(|| TrainingError::UnknownAsk(AskId(id).to_string()))
    }
}

impl AskByHand {
    fn which(&self, mind: &Mind) -> Result<Which, TrainingError> {
        let choice = self.designer.unwrap_or(mind.settings.design.designer);
        let fault = |words: &str| TrainingError::invalid("designer", words);
        let which = choice.which(self.has_llm).ok_or_else(|| match self.designer {
            Some(_) => fault("nobody designs then; choose auto, llm or procedural"),
            None => fault("nothing is designed for this run by itself: name one, auto, llm or procedural"),
        })?;
        if self.designer == Some(DesignerChoice::Llm) && !self.has_llm {
            return Err(fault("this server has no language model; procedural needs none"));
        }
        Ok(which)
    }

    async fn task(&self, conn: &mut SqliteConnection, mind: &Mind) -> Result<String, TrainingError> {
        let tasks = mind.settings.curriculum.tasks.iter().map(|plan| plan.task.as_str());
        let designable: Vec<&str> =
            tasks.filter(|id| env_core::task(id).is_some_and(|task| language(task).is_some())).collect();
        if let Some(wanted) = &self.task {
            return match designable.iter().find(|id| **id == wanted) {
                Some(id) => Ok((*id).to_owned()),
                None => {
                    let known = designable.join(", ");
                    let known = if known.is_empty() { "it has none".to_owned() } else { known };
                    let words = format!("it is none of the run's tasks that can be designed for: {known}");
                    Err(TrainingError::invalid("task", words))
                }
            };
        }
        let mut most: Option<(&str, f64)> = None;
        for id in designable {
            let failures = Collected::read(conn, &mind.run, id).await?.profile(id).failures();
            if most.is_none_or(|(_, held)| failures > held) {
                most = Some((id, failures));
            }
        }
        let none = || TrainingError::invalid("task", "none of the run's tasks can be designed for yet");
        most.map(|(id, _)| id.to_owned()).ok_or_else(none)
    }
}

/// Takes a layout out for good, or puts it back with a fresh window. Twice is the same as once.
#[derive(Debug)]
pub struct SetRetired {
    /// Of which run.
    pub run: RunId,
    /// Which.
    pub layout: LayoutId,
    /// Whether it should be out.
    pub retired: bool,
}

impl Change for SetRetired {
    type Answer = LayoutRow;

    async fn apply(self, work: &mut Work) -> Result<LayoutRow, TrainingError> {
        let now = work.now;
        let conn = &mut work.conn;
        let row = find(conn, &self.run, self.layout).await?;
        let standing = Standing::of(&row.state, row.why.as_deref())
            .ok_or_else(|| TrainingError::Refused(self.layout.to_string()))?;
        let done = if self.retired { standing == Standing::Hand } else { standing == Standing::Active };
        if done {
            return Ok(row);
        }
        let (standing, reason) = if self.retired {
            (Standing::Hand, "taken out by hand")
        } else {
            layouts::reset(conn, row.id, &to_json(&Life::new().recent)?).await?;
            (Standing::Active, "put back by hand")
        };
        let (state, why) = standing.words();
        layouts::turn(conn, row.id, &Turn { state, why, reason: reason.to_owned() }, now).await?;
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
) -> Result<LayoutRow, TrainingError> {
    let row = layouts::get(conn, id.0).await?.filter(|row| row.run == run.as_str());
    row.ok_or_else(|| TrainingError::UnknownLayout(id.to_string()))
}
