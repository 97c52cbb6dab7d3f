"""Arguments of feeds on NATS, and the names of their streams."""

from __future__ import annotations

import base64
import binascii
import itertools
import os
import re
import ssl
from pathlib import Path
from typing import Any
from urllib.parse import SplitResult, urlsplit

from .errors import invalid

#: Beginning of the subjects of replies: `deploy/nats.conf` allows no others to a trainer.
INBOX_PREFIX = "_INBOX_TRAINER"
#: Shortest `ack_wait_s` and `forget_after_s`, seconds: shorter ones end while messages are on their way.
MIN_DURATION_S = 1
#: Longest `ack_wait_s` and `forget_after_s`, seconds: a year. NATS stores durations as nanoseconds in 64 bits.
MAX_DURATION_S = 31_536_000
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


def check_options(server: str, names: dict[str, str], durations: dict[str, float]) -> None:
    """Checks the address, the names and the durations of a feed.

    Raises:
        ValueError: An argument is invalid; the message names it.
    """
    for name, value in names.items():
        pattern, description = NAMES[name]
        if not isinstance(value, str) or not re.fullmatch(pattern, value):
            raise invalid(name, description, value)
    _check_server(server)
    for name, seconds in durations.items():
        if not _is_number(seconds) or not MIN_DURATION_S <= seconds <= MAX_DURATION_S:
            raise invalid(name, f"a number of seconds from {MIN_DURATION_S} to {MAX_DURATION_S} (a year)", seconds)


def check_idle(idle_s: float | None) -> None:
    """Checks the time after which an iteration ends.

    Raises:
        ValueError: The time is not a positive number.
    """
    if idle_s is not None and (not _is_number(idle_s) or not idle_s > 0):
        raise invalid("idle_s", "a number of seconds > 0, or None to wait for ever", idle_s)


def connection_options(
    server: str, credentials: str | os.PathLike[str] | None, ca_file: str | os.PathLike[str] | None
) -> dict[str, Any]:
    """Returns the arguments of a connection.

    Raises:
        ValueError: A file cannot be read, or has other content; the message names the argument.
    """
    servers = [part.strip() for part in server.split(",")]
    options: dict[str, Any] = {
        "servers": servers,
        "name": "sparring trainer",
        "inbox_prefix": INBOX_PREFIX,
        "connect_timeout": 5,
        "allow_reconnect": True,
        "max_reconnect_attempts": -1,
        "reconnect_time_wait": 1,
    }
    options |= _user_options(servers) if credentials is None else _credentials_option(credentials)
    if ca_file is not None:
        options["tls"] = _trust(ca_file)
    return options


def _check_server(server: str) -> None:
    """Checks each of the addresses of a NATS server, which have commas between them.

    Raises:
        ValueError: An address is invalid; the message does not show users and passwords.
    """
    expected = "an address such as nats://127.0.0.1:4222 or tls://nats.example.com"
    if not isinstance(server, str):
        raise invalid("server", expected, type(server))
    for address in server.split(","):
        fault = _address_fault(address.strip())
        if fault is not None:
            shown = re.sub("^([a-z]+://)?.*@", r"\1…@", server, flags=re.DOTALL)
            raise invalid("server", f"{expected} ({fault})", shown)


def _address_fault(address: str) -> str | None:
    """Returns why an address is invalid, or None. It does not use the errors of `urllib`, which can show a password."""
    if not address:
        return "an address is missing"
    if not re.match("(nats|tls)://", address):
        return "it must begin with nats:// or tls://"
    try:
        parts = urlsplit(address)
    except ValueError:
        return "the host is invalid"
    if re.search(r"\s", address):
        return "it must have no spaces"
    if "%" in parts.netloc.rpartition("@")[0]:
        return "the user and the password may have letters, digits and `-._~` only; else set `credentials`"
    if not _is_port(parts):
        return "the port must be a number from 1 to 65535"
    if not parts.hostname:
        return "the host is missing"
    if parts.path not in ("", "/") or parts.query or parts.fragment:
        return "it must end after the port"
    return None


def _is_port(parts: SplitResult) -> bool:
    """Returns True if an address has no port, or one that is valid."""
    try:
        return parts.port != 0
    except ValueError:
        return False


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _user_options(servers: list[str]) -> dict[str, str]:
    """Returns the user and password, or the token, of the first address that has one: all servers of a cluster know it."""
    for parts in map(urlsplit, servers):
        if parts.username is not None:
            return {"token": parts.username} if parts.password is None else {"user": parts.username, "password": parts.password}
    return {}


def _credentials_option(credentials: str | os.PathLike[str]) -> dict[str, str]:
    """Returns the option of nats-py for a file with credentials."""
    expected = "a .creds file of a NATS account, or a file with the seed of an nkey (SU…), which `nk -gen user` prints"
    try:
        path = os.fspath(credentials)
        content = Path(path).read_bytes()
    except (OSError, TypeError, ValueError) as error:
        raise invalid("credentials", f"{expected} ({error})", credentials) from error
    if _is_seed(content.strip()):
        return {"nkeys_seed": path}
    lines = content.split(b"\n")
    seeds = [after for line, after in itertools.pairwise(lines) if b"BEGIN USER NKEY SEED" in line]
    if b"BEGIN NATS USER JWT" in content and seeds and _is_seed(seeds[0]):
        return {"user_credentials": path}
    raise invalid("credentials", f"{expected} (the file has neither)", credentials)


def _is_seed(text: bytes) -> bool:
    """Returns True for the seed of a user's nkey, whose last two bytes are a checksum."""
    if not re.fullmatch(rb"SU[A-Z2-7]{56}", text):
        return False
    raw = base64.b32decode(text + b"======")
    return binascii.crc_hqx(raw[:-2], 0) == int.from_bytes(raw[-2:], "little")


def _trust(ca_file: str | os.PathLike[str]) -> ssl.SSLContext:
    """Returns TLS settings that trust only the certificate authorities of a file."""
    try:
        return ssl.create_default_context(cafile=os.fspath(ca_file))
    except (OSError, TypeError, ValueError) as error:
        requirement = f"a PEM file with the certificate of the authority that issued the certificate of NATS ({error})"
        raise invalid("ca_file", requirement, ca_file) from error
