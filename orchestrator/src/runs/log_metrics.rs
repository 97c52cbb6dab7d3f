//! Stores the metrics that a trainer logs about its training.

use api_types::{TrainerMetricsReceipt, TrainerMetricsRequest};
use store::ids::RunId;
use store::trainer_metrics::{self, MetricName, MetricsAtStep};

use crate::engine::change::Change;
use crate::engine::error::ServiceError;
use crate::engine::write_tx::WriteTx;
use crate::limits::constants::MAX_METRICS;

/// Largest step: integers up to it are exact in double precision, as which JavaScript reads them.
const MAX_STEP: u64 = (1 << 53) - 1;

/// Stores the metrics of one step of a trainer.
#[derive(Debug)]
pub struct LogMetrics {
    run: RunId,
    metrics: MetricsAtStep,
}

impl LogMetrics {
    /// Checks a request.
    ///
    /// # Errors
    /// Returns an error that names the first invalid field.
    pub fn from_request(run: RunId, request: TrainerMetricsRequest) -> Result<Self, ServiceError> {
        let TrainerMetricsRequest { step, metrics } = request;
        if step > MAX_STEP {
            return Err(ServiceError::invalid("step", format!("must be from 0 to {MAX_STEP}, got {step}")));
        }
        if metrics.is_empty() || metrics.len() > MAX_METRICS {
            let reason = format!("must have 1 to {MAX_METRICS} metrics, got {}", metrics.len());
            return Err(ServiceError::invalid("metrics", reason));
        }
        let parse = |(name, value): (String, Option<f64>)| match name.parse::<MetricName>() {
            Ok(name) => Ok((name, value)),
            Err(error) => Err(ServiceError::invalid("metrics", error.to_string())),
        };
        let values = metrics.into_iter().map(parse).collect::<Result<_, _>>()?;
        Ok(Self { run, metrics: MetricsAtStep { step: step.cast_signed(), values } })
    }
}

impl Change for LogMetrics {
    type Output = TrainerMetricsReceipt;

    async fn apply(self, tx: &mut WriteTx) -> Result<TrainerMetricsReceipt, ServiceError> {
        let id = self.run.as_str();
        let run = tx.run(id).await?;
        let metrics = trainer_metrics::count_with(run.conn, id, &self.metrics).await?;
        if metrics > MAX_METRICS as i64 {
            let reason = format!(
                "a run can have at most {MAX_METRICS} metrics, and would have {metrics}: log fewer names, or use another run"
            );
            return Err(ServiceError::invalid("metrics", reason));
        }
        trainer_metrics::put(run.conn, id, &self.metrics, run.now).await?;
        Ok(TrainerMetricsReceipt {
            step: self.metrics.step.cast_unsigned(),
            stored: self.metrics.values.len(),
            metrics,
        })
    }
}
