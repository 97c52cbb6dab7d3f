"""Metrics of a curriculum: their names, and reading them for the loggers and callbacks of trainers."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any, Protocol

from ._native import CurriculumError

_logger = logging.getLogger(__name__)


class MetricsSource(Protocol):
    """Curriculum, or another object with its `metrics`, such as `sparring.trl.EnvironmentFactory`."""

    def metrics(self) -> dict[str, float]:
        """Returns metrics for training curves by name.

        Raises:
            CurriculumError: The server does not answer.
        """


def read_metrics(source: MetricsSource) -> dict[str, float]:
    """Returns the metrics as `curriculum/<name>`; none, with a warning, if the server does not answer.

    An unreachable server does not end a training.
    """
    try:
        metrics = source.metrics()
    except CurriculumError as error:
        _logger.warning("cannot read the metrics of the curriculum: %s", error)
        return {}
    return {f"curriculum/{name}": value for name, value in metrics.items()}


def task_metrics(row: Mapping[str, Any]) -> dict[str, float]:
    """Returns the metrics of one task by name, without those that have no value yet.

    Args:
        row: Mastery of the task, as the server returns it.
    """
    # There is no level during placement, nor under strategies without levels; no rung before the first proposal.
    mastery, results = (row["mastery"] or {}) if row["placement_done"] else {}, row["results"]
    values = {
        "rung": row["mean_rung"],
        "level": row["level"],
        "mastery": mastery.get("mean"),
        "mastery_q10": mastery.get("q10"),
        "mastery_q90": mastery.get("q90"),
        **{name: results[name] for name in ("success", "score", "skill")},
        "zero_variance_share": row["group_counts"]["zero_variance_share"],
        **{f"params/{name}": value for name, value in row["params"].items()},
    }
    return {f"{row['task']}/{name}": float(value) for name, value in values.items() if value is not None}
