//! Two servers with a shard each, behind nginx with the committed configuration.

use std::path::PathBuf;

use crate::nginx::{NginxProxy, free_address};
use crate::{ApiClient, ServerProcess};

/// Configuration of nginx that operators copy.
const CONFIGURATION: &str = include_str!("../../deploy/nginx.conf");

/// One server of the cluster.
#[derive(Debug)]
pub struct ShardServer {
    name: &'static str,
    address: String,
    /// Value of its flag `--peers`.
    peers: String,
    db: PathBuf,
    process: Option<ServerProcess>,
}

impl ShardServer {
    /// Starts the server, at the same address each time.
    ///
    /// # Panics
    /// Panics if the server does not start.
    pub fn start(&mut self) {
        let options = ["--shard", self.name, "--peers", &self.peers];
        self.process = Some(ServerProcess::start_at(&self.address, &self.db, &options));
    }

    /// Kills the server with SIGKILL.
    pub fn kill(&mut self) {
        self.process = None;
    }

    /// Path of its database.
    #[must_use]
    pub const fn db(&self) -> &PathBuf {
        &self.db
    }

    /// Creates a client of this server alone.
    #[must_use]
    pub fn api(&self) -> ApiClient {
        ApiClient::new(&format!("http://{}", self.address))
    }
}

/// Servers of the shards `east` and `west`, and nginx in front of them.
#[derive(Debug)]
pub struct ShardCluster {
    /// Server of the shard `east`, which answers requests without a shard.
    pub east: ShardServer,
    /// Server of the shard `west`.
    pub west: ShardServer,
    /// Proxy in front of both.
    pub nginx: NginxProxy,
    _folder: tempfile::TempDir,
}

impl ShardCluster {
    /// Starts both servers and nginx.
    ///
    /// # Panics
    /// Panics if one of them does not start.
    pub async fn start() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let (east, west) = (free_address(), free_address());
        let server = |name, address: &str, peer: &str, peer_address: &str| ShardServer {
            name,
            address: address.to_owned(),
            peers: format!("{peer}=http://{peer_address}"),
            db: folder.path().join(format!("{name}.sqlite3")),
            process: None,
        };
        let mut servers = [server("east", &east, "west", &west), server("west", &west, "east", &east)];
        servers.iter_mut().for_each(ShardServer::start);
        let nginx = NginxProxy::start_with(|listen| {
            let placed = CONFIGURATION.replace("10.0.0.5:8700", &east).replace("10.0.0.6:8700", &west);
            placed.replace("listen 80;", &format!("listen {listen};"))
        })
        .await;
        let [east, west] = servers;
        Self { east, west, nginx, _folder: folder }
    }

    /// Creates a client of both servers, through nginx.
    #[must_use]
    pub fn api(&self) -> ApiClient {
        self.nginx.api()
    }
}
