"""Arguments of feeds on NATS, and the names of their streams."""

from __future__ import annotations

import os
import re
import ssl
from typing import Any

from .errors import invalid

#: Beginning of the subjects of replies: `deploy/nats.conf` allows no others to a trainer.
INBOX_PREFIX = "_INBOX_TRAINER"
#: Pattern and description of each name.
NAMES = {
    "run": (r"([a-z0-9]{1,16}\.)?[a-z0-9_-]{1,64}", "the id of a run, such as my-run, or east.my-run with a shard"),
    "consumer": ("[A-Za-z0-9_-]{1,64}", "1 to 64 letters, digits, `-` or `_`"),
    "cluster": ("[A-Za-z0-9_-]{1,32}", "1 to 32 letters, digits, `-` or `_`"),
}


def stream_name(cluster: str, run: str) -> str:
    """Returns the name of the stream of a run's feed, and of the bucket of its large groups.

    Names of streams have no dots. The name of a run can contain `_`, but its shard cannot, so all names differ.
    """
    shard, dot, name = run.rpartition(".")
    return f"SPARRING_{cluster}_FEED{f'-{shard}' if dot else ''}_{name}"


def check_options(server: str, names: dict[str, str], durations: dict[str, float | None]) -> None:
    """Checks the address, the names and the durations of a feed.

    Raises:
        ValueError: An argument is invalid; the message names it.
    """
    for name, value in names.items():
        pattern, description = NAMES[name]
        if not isinstance(value, str) or not re.fullmatch(pattern, value):
            raise invalid(name, description, value)
    if not isinstance(server, str) or not re.match("(nats|tls|ws|wss)://.", server):
        raise invalid("server", "an address such as nats://127.0.0.1:4222", server)
    for name, seconds in durations.items():
        if seconds is not None and (isinstance(seconds, bool) or not isinstance(seconds, (int, float)) or not seconds > 0):
            raise invalid(name, "a number of seconds > 0", seconds)


def connection_options(
    server: str, credentials: str | os.PathLike[str] | None, ca_file: str | os.PathLike[str] | None
) -> dict[str, Any]:
    """Returns the arguments of a connection."""
    options: dict[str, Any] = {
        "servers": [part.strip() for part in server.split(",")],
        "name": "sparring trainer",
        "inbox_prefix": INBOX_PREFIX,
        "connect_timeout": 5,
        "allow_reconnect": True,
        "max_reconnect_attempts": -1,
        "reconnect_time_wait": 1,
        "error_cb": _ignore,
    }
    if credentials is not None:
        path = os.fspath(credentials)
        with open(path, encoding="utf-8") as file:
            is_seed = file.read(2) == "SU"
        options["nkeys_seed" if is_seed else "user_credentials"] = path
    if ca_file is not None:
        options["tls"] = ssl.create_default_context(cafile=os.fspath(ca_file))
    return options


async def _ignore(_: Exception) -> None:
    """Ignores an error of the connection: requests fail by themselves, and the client connects again."""
