//! What is told of an episode: the public kessler-env's lines, and the transcript.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use anyhow::{Context, bail};
use clap::ValueEnum;
use serde::Serialize;
use serde_json::Value;

use super::super::output;
use orchestrator::policy::ChatTurn;

/// What stands on stdout.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Format {
    /// The public kessler-env's lines
    Lines,
    /// The transcript: one JSON object a line
    Jsonl,
}

/// One thing to tell.
#[derive(Debug, Serialize)]
#[serde(tag = "type", rename_all = "lowercase")]
pub(super) enum Record<'a> {
    /// An episode begins.
    Start {
        episode: u64,
        task: &'a str,
        env: &'a str,
        model: &'a str,
        prompt: Option<String>,
        seed: Option<u64>,
        observation: &'a Value,
    },
    /// A step was flown.
    Step {
        episode: u64,
        step: u32,
        action: &'a Value,
        /// The same as it stands in the line.
        #[serde(skip)]
        text: &'a str,
        reward: f64,
        done: bool,
        error: Option<&'a str>,
        observation: &'a Value,
        model: Option<&'a ChatTurn>,
    },
    /// The episode is over.
    End { episode: u64, success: bool, steps: usize, score: f64, rewards: &'a [f64], fault: Option<&'a str> },
}

impl Record<'_> {
    /// The public kessler-env's line.
    pub(super) fn line(&self) -> String {
        match self {
            Self::Start { task, env, model, .. } => format!("[START] task={task} env={env} model={model}"),
            Self::Step { step, text, reward, done, error, .. } => {
                let error = error.map_or_else(|| "null".to_owned(), llm::sanitize_line);
                format!("[STEP] step={step} action={text} reward={reward:.2} done={done} error={error}")
            }
            Self::End { success, steps, score, rewards, .. } => {
                let mut line = format!("[END] success={success} steps={steps} score={score:.3} rewards=");
                for (index, reward) in rewards.iter().enumerate() {
                    // Writing to a string cannot fail.
                    let _ = write!(line, "{}{reward:.2}", if index > 0 { "," } else { "" });
                }
                line
            }
        }
    }
}

/// Where it is told.
#[derive(Debug)]
pub(super) struct Output {
    format: Format,
    file: Option<Mutex<BufWriter<File>>>,
    live: bool,
}

impl Output {
    /// With `live`, each line as it comes; else episode by episode, so that those flown at the same time do not mingle.
    pub(super) fn new(format: Format, file: Option<&Path>, live: bool) -> anyhow::Result<Self> {
        let open = |path: &Path| {
            let file = File::create(path).with_context(|| format!("--out {}", path.display()))?;
            Ok::<_, anyhow::Error>(Mutex::new(BufWriter::new(file)))
        };
        Ok(Self { format, file: file.map(open).transpose()?, live })
    }

    /// What one episode tells.
    pub(super) fn tape(&self) -> Tape<'_> {
        Tape { output: self, printed: String::new(), filed: String::new() }
    }
}

/// What one episode tells, as far as it is not told yet.
#[derive(Debug)]
pub(super) struct Tape<'a> {
    output: &'a Output,
    printed: String,
    filed: String,
}

impl Tape<'_> {
    /// Tells this.
    pub(super) fn push(&mut self, record: &Record<'_>) -> anyhow::Result<()> {
        let json = || serde_json::to_string(record).context("a record of the transcript");
        let mut add = |to_file: bool, line: &str| {
            let text = if to_file { &mut self.filed } else { &mut self.printed };
            text.push_str(line);
            text.push('\n');
        };
        match self.output.format {
            Format::Lines => add(false, &record.line()),
            Format::Jsonl => add(false, &json()?),
        }
        if self.output.file.is_some() {
            add(true, &json()?);
        }
        if self.output.live { self.flush() } else { Ok(()) }
    }

    /// Writes what is not written yet.
    pub(super) fn flush(&mut self) -> anyhow::Result<()> {
        if !self.printed.is_empty() {
            let read = output::print_if_read(&std::mem::take(&mut self.printed))?;
            // Flying costs: where it is told to nobody it ends.
            if !read && self.output.file.is_none() {
                bail!("nobody reads stdout any more, and there is no --out");
            }
        }
        if let Some(file) = &self.output.file {
            let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
            let written = file.write_all(self.filed.as_bytes()).and_then(|()| file.flush());
            written.context("the transcript cannot be written")?;
            self.filed.clear();
        }
        Ok(())
    }
}
