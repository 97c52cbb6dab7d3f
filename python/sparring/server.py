"""A server on this machine, for as long as a process needs one."""

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


def _found() -> str | None:
    # Beside this Python, where pip puts it: an environment that was not activated has nothing on the path.
    return shutil.which("sparring", path=sysconfig.get_path("scripts")) or shutil.which("sparring")


class Server:
    """A server of this process's own."""

    def __init__(self, db: str | os.PathLike[str] | None, binary: str | None) -> None:
        program = binary or os.environ.get("SPARRING_BIN") or _found()
        if not program:
            raise CurriculumError("there is no program `sparring`: pip install sparring-server, or name one by SPARRING_BIN")
        # What is forgotten the server removes: it outlives a process that is killed.
        where = ["--temporary"] if db is None else ["--db", os.fspath(db)]
        line = [program, "serve", "--bind", "127.0.0.1:0", "--while-stdin", *where]
        self._said: list[str] = []
        pipe, same = subprocess.PIPE, subprocess.STDOUT
        try:
            # It ends with this process, whatever becomes of that, but not by a Ctrl-C that is this process's to handle:
            # what was flown is handed in before.
            self._process = subprocess.Popen(line, stdin=pipe, stdout=pipe, stderr=same, text=True, start_new_session=True)
        except OSError as error:
            raise CurriculumError(f"{program} does not start: {error}") from error
        self._pid = os.getpid()
        self._watching: list[Callable[[str], None]] = []
        # When nobody has it any more, and when the program ends.
        self._finalizer = weakref.finalize(self, _stop, self._process, self._pid)
        url = self._find()
        if url is None:
            self.stop()
            raise CurriculumError(f"{program} does not serve: {''.join(self._said[-5:]).strip() or 'it says nothing'}")
        self.url = url

    def _find(self) -> str | None:
        found = threading.Event()
        urls: list[str] = []

        # The thread keeps what it needs, and not the server, so that one that is forgotten ends.
        process, out, said, watching = self._process, self._process.stdout, self._said, self._watching

        def read() -> None:
            for text in out or ():
                del said[:-50]
                said.append(text)
                at = re.search(r"serves at (http://\S+?)[.,]?(?:\s|$)", text)
                if at and not urls:
                    urls.append(at[1])
                    found.set()
            if out is not None:
                out.close()
            found.set()
            with contextlib.suppress(subprocess.TimeoutExpired):
                code = process.wait(10)
                how = f"was killed by signal {-code}" if code < 0 else f"ended with code {code}"
                words = [line.strip() for line in said if " INFO " not in line]
                for tell in watching:
                    tell(": ".join([f"the server that was started here {how}", *words[-1:]]))

        self._reader = threading.Thread(target=read, daemon=True, name="sparring-server")
        self._reader.start()
        found.wait(60)
        return urls[0] if urls else None

    def watch(self, tell: Callable[[str], None]) -> None:
        """Has it told, by another thread, when the server ends, by itself or by being stopped."""
        self._watching.append(tell)

    def stop(self) -> None:
        """Stops it."""
        if os.getpid() != self._pid:
            return  # it is the parent's of a process that was forked
        self._finalizer()
        self._reader.join(10)


def _stop(process: subprocess.Popen[str], pid: int) -> None:
    if os.getpid() != pid:
        return
    if process.stdin is not None:
        process.stdin.close()
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(30)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            warnings.warn("the server did not stop by itself and was killed", ResourceWarning, stacklevel=2)
