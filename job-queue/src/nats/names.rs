//! Names of streams, consumers and subjects.

use std::fmt;
use std::str::FromStr;

use jobs::JobKind;

/// Name under which servers and workers find each other on a NATS server.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ClusterName(String);

/// A name that no subject can contain.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the name must have 1 to 32 letters, digits, `-` or `_`, got `{0}`")]
pub struct InvalidClusterName(String);

impl FromStr for ClusterName {
    type Err = InvalidClusterName;

    fn from_str(name: &str) -> Result<Self, InvalidClusterName> {
        let is_valid = !name.is_empty() && name.len() <= 32 && name.bytes().all(is_plain);
        if is_valid { Ok(Self(name.to_owned())) } else { Err(InvalidClusterName(name.to_owned())) }
    }
}

impl Default for ClusterName {
    fn default() -> Self {
        Self("default".to_owned())
    }
}

impl fmt::Display for ClusterName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

const fn is_plain(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_'
}

/// Returns a word for subjects: every other character becomes `-`.
pub(crate) fn subject_word(text: &str) -> String {
    let word: String =
        text.bytes().map(|byte| if is_plain(byte) { char::from(byte) } else { '-' }).take(48).collect();
    if word.is_empty() { "unknown".to_owned() } else { word }
}

impl ClusterName {
    /// Name of the stream of jobs.
    pub(crate) fn jobs_stream(&self) -> String {
        format!("SPARRING_{self}_JOBS")
    }

    /// Name of the stream of results.
    pub(crate) fn results_stream(&self) -> String {
        format!("SPARRING_{self}_RESULTS")
    }

    /// Subjects of all jobs.
    pub(crate) fn all_jobs(&self) -> String {
        format!("sparring.{self}.jobs.>")
    }

    /// Subjects of all results.
    pub(crate) fn all_results(&self) -> String {
        format!("sparring.{self}.results.>")
    }

    /// Subject of the jobs of a kind that a server publishes.
    pub(crate) fn jobs(&self, kind: JobKind, server: &str) -> String {
        format!("sparring.{self}.jobs.{kind}.{server}")
    }

    /// Subjects of the jobs of a kind.
    pub(crate) fn jobs_of_kind(&self, kind: JobKind) -> String {
        format!("sparring.{self}.jobs.{kind}.*")
    }

    /// Subjects of the jobs that a server publishes.
    pub(crate) fn jobs_of_server(&self, server: &str) -> String {
        format!("sparring.{self}.jobs.*.{server}")
    }

    /// Subject of the results of a worker for a server.
    pub(crate) fn results(&self, server: &str, kind: JobKind, worker: &str) -> String {
        format!("sparring.{self}.results.{server}.{kind}.{worker}")
    }

    /// Subjects of the results for a server.
    pub(crate) fn results_of_server(&self, server: &str) -> String {
        format!("sparring.{self}.results.{server}.>")
    }

    /// Subject of the heartbeats of a worker.
    pub(crate) fn heartbeats(&self, worker: &str) -> String {
        format!("sparring.{self}.workers.{worker}")
    }

    /// Subjects of all heartbeats.
    pub(crate) fn all_heartbeats(&self) -> String {
        format!("sparring.{self}.workers.*")
    }

    /// Name of the bucket of large jobs and results.
    pub(crate) fn job_objects(&self) -> String {
        format!("SPARRING_{self}_JOBS")
    }

    /// Name of the stream of a run's trajectory feed, and of the bucket of its large groups. A name cannot have the dot of a run of
    /// a shard: `east.run` becomes `FEED-east_run`, and no name of a shard has a `_`.
    pub(crate) fn feed_stream(&self, run: &str) -> String {
        match run.split_once('.') {
            Some((shard, name)) => format!("SPARRING_{self}_FEED-{shard}_{name}"),
            None => format!("SPARRING_{self}_FEED_{run}"),
        }
    }

    /// Returns the run of a stream; `None` if the stream is no feed.
    pub(crate) fn run_of_feed_stream(&self, stream: &str) -> Option<String> {
        let rest = stream.strip_prefix(&format!("SPARRING_{self}_FEED"))?;
        match rest.strip_prefix('-') {
            Some(run) => run.split_once('_').map(|(shard, name)| format!("{shard}.{name}")),
            None => rest.strip_prefix('_').map(str::to_owned),
        }
    }

    /// Subject of the groups of a run's trajectory feed.
    pub(crate) fn feed(&self, run: &str) -> String {
        format!("sparring.{self}.feed.{run}")
    }

    /// Subject on which a server answers that it runs.
    pub(crate) fn server_presence(&self, server: &str) -> String {
        format!("sparring.{self}.servers.{server}")
    }

    /// Name of the key-value bucket with the states of runs.
    pub(crate) fn run_states_bucket(&self) -> String {
        format!("SPARRING_{self}_RUNS")
    }

    /// Subject of the answers to a worker.
    pub(crate) fn control(&self, worker: &str) -> String {
        format!("sparring.{self}.control.{worker}")
    }
}

/// Returns the last word of a subject: the id of the worker that published on it.
pub(crate) fn last_word(subject: &str) -> &str {
    subject.rsplit('.').next().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_of_feeds_name_their_runs() {
        let name: ClusterName = "team".parse().unwrap();
        for (run, stream) in [
            ("run", "SPARRING_team_FEED_run"),
            ("my_run-2", "SPARRING_team_FEED_my_run-2"),
            ("east.my_run", "SPARRING_team_FEED-east_my_run"),
            ("east._", "SPARRING_team_FEED-east__"),
        ] {
            assert_eq!(name.feed_stream(run), stream);
            assert_eq!(name.run_of_feed_stream(stream).as_deref(), Some(run));
        }
        for other in [
            "SPARRING_team_JOBS",
            "SPARRING_other_FEED_run",
            "SPARRING_team_FEED",
            "OBJ_SPARRING_team_FEED_run",
        ] {
            assert_eq!(name.run_of_feed_stream(other), None, "{other}");
        }
    }

    #[test]
    fn names_fit_into_subjects() {
        let name: ClusterName = "team-7".parse().unwrap();
        assert_eq!(name.jobs(JobKind::Audit, "s1"), "sparring.team-7.jobs.audit.s1");
        assert_eq!(last_word(&name.results("s1", JobKind::Audit, "w1")), "w1");
        for wrong in ["", "a.b", "a b", "*", ">", &"x".repeat(33)] {
            assert!(wrong.parse::<ClusterName>().is_err(), "{wrong}");
        }
        assert_eq!(subject_word("host.example.com"), "host-example-com");
        assert_eq!(subject_word(""), "unknown");
    }
}
