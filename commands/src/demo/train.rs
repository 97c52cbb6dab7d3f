//! The training loop: lease groups, roll them out, report the results, learn.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use api_types::{Lease, ReceiptStatus, ResultsResponse, TaskMastery};
use curriculum::LevelMove;

use super::designs::Designs;
use super::feed::{Feed, FinishedEpisode, MAX_RESULTS, batches};
use super::rollouts::{assign_groups, group_outcomes, roll_out_groups};
use super::trainee::{LearnerMode, Trainee};
use crate::options::TaskOptions;

/// Members of a population, and therefore episodes of a group: siblings run the same scenario and are compared on it.
pub(super) const MEMBERS: usize = 12;
/// Groups in one lease, per task.
const GROUPS_PER_TASK: usize = 8;

/// Settings of one training run.
#[derive(Debug, Clone)]
pub(super) struct TrainingPlan {
    pub(super) kind: LearnerMode,
    pub(super) seed: u64,
    /// Episodes to run; the last group may exceed it.
    pub(super) episodes: usize,
    pub(super) tasks: Vec<String>,
    /// Physics options from the command line, by task.
    pub(super) options: TaskOptions,
}

/// Change of a task's level, with its position in the training run.
#[derive(Debug, Clone)]
pub(super) struct LevelChange {
    pub(super) task: String,
    /// Episodes finished before the change, over all tasks.
    pub(super) at: usize,
    pub(super) from: Option<u32>,
    pub(super) to: u32,
    pub(super) why: String,
}

/// State of the training run after the latest batch.
#[derive(Debug)]
pub(super) struct Progress {
    pub(super) plan: TrainingPlan,
    pub(super) flown: usize,
    pub(super) elapsed: Duration,
    pub(super) trainees: BTreeMap<String, Trainee>,
    pub(super) moves: Vec<LevelChange>,
    /// Latest mastery of each task, in the order of the plan.
    pub(super) mastery: Vec<TaskMastery>,
    /// Latest designs of the run.
    pub(super) designs: Designs,
    /// Ids of layouts already reported to the observer.
    announced: BTreeSet<String>,
    /// Results that the service received after their lease ended; they do not count.
    pub(super) late: usize,
    /// True if training stopped before all planned episodes were run.
    pub(super) stopped: bool,
}

/// Receiver of progress updates.
pub(super) trait ProgressObserver {
    /// Returns true if the display needs an update.
    fn is_due(&self) -> bool;
    /// Displays the current progress.
    fn show(&mut self, progress: &Progress);
    /// Reports a change of level.
    fn level_changed(&mut self, change: &LevelChange);
    /// Reports new layouts in one sentence; `at` is the number of finished episodes.
    fn layouts_designed(&mut self, at: usize, news: &str);
}

/// Trains until all planned episodes are run or `stop` is set. After a stop, leased groups are still run but no more are
/// leased, because released groups would count as lost episodes.
pub(super) async fn train(
    feed: &impl Feed,
    plan: TrainingPlan,
    observer: &mut impl ProgressObserver,
    stop: &AtomicBool,
) -> anyhow::Result<Progress> {
    let started = Instant::now();
    let mut training = Training::new(feed, plan, stop);
    let mut ahead = training.lease().await?;
    while let Some(lease) = ahead.take() {
        ahead = training.step(&lease, observer).await?;
        training.progress.elapsed = started.elapsed();
        if observer.is_due() || ahead.is_none() {
            training.progress.refresh(feed, observer).await?;
            observer.show(&training.progress);
        }
    }
    let mut progress = training.progress;
    progress.stopped = progress.flown < progress.plan.episodes;
    progress.refresh(feed, observer).await?;
    progress.elapsed = started.elapsed();
    Ok(progress)
}

impl Progress {
    /// Fetches mastery and designs from the service and reports new layouts.
    async fn refresh(
        &mut self,
        feed: &impl Feed,
        observer: &mut impl ProgressObserver,
    ) -> anyhow::Result<()> {
        self.mastery = feed.mastery().await?;
        self.designs = feed.designs().await?;
        for news in self.designs.describe_new(&mut self.announced) {
            observer.layouts_designed(self.flown, &news);
        }
        Ok(())
    }
}

