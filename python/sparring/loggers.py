"""Loggers that send a curriculum's metrics to Weights & Biases, MLflow, Trackio or TensorBoard.

    run = wandb.init(project="satellites")               # import wandb, sparring.loggers
    logger = sparring.loggers.WandbLogger(curriculum)
    for update in range(1000):
        ...                                              # step, learn
        logger.log(update, {"train/loss": loss})         # curriculum/… and train/loss

All loggers have the methods of `CurriculumLogger`. A logger imports the package of its tracker when it is made.
"""

from __future__ import annotations

import importlib
import os
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import TracebackType
from typing import Any, SupportsFloat

import numpy as np

from .errors import invalid
from .metrics import MetricsSource, read_metrics
from .trainer_metrics import TrainerReport, replace_characters

#: Metric of W&B with the step of each call, the x axis of the curriculum's charts.
WANDB_STEP = "curriculum/step"


class CurriculumLogger(ABC):
    """Common interface of the loggers.

    A logger is a context manager that closes itself. It never ends a run or a writer that it was given.

    Args:
        curriculum: Curriculum, or another source of its metrics, such as `sparring.trl.EnvironmentFactory`.
        report: False to send the numbers of the training loop to the tracker only. Otherwise the dashboard of the curriculum's
            server shows them, too.
    """

    def __init__(self, curriculum: MetricsSource, *, report: bool = True) -> None:
        self._source = curriculum
        self._report = TrainerReport(curriculum if report else None, interval_s=0.0)
        self._next_step = 0

    def log(self, step: int | None = None, extra: Mapping[str, SupportsFloat] | None = None) -> dict[str, float]:
        """Reads the curriculum's metrics once and sends them to the tracker as `curriculum/<name>`.

        If the server does not answer, it warns and sends only `extra`.

        Args:
            step: Position on the x axis, an integer >= 0. None: the next step of the tracker. MLflow and TensorBoard have none:
                there it is one more than the step of the last call, from 0.
            extra: Other numbers to send at this step, under their own names. They are also sent to the curriculum's run
                (`Curriculum.log_metrics`), without a step at one more than the step of the last call.

        Returns:
            The numbers that were sent, by the names that the tracker has for them.

        Raises:
            ValueError: `step` is no integer >= 0.
        """
        if step is not None and (isinstance(step, bool) or not isinstance(step, (int, np.integer)) or step < 0):
            raise invalid("step", "an integer >= 0, or None for the next step", step)
        numbers = {name: float(value) for name, value in (extra or {}).items()}
        self._report.add(self._next_step if step is None else int(step), numbers)
        numbers = {self._valid_name(name): value for name, value in {**read_metrics(self._source), **numbers}.items()}
        if numbers:
            self._send(numbers, None if step is None else int(step))
        self._next_step = (self._next_step if step is None else int(step)) + 1
        return numbers

    @abstractmethod
    def _send(self, numbers: dict[str, float], step: int | None) -> None:
        """Sends numbers to the tracker."""

    def _valid_name(self, name: str) -> str:
        """Returns the name that the tracker accepts for a metric."""
        return name

    def close(self) -> None:  # noqa: B027 (most trackers need no close)
        """Closes files that the logger has opened."""

    def __enter__(self) -> CurriculumLogger:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


class WandbLogger(CurriculumLogger):
    """Sends the metrics to a run of Weights & Biases.

    W&B drops numbers of a step below the newest. The logger therefore writes to the newest row in this case. The charts of
    `curriculum/…` have the metric `curriculum/step` as their x axis, which has the steps of `log`. A row is open until a later
    step, so `run.log(…, step=step)` before or after `log(step)` writes to the same row.

    Args:
        curriculum: As for `CurriculumLogger`.
        run: Run of `wandb.init`; None for the active one.
        report: As for `CurriculumLogger`.

    Raises:
        ImportError: wandb is not installed.
        ValueError: No run is active.
    """

    def __init__(self, curriculum: MetricsSource, run: Any = None, *, report: bool = True) -> None:
        super().__init__(curriculum, report=report)
        wandb = _import("wandb", "WandbLogger needs wandb: pip install wandb")
        self._run = _require(wandb.run if run is None else run, "wandb.init()")
        self._run.define_metric(WANDB_STEP, hidden=True)
        self._run.define_metric("curriculum/*", step_metric=WANDB_STEP)
        #: Newest row that the logger wrote to, and its step.
        self._row, self._row_step = -1, -1

    def _send(self, numbers: dict[str, float], step: int | None) -> None:
        if self._run.settings.mode == "shared":  # W&B has no steps then
            self._run.log({**numbers, WANDB_STEP: self._next_step if step is None else step})
            return
        row = max(self._run.step, 0 if step is None else step)
        if row == self._row and step != self._row_step:
            row += 1  # numbers of another step in the same row would be overwritten
        step = row if step is None else step
        self._run.log({**numbers, WANDB_STEP: step}, step=row)
        self._row, self._row_step = row, step


