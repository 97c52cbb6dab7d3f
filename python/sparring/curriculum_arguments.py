"""Arguments of `Curriculum`: their types and limits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, get_args
from urllib.parse import quote

import numpy as np

from ._native import CurriculumError, NativeHttpClient
from .errors import invalid, one_of

Form = Literal["auto", "groups", "columns"]
Purpose = Literal["train", "probe", "eval"]

#: Maximum number of groups of a lease.
MAX_LEASE_GROUPS = 1024
#: Default number of groups of a lease of groups, and the minimum for columns.
DEFAULT_LEASE_GROUPS = 64
#: Maximum number of episodes of a lease of groups.
MAX_GROUP_EPISODES = 16_384
#: Maximum number of episodes of a lease of columns.
MAX_COLUMN_EPISODES = 100_000
#: Maximum of each integer argument of `Curriculum`.
INTEGER_LIMITS = {
    "lease_groups": MAX_LEASE_GROUPS,
    "group_size": 1024,
    "ahead": 2**20,
    "buffer": 2**31,
    "ttl_s": 24 * 3600,
}


def check_modes(form: str, purpose: str) -> None:
    """Checks form and purpose.

    Raises:
        ValueError: One of them is unknown, or the form is not valid for the purpose.
    """
    if form not in get_args(Form):
        raise one_of("form", get_args(Form), form)
    if purpose not in get_args(Purpose):
        raise one_of("purpose", get_args(Purpose), purpose)
    if purpose == "eval" and form == "columns":
        raise invalid("form", "groups or auto with purpose='eval'", form)


def check_numbers(max_wait_s: Any, **integers: Any) -> None:
    """Checks the numeric arguments.

    Raises:
        ValueError: A number is out of range; the message names the field.
    """
    for name, value in integers.items():
        limit = INTEGER_LIMITS[name]
        if value is None and name in ("lease_groups", "group_size"):
            continue
        if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 1 <= value <= limit:
            raise invalid(name, f"an integer from 1 to {limit}", value)
    if not isinstance(max_wait_s, (int, float, np.number)) or not 0.0 <= max_wait_s < 1e9:
        raise invalid("max_wait_s", "a number of seconds from 0 to 1e9", max_wait_s)


def check_settings(http: NativeHttpClient, run: str, settings: Mapping[str, Any] | None) -> None:
    """Checks that no settings are passed with `run`, since they neither create nor change a run.

    Raises:
        CurriculumError: The server does not answer, or rejects the request.
        ValueError: There are settings; the message says whether the run exists.
    """
    if settings is None:
        return
    try:
        http.request("GET", f"/v1/runs/{quote(run, safe='')}")
    except CurriculumError as error:
        if ": 404: " not in str(error):
            raise
        reason = f"{run!r} does not exist; to create it, pass settings={{'id': {run!r}, …}} without `run`"
    else:
        reason = f"{run!r} exists and keeps its settings"
    raise ValueError(f"`settings` must be omitted with `run`: {reason}")


def default_groups(group_size: int) -> int:
    """Returns the default number of groups of a lease of groups."""
    return max(1, min(DEFAULT_LEASE_GROUPS, MAX_GROUP_EPISODES // group_size))


def default_column_groups(group_size: int, num_envs: int) -> int:
    """Returns the default number of groups of a lease of columns for a number of environments."""
    return max(1, min(max(num_envs, DEFAULT_LEASE_GROUPS), MAX_LEASE_GROUPS, MAX_COLUMN_EPISODES // group_size))
