//! One design of a worker.

use std::time::Instant;

use designer::Designer;
use designer::design_thread::{DesignTask, run_designer};
use designer::llm_designer::LlmDesigner;
use designer::procedural::ProceduralDesigner;
use jobs::design::{DesignJob, DesignOutput, JobDesigner};
use jobs::envelope::{JobEnvelope, JobReply, ReplyBody};
use llm::LlmClient;
use tokio::sync::watch;

use super::{BACKGROUND_NICE, WorkerProcess, lower_priority};

/// Designers of a worker, besides the procedural one.
#[derive(Debug, Clone, Default)]
pub struct WorkerDesigners {
    /// Language model that designs, if one is configured.
    pub llm: Option<LlmClient>,
}

impl WorkerDesigners {
    /// Creates the designer of a job; `None` if the worker has none of the kind.
    fn designer(&self, job: &DesignJob) -> Option<Box<dyn Designer>> {
        match job.designer {
            JobDesigner::Procedural => Some(Box::new(ProceduralDesigner)),
            JobDesigner::Llm => Some(Box::new(LlmDesigner::new(self.llm.clone()?, &job.run))),
        }
    }

    /// Number of requests to the language model that are designed at once; 0 without one.
    pub(super) fn llm_designs(&self) -> usize {
        self.llm.as_ref().map_or(0, |llm| llm.config().concurrency)
    }
}

/// Designs the layouts of a job.
pub(super) async fn design(state: &WorkerProcess, envelope: &JobEnvelope) -> JobReply {
    let started = Instant::now();
    let job = match DesignJob::decode(envelope.body()) {
        Ok(job) => job,
        Err(error) => return JobReply::Failed(format!("the job cannot be read: {error}")),
    };
    let gate = match job.gate() {
        Ok(gate) => gate,
        Err(error) => return JobReply::Failed(error.to_string()),
    };
    let refused =
        |reason: &str| JobReply::Refused(format!("{} on {}: {reason}", state.id, state.config.host));
    let Some(designer) = state.config.designers.designer(&job) else {
        return refused("there is no language model for designs; name one with --llm-url and --llm-model");
    };
    // The sender is dropped with this future: the designer stops with it.
    let (_wanted, stopping) = watch::channel(());
    let task = DesignTask { brief: job.brief, gate };
    let designed = run_designer(designer, task, || lower_priority(BACKGROUND_NICE), stopping).await;
    let result = match designed {
        Ok(result) => result,
        Err(reason) => return refused(&reason),
    };
    let encoding = tokio::task::spawn_blocking(move || DesignOutput::from(&result.outcome).encode());
    match encoding.await {
        Ok(Ok(body)) => {
            let micros = u64::try_from(started.elapsed().as_micros()).unwrap_or(u64::MAX);
            JobReply::Done { body: ReplyBody::new(body), micros }
        }
        Ok(Err(error)) => JobReply::Failed(error.to_string()),
        Err(error) => JobReply::Failed(error.to_string()),
    }
}