struct Training<'a, F> {
    feed: &'a F,
    stop: &'a AtomicBool,
    progress: Progress,
    leased: usize,
    /// Populations replaced so far, over all tasks.
    policy_version: u32,
}

impl<'a, F: Feed> Training<'a, F> {
    fn new(feed: &'a F, plan: TrainingPlan, stop: &'a AtomicBool) -> Self {
        let trainee = |(at, task): (u64, &String)| {
            // Seeds must differ between the tasks of one run and between neighbouring runs.
            let seed = plan.seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(at);
            let numbers = env_core::task(task).map_or(0, |spec| spec.reflex().names.len());
            (task.clone(), Trainee::new(plan.kind, MEMBERS, numbers, seed))
        };
        let trainees = (0..).zip(&plan.tasks).map(trainee).collect();
        let progress = Progress {
            plan,
            flown: 0,
            elapsed: Duration::ZERO,
            trainees,
            moves: Vec::new(),
            mastery: Vec::new(),
            designs: Designs::default(),
            announced: BTreeSet::new(),
            late: 0,
            stopped: false,
        };
        Self { feed, stop, progress, leased: 0, policy_version: 0 }
    }

    /// Leases the next groups. Returns `None` once all planned episodes are leased or a stop was requested.
    async fn lease(&mut self) -> anyhow::Result<Option<Lease>> {
        let plan = &self.progress.plan;
        let left = plan.episodes.saturating_sub(self.leased).div_ceil(MEMBERS);
        let groups = left.min(GROUPS_PER_TASK * plan.tasks.len()).min(MAX_RESULTS / MEMBERS);
        if groups == 0 || self.stop.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let lease = self.feed.lease(groups, self.policy_version).await?;
        self.leased += lease.groups.iter().map(|group| group.episodes.len()).sum::<usize>();
        Ok(Some(lease))
    }

    /// Runs a lease while the next one is requested, reports the results and learns from them. Returns the next lease.
    async fn step(
        &mut self,
        lease: &Lease,
        observer: &mut impl ProgressObserver,
    ) -> anyhow::Result<Option<Lease>> {
        let assignments = Arc::new(assign_groups(lease, &self.progress.trainees)?);
        let rollouts = {
            let assignments = Arc::clone(&assignments);
            tokio::task::spawn_blocking(move || roll_out_groups(&assignments))
        };
        let next = self.lease().await?;
        let finished = rollouts.await??;
        let flown = finished.len();
        let ResultsResponse { results, moves, .. } = self.report(finished).await?;
        self.progress.flown += flown;
        self.progress.late += results.iter().filter(|receipt| receipt.status == ReceiptStatus::Late).count();
        for (sortie, outcomes) in assignments.iter().zip(group_outcomes(&assignments, results)?) {
            if let Some(trainee) = self.progress.trainees.get_mut(&sortie.task) {
                trainee.record(&outcomes, sortie.contested);
            }
        }
        for trainee in self.progress.trainees.values_mut() {
            self.policy_version += u32::from(trainee.learn());
        }
        self.record_moves(moves, observer);
        Ok(next)
    }

    /// Reports finished episodes in as few requests as the service's limits allow.
    async fn report(&self, finished: Vec<FinishedEpisode>) -> anyhow::Result<ResultsResponse> {
        let results = Vec::with_capacity(finished.len());
        let mut all = ResultsResponse { results, moves: Vec::new(), groups: Vec::new(), refills: Vec::new() };
        for batch in batches(finished, MEMBERS) {
            let response = self.feed.report(self.policy_version, batch).await?;
            all.results.extend(response.results);
            all.moves.extend(response.moves);
        }
        Ok(all)
    }

    fn record_moves(&mut self, moves: Vec<LevelMove>, observer: &mut impl ProgressObserver) {
        let at = self.progress.flown;
        for LevelMove { task, from, to, evidence, .. } in moves {
            let change = LevelChange { task, at, from, to, why: evidence.sentence };
            observer.level_changed(&change);
            self.progress.moves.push(change);
        }
    }
}
