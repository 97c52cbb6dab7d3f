//! Crash test: a server is killed repeatedly while trainers use every interface of it.
//!
//! [`run_crash_test`] starts the trainers, kills the server (every fifth time it sends SIGTERM instead) and finally
//! compares the acknowledgements that the trainers received with the database. The trainers are in `trainers`, the
//! comparison is in `acknowledgements`, the processes that die in `processes`. `sessions` has the trainers that step environments on
//! the server.

mod acknowledgements;
mod faults;
mod processes;
mod progress;
mod sessions;
mod trainers;
mod workers;

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};
use serde_json::{Value, json};
use tokio::task::JoinSet;

use self::acknowledgements::ServerState;
pub use self::acknowledgements::{AcknowledgementLog, CrashReport};
use self::processes::{KilledProcesses, ServerExits};
pub use self::progress::CurriculumProgress;
use self::trainers::Trainer;
use crate::{ApiClient, TlsFiles, try_wait_for};

/// Id of the run that all trainers use.
const RUN: &str = "survivor";

const TASKING_TASKS: [&str; 3] = ["tasking/scanning", "tasking/imaging", "tasking/constellation"];

/// When the test stops to kill servers.
#[derive(Debug, Clone, Copy)]
pub enum StopCondition {
    /// Stops after `kills` kills, but not before each interface has acknowledged `episodes` episodes: a busy machine
    /// needs more kills for as many.
    Kills {
        /// Least number of kills.
        kills: u32,
        /// Least number of acknowledged episodes of each interface.
        episodes: usize,
    },
    /// Stops after this time.
    Time(Duration),
}

/// World of the episodes of a crash test.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CrashWorld {
    /// Two tasks of kessler.
    Kessler,
    /// All tasks of tasking, with short episodes of one level.
    ShortTasking,
    /// All tasks of tasking at their own levels, with designed layouts. Probes are the evidence, because sessions that
    /// hold would keep every task at its first level: they are those of the heuristic, then of the reference planner.
    Tasking,
}

impl CrashWorld {
    /// Settings of the run for its tasks.
    fn settings(self) -> Value {
        match self {
            Self::Kessler => json!({"tasks": ["kessler/survival", "kessler/eco_station"]}),
            Self::Tasking => json!({
                "tasks": TASKING_TASKS,
                "design": {"designer": "procedural", "share": 0.3},
                "evidence_from": "probe",
            }),
            Self::ShortTasking => {
                let table =
                    |columns: Value, row: Value| json!({"levels": {"columns": columns, "rows": [row]}});
                let imaging = table(json!(["targets", "time_limit_s"]), json!([500, 1800]));
                json!({
                    "tasks": TASKING_TASKS,
                    "task_settings": {
                        "tasking/scanning": table(json!(["time_limit_s"]), json!([1800])),
                        "tasking/imaging": imaging,
                        "tasking/constellation": imaging,
                    },
                })
            }
        }
    }

    /// Policies of the episodes that trainers claim by columns, and of the server's rollouts.
    pub(crate) const fn policies(self) -> CrashPolicies {
        match self {
            Self::Tasking => CrashPolicies { columns: "heuristic", rollouts: "heuristic" },
            Self::Kessler | Self::ShortTasking => CrashPolicies { columns: "hold", rollouts: "random" },
        }
    }

    /// Observation of a vector session.
    pub(crate) const fn vector_observation(self) -> &'static str {
        match self {
            Self::Kessler => "tracks",
            Self::ShortTasking | Self::Tasking => "all",
        }
    }
}

/// Built-in policies of a crash test.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CrashPolicies {
    /// Policy of the episodes in claims of columns.
    pub(crate) columns: &'static str,
    /// Policy of the rollouts on the server.
    pub(crate) rollouts: &'static str,
}

/// Settings of a crash test.
#[derive(Debug, Clone, Copy)]
pub struct CrashPlan {
    /// World of the episodes.
    pub world: CrashWorld,
    /// When the test ends.
    pub until: StopCondition,
    /// Seed of the times at which servers are killed, and of the run.
    pub seed: u64,
    /// Shortest time from the start of a server to its kill, in milliseconds.
    pub min_lifetime_ms: u64,
    /// Longest time from the start of a server to its kill, in milliseconds.
    pub max_lifetime_ms: u64,
    /// True if the run keeps few leases in full, so that servers are also killed while they compact.
    pub compacts: bool,
    /// True if the trainers connect with TLS.
    pub tls: bool,
    /// True if the disk is full, a sync fails or another process locks the database when some servers are killed. Linux only.
    pub faults: bool,
    /// Number of workers on NATS, which do jobs of all kinds but those of language models and policy files; with any, they and NATS are
    /// killed, too.
    pub workers: usize,
    /// Pause of a trainer between two leases or episodes, in milliseconds; 0 loads the machine fully.
    pub trainer_pause_ms: u64,
    /// True if Ctrl-C and SIGTERM end the test early, with its report; they no longer end the process.
    pub ends_on_signal: bool,
    /// Interval of progress lines on stderr, in seconds; 0 prints none.
    pub progress_interval_s: u64,
}

