//! Tests of the training loop against a curriculum in this process, without HTTP or a database.

mod local_feed;

use std::sync::atomic::AtomicBool;

use curriculum::{Curriculum, SequencedProposal, Settings, TaskPlan};
use env_core::{SeedSpace, rollout};
use jobs::prepare::{DrawContext, SeedSource, prepare, unsolvable::UnsolvableParams};
use orchestrator::service::{Config, Service};

use self::local_feed::LocalFeed;
use super::train::{LevelChange, MEMBERS, Progress, ProgressObserver, TrainingPlan, train};
use super::trainee::{LearnerMode, Member, Trainee};
use crate::api::{ApiClient, CaArgs};
use crate::options::TaskOptions;
use crate::output::OutputTarget;

/// Observer that is due after every batch and displays nothing.
struct SilentObserver;

impl ProgressObserver for SilentObserver {
    fn is_due(&self) -> bool {
        true
    }

    fn show(&mut self, _: &Progress) {}

    fn layouts_designed(&mut self, _: usize, _: &str) {}
    fn level_changed(&mut self, _: &LevelChange) {}
}

fn trained(kind: LearnerMode, seed: u64, episodes: usize) -> Progress {
    trained_on(TASK, kind, seed, episodes)
}

fn trained_on(task: &str, kind: LearnerMode, seed: u64, episodes: usize) -> Progress {
    let plan =
        TrainingPlan { kind, seed, episodes, tasks: vec![task.to_owned()], options: TaskOptions::new() };
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).build().unwrap();
    runtime
        .block_on(train(&LocalFeed::new(seed, &[task]), plan, &mut SilentObserver, &AtomicBool::new(false)))
        .unwrap()
}

const TASK: &str = "kessler/eco_station";

/// Returns a population's share of successes on contested scenarios of level 4, drawn from evaluation seeds.
fn fitness(members: &[Member]) -> f64 {
    let spec = env_core::task(TASK).unwrap();
    let mut curriculum =
        Curriculum::new(0, Settings::ladder(vec![TaskPlan::standard(TASK).unwrap()])).unwrap();
    let SequencedProposal { proposal, .. } = curriculum.propose(); // the first probe of a placement: level 4, contested
    assert_eq!((proposal.level, proposal.contested), (Some(4), true));
    let (mut successes, n) = (0, 40);
    for seq in 0..n {
        let prepared = prepare(
            SeedSource { space: SeedSpace::Evaluation, run_seed: 0, seq },
            &proposal,
            None,
            DrawContext { unsolvable: &UnsolvableParams::default(), is_wanted: &|| true },
        )
        .unwrap();
        for member in members {
            let mut policy = member.policy(&prepared.scenario).unwrap();
            let flown = rollout::roll_out(&prepared.scenario, &mut *policy).unwrap().outcome;
            successes += u32::from(spec.is_success(&flown, prepared.bracket.skill(flown.score)));
        }
    }
    f64::from(successes) / n as f64 / members.len() as f64
}

#[test]
fn the_learner_learns_and_climbs() {
    let before = fitness(Trainee::new(LearnerMode::Learn, MEMBERS, 12, 5).members());
    let progress = trained(LearnerMode::Learn, 5, 6000);
    let trainee = &progress.trainees[TASK];
    let after = fitness(trainee.members());
    println!("success at level 4: {before:.2} before, {after:.2} after; {:?}", progress.mastery[0]);
    // A uniform population succeeds in 0.2; measured over seeds, 6 000 episodes bring it above 0.8.
    assert!(before < 0.4 && after > before + 0.3, "{before} to {after}");
    assert!(trainee.generation() > 20);
    assert!(progress.mastery[0].level >= Some(2), "{:?}", progress.mastery);
    assert_eq!(progress.moves.last().map(|moved| moved.to), progress.mastery[0].level);
    assert!((6000..6000 + MEMBERS).contains(&progress.flown));
}

#[test]
fn doing_nothing_masters_nothing() {
    for kind in [LearnerMode::Hold, LearnerMode::Blind] {
        let progress = trained(kind, 2, 4000);
        assert_eq!(progress.mastery[0].level, Some(0));
        assert!(progress.moves.is_empty());
    }
}

/// The learner needs no knowledge of a world beyond its reflex.
#[test]
fn learner_learns_in_every_world() {
    let progress = trained_on("docking/multiagent", LearnerMode::Learn, 1, 3000);
    let trainee = &progress.trainees["docking/multiagent"];
    println!("{:?}, {:?}", trainee.last_success(), progress.mastery[0]);
    // Measured: level 1 after 2 700 episodes of this seed; holding and the blind plan never leave level 0.
    assert!(progress.mastery[0].level >= Some(1), "{:?}", progress.mastery);
    let words = super::summary::text_report(&progress, "r", None).render(OutputTarget::Terminal(100));
    assert!(words.contains("m/s") && !words.contains("LU"), "{words}");
    let held = trained_on("docking/multiagent", LearnerMode::Blind, 1, 600);
    assert!(held.mastery[0].mastery.unwrap().mean < 0.05, "{:?}", held.mastery);
}

#[test]
fn the_same_seed_is_the_same_run() {
    let (one, other) = (trained(LearnerMode::Learn, 3, 1500), trained(LearnerMode::Learn, 3, 1500));
    assert_eq!(one.trainees[TASK].members(), other.trainees[TASK].members());
    assert_ne!(one.trainees[TASK].members(), trained(LearnerMode::Learn, 4, 1500).trainees[TASK].members());
}

