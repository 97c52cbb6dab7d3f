"""Log lines with the simulation time and the satellite, as BSK-RL prints them."""

from __future__ import annotations

import logging
import os
from typing import Any

#: Name of the logger of the package.
ROOT = "sparring.tasking"

_GRAY, _RED, _YELLOW = 90, 91, 93
_DARK_YELLOW = 33
_SATELLITE_COLORS = (36, 92, 34, 95, 96, 32, 94, 35)
_LEVEL_COLORS = {"WARNING": _YELLOW, "ERROR": _RED, "CRITICAL": _RED}
_BOLD, _ITALIC = 1, 3


class SimFormatter(logging.Formatter):
    """Formatter of log lines; colours satellites and levels if `color_output` is true."""

    def __init__(self, *args: Any, color_output: bool = True, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.color_output = color_output
        self.satellite_colors: dict[str, int] = {}

    def _styled(self, text: str, *codes: int | None) -> str:
        """Wraps a text in terminal codes; None is no code."""
        if not self.color_output:
            return text
        return f"\x1b[{';'.join(str(code) for code in codes if code is not None)}m{text}\x1b[0m"

    def format(self, record: logging.LogRecord) -> str:
        """Returns the line of a record."""
        short = record.name.removeprefix(ROOT).lstrip(".")
        parts = short.split(".")
        satellite = parts[2] if parts[0] == "sats" and len(parts) > 2 else None
        color = None
        if satellite is not None:
            number = self.satellite_colors.setdefault(satellite, len(self.satellite_colors))
            color = _SATELLITE_COLORS[number % len(_SATELLITE_COLORS)]
        record.shortname = short
        level = _LEVEL_COLORS.get(record.levelname)
        bold = _BOLD if record.levelname == "CRITICAL" else None
        line = self._styled("%(asctime)s ", _GRAY, _ITALIC)
        line += self._styled("%(shortname)-30s ", color)
        line += self._styled("%(levelname)-10s ", level, bold)
        if hasattr(record, "sim_time"):
            line += self._styled("<%(sim_time)-.2f> ", _DARK_YELLOW)
        if satellite is not None:
            line += self._styled(f"{satellite}: ", color)
        if str(record.msg).startswith("=== "):
            line += self._styled("%(message)s", _YELLOW, _BOLD)
        else:
            line += self._styled("%(message)s", level, bold)
        self._style = logging.PercentStyle(line)
        self._fmt = line
        return super().format(record)


class ContextFilter(logging.Filter):
    """Filter that adds the simulation time of an environment, and drops other processes' records."""

    def __init__(self, name: str = "", env: Any = None, proc_id: int | None = None) -> None:
        super().__init__(name)
        self.env = env
        self.proc_id = proc_id

    def filter(self, record: logging.LogRecord) -> bool:
        """Returns whether the record is of this process, and sets its `sim_time` in seconds."""
        simulator = getattr(self.env.unwrapped, "simulator", None)
        if simulator is not None:
            record.sim_time = simulator.log_time
        return self.proc_id == record.process


def configure(env: Any, log_level: int | str, log_file: str | None) -> None:
    """Prints the package's log with the time of an environment, and writes it to a file if given.

    The handlers of an earlier environment of this process are removed.
    """
    root = logging.getLogger(ROOT)
    root.setLevel(log_level.upper() if isinstance(log_level, str) else log_level)
    process = os.getpid()
    replaced = [
        handler for handler in root.handlers if any(getattr(item, "proc_id", None) == process for item in handler.filters)
    ]
    for handler in replaced:
        root.removeHandler(handler)
        handler.close()
    handlers: list[logging.Handler] = [logging.StreamHandler()]
    if log_file is not None:
        handlers.append(logging.FileHandler(log_file))
    for handler in handlers:
        is_file = isinstance(handler, logging.FileHandler)
        handler.setFormatter(SimFormatter(color_output=not is_file))
        handler.addFilter(ContextFilter(env=env, proc_id=process))
        root.addHandler(handler)
    if replaced:
        root.warning(f"Creating logger for new env on PID={process}. Old environments in process may now log times incorrectly.")
