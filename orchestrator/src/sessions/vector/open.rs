//! Opening a vector session: what it is to fly, how large its frames are, and whether there is memory for it.

use std::collections::HashSet;
use std::sync::Arc;

use axum::body::Bytes;
use env_core::batch::book::Assigned;
use env_core::batch::{Autoreset, Batch, BatchConfig, BatchError, Feed, MAX_ENVS, Observe, Seeds, Shape};
use env_core::{Scenario, TaskSpec};
use uuid::Uuid;

use super::super::leased::{Held, for_no_runs, lock};
use super::super::seat::Seat;
use super::super::{Sessions, Who, WishError, Wished};
use super::book::Book;
use super::flock::Flock;
use super::frame::{Layout, MAX_IN, MAX_OUT};
use super::reports::Reports;
use super::{Leasing, Source, Vector, VectorError, on};

/// How the environments of a vector session are stepped.
#[derive(Clone)]
pub struct VectorWish {
    /// Environments.
    pub envs: usize,
    /// What happens when an episode is over.
    pub autoreset: Autoreset,
    /// What is observed.
    pub observe: Observe,
    /// Which task's episodes of a lease; needed where it has several.
    pub task: Option<&'static dyn TaskSpec>,
}

/// Recipes of a lease that are tried to see how large they are.
const TRIED: usize = 64;
/// Memory of an environment beyond what one that was just begun takes, in percent: rogues and fragments come.
const GROWTH: usize = 150;

/// A batch, and who is told there what a lease's environments begin next.
type Made = (Box<dyn Batch>, Option<Assigned>);

/// What is to be flown.
struct Plan {
    task: &'static dyn TaskSpec,
    config: BatchConfig,
    /// Those whose sizes are looked at; the first is the one whose observation is the largest, once that is known.
    starts: Vec<Scenario>,
    leased: bool,
}

impl Plan {
    fn feed(&self, envs: usize, start: &Scenario) -> (Box<dyn Feed>, Option<Assigned>) {
        if !self.leased {
            return (Box::new(Seeds::new(Arc::clone(start.recipe()), start.seed().get())), None);
        }
        let assigned = Assigned::new(envs, start);
        (Box::new(assigned.clone()), Some(assigned))
    }

    /// The sizes of one environment, its bytes, and the start that has the largest.
    fn measure(&mut self) -> Result<(Shape, usize), BatchError> {
        let (mut largest, mut bytes): (Option<Shape>, usize) = (None, 0);
        for at in 0..self.starts.len() {
            let (feed, _) = self.feed(1, &self.starts[at]);
            let mut one = self.task.batch(feed, BatchConfig { envs: 1, ..self.config })?;
            let shape = one.shape();
            one.reset(None, &mut vec![0.0; shape.observation])?;
            bytes = bytes.max(one.bytes_per_env());
            if largest.is_none_or(|known| shape.observation > known.observation) {
                largest = Some(shape);
                self.starts.swap(0, at);
            }
        }
        // There is at least one start.
        let shape = largest.ok_or(BatchError::Unsupported("there is nothing to fly"))?;
        Ok((Shape { envs: self.config.envs, ..shape }, bytes))
    }

    /// How the frames of so many environments look.
    fn layout(&self, shape: Shape) -> Result<Layout, VectorError> {
        let Shape { envs, agents, action, observation } = shape;
        let finals = self.config.autoreset == Autoreset::SameStep;
        let layout = Layout { envs, agents, action, observation, leased: self.leased, finals };
        if layout.most_bytes() > MAX_OUT || layout.actions_bytes() > MAX_IN {
            let reason = format!(
                "frames of so many would have {} MiB of answers and {} of actions; at most {} are sent and {} read",
                layout.most_bytes() >> 20,
                layout.actions_bytes() >> 20,
                MAX_OUT >> 20,
                MAX_IN >> 20
            );
            return Err(wrong("vector.envs", reason));
        }
        Ok(layout)
    }

    fn batch(&self) -> Result<Made, BatchError> {
        let (feed, assigned) = self.feed(self.config.envs, &self.starts[0]);
        Ok((self.task.batch(feed, self.config)?, assigned))
    }
}

fn wrong(field: &str, reason: impl Into<String>) -> VectorError {
    WishError { field: field.to_owned(), reason: reason.into() }.into()
}