#[test]
fn stop_request_ends_leasing_and_still_sums_up() {
    let plan = TrainingPlan {
        kind: LearnerMode::Hold,
        seed: 1,
        episodes: 1200,
        tasks: vec![TASK.to_owned()],
        options: TaskOptions::new(),
    };
    let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
    let progress = runtime
        .block_on(train(&LocalFeed::new(1, &[TASK]), plan, &mut SilentObserver, &AtomicBool::new(true)))
        .unwrap();
    assert!(progress.stopped && progress.flown == 0 && progress.mastery.len() == 1);
}

#[test]
fn the_summary_says_what_happened() {
    let progress = trained(LearnerMode::Learn, 5, 3000);
    let words = super::summary::text_report(&progress, "r", Some(std::path::Path::new("x.sqlite3")))
        .render(OutputTarget::Terminal(100));
    for part in
        ["The learner ran 3000 episodes", TASK, "Mastered:", "look ahead", "sparring serve --db x.sqlite3"]
    {
        assert!(words.contains(part), "{part} is missing in\n{words}");
    }
    let summary = serde_json::to_value(super::summary::DemoSummary::new(&progress, "r", None)).unwrap();
    assert_eq!((&summary["learner"], &summary["episodes"]), (&"learn".into(), &3000.into()));
    let task = &summary["tasks"][TASK];
    assert!(task["level"].is_u64() && task["success"].is_f64() && task["episodes"] == 3000, "{summary}");
}

/// Runs the real service over HTTP. The order of requests does not depend on timing, so the seed decides the run. Designs
/// are the exception, since they arrive when they are finished.
#[test]
fn over_http_the_same_seed_is_the_same_run() {
    same_seed_over_http(
        "demo --temporary --designer off --episodes 1500 --seed 6 --task kessler/survival --task kessler/eco_station",
        1500,
    );
}

/// Covers long episodes and a number of agents that depends on the level.
#[test]
fn over_http_the_same_seed_is_the_same_run_in_every_world() {
    same_seed_over_http(
        "demo --temporary --episodes 480 --seed 6 --task docking/single --task docking/multiagent",
        480,
    );
}

/// Parses a command line without the name of the program.
fn parse_args(line: &str) -> super::Args {
    let command = <super::Args as clap::Args>::augment_args(clap::Command::new("demo"));
    <super::Args as clap::FromArgMatches>::from_arg_matches(&command.get_matches_from(line.split(' ')))
        .unwrap()
}

/// An active run without a trainer would be reported as stalled.
#[test]
fn the_run_is_paused_after_the_training() {
    let args = parse_args("demo --temporary --designer off --episodes 96 --task kessler/survival");
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    let run = runtime.block_on(async {
        let folder = tempfile::tempdir().unwrap();
        let service = Service::start(Config::local(folder.path().join("demo.sqlite3"))).await.unwrap();
        let (_, run) = super::train_at(&service.url(), &args).await.unwrap();
        let api = ApiClient::new(&service.url(), &CaArgs::default()).unwrap();
        let run: api_types::Run = api.get(&format!("/v1/runs/{run}")).await.unwrap();
        service.stop().await;
        run
    });
    assert_eq!((run.summary.activity, run.summary.episodes), (api_types::RunActivity::Paused, 96));
}

/// Runs the demo without its output.
async fn run_demo(args: &super::Args) -> anyhow::Result<(Progress, String)> {
    let folder = tempfile::tempdir()?;
    let service = Service::start(Config::local(folder.path().join("demo.sqlite3"))).await?;
    let trained = super::train_at(&service.url(), args).await;
    service.stop().await;
    trained
}

fn same_seed_over_http(line: &str, episodes: usize) {
    let args = parse_args(line);
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    let (one, _) = runtime.block_on(run_demo(&args)).unwrap();
    let (other, _) = runtime.block_on(run_demo(&args)).unwrap();
    assert_eq!((one.flown, one.late, one.stopped), (episodes, 0, false));
    assert_eq!(one.mastery.iter().map(|task| task.results.episodes).sum::<i64>(), episodes as i64);
    for (task, trainee) in &one.trainees {
        assert!(trainee.generation() > 0);
        assert_eq!(trainee.members(), other.trainees[task].members(), "{task}");
    }
    for (one, other) in one.mastery.iter().zip(&other.mastery) {
        assert_eq!((one.level, one.mastery, &one.results), (other.level, other.mastery, &other.results));
    }
}

/// Options reach the created run. Options that a server would refuse are refused before a server starts.
#[test]
fn options_are_the_runs_physics() {
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    let demo = |line: &str| runtime.block_on(run_demo(&parse_args(line)));
    let plain = "demo --temporary --episodes 240 --seed 6 --task kessler/survival";
    let (swept, run) = demo(&format!("{plain} --physics contact=swept --physics gravity=j2")).unwrap();
    let (other, _) = demo(plain).unwrap();
    assert_eq!((swept.flown, swept.late), (240, 0));
    assert_ne!(swept.mastery[0].results.score, other.mastery[0].results.score, "another physics");
    let words = super::summary::text_report(&swept, &run, None).render(OutputTarget::Terminal(100));
    assert!(words.contains("\nPhysics: kessler/survival: contact swept, gravity j2.\n"), "{words}");
    let summary = serde_json::to_value(super::summary::DemoSummary::new(&swept, &run, None)).unwrap();
    assert_eq!(summary["physics"]["kessler/survival"]["contact"], "swept");
    let refuse = |options: &str| format!("{:#}", demo(&format!("{plain} {options}")).unwrap_err());
    assert!(refuse("--physics contact=swept --physics risk=pc").contains("cannot be combined"));
    assert!(refuse("--physics compat=upstream").contains("which only scenarios made by hand may have"));
    assert!(refuse("--physics kessler/formation:risk=pc").contains("none of the tasks is kessler/formation"));
}