/// Trains against a server that is killed and restarted, then compares acknowledgements with the database. If the plan says so,
/// Ctrl-C and SIGTERM end the test early, and its report is that of the time until then.
///
/// # Errors
/// Returns an error if the server rejects a valid request, if a trainer fails, or if an acknowledged result is
/// missing or counted twice. It has the counts until then.
pub async fn run_crash_test(db: &Path, plan: CrashPlan) -> anyhow::Result<CrashReport> {
    let mut interruption = Interruption::install(plan.ends_on_signal)?;
    let tls = plan.tls.then(TlsFiles::create);
    let mut processes = KilledProcesses::start(db, plan, tls.as_ref())?;
    let server = processes.server()?;
    let api = tls.as_ref().map_or_else(|| server.api(), |tls| tls.api(server.url()));
    create_run(&api, plan).await?;
    let test = CrashTest { plan, api, log: Arc::default(), start: Instant::now() };
    let report = test.run(&mut processes, &mut interruption).await;
    report.with_context(|| test.progress_line(processes.exits()))
}

/// A crash test that runs.
struct CrashTest {
    plan: CrashPlan,
    api: ApiClient,
    log: Arc<AcknowledgementLog>,
    start: Instant,
}

impl CrashTest {
    /// Kills processes under trainers until the test ends, and compares.
    async fn run(
        &self,
        processes: &mut KilledProcesses,
        interruption: &mut Interruption,
    ) -> anyhow::Result<CrashReport> {
        let Self { plan, api, log, start } = self;
        let stop = Arc::new(AtomicBool::new(false));
        let mut trainers = spawn_trainers(|seed| Trainer::new(api, log, &stop, plan, seed), plan);
        let mut last_progress = Instant::now();
        let mut is_interrupted = false;
        while !is_interrupted && self.continues(processes.exits().kills) {
            tokio::select! {
                () = processes.live() => {}
                () = interruption.received() => is_interrupted = true,
                Some(ended) = trainers.join_next() => {
                    ended??;
                    anyhow::bail!("a trainer ended before the test");
                }
            }
            if is_interrupted {
                print_progress("interrupted: the acknowledgements are compared with the database")?;
                processes.replace_server().await;
            } else {
                processes.kill_and_restart(api).await?;
            }
            let interval = Duration::from_secs(plan.progress_interval_s);
            if !interval.is_zero() && last_progress.elapsed() > interval {
                last_progress = Instant::now();
                print_progress(&self.progress_line(processes.exits()))?;
            }
        }
        let elapsed = start.elapsed();
        stop.store(true, Ordering::SeqCst);
        processes.recover();
        while let Some(ended) = trainers.join_next().await {
            ended??;
        }
        let report = drain_and_compare(api, log, processes.exits()).await?;
        processes.stop()?;
        Ok(CrashReport { elapsed_s: elapsed.as_secs(), is_interrupted, ..report })
    }

    /// True if the test goes on after so many kills.
    fn continues(&self, kills: u32) -> bool {
        match self.plan.until {
            StopCondition::Kills { kills: least, episodes } => {
                kills < least || self.log.fewest_episodes() < episodes
            }
            StopCondition::Time(duration) => self.start.elapsed() < duration,
        }
    }

    /// Counts until now, in one line.
    fn progress_line(&self, exits: ServerExits) -> String {
        let seconds = self.start.elapsed().as_secs_f64();
        let ServerExits { kills, stops, remote } = exits;
        let killed = format!("{} workers, {} NATS servers", remote.workers, remote.nats);
        format!("{seconds:>6.0} s, {kills} kills, {stops} stops, {killed}: {}", self.log.summary_line())
    }
}

/// Signals that end a test early: Ctrl-C and, on Unix, SIGTERM.
struct Interruption {
    #[cfg(unix)]
    signals: Option<[tokio::signal::unix::Signal; 2]>,
}

impl Interruption {
    /// Installs the handlers if the plan asks for them.
    fn install(is_wanted: bool) -> std::io::Result<Self> {
        #[cfg(unix)]
        {
            use tokio::signal::unix::{SignalKind, signal};
            let signals =
                || std::io::Result::Ok([signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?]);
            Ok(Self { signals: is_wanted.then(signals).transpose()? })
        }
        #[cfg(not(unix))]
        {
            let _ = is_wanted;
            Ok(Self {})
        }
    }

    /// Waits for a signal.
    async fn received(&mut self) {
        #[cfg(unix)]
        if let Some([interrupt, terminate]) = &mut self.signals {
            tokio::select! {
                _ = interrupt.recv() => return,
                _ = terminate.recv() => return,
            }
        }
        std::future::pending::<()>().await;
    }
}