impl Sessions {
    /// Opens a vector session.
    ///
    /// # Errors
    /// A wish that cannot be granted, and no place or memory for it.
    pub async fn open_vector(
        &self,
        who: &Who,
        wish: VectorWish,
        wished: Wished,
    ) -> Result<Vector, VectorError> {
        if wish.envs == 0 || wish.envs > MAX_ENVS {
            return Err(wrong("vector.envs", format!("it is {}, outside 1 to {MAX_ENVS}", wish.envs)));
        }
        if cfg!(target_endian = "big") {
            return Err(wrong("vector", "this server's processor has the other byte order"));
        }
        let seat = self.seat_for(who, &wished)?;
        let (plan, source, pool) = self.plan(&wish, wished).await?;
        let (plan, (shape, bytes)) = on(&self.threads, move || {
            let mut plan = plan;
            plan.measure().map(|sizes| (plan, sizes))
        })
        .await
        .ok_or(VectorError::Lost)??;
        let (leased, layout) = (plan.leased, plan.layout(shape)?);
        let Shape { envs, agents, action, .. } = shape;
        // Logs are kept of a lease's episodes until they are reported: at most a horizon of them.
        let log = if leased {
            plan.task.horizon(plan.starts[0].recipe()) as usize * agents * (4 + 8 * action)
        } else {
            0
        };
        let memory = self.memory(envs * (bytes * GROWTH / 100 + log) + Flock::bytes(layout))?;
        let task = plan.task;
        let book_pool = pool.clone();
        let (flock, first) = on(&self.threads, move || {
            let (batch, assigned) = plan.batch()?;
            let book = assigned
                .zip(book_pool)
                .map(|(assigned, pool)| Book::new(pool, task.id(), assigned, shape, wish.autoreset));
            let mut flock = Box::new(Flock::new(batch, layout, book));
            let first = flock.reset(0, None)?;
            Ok::<_, BatchError>((flock, first))
        })
        .await
        .ok_or(VectorError::Lost)??;
        let leasing = match (&source, pool) {
            (Source::Lease { run, .. }, Some(pool)) => {
                let reports = Reports::begin(&self.leased, run.clone());
                Some(Leasing { leased: Arc::clone(&self.leased), pool, reports })
            }
            _ => None,
        };
        let columns = flock.batch.columns();
        Ok(Vector {
            token: Uuid::new_v4().to_string(),
            task,
            source,
            autoreset: wish.autoreset,
            layout,
            columns,
            flock: Some(flock),
            steps: 0,
            last: (0, Bytes::clone(&first)),
            threads: Arc::clone(&self.threads),
            leasing,
            _seat: seat,
            _memory: memory,
        })
    }

    /// A place for who may fly what they wish for.
    fn seat_for(&self, who: &Who, wished: &Wished) -> Result<Seat, VectorError> {
        if !who.runs && !matches!(wished, Wished::Free(_)) {
            return Err(for_no_runs().into());
        }
        Ok(self.seat(who)?)
    }

    /// What is to be flown.
    async fn plan(
        &self,
        wish: &VectorWish,
        wished: Wished,
    ) -> Result<(Plan, Source, Option<Held>), VectorError> {
        let config = BatchConfig::new(wish.envs, wish.autoreset, wish.observe);
        match wished {
            Wished::Free(scenario) => {
                if wish.task.is_some() {
                    return Err(wrong("vector.task", "it is of a lease; say `task` beside `vector`"));
                }
                let (task, seed) = (scenario.task(), scenario.seed());
                Ok((
                    Plan { task, config, starts: vec![scenario], leased: false },
                    Source::Recipe { seed: seed.get() },
                    None,
                ))
            }
            Wished::Run { .. } => Err(wrong("lease_id", "it is missing: take a lease of the run first")),
            Wished::Lease { group: Some(_), .. } => {
                Err(wrong("group_id", "a vector session flies all of a lease; leave it out"))
            }
            Wished::Lease { episode: Some(_), .. } => {
                Err(wrong("episode_id", "a vector session flies all of a lease; leave it out"))
            }
            Wished::Lease { run, lease, .. } => {
                let pool = self.leased.shared(run.clone(), lease.clone()).await?;
                let (task, starts) = {
                    let pool = lock(&pool);
                    let mut tasks: Vec<&'static dyn TaskSpec> = Vec::new();
                    for (scenario, _) in pool.left() {
                        if tasks.iter().all(|task| task.id() != scenario.task().id()) {
                            tasks.push(scenario.task());
                        }
                    }
                    let task = chosen(&tasks, wish.task)?;
                    let mut seen = HashSet::new();
                    let of_task = pool.left().filter(|(scenario, _)| scenario.task().id() == task.id());
                    let distinct =
                        of_task.filter(|(scenario, _)| seen.insert(Arc::as_ptr(scenario.recipe())));
                    (task, distinct.take(TRIED).map(|(scenario, _)| scenario.clone()).collect())
                };
                Ok((Plan { task, config, starts, leased: true }, Source::Lease { run, lease }, Some(pool)))
            }
        }
    }
}

/// Which task of a lease is flown.
fn chosen(
    tasks: &[&'static dyn TaskSpec],
    wanted: Option<&'static dyn TaskSpec>,
) -> Result<&'static dyn TaskSpec, VectorError> {
    let known = || tasks.iter().map(|task| task.id()).collect::<Vec<_>>().join(", ");
    match (tasks, wanted) {
        ([], _) => Err(wrong("lease_id", "all episodes of this lease are flown or being flown")),
        (tasks, Some(wanted)) => {
            let found = tasks.iter().find(|task| task.id() == wanted.id());
            found
                .copied()
                .ok_or_else(|| wrong("vector.task", format!("the lease has episodes of {}", known())))
        }
        ([one], None) => Ok(*one),
        (_, None) => {
            let reason =
                format!("it is missing: the lease has episodes of {}, and a batch flies one", known());
            Err(wrong("vector.task", reason))
        }
    }
}
