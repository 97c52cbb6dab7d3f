//! Stores critiques in a real database: every finding once, whatever the size of jobs and batches.

mod tasking;

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use api_types::RunRequest;
use env_core::critique::{Judgement, SpeedBands};
use env_core::{ActionLog, SeedSpace, rollout};
use proptest::prelude::*;
use store::critiques::{self, CritiqueCounters, CritiqueJob, NewCritiqueJob};
use store::failure_sectors::{self, InertialSectorRow};
use store::failures::{self, CellCounters, CellKey, FailureCursor, FailureFilter};
use store::leases::{self, Disclosure, LeaseForm, LeaseRow, LeaseStatus, Purpose};

use crate::critiques::criticise::PendingCritiques;
use crate::critiques::critique_input::{CritiqueEpisode, CritiqueInput, SelectedEpisode};
use crate::critiques::critique_result::CritiqueResult;
use crate::critiques::profile::{EpisodeFindings, FailureFinding, decay};
use crate::critiques::store_critiques::StoreCritiques;
use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::signals::WorkerSignals;
use crate::engine::write_tx::WriteTx;
use crate::engine::writer::Writer;
use crate::runs::create_run::CreateRun;
use crate::shards::Shards;
use clock::Clock;
use jobs::critique::{CritiqueFindings, EncounterFinding};
use jobs::seeds::seed_of;

const RUN: &str = "run";
const TASK: &str = "kessler/survival";
const BANDS: SpeedBands = SpeedBands { edges: &[1.0, 2.0], unit: "LU/TU" };

/// Stores a lease and enqueues jobs of these sizes.
struct EnqueueJobs {
    task: &'static str,
    sizes: Vec<usize>,
}

impl Change for EnqueueJobs {
    type Output = Vec<CritiqueJob>;

    async fn apply(self, tx: &mut WriteTx) -> Result<Vec<CritiqueJob>, ServiceError> {
        let row = LeaseRow {
            is_compacted: false,
            owner: None,
            id: leases::counters(&mut tx.conn, RUN).await?.next,
            id_suffix: "aaaaaa".to_owned(),
            run: RUN.to_owned(),
            purpose: Purpose::Train,
            form: LeaseForm::Groups,
            status: LeaseStatus::Active,
            groups: 1,
            group_size: 1000,
            policy_version: 0,
            ttl_ms: 1000,
            created_at: 0,
            expires_at: 1000,
            first_expires_at: 0,
            disclosure: Disclosure::Lease,
        };
        leases::insert(&mut tx.conn, &row, &[]).await?;
        let mut first = 0;
        for size in self.sizes {
            let numbers: Vec<i64> = (first..).take(size).collect();
            first += size as i64;
            let job = NewCritiqueJob { task: self.task, lease: row.id, numbers: &numbers };
            critiques::enqueue(&mut tx.conn, RUN, &[job]).await?;
        }
        Ok(critiques::oldest(&mut tx.conn, 1000).await?)
    }
}

/// Everything that the store keeps of critiques.
#[derive(Debug, PartialEq)]
struct StoredProfile {
    sums: CritiqueCounters,
    cells: Vec<(CellKey, CellCounters)>,
    inertial: Vec<InertialSectorRow>,
    waiting: i64,
}

