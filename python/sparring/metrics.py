"""Reading a curriculum's metrics for the loggers and callbacks of trainers."""

from __future__ import annotations

import logging
from typing import Protocol

from .curriculum import CurriculumError

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
