//! Output of an episode: the lines of the public kessler-env and the JSON transcript.

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
use crate::files;
use llm_policy::ChatTurn;

/// Format of the records on stdout.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum TranscriptFormat {
    /// Lines in the format of the public kessler-env
    Lines,
    /// Transcript with one JSON object per line
    Jsonl,
}

/// Record of the transcript.
#[derive(Debug, Serialize)]
#[serde(tag = "type", rename_all = "lowercase")]
pub(super) enum TranscriptRecord<'a> {
    /// Start of an episode, with its first observation.
    Start {
        episode: u64,
        task: &'a str,
        env: &'a str,
        model: &'a str,
        prompt: Option<String>,
        seed: Option<u64>,
        observation: &'a Value,
    },
    /// Step that the environment took.
    Step {
        episode: u64,
        step: u32,
        action: &'a Value,
        /// Action as printed in the output line.
        #[serde(skip)]
        text: &'a str,
        reward: f64,
        done: bool,
        error: Option<&'a str>,
        observation: &'a Value,
        model: Option<&'a ChatTurn>,
    },
    /// End of an episode, complete or not.
    End { episode: u64, success: bool, steps: usize, score: f64, rewards: &'a [f64], fault: Option<&'a str> },
}

impl TranscriptRecord<'_> {
    /// Formats the record as a line of the public kessler-env.
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

/// Destination of the records: stdout and optionally a file.
#[derive(Debug)]
pub(super) struct Transcript {
    format: TranscriptFormat,
    file: Option<Mutex<BufWriter<File>>>,
    /// True if each record is written at once, not at the end of its episode.
    is_live: bool,
}

impl Transcript {
    /// Opens the destination. Without `is_live`, records are written episode by episode, so that the lines of concurrent
    /// episodes do not mix.
    ///
    /// # Errors
    /// Returns an error if the file cannot be created.
    pub(super) fn new(format: TranscriptFormat, file: Option<&Path>, is_live: bool) -> anyhow::Result<Self> {
        let open = |path: &Path| {
            let file =
                File::create(path).map_err(|error| files::write_fault(path, &error)).context("--out")?;
            Ok::<_, anyhow::Error>(Mutex::new(BufWriter::new(file)))
        };
        Ok(Self { format, file: file.map(open).transpose()?, is_live })
    }

    /// Creates the writer of one episode.
    pub(super) fn writer(&self) -> TranscriptWriter<'_> {
        TranscriptWriter { output: self, printed: String::new(), filed: String::new() }
    }
}

/// Writer of one episode's records, with the records that are not written yet.
#[derive(Debug)]
pub(super) struct TranscriptWriter<'a> {
    output: &'a Transcript,
    printed: String,
    filed: String,
}

impl TranscriptWriter<'_> {
    /// Adds a record and writes it if the transcript is live.
    ///
    /// # Errors
    /// Returns an error if the record cannot be serialised or written.
    pub(super) fn push(&mut self, record: &TranscriptRecord<'_>) -> anyhow::Result<()> {
        let json = || serde_json::to_string(record).context("a record of the transcript");
        let mut add = |to_file: bool, line: &str| {
            let text = if to_file { &mut self.filed } else { &mut self.printed };
            text.push_str(line);
            text.push('\n');
        };
        match self.output.format {
            TranscriptFormat::Lines => add(false, &record.line()),
            TranscriptFormat::Jsonl => add(false, &json()?),
        }
        if self.output.file.is_some() {
            add(true, &json()?);
        }
        if self.output.is_live { self.flush() } else { Ok(()) }
    }

    /// Writes the buffered records.
    ///
    /// # Errors
    /// Returns an error if the file cannot be written, or if stdout is closed and there is no file.
    pub(super) fn flush(&mut self) -> anyhow::Result<()> {
        if !self.printed.is_empty() {
            let is_open = output::print_unless_closed(&std::mem::take(&mut self.printed))?;
            // Model calls cost money, so episodes without any reader end here.
            if !is_open && self.output.file.is_none() {
                bail!("stdout is closed, and there is no --out");
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
