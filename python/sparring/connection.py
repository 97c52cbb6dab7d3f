"""Addresses and tokens of servers."""

from __future__ import annotations

import os
import socket

from . import _native
from ._native import CurriculumError
from .errors import invalid

#: Address of a server with default settings.
DEFAULT_URL = "http://127.0.0.1:8700"


def read_token(token: str | None) -> str | None:
    """Returns the token to send: the given one, or `SPARRING_TOKEN`; None if it is empty.

    Raises:
        ValueError: The token is not printable ASCII without spaces; the message does not repeat it.
    """
    if token is not None and not isinstance(token, str):
        raise invalid("token", "a string", type(token))
    token = (os.environ.get("SPARRING_TOKEN", "") if token is None else token).strip()
    if not all("!" <= letter <= "~" for letter in token):
        raise ValueError("`token` must consist of printable ASCII characters without spaces; `sparring token create` prints one")
    return token or None


def read_url(url: str | None) -> str:
    """Returns the address of the server: the given one, or `SPARRING_URL`, or that of a server with default settings."""
    return url or os.environ.get("SPARRING_URL") or DEFAULT_URL


def read_ca_file(ca_file: str | os.PathLike[str] | None) -> str | None:
    """Returns the file of certificate authorities to trust: the given one, or `SPARRING_CA_FILE`; None if it is empty."""
    return os.fspath(os.environ.get("SPARRING_CA_FILE", "") if ca_file is None else ca_file) or None


def needs_token(url: str) -> bool:
    """Returns True if the server rejects requests without a token; it accepts them while its database has no token."""
    try:
        _native.NativeHttpClient(url).request("GET", "/v1/runs?limit=1")
    except CurriculumError:
        return True
    return False


def request_headers(token: str | None) -> dict[str, str]:
    """Returns the headers of all requests: the accepted format, the name of the trainer, and its token."""
    headers = {"Accept": "application/json", "Sparring-Client": client_name()}
    return {**headers, "Authorization": f"Bearer {token}"} if token else headers


def client_name() -> str:
    """Returns the name by which the server lists this trainer: that of the host and the number of the process."""
    host = "".join(character for character in socket.gethostname() if "!" <= character <= "~")
    return f"{host[:48]}:{os.getpid()}"