/// Starts the trainers of a plan. Each has a seed.
fn spawn_trainers(trainer: impl Fn(u64) -> Trainer, plan: &CrashPlan) -> JoinSet<anyhow::Result<()>> {
    let mut trainers = JoinSet::new();
    trainers.spawn(trainer(1).report_results());
    trainers.spawn(trainer(2).report_results());
    trainers.spawn(trainer(3).claim_columns());
    trainers.spawn(trainer(4).step_sessions());
    trainers.spawn(trainer(5).step_sessions());
    trainers.spawn(trainer(6).consume_trajectories());
    trainers.spawn(trainer(7).step_vectors());
    if plan.workers > 0 {
        trainers.spawn(trainer(9).request_designs());
    }
    if plan.world == CrashWorld::Tasking {
        trainers.spawn(trainer(8).report_probes(TASKING_TASKS.len()));
    }
    trainers
}

/// Creates the run and the policy of its server rollouts.
async fn create_run(api: &ApiClient, plan: CrashPlan) -> anyhow::Result<()> {
    let retention = match plan.compacts {
        true => json!({"episodes": 200, "claimed": 400}),
        false => json!({"episodes": "all", "claimed": "all"}),
    };
    let mut settings = json!({"strategy": "ladder", "id": RUN, "seed": plan.seed, "group_size": 2, "target": "mastery", "retention": retention});
    if plan.workers > 0 {
        // Workers design, too.
        settings["design"] = json!({"designer": "procedural", "share": 0.3});
    }
    for (name, value) in plan.world.settings().as_object().into_iter().flatten() {
        settings[name] = value.clone();
    }
    let created = api.post("/v1/runs", settings).await;
    ensure!(created.status == 201, "the run was not created: {}", created.body);
    let rollouts = plan.world.policies().rollouts;
    let policy = json!({"policy": rollouts, "version": 1, "max_unacknowledged_groups": 64}).to_string();
    let put = api.request("PUT", &format!("/v1/runs/{RUN}/policy"), "application/json", policy).await;
    ensure!(put.status == 200, "the policy was not set: {}", put.body);
    Ok(())
}

/// Stops server rollouts, releases active leases, waits for all critiques, then compares the log with the server.
async fn drain_and_compare(
    api: &ApiClient,
    log: &AcknowledgementLog,
    exits: ServerExits,
) -> anyhow::Result<CrashReport> {
    let off = json!({"policy": "off"}).to_string();
    let put = api.request("PUT", &format!("/v1/runs/{RUN}/policy"), "application/json", off).await;
    ensure!(put.status == 200, "the policy was not switched off: {}", put.body);
    for lease in list_all(api, "leases", "leases").await? {
        if lease["status"] == "active" {
            let path =
                format!("/v1/runs/{RUN}/leases/{}/release", lease["lease"].as_str().unwrap_or_default());
            let released = api.post(&path, json!({})).await;
            ensure!(released.status == 200, "{path}: {}", released.body);
        }
    }
    wait_for_critiques(api).await?;
    let undelivered = trainers::drain_feed(api, RUN).await?;
    let progress = CurriculumProgress::fetch(api, RUN).await?;
    let mastery = api.get(&format!("/v1/runs/{RUN}/mastery")).await.body;
    let episodes = list_all(api, "episodes", "episodes").await?;
    log.compare(exits, &ServerState { episodes, mastery, undelivered, progress })
}

/// Waits until all critiques are computed. Those of tasking are slow, so that the time is limited for a smaller backlog only.
async fn wait_for_critiques(api: &ApiClient) -> anyhow::Result<()> {
    let mut fewest = i64::MAX;
    while fewest > 0 {
        fewest = try_wait_for("fewer episodes wait for their critique", async || {
            let run = api.get(&format!("/v1/runs/{RUN}")).await.body;
            run["critique_backlog"]["waiting"].as_i64().filter(|waiting| *waiting < fewest)
        })
        .await?;
    }
    Ok(())
}

/// Fetches all pages of a list of the run; `field` is the list's name in a page.
async fn list_all(api: &ApiClient, resource: &str, field: &str) -> anyhow::Result<Vec<Value>> {
    let (mut items, mut cursor) = (Vec::new(), String::new());
    loop {
        let page = api.get(&format!("/v1/runs/{RUN}/{resource}?limit=500{cursor}")).await;
        ensure!(page.status == 200, "{resource}: {}", page.body);
        items.extend(page.body[field].as_array().context("the page has no list")?.clone());
        match page.body["next"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => return Ok(items),
        }
    }
}

fn print_progress(line: &str) -> std::io::Result<()> {
    use std::io::Write;
    writeln!(std::io::stderr(), "{line}")
}
