"""Addresses and tokens of servers."""

from __future__ import annotations

import os

from . import _native
from ._native import CurriculumError


def read_token(token: str | None) -> str | None:
    """Returns the token to send: the given one, or `SPARRING_TOKEN`; an empty text means none.

    Raises:
        ValueError: The token has characters that no token has; the message does not repeat it.
    """
    if token is not None and not isinstance(token, str):
        raise ValueError("token: must be text")
    token = (os.environ.get("SPARRING_TOKEN", "") if token is None else token).strip()
    if not all("!" <= letter <= "~" for letter in token):
        raise ValueError("token: has characters that no token has")
    return token or None


def needs_token(url: str) -> bool:
    """Returns False if the server accepts requests without a token, as if its database has none."""
    try:
        _native.NativeHttpClient(url).request("GET", "/v1/runs?limit=1")
    except CurriculumError:
        return True
    return False
