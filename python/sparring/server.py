"""A server process on this machine that ends with this process."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import subprocess
import sysconfig
import threading
import warnings
import weakref
from collections.abc import Callable

from ._native import CurriculumError

#: Timeout for a started server to print its address, seconds.
START_TIMEOUT_S = 60
#: Timeout for a server to stop before it is killed, seconds.
STOP_TIMEOUT_S = 30
#: Lines of the server's output that are kept for error messages.
KEPT_LINES = 50


class Server:
    """Server process that this process starts and stops."""

    def __init__(self, db: str | os.PathLike[str] | None, binary: str | None) -> None:
        """Starts a server on a free port.

        Args:
            db: Database file; None for a temporary one, which the server deletes even if this process is killed.
            binary: Program to start; by default `SPARRING_BIN`, or the installed `sparring`.

        Raises:
            CurriculumError: There is no such program, or it does not start.
        """
        program = binary or os.environ.get("SPARRING_BIN") or _find_program()
        if not program:
            raise CurriculumError(
                "cannot find the program `sparring`: pip install sparring-server, or set SPARRING_BIN to its path"
            )
        database = ["--temporary"] if db is None else ["--db", os.fspath(db)]
        command = [program, "serve", "--bind", "127.0.0.1:0", "--while-stdin", *database]
        self._output: list[str] = []
        pipe, stdout = subprocess.PIPE, subprocess.STDOUT
        try:
            # The server ends with this process. It has its own session, so that Ctrl-C reaches only this process, which
            # submits its results first.
            self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=stdout, text=True, start_new_session=True)
        except OSError as error:
            raise CurriculumError(f"cannot start {program}: {error}; check SPARRING_BIN or `binary`") from error
        self._pid = os.getpid()
        self._exit_callbacks: list[Callable[[str], None]] = []
        # Stops the server when this object is deleted and when the program ends.
        self._finalizer = weakref.finalize(self, _stop, self._process, self._pid)
        url = self._read_url()
        if url is None:
            self.stop()
            output = "".join(self._output[-5:]).strip() or "it printed nothing"
            raise CurriculumError(f"{program} did not start a server: {output}")
        self.url = url

    def _read_url(self) -> str | None:
        """Reads the server's output in a thread; returns the address that it prints."""
        has_url_or_ended = threading.Event()
        urls: list[str] = []

        # The thread does not refer to self, so that a server without references is deleted and stops.
        process, stdout, output, callbacks = self._process, self._process.stdout, self._output, self._exit_callbacks

        def read() -> None:
            for line in stdout or ():
                del output[:-KEPT_LINES]
                output.append(line)
                match = re.search(r"serves at (https?://\S+?)[.,]?(?:\s|$)", line)
                if match and not urls:
                    urls.append(match[1])
                    has_url_or_ended.set()
            if stdout is not None:
                stdout.close()
            has_url_or_ended.set()
            with contextlib.suppress(subprocess.TimeoutExpired):
                code = process.wait(10)
                reason = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
                errors = [line.strip() for line in output if " INFO " not in line]
                for callback in callbacks:
                    callback(": ".join([f"the server that was started here {reason}", *errors[-1:]]))

        self._reader = threading.Thread(target=read, daemon=True, name="sparring-server")
        self._reader.start()
        has_url_or_ended.wait(START_TIMEOUT_S)
        return urls[0] if urls else None

    def on_exit(self, callback: Callable[[str], None]) -> None:
        """Registers a callback that another thread calls with a message when the server ends for any reason."""
        self._exit_callbacks.append(callback)

    def stop(self) -> None:
        """Stops the server and waits for its end."""
        if os.getpid() != self._pid:
            return  # the server belongs to the parent of this fork
        self._finalizer()
        self._reader.join(10)


def _find_program() -> str | None:
    # pip installs it beside this Python, which is not on the path of an environment that was not activated.
    return shutil.which("sparring", path=sysconfig.get_path("scripts")) or shutil.which("sparring")


def _stop(process: subprocess.Popen[str], pid: int) -> None:
    if os.getpid() != pid:
        return
    if process.stdin is not None:
        process.stdin.close()
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            warnings.warn(f"The server did not stop within {STOP_TIMEOUT_S} s and was killed.", ResourceWarning, stacklevel=2)
