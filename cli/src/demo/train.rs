//! The training loop: lease, fly, report, learn.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use super::designs::Designs;
use super::feed::{Feed, Finished, Lease, MAX_RESULTS, Move, Receipts, TaskMastery, batches};
use super::fly::{fly, outcomes, sorties};
use super::trainee::{Kind, Trainee};
use crate::options::TaskOptions;

/// Members of a population, and so episodes of a group: siblings fly the same scenario, and are compared on it.
pub(super) const MEMBERS: usize = 12;
/// Groups leased at a time, per task.
const GROUPS_PER_TASK: usize = 8;

/// What to train.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    pub(super) kind: Kind,
    pub(super) seed: u64,
    /// Episodes to fly, up to a group more.
    pub(super) episodes: usize,
    pub(super) tasks: Vec<String>,
    /// Physics options that were asked for.
    pub(super) options: TaskOptions,
}

/// A change of level, and when.
#[derive(Debug, Clone)]
pub(super) struct Moved {
    pub(super) task: String,
    /// Episodes flown by then, over all tasks.
    pub(super) at: usize,
    pub(super) from: Option<u32>,
    pub(super) to: u32,
    pub(super) why: String,
}

/// How far it is.
#[derive(Debug)]
pub(super) struct Progress {
    pub(super) plan: Plan,
    pub(super) flown: usize,
    pub(super) elapsed: Duration,
    pub(super) trainees: BTreeMap<String, Trainee>,
    pub(super) moves: Vec<Moved>,
    /// As last asked for, in the order of the plan.
    pub(super) mastery: Vec<TaskMastery>,
    /// As last asked for.
    pub(super) designs: Designs,
    /// Layouts that were told of.
    told: BTreeSet<String>,
    /// Results that came too late to count.
    pub(super) late: usize,
    /// It was told to stop before its episodes were flown.
    pub(super) stopped: bool,
}

/// Who watches.
pub(super) trait Watch {
    /// Whether something new should be shown by now.
    fn due(&self) -> bool;
    /// Shows where things stand.
    fn show(&mut self, progress: &Progress);
    /// A level moved.
    fn moved(&mut self, moved: &Moved);
    /// Layouts were designed.
    fn designed(&mut self, at: usize, news: &str);
}

/// Trains until the episodes are flown, or `stop` is set: then what is leased is flown and no more is taken. (Leases given
/// back would count as episodes lost.)
pub(super) async fn train(
    feed: &impl Feed,
    plan: Plan,
    watch: &mut impl Watch,
    stop: &AtomicBool,
) -> anyhow::Result<Progress> {
    let started = Instant::now();
    let mut training = Training::new(feed, plan, stop);
    let mut ahead = training.lease().await?;
    while let Some(lease) = ahead.take() {
        ahead = training.step(&lease, watch).await?;
        training.progress.elapsed = started.elapsed();
        if watch.due() || ahead.is_none() {
            training.progress.look(feed, watch).await?;
            watch.show(&training.progress);
        }
    }
    let mut progress = training.progress;
    progress.stopped = progress.flown < progress.plan.episodes;
    progress.look(feed, watch).await?;
    progress.elapsed = started.elapsed();
    Ok(progress)
}

impl Progress {
    /// Asks where things stand, and tells of layouts that are new.
    async fn look(&mut self, feed: &impl Feed, watch: &mut impl Watch) -> anyhow::Result<()> {
        self.mastery = feed.mastery().await?;
        self.designs = feed.designs().await?;
        for news in self.designs.news(&mut self.told) {
            watch.designed(self.flown, &news);
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
    fn new(feed: &'a F, plan: Plan, stop: &'a AtomicBool) -> Self {
        let trainee = |(at, task): (u64, &String)| {
            // Seeds of one run's tasks must differ, and so must those of neighbouring runs.
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
            told: BTreeSet::new(),
            late: 0,
            stopped: false,
        };
        Self { feed, stop, progress, leased: 0, policy_version: 0 }
    }

    /// The next lease; none once enough is leased, or nobody wants more.
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

    /// Flies a lease while the next is taken, reports it, learns from it; the next.
    async fn step(&mut self, lease: &Lease, watch: &mut impl Watch) -> anyhow::Result<Option<Lease>> {
        let sorties = Arc::new(sorties(lease, &self.progress.trainees)?);
        let flying = {
            let sorties = Arc::clone(&sorties);
            tokio::task::spawn_blocking(move || fly(&sorties))
        };
        let next = self.lease().await?;
        let finished = flying.await??;
        let flown = finished.len();
        let Receipts { results, moves } = self.report(finished).await?;
        self.progress.flown += flown;
        self.progress.late += results.iter().filter(|receipt| receipt.status == "late").count();
        for (sortie, outcomes) in sorties.iter().zip(outcomes(&sorties, results)?) {
            if let Some(trainee) = self.progress.trainees.get_mut(&sortie.task) {
                trainee.take(&outcomes, sortie.contested);
            }
        }
        for trainee in self.progress.trainees.values_mut() {
            self.policy_version += u32::from(trainee.learn());
        }
        self.note(moves, watch);
        Ok(next)
    }

    /// Reports what was flown, in as few reports as the service takes it.
    async fn report(&self, finished: Vec<Finished>) -> anyhow::Result<Receipts> {
        let mut all = Receipts { results: Vec::with_capacity(finished.len()), moves: Vec::new() };
        for batch in batches(finished, MEMBERS) {
            let Receipts { results, moves } = self.feed.report(self.policy_version, batch).await?;
            all.results.extend(results);
            all.moves.extend(moves);
        }
        Ok(all)
    }

    fn note(&mut self, moves: Vec<Move>, watch: &mut impl Watch) {
        let at = self.progress.flown;
        for Move { task, from, to, evidence } in moves {
            let moved = Moved { task, at, from, to, why: evidence.sentence };
            watch.moved(&moved);
            self.progress.moves.push(moved);
        }
    }
}
