//! `--shard` and `--peers` of `sparring serve`: several servers that divide the runs of a team.

use orchestrator::shards::PeerServer;
use store::shard::Shard;

/// Arguments of a server that is one of several.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Several servers")]
pub struct ShardArgs {
    /// Shard of this server, 1 to 16 of a-z and 0-9, with which the ids of its runs, layouts and evaluations begin, so that a proxy
    /// can route requests; the database remembers it [default: the one of the database]
    #[arg(long, value_name = "NAME", env = "SPARRING_SHARD", hide_env_values = true)]
    pub(super) shard: Option<Shard>,
    /// Other servers, each as the name of its shard and its URL, with commas between them; lists have the runs of all servers. It
    /// needs a shard of this server
    #[arg(
        long,
        value_name = "NAME=URL",
        env = "SPARRING_PEERS",
        hide_env_values = true,
        value_delimiter = ','
    )]
    pub(super) peers: Vec<PeerServer>,
}