class MlflowLogger(CurriculumLogger):
    """Sends the metrics to a run of MLflow.

    MLflow accepts letters, digits and the characters `_-. :/` in names, which must be paths. The logger replaces other
    characters by `_`, and removes empty parts of paths.

    Args:
        curriculum: As for `CurriculumLogger`.
        run: Run of `mlflow.start_run`, or its id; None for the active one.
        report: As for `CurriculumLogger`.

    Raises:
        ImportError: mlflow is not installed.
        ValueError: No run is active.
    """

    def __init__(self, curriculum: MetricsSource, run: Any = None, *, report: bool = True) -> None:
        super().__init__(curriculum, report=report)
        mlflow = _import("mlflow", "MlflowLogger needs mlflow: pip install mlflow")
        run = _require(mlflow.active_run() if run is None else run, "mlflow.start_run()")
        self._run_id = run if isinstance(run, str) else run.info.run_id
        self._client = mlflow.MlflowClient()
        self._metric = mlflow.entities.Metric

    def _send(self, numbers: dict[str, float], step: int | None) -> None:
        step = self._next_step if step is None else step
        now_ms = time.time_ns() // 1_000_000
        self._client.log_batch(self._run_id, [self._metric(name, value, now_ms, step) for name, value in numbers.items()])

    def _valid_name(self, name: str) -> str:
        """Returns the name with the characters that MLflow accepts."""
        return replace_characters(name, r"\w.\- :")


class TrackioLogger(CurriculumLogger):
    """Sends the metrics to a run of Trackio, on this machine or on a Space.

    Trackio prefixes its reserved names, such as `step` and `time`, by `__`.

    Args:
        curriculum: As for `CurriculumLogger`.
        run: Run of `trackio.init`; None for the active one.
        report: As for `CurriculumLogger`.

    Raises:
        ImportError: trackio is not installed.
        ValueError: No run is active.
    """

    def __init__(self, curriculum: MetricsSource, run: Any = None, *, report: bool = True) -> None:
        super().__init__(curriculum, report=report)
        trackio = _import("trackio", "TrackioLogger needs trackio: pip install trackio")
        # The active run of a thread is invisible to other threads, so `trackio.log` would fail there.
        self._run = _require(trackio.context_vars.current_run.get() if run is None else run, "trackio.init()")

    def _send(self, numbers: dict[str, float], step: int | None) -> None:
        self._run.log(dict(numbers), step=step)


class TensorBoardLogger(CurriculumLogger):
    """Writes the metrics as scalars for TensorBoard, in single precision.

    Args:
        curriculum: As for `CurriculumLogger`.
        writer: Folder of the event file, or a writer such as `torch.utils.tensorboard.SummaryWriter`. The logger closes the
            event file of a folder; the caller closes the writer.
        report: As for `CurriculumLogger`.

    Raises:
        ImportError: `writer` is a folder, and tensorboard is not installed.
    """

    def __init__(self, curriculum: MetricsSource, writer: str | os.PathLike[str] | Any, *, report: bool = True) -> None:
        super().__init__(curriculum, report=report)
        self._file = _EventFile(os.fspath(writer)) if isinstance(writer, (str, os.PathLike)) else None
        self._writer: Any = self._file or writer

    def _send(self, numbers: dict[str, float], step: int | None) -> None:
        step = self._next_step if step is None else step
        for name, value in numbers.items():
            self._writer.add_scalar(name, value, step)
        self._writer.flush()  # a program that ends without close loses no scalar

    def close(self) -> None:
        """Closes the event file of a folder."""
        if self._file is not None:
            self._file.close()


class _EventFile:
    """Event file in a folder, written without torch."""

    def __init__(self, folder: str) -> None:
        needs = "TensorBoardLogger needs tensorboard: pip install tensorboard"
        self._file = _import("tensorboard.summary.writer.event_file_writer", needs).EventFileWriter(folder)
        self._event = _import("tensorboard.compat.proto.event_pb2", needs).Event
        self._summary = _import("tensorboard.compat.proto.summary_pb2", needs).Summary

    def add_scalar(self, name: str, value: float, step: int) -> None:
        summary = self._summary(value=[self._summary.Value(tag=name, simple_value=value)])
        self._file.add_event(self._event(wall_time=time.time(), step=step, summary=summary))

    def flush(self) -> None:
        self._file.flush()

    def close(self) -> None:
        self._file.close()


def _import(module: str, message: str) -> Any:
    try:
        imported = importlib.import_module(module)
    except ImportError as error:
        raise ImportError(message) from error
    if imported.__file__ is None:  # a folder of this name, such as the one that wandb writes to
        raise ImportError(message)
    return imported


def _require(run: Any, call: str) -> Any:
    if run is None:
        raise ValueError(f"`run` must be given, because no run is active: call {call} first")
    return run
