"""Numbers that a trainer logs about its training: their names, and the thread that sends them to the server."""

from __future__ import annotations

import logging
import math
import numbers
import re
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Protocol, SupportsFloat

from ._native import CurriculumError
from .errors import invalid
from .scenario import to_json

#: Maximum number of metrics of a request, and of a run.
MAX_METRICS = 100
#: Maximum length of a metric's name, characters.
MAX_NAME_CHARS = 128
#: Maximum step of a trainer; the server stores steps without loss up to it.
MAX_STEP = 2**53 - 1
#: Maximum number of requests that wait for the server; further ones are dropped.
MAX_WAITING = 20
#: Minimum time between two reports of a callback, seconds.
REPORT_INTERVAL_S = 1.0

_logger = logging.getLogger(__name__)


def replace_characters(name: str, valid: str) -> str:
    """Returns a metric's name as a path without empty parts, with `_` for each character that is not valid.

    Args:
        name: Name of a metric, such as `train/loss`.
        valid: Valid characters, as in a set of a regular expression.
    """
    parts = re.sub(f"[^/{valid}]", "_", name).split("/")
    return "/".join(part for part in parts if part.strip("."))


def server_name(name: str) -> str:
    """Returns the name that the server accepts for a metric, cut to 128 characters.

    It is empty if the name has no letter from a to z and no digit.
    """
    return replace_characters(name, r"a-zA-Z0-9_.:\-").lstrip("_.:/-")[:MAX_NAME_CHARS]


def metrics_request(step: int, metrics: Mapping[str, SupportsFloat | None]) -> str:
    """Returns the request that stores metrics of one step, as JSON; numbers that are not finite are null.

    Raises:
        ValueError: The step or a value is invalid, a name has no letter and no digit, or there are more than 100 metrics.
    """
    if isinstance(step, bool) or not isinstance(step, numbers.Integral) or not 0 <= step <= MAX_STEP:
        raise invalid("step", f"an integer from 0 to {MAX_STEP}", step)
    if not isinstance(metrics, Mapping):
        raise invalid("metrics", "a mapping from names to numbers", metrics)
    values: dict[str, float | None] = {}
    for name, value in metrics.items():
        valid = server_name(str(name))
        if not valid:
            raise invalid("metrics", "named by at least one letter from a to z or one digit", name)
        values[valid] = _finite(str(name), value)
    if len(values) > MAX_METRICS:
        raise ValueError(
            f"`metrics` must have at most {MAX_METRICS} names, got {len(values)}: a run stores no more, so log fewer metrics"
        )
    return to_json("metrics", {"step": int(step), "metrics": values})


def _finite(name: str, value: SupportsFloat | None) -> float | None:
    if value is None:
        return None
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise invalid(f"metrics[{name!r}]", "a number or None", value) from error
    return number if math.isfinite(number) else None


class MetricsSender:
    """Sends requests in a thread that ends when none waits; drops requests that the server refuses or that are too many.

    Each reason for which requests are dropped is a warning once.

    Args:
        send: Sends one request; raises `CurriculumError` if the server refuses it or does not answer.
    """

    def __init__(self, send: Callable[[str], object]) -> None:
        self._send = send
        self._lock = threading.Lock()
        self._waiting: deque[str] = deque()
        self._thread: threading.Thread | None = None
        self._warned: set[str] = set()

    def add(self, request: str) -> None:
        """Adds a request, which the thread sends; never waits."""
        with self._lock:
            if len(self._waiting) == MAX_WAITING:
                self._warn("waiting", f"{MAX_WAITING} requests already wait for the server")
                return
            self._waiting.append(request)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="sparring-metrics", daemon=True)
                self._thread.start()

    @property
    def is_busy(self) -> bool:
        """True while requests wait or one is sent."""
        return self._thread is not None

    def flush(self, timeout_s: float) -> None:
        """Waits until no request waits, for at most `timeout_s` seconds."""
        thread = self._thread
        if thread is not None:
            thread.join(max(0.0, min(timeout_s, threading.TIMEOUT_MAX)))

    def _run(self) -> None:
        while True:
            with self._lock:
                if not self._waiting:
                    self._thread = None
                    return
                request = self._waiting.popleft()
            try:
                self._send(request)
            except (CurriculumError, ValueError) as error:
                status = re.search(r": (\d{3}): ", str(error))
                self._warn(status[1] if status else "unreachable", str(error))

    def _warn(self, reason: str, message: str) -> None:
        if reason not in self._warned:
            self._warned.add(reason)
            _logger.warning("metrics of the trainer are dropped (this warning is not repeated): %s", message)


class MetricsTarget(Protocol):
    """Curriculum, or another object with its `log_metrics`, such as `sparring.trl.EnvironmentFactory`."""

    def log_metrics(self, step: int, metrics: Mapping[str, SupportsFloat | None]) -> None:
        """Logs metrics of the trainer at one of its steps."""


class TrainerReport:
    """Reports the scalars of a trainer to a run; what it cannot report never ends a training.

    It leaves out values that are no numbers, the curriculum's own metrics, and numbers beyond the hundredth.

    Args:
        target: Curriculum of the run; other objects, and None, get no report.
        interval_s: Minimum time between two reports, seconds. `finish` sends the newest report in between.
    """

    def __init__(self, target: MetricsTarget | object | None, interval_s: float = REPORT_INTERVAL_S) -> None:
        self._log_metrics = getattr(target, "log_metrics", None)
        self._interval_s = interval_s
        self._next_time = -math.inf
        self._skipped: tuple[int, dict[str, SupportsFloat]] | None = None
        self._has_warned = False

    def add(self, step: int, values: Mapping[str, object]) -> None:
        """Reports the numbers of a step, unless the last report was less than the interval ago."""
        if self._log_metrics is None:
            return
        scalars = _scalars(values)
        if not scalars:
            return
        if time.monotonic() < self._next_time:
            self._skipped = step, scalars
            return
        self._next_time = time.monotonic() + self._interval_s
        self._send(step, scalars)

    def finish(self) -> None:
        """Sends the newest report that was skipped."""
        if self._skipped is not None:
            self._send(*self._skipped)

    def _send(self, step: int, scalars: dict[str, SupportsFloat]) -> None:
        self._skipped = None
        if len(scalars) > MAX_METRICS:
            self._warn(f"a run stores {MAX_METRICS} metrics, the trainer has {len(scalars)}: the first in the alphabet are sent")
            scalars = dict(sorted(scalars.items())[:MAX_METRICS])
        try:
            assert self._log_metrics is not None
            self._log_metrics(step, scalars)
        except (CurriculumError, ValueError) as error:
            self._warn(f"cannot report metrics of the trainer: {error}")

    def _warn(self, message: str) -> None:
        if not self._has_warned:
            self._has_warned = True
            _logger.warning("%s", message)


def _scalars(values: Mapping[str, object]) -> dict[str, SupportsFloat]:
    """Returns the numbers by the names that the server accepts, without those of the curriculum, which the server has."""
    return {
        server_name(name): value
        for name, value in values.items()
        if isinstance(value, numbers.Real)
        and not isinstance(value, bool)
        and server_name(name)
        and not name.startswith("curriculum/")
    }
