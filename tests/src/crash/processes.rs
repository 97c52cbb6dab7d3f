//! Processes that a crash test kills and starts again.

use std::path::Path;
use std::time::Duration;

use anyhow::{Context, ensure};

use super::CrashPlan;
use super::faults::RandomFaults;
use super::workers::{RandomWorkers, RemoteExits};
use crate::{ApiClient, ServerProcess, TlsFiles};

/// Number of exits of the server during a test.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ServerExits {
    /// Number of exits by SIGKILL.
    pub(super) kills: u32,
    /// Number of exits by SIGTERM.
    pub(super) stops: u32,
    /// Exits of the processes beside the server.
    pub(super) remote: RemoteExits,
}

/// Processes that a crash test kills and starts again.
pub(super) struct KilledProcesses {
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
    pub(super) fn start(db: &Path, plan: CrashPlan, tls: Option<&TlsFiles>) -> anyhow::Result<Self> {
        let (faults, workers) = (RandomFaults::new(db, plan.faults)?, RandomWorkers::start(plan.workers)?);
        let mut options = tls.map_or_else(Vec::new, |tls| tls.serve_options().to_vec());
        options.extend(workers.server_options());
        let server = faults.start_server("127.0.0.1:0", &options);
        let (address, exits) = (server.address().to_owned(), ServerExits::default());
        Ok(Self { plan, faults, workers, address, options, server: Some(server), exits })
    }

    /// Returns the server that runs now.
    pub(super) fn server(&self) -> anyhow::Result<&ServerProcess> {
        self.server.as_ref().context("the server does not run")
    }

    /// Returns the number of exits until now.
    pub(super) fn exits(&self) -> ServerExits {
        ServerExits { remote: self.workers.exits, ..self.exits }
    }

    /// Lets the server live for a while.
    pub(super) async fn live(&mut self) {
        let lifetime = draw_lifetime_ms(&self.plan, self.exits.kills + self.exits.stops);
        // Tests the passing of time: the kill comes at a random moment.
        self.faults.live(Duration::from_millis(lifetime), self.exits.kills).await;
    }

    /// Kills the server, or stops it every fifth time, kills some workers, and starts them again.
    pub(super) async fn kill_and_restart(&mut self, api: &ApiClient) -> anyhow::Result<()> {
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

    /// Replaces the server after an interruption: Ctrl-C ends all processes of a terminal.
    pub(super) async fn replace_server(&mut self) {
        if let Some(server) = self.server.take() {
            server.kill();
        }
        self.faults.clear().await;
        self.server = Some(self.faults.start_server(&self.address, &self.options));
    }

    /// Ends the faults of the processes beside the server.
    pub(super) fn recover(&mut self) {
        self.workers.recover();
    }

    /// Stops the last server.
    pub(super) fn stop(&mut self) -> anyhow::Result<()> {
        let server = self.server.take().context("the server does not run")?;
        ensure!(server.terminate() == Some(0), "the last server did not exit with 0 after SIGTERM");
        Ok(())
    }
}

/// Draws the lifetime of server number `index`, the same for the same seed (SplitMix64: Steele, Lea and Flood 2014).
fn draw_lifetime_ms(plan: &CrashPlan, index: u32) -> u64 {
    let mut z = plan.seed.wrapping_add(u64::from(index).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    plan.min_lifetime_ms + (z ^ (z >> 31)) % (plan.max_lifetime_ms - plan.min_lifetime_ms + 1)
}
