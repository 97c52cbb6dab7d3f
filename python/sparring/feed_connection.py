"""Connections to NATS that never fall back to plain text, and the reasons why they fail."""

from __future__ import annotations

import asyncio
import contextlib
import os
import ssl
import time
from typing import Any

from nats.aio.client import Client
from nats.errors import SecureConnWantedError
from nats.js.errors import ServiceUnavailableError

from .feed_options import connection_options

#: Timeout of the first connection, seconds.
CONNECT_S = 30.0
#: Timeout of the end of a connection, seconds.
CLOSE_S = 2.0
#: Wordings with which NATS rejects a user.
REJECTIONS = ("authorization violation", "authorization failed", "authentication expired", "authentication revoked")
#: How to pass a user with a password.
PASSWORD_HINT = "put its name and password into `server` (nats://user:password@host:4222)"


class NatsConnection(Client):
    """Client of NATS for a trainer. With `ca_file` or an address tls:// it connects by TLS only.

    nats-py itself continues in plain text if the server does not require TLS.
    """

    def __init__(self, server: str, credentials: str | os.PathLike[str] | None, ca_file: str | os.PathLike[str] | None) -> None:
        super().__init__()
        self._arguments = connection_options(server, credentials, ca_file)
        self._credentials = credentials
        self._has_password = any("@" in address for address in self._arguments["servers"])
        self._requires_tls = ca_file is not None or any(address.startswith("tls://") for address in self._arguments["servers"])
        self._is_open = self._raises = False
        self._failure: Exception | None = None
        #: Rejection of the user, and the time of the first one, since the connection was open.
        self._rejection: Exception | None = None
        self._rejected_at = 0.0
        if credentials is not None:
            import nkeys  # type: ignore[import-not-found,import-untyped,unused-ignore]  # noqa: F401

    async def open(self) -> None:
        """Connects; a server that does not answer is tried for `CONNECT_S`, and `explain` describes the error.

        Raises:
            Exception: The server does not answer, rejects the user, or has no TLS although it is required.
        """
        self._raises = True
        await asyncio.wait_for(self.connect(**self._arguments, error_cb=self._note, reconnected_cb=self._note_open), CONNECT_S)
        self._check_tls()
        self._is_open, self._raises = True, False
        await self._note_open()

    async def close(self) -> None:
        """Disconnects, within `CLOSE_S`: after a failed TLS handshake, nats-py waits for the end of a connection without end.

        It does nothing if the connection was not begun, which nats-py would report with an AssertionError.
        """
        self._raises = False
        with contextlib.suppress(asyncio.TimeoutError, AssertionError):
            await asyncio.wait_for(super().close(), CLOSE_S)

    def explain(self, error: Exception) -> str:
        """Returns why a connection or a request has failed, and how to fix it."""
        noted = self._rejection or self._failure
        cause = noted if isinstance(error, asyncio.TimeoutError) and noted is not None else error
        text = str(cause) or type(cause).__name__
        if isinstance(cause, SecureConnWantedError):
            return (
                "the NATS server does not require TLS, but `ca_file` or an address tls:// does: start nats-server with `tls`, "
                "or omit `ca_file` and use nats:// in a network that you trust"
            )
        if isinstance(cause, ssl.SSLCertVerificationError):
            return (
                f"the certificate of NATS is not valid here ({cause.verify_message}): set `ca_file` to the authority that "
                "issued it, and use a host of the certificate in `server`"
            )
        if _is_rejection(cause):
            return self._explain_rejection()
        if "permissions violation" in text.lower():
            return f"NATS does not permit this user to read the feed ({text}): deploy/nats.conf has the permissions of a trainer"
        if isinstance(cause, ServiceUnavailableError):
            return "JetStream of NATS does not answer: start nats-server with -js"
        return text if self._is_open else f"NATS does not answer ({text}): check `server`"

    def reason_of_end(self, patience_s: float) -> str | None:
        """Returns why the connection does not open again, or None. NATS may reject the user for so many seconds."""
        if self.is_closed:
            error = self.last_error or self._failure
            return "the connection was closed" if error is None else self.explain(error)
        if self._rejection is None or time.monotonic() - self._rejected_at < patience_s:
            return None
        return self.explain(self._rejection)

    def _explain_rejection(self) -> str:
        if self._credentials is not None:
            file = os.fspath(self._credentials)
            return f"NATS rejects the user of {file}: set `credentials` to the file of a user that it knows, or {PASSWORD_HINT}"
        if self._has_password:
            return "NATS rejects the user or the password in `server`: correct it, or set `credentials` to the file of a user"
        return f"NATS requires a user: set `credentials` to its .creds file or the file of its nkey, or {PASSWORD_HINT}"

    async def _note(self, error: Exception) -> None:
        """Notes an error of the connection. The client connects again by itself, or to the next address.

        A first attempt ends with an error that does not pass, if there is no other address.
        """
        self._failure = error
        if _is_rejection(error):
            self._rejected_at = time.monotonic() if self._rejection is None else self._rejected_at
            self._rejection = error
        elif len(self._server_pool) == 1:
            self._rejection = None  # the server is away
        is_lasting = isinstance(error, (SecureConnWantedError, ssl.SSLCertVerificationError)) or _is_rejection(error)
        if self._raises and is_lasting and len(self._arguments["servers"]) == 1:
            raise error

    async def _note_open(self) -> None:
        """Forgets errors of earlier connections."""
        self._failure = self._rejection = None

    def _connect_command(self) -> bytes:
        # nats-py calls it before it sends the first bytes of each connection, which have the credentials.
        self._check_tls()
        return super()._connect_command()

    def _check_tls(self) -> None:
        """Closes a connection in plain text for which TLS is required.

        Raises:
            SecureConnWantedError: The connection is in plain text.
        """
        transport: Any = self._transport
        if self._requires_tls and not self._is_encrypted():
            if transport is not None:
                transport.close()
            raise SecureConnWantedError

    def _is_encrypted(self) -> bool:
        writer = getattr(self._transport, "_io_writer", None)
        return writer is not None and writer.get_extra_info("ssl_object") is not None


def _is_rejection(error: Exception) -> bool:
    return any(wording in str(error).lower() for wording in REJECTIONS)
