//! Crash test: a server is killed repeatedly while trainers use every interface of it.
//!
//! [`run_crash_test`] starts the trainers, kills the server (every fifth time it sends SIGTERM instead) and finally
//! compares the acknowledgements that the trainers received with the database. The trainers are in `trainers`, the
//! comparison is in `acknowledgements`. `sessions` has the trainers that step environments on the server.

mod acknowledgements;
mod faults;
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
use self::faults::RandomFaults;
pub use self::progress::CurriculumProgress;
use self::trainers::Trainer;
use self::workers::{RandomWorkers, RemoteExits};
use crate::{ApiClient, ServerProcess, TlsFiles, try_wait_for};

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
    /// Number of workers on NATS; with any, they and NATS are killed, too.
    pub workers: usize,
    /// Interval of progress lines on stderr, in seconds; 0 prints none.
    pub progress_interval_s: u64,
}

/// Number of exits of the server during a test.
#[derive(Debug, Clone, Copy, Default)]
struct ServerExits {
    /// Number of exits by SIGKILL.
    kills: u32,
    /// Number of exits by SIGTERM.
    stops: u32,
    /// Exits of the processes beside the server.
    remote: RemoteExits,
}

/// Processes that a crash test kills and starts again.
struct KilledProcesses {
    plan: CrashPlan,
    faults: RandomFaults,
    workers: RandomWorkers,
    /// Address of the server, the same after each start.
    address: String,
    options: Vec<String>,
    server: Option<ServerProcess>,
    exits: ServerExits,
}

impl KilledProcesses {
    /// Starts the first server, and the workers if the plan has some.
    fn start(db: &Path, plan: CrashPlan, tls: Option<&TlsFiles>) -> anyhow::Result<Self> {
        let (faults, workers) = (RandomFaults::new(db, plan.faults)?, RandomWorkers::start(plan.workers)?);
        let mut options = tls.map_or_else(Vec::new, |tls| tls.serve_options().to_vec());
        options.extend(workers.server_options());
        let server = faults.start_server("127.0.0.1:0", &options);
        let (address, exits) = (server.address().to_owned(), ServerExits::default());
        Ok(Self { plan, faults, workers, address, options, server: Some(server), exits })
    }

    /// Lets the server live for a while.
    async fn live(&mut self) {
        let lifetime = draw_lifetime_ms(&self.plan, self.exits.kills + self.exits.stops);
        // Tests the passing of time: the kill comes at a random moment.
        self.faults.live(Duration::from_millis(lifetime), self.exits.kills).await;
    }

    /// Kills the server, or stops it every fifth time, kills some workers, and starts them again.
    async fn kill_and_restart(&mut self, api: &ApiClient) -> anyhow::Result<()> {
        self.workers.count_jobs(api).await;
        let server = self.server.take().context("the server does not run")?;
        if (self.exits.kills + self.exits.stops) % 5 == 4 {
            ensure!(server.terminate() == Some(0), "the server did not exit with 0 after SIGTERM");
            self.exits.stops += 1;
        } else {
            server.kill();
            self.exits.kills += 1;
        }
        self.faults.clear().await;
        self.workers.kill_some(self.exits.kills + self.exits.stops);
        self.server = Some(self.faults.start_server(&self.address, &self.options));
        Ok(())
    }
}

/// Trains against a server that is killed and restarted, then compares acknowledgements with the database.
///
/// # Errors
/// Returns an error if the server rejects a valid request, if a trainer fails, or if an acknowledged result is
/// missing or counted twice.
pub async fn run_crash_test(db: &Path, plan: CrashPlan) -> anyhow::Result<CrashReport> {
    let tls = plan.tls.then(TlsFiles::create);
    let mut processes = KilledProcesses::start(db, plan, tls.as_ref())?;
    let server = processes.server.as_ref().context("the server does not run")?;
    let api = tls.as_ref().map_or_else(|| server.api(), |tls| tls.api(server.url()));
    create_run(&api, plan).await?;

    let (log, stop) = (Arc::new(AcknowledgementLog::default()), Arc::new(AtomicBool::new(false)));
    let mut trainers = spawn_trainers(|seed| Trainer::new(&api, &log, &stop, plan.world, seed), plan.world);
    let (start, mut last_progress) = (Instant::now(), Instant::now());
    let should_continue = |kills: u32| match plan.until {
        StopCondition::Kills { kills: least, episodes } => kills < least || log.fewest_episodes() < episodes,
        StopCondition::Time(duration) => start.elapsed() < duration,
    };
    while should_continue(processes.exits.kills) {
        tokio::select! {
            () = processes.live() => {}
            Some(ended) = trainers.join_next() => {
                ended??;
                anyhow::bail!("a trainer ended before the test");
            }
        }
        processes.kill_and_restart(&api).await?;
        if plan.progress_interval_s > 0
            && last_progress.elapsed() > Duration::from_secs(plan.progress_interval_s)
        {
            last_progress = Instant::now();
            let (seconds, kills) = (start.elapsed().as_secs_f64(), processes.exits.kills);
            print_progress(&format!("{seconds:>6.0} s, {kills} kills: {}", log.summary_line()))?;
        }
    }
    stop.store(true, Ordering::SeqCst);
    processes.workers.recover();
    while let Some(ended) = trainers.join_next().await {
        ended??;
    }
    let exits = ServerExits { remote: processes.workers.exits, ..processes.exits };
    let report = drain_and_compare(&api, &log, exits).await?;
    let server = processes.server.take().context("the server does not run")?;
    ensure!(server.terminate() == Some(0), "the last server did not exit with 0 after SIGTERM");
    Ok(report)
}

/// Starts the trainers of a world. Each has a seed.
fn spawn_trainers(trainer: impl Fn(u64) -> Trainer, world: CrashWorld) -> JoinSet<anyhow::Result<()>> {
    let mut trainers = JoinSet::new();
    trainers.spawn(trainer(1).report_results());
    trainers.spawn(trainer(2).report_results());
    trainers.spawn(trainer(3).claim_columns());
    trainers.spawn(trainer(4).step_sessions());
    trainers.spawn(trainer(5).step_sessions());
    trainers.spawn(trainer(6).consume_trajectories());
    trainers.spawn(trainer(7).step_vectors());
    if world == CrashWorld::Tasking {
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

/// Draws the lifetime of server number `index`, the same for the same seed (SplitMix64: Steele, Lea and Flood 2014).
fn draw_lifetime_ms(plan: &CrashPlan, index: u32) -> u64 {
    let mut z = plan.seed.wrapping_add(u64::from(index).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    plan.min_lifetime_ms + (z ^ (z >> 31)) % (plan.max_lifetime_ms - plan.min_lifetime_ms + 1)
}

fn print_progress(line: &str) -> std::io::Result<()> {
    use std::io::Write;
    writeln!(std::io::stderr(), "{line}")
}
