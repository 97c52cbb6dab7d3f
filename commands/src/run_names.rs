//! Runs by id, unique prefix of an id, or name.

use anyhow::bail;
use sqlx::SqliteConnection;
use store::runs::{self, RunNameRow};

use crate::names::suggest;

/// Largest number of runs that an error lists.
const MAX_LISTED: usize = 10;

/// Run by which a user may mean it.
pub trait NamedRun {
    /// Id of the run.
    fn id(&self) -> &str;
    /// Name of the run for people.
    fn name(&self) -> &str;
    /// True if the run is archived.
    fn is_archived(&self) -> bool;
}

impl NamedRun for RunNameRow {
    fn id(&self) -> &str {
        &self.id
    }

    fn name(&self) -> &str {
        &self.name
    }

    fn is_archived(&self) -> bool {
        self.is_archived
    }
}

/// Finds a run of a database, as [`select_run`] does, and returns its id.
///
/// # Errors
/// Returns the errors of [`select_run`], and an error if the database cannot be read.
pub async fn find_stored_run(conn: &mut SqliteConnection, wanted: Option<&str>) -> anyhow::Result<String> {
    Ok(select_run(runs::names(conn).await?, wanted)?.id)
}

/// Finds a run by its id, by a prefix of one id only, or by a name of one run only. Without `wanted`, returns the only run
/// that is not archived. `runs` are in order of creation.
///
/// # Errors
/// Returns an error that lists the candidates or similar names if no single run is meant.
pub fn select_run<R: NamedRun>(mut runs: Vec<R>, wanted: Option<&str>) -> anyhow::Result<R> {
    let at = match wanted {
        None => only_run(&runs)?,
        Some(wanted) => position(&runs, wanted)?,
    };
    Ok(runs.remove(at))
}

fn only_run<R: NamedRun>(runs: &[R]) -> anyhow::Result<usize> {
    let current: Vec<usize> = (0..runs.len()).filter(|&at| !runs[at].is_archived()).collect();
    match current.as_slice() {
        [one] => Ok(*one),
        [] => bail!("there are no runs; `sparring runs create` creates one"),
        several => bail!("there are several runs; name one: {}", describe(runs, several)),
    }
}

fn position<R: NamedRun>(runs: &[R], wanted: &str) -> anyhow::Result<usize> {
    if let Some(at) = runs.iter().position(|run| run.id() == wanted) {
        return Ok(at);
    }
    let is_meant = |run: &R| !wanted.is_empty() && (run.id().starts_with(wanted) || run.name() == wanted);
    let meant: Vec<usize> = (0..runs.len()).filter(|&at| is_meant(&runs[at])).collect();
    match meant.as_slice() {
        [one] => Ok(*one),
        [] => {
            let known = runs.iter().flat_map(|run| [run.id(), run.name()]);
            bail!("there is no run {wanted:?}{}; `sparring runs list` lists all", suggest(wanted, known))
        }
        several => bail!("several runs match {wanted:?}; name one by its id: {}", describe(runs, several)),
    }
}

/// Lists the runs at these positions as `id (name)`, the newest first.
fn describe<R: NamedRun>(runs: &[R], positions: &[usize]) -> String {
    let listed = positions.iter().rev().map(|&at| format!("{} ({})", runs[at].id(), runs[at].name()));
    let mut words: Vec<String> = listed.take(MAX_LISTED).collect();
    let more = positions.len().saturating_sub(MAX_LISTED);
    if more > 0 {
        words.push(format!("{more} more"));
    }
    words.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, PartialEq)]
    struct Run(&'static str, &'static str, bool);

    impl NamedRun for Run {
        fn id(&self) -> &str {
            self.0
        }

        fn name(&self) -> &str {
            self.1
        }

        fn is_archived(&self) -> bool {
            self.2
        }
    }

    fn select(runs: Vec<Run>, wanted: Option<&str>) -> Result<&'static str, String> {
        select_run(runs, wanted).map(|run| run.0).map_err(|error| error.to_string())
    }

    #[test]
    fn runs_are_found_by_id_prefix_and_name() {
        let runs = || {
            vec![Run("run-1a", "first", false), Run("run-1b", "second", true), Run("run-1", "second", false)]
        };
        assert_eq!(select(runs(), Some("run-1")), Ok("run-1"));
        assert_eq!(select(runs(), Some("run-1a")), Ok("run-1a"));
        assert_eq!(select(runs(), Some("run-1b")), Ok("run-1b"));
        assert_eq!(select(runs(), Some("first")), Ok("run-1a"));
        let fault = select(vec![Run("young", "young", false)], Some("yuong")).unwrap_err();
        assert!(fault.contains("(did you mean young?)"), "{fault}");
        let faults = ["second", "run-", "frist", ""].map(|wanted| select(runs(), Some(wanted)).unwrap_err());
        insta::assert_snapshot!(faults.join("\n"));
    }

    #[test]
    fn only_current_run_needs_no_name() {
        assert_eq!(select(vec![Run("a", "x", false)], None), Ok("a"));
        assert_eq!(select(vec![Run("a", "x", true), Run("b", "y", false)], None), Ok("b"));
        let none = select(vec![Run("a", "x", true)], None).unwrap_err();
        assert!(none.contains("runs create"), "{none}");
        let several = vec![Run("a", "x", false), Run("b", "y", false)];
        assert_eq!(select(several, None), Err("there are several runs; name one: b (y), a (x)".to_owned()));
    }
}