struct ReadProfile(&'static str);

impl Change for ReadProfile {
    type Output = StoredProfile;

    async fn apply(self, tx: &mut WriteTx) -> Result<StoredProfile, ServiceError> {
        let conn = &mut tx.conn;
        let cells = failures::profile(conn, RUN, self.0).await?;
        Ok(StoredProfile {
            sums: critiques::counters(conn, RUN, self.0).await?,
            cells: cells.into_iter().map(|cell| (cell.key, cell.counters)).collect(),
            inertial: failure_sectors::of_task(conn, RUN, self.0).await?,
            waiting: critiques::waiting_by_run(conn).await?.values().sum(),
        })
    }
}

struct ReadExamples(FailureFilter, i64);

impl Change for ReadExamples {
    type Output = Vec<failures::ListedFailure>;

    async fn apply(self, tx: &mut WriteTx) -> Result<Vec<failures::ListedFailure>, ServiceError> {
        Ok(failures::examples(&mut tx.conn, RUN, TASK, &self.0, self.1).await?)
    }
}

async fn open(db: &Path) -> Writer {
    let connection = store::open_writer(db).await.unwrap();
    let (writer, _) = Writer::start(connection, None, Clock::manual(1_000).clock, WorkerSignals::default());
    let request = RunRequest {
        id: Some(RUN.to_owned()),
        tasks: Some(vec![TASK.to_owned(), tasking::TASK.to_owned()]),
        ..RunRequest::default()
    };
    writer.change(CreateRun::from_request(&request, &Shards::default()).unwrap()).await.unwrap();
    writer
}

fn collision(bearing_deg: f64, relative_speed: f64, avoidable: Option<bool>) -> env_core::critique::Failure {
    let encounter = env_core::critique::Encounter {
        body: 4,
        bearing_deg,
        bearing_inertial_deg: None,
        relative_speed,
        first_visible_step: avoidable.map(|_| 0),
        steps_left: 6,
        avoidable,
        cheapest_avoidance: None,
    };
    env_core::critique::Failure {
        mode: "collision",
        agent: 1,
        step: 7,
        encounter: Some(encounter),
        orbit_angle_deg: None,
        measures: Vec::new(),
        explanation: String::new(),
    }
}

fn critique(value: f64, failures: Vec<env_core::critique::Failure>) -> env_core::critique::Critique {
    let verdict =
        |verdict| env_core::critique::ActionVerdict { step: 1, agent: 0, cost: 1.0, verdict, gain: 0.0 };
    env_core::critique::Critique {
        failures,
        actions: [env_core::critique::Verdict::Needed, env_core::critique::Verdict::Harmful]
            .map(verdict)
            .to_vec(),
        assessment: Judgement { value, case: "missed", explanation: String::new() },
    }
}

/// Findings of an episode without a layout.
fn findings_of(number: i64, critique: &env_core::critique::Critique) -> Result<EpisodeFindings, String> {
    Ok(EpisodeFindings::new(number, None, CritiqueFindings::of(critique, BANDS)?))
}

/// Criticises a job as the worker does.
fn criticise(input: CritiqueInput) -> CritiqueResult {
    let (pending, batch) = PendingCritiques::take_episodes(vec![input]);
    pending.finish(jobs::critique::criticise(&batch)).remove(0)
}

fn result_of(job: CritiqueJob, findings: Vec<EpisodeFindings>) -> CritiqueResult {
    CritiqueResult { job, findings, skipped: 0, failed: 0, reason: None }
}

#[test]
fn critique_fills_the_cells_of_its_failures() {
    let decay = env_core::critique::Failure { mode: "decay", encounter: None, ..collision(0.0, 0.0, None) };
    let shown = critique(-0.5, vec![collision(-20.0, 2.0, Some(true)), decay]);
    let note = findings_of(3, &shown).unwrap();
    assert_eq!((note.number, note.judged, note.verdicts), (3, -0.5, [1, 0, 0, 1]));
    assert_eq!(
        note.failures[0].key,
        CellKey { mode: "collision".to_owned(), sector: Some(11), band: Some(2) }
    );
    assert_eq!(note.failures[1].key, CellKey { mode: "decay".to_owned(), sector: None, band: None });
    assert!(findings_of(3, &critique(f64::NAN, Vec::new())).is_err());
}

#[tokio::test]
async fn findings_read_back_and_a_job_is_stored_once() {
    let folder = tempfile::tempdir().unwrap();
    let writer = open(&folder.path().join("x.sqlite3")).await;
    let jobs = writer.change(EnqueueJobs { task: TASK, sizes: vec![100, 3] }).await.unwrap();
    assert_eq!(writer.change(ReadProfile(TASK)).await.unwrap().waiting, 103);
    let notes = |count: i64| {
        let note = |n| findings_of(n, &critique(0.25, vec![collision(95.0, 1.5, Some(n % 2 == 0))]));
        (0..count).map(|n| note(n).unwrap()).collect::<Vec<_>>()
    };
    let first = || result_of(jobs[0].clone(), notes(100));
    writer.change(StoreCritiques(vec![first()])).await.unwrap();
    let once = writer.change(ReadProfile(TASK)).await.unwrap();
    let closed: f64 = (0..100).map(|i| decay(1.0, i)).sum();
    let (key, cell) = &once.cells[0];
    assert_eq!((key.sector, key.band, once.cells.len(), once.waiting), (Some(3), Some(1), 1, 3));
    assert_eq!((cell.count, cell.avoidable, cell.unavoidable, cell.steps_left), (100, 50, 50, 600));
    assert_eq!((cell.as_of, cell.last_at), (100, 1_000));
    // 100 multiplications and additions below 128: at most 1e-12 together.
    assert!((cell.weight - closed).abs() < 1e-11, "{} is not {closed}", cell.weight);
    assert_eq!((once.sums.criticised, once.sums.judgement.overall), (100, 25.0));
    assert_eq!(once.sums.verdicts.map(|v| v.overall), [100, 0, 0, 100]);

    // A worker that stopped after its commit repeats the job: nothing changes.
    writer.change(StoreCritiques(vec![first()])).await.unwrap();
    assert_eq!(writer.change(ReadProfile(TASK)).await.unwrap(), once);

    // Skipped and failed episodes are counted only.
    let rest = CritiqueResult {
        skipped: 2,
        failed: 1,
        reason: Some("lost".to_owned()),
        ..result_of(jobs[1].clone(), Vec::new())
    };
    writer.change(StoreCritiques(vec![rest])).await.unwrap();
    let both = writer.change(ReadProfile(TASK)).await.unwrap();
    assert_eq!((both.sums.criticised, both.sums.skipped, both.sums.failed, both.waiting), (100, 2, 1, 0));
    assert_eq!(both.cells, once.cells);

    // A cell keeps its newest examples; pages list them from the newest.
    let all = writer.change(ReadExamples(FailureFilter::default(), 500)).await.unwrap();
    let numbers: Vec<i64> = all.iter().map(|k| k.example.number).collect();
    assert_eq!(numbers, (36..100).rev().collect::<Vec<_>>());
    let last = all[9].clone();
    let before = FailureCursor {
        episode_ordinal: last.example.episode_ordinal,
        cell: last.cell,
        ordinal: last.example.ordinal,
    };
    let wanted = FailureFilter { before: Some(before), ..FailureFilter::default() };
    assert_eq!(writer.change(ReadExamples(wanted, 5)).await.unwrap(), all[10..15]);
    let elsewhere = FailureFilter { sector: Some(4), ..FailureFilter::default() };
    assert!(writer.change(ReadExamples(elsewhere, 5)).await.unwrap().is_empty());
    let x = &all[0].example;
    assert_eq!(
        (x.sector_deg, x.relative_speed, x.steps_left, x.avoidable),
        (Some(95.0), Some(1.5), Some(6), Some(false))
    );
}

#[test]
fn failed_critique_is_counted_and_affects_no_other() {
    let task = env_core::task(TASK).unwrap();
    let recipe = env_core::Recipe::new(task).unwrap();
    let scenario = env_core::Scenario::new(recipe, seed_of(SeedSpace::Training, 1, 2, 3));
    let mut hold = task.policy("hold", &scenario, 0).unwrap();
    let log = rollout::roll_out(&scenario, &mut *hold).unwrap().log;
    let too_short = ActionLog::new(2, env_core::log::Precision::F64);
    let job = CritiqueJob {
        id: 1,
        run: RUN.to_owned(),
        task: TASK.to_owned(),
        lease: 1,
        group_size: 4,
        numbers: "[0,1,2,3]".to_owned(),
        episodes: 4,
    };
    let with = |log: &ActionLog| {
        Ok(CritiqueEpisode { scenario: scenario.clone(), layout: Some(7), log: log.clone() })
    };
    let episodes = [with(&log), Err("its log is gone".to_owned()), with(&too_short), with(&log)];
    let selected = (0..).zip(episodes).map(|(number, episode)| SelectedEpisode { number, episode }).collect();
    let result = criticise(CritiqueInput { job, selected, skipped: 0 });
    assert_eq!(result.findings.iter().map(|n| n.number).collect::<Vec<_>>(), [0, 3]);
    assert!(result.findings.iter().all(|found| found.layout == Some(7)));
    assert_eq!((result.failed, result.reason.as_deref()), (2, Some("episode 1: its log is gone")));
}

fn findings() -> impl Strategy<Value = Vec<EpisodeFindings>> {
    let failure = (0usize..3, 0u32..3, 0u32..2, proptest::option::of(any::<bool>()), 0u32..9);
    let failure = failure.prop_map(|(mode, sector, band, avoidable, steps_left)| FailureFinding {
        key: CellKey {
            mode: ["collision", "debris", "decay"][mode].to_owned(),
            sector: (mode < 2).then_some(sector),
            band: (mode < 2).then_some(band),
        },
        agent: 0,
        step: 5,
        inertial: (mode < 2).then_some((sector * 5 + band) % 12),
        sector_deg: (mode < 2).then_some(1.0),
        encounter: (mode < 2).then_some(EncounterFinding { relative_speed: 1.0, steps_left, avoidable }),
    });
    let failures = proptest::collection::vec(failure, 0..4);
    // The judged values are eighths, whose sums are exact in any order.
    let note = (-8i32..9, [0i64..4, 0..4, 0..4, 0..4], failures).prop_map(|(eighths, verdicts, failures)| {
        EpisodeFindings { number: 0, layout: None, judged: f64::from(eighths) / 8.0, verdicts, failures }
    });
    proptest::collection::vec(note, 1..60)
}

/// The part of a profile that does not depend on the order of episodes.
fn totals(profile: &StoredProfile) -> (CritiqueCounters, Vec<(CellKey, CellCounters)>) {
    let mut sums = profile.sums.clone();
    sums.judgement.recent = 0.0;
    sums.verdicts.iter_mut().for_each(|v| v.recent = 0.0);
    let still = |(key, cell): &(CellKey, CellCounters)| {
        (key.clone(), CellCounters { weight: 0.0, as_of: 0, ..*cell })
    };
    (sums, profile.cells.iter().map(still).collect())
}

/// Stores findings in jobs and batches of these sizes, and reads the profile.
async fn store(findings: Vec<EpisodeFindings>, sizes: &[usize], batch: usize) -> StoredProfile {
    static DATABASES: AtomicUsize = AtomicUsize::new(0);
    let folder = tempfile::tempdir().unwrap();
    let name = format!("{}.sqlite3", DATABASES.fetch_add(1, Ordering::Relaxed));
    let writer = open(&folder.path().join(name)).await;
    let mut parts: Vec<Vec<EpisodeFindings>> = Vec::new();
    let mut rest = findings;
    let mut sizes = sizes.iter().cycle();
    while !rest.is_empty() {
        let size = sizes.next().map_or(1, |s| *s).clamp(1, rest.len());
        let tail = rest.split_off(size);
        parts.push(std::mem::replace(&mut rest, tail));
    }
    let jobs =
        writer.change(EnqueueJobs { task: TASK, sizes: parts.iter().map(Vec::len).collect() }).await.unwrap();
    let mut all: Vec<CritiqueResult> =
        jobs.into_iter().zip(parts).map(|(job, findings)| result_of(job, findings)).collect();
    while !all.is_empty() {
        let tail = all.split_off(batch.min(all.len()));
        writer.change(StoreCritiques(std::mem::replace(&mut all, tail))).await.unwrap();
    }
    writer.change(ReadProfile(TASK)).await.unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn order_and_size_of_batches_do_not_change_totals(
        findings in findings(),
        sizes in proptest::collection::vec(1usize..9, 1..5),
        batch in 1usize..4,
        turn in 0usize..60,
    ) {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let one = runtime.block_on(store(findings.clone(), &[findings.len()], 1));
        let many = runtime.block_on(store(findings.clone(), &sizes, batch));
        prop_assert_eq!(&one, &many, "how episodes are batched changes nothing at all, to the bit");
        let mut turned = findings;
        let by = turn % turned.len();
        turned.rotate_left(by);
        let other = runtime.block_on(store(turned, &sizes, batch));
        prop_assert_eq!(totals(&one), totals(&other), "their order changes no total");
    }
}
