"""A server on this machine, for as long as a process needs one."""

from __future__ import annotations

import atexit
import os
import re
import shutil
import subprocess
import tempfile
import threading
import warnings
import weakref

from ._native import CurriculumError


class Server:
    """A server of this process's own."""

    def __init__(self, db: str | os.PathLike[str] | None, binary: str | None) -> None:
        program = binary or os.environ.get("SPARRING_BIN") or shutil.which("sparring")
        if not program:
            raise CurriculumError("there is no program `sparring`: pip install sparring-server, or name one by SPARRING_BIN")
        self._folder = tempfile.TemporaryDirectory(prefix="sparring-") if db is None else None
        file = os.path.join(self._folder.name, "run.sqlite3") if db is None and self._folder else os.fspath(db or "")
        line = [program, "serve", "--bind", "127.0.0.1:0", "--db", file, "--while-stdin"]
        self._said: list[str] = []
        pipe, same = subprocess.PIPE, subprocess.STDOUT
        try:
            # It ends with this process, whatever becomes of that, but not by a Ctrl-C that is this process's to handle:
            # what was flown is handed in before.
            self._process = subprocess.Popen(line, stdin=pipe, stdout=pipe, stderr=same, text=True, start_new_session=True)
        except OSError as error:
            self._forget()
            raise CurriculumError(f"{program} does not start: {error}") from error
        self._finalizer = weakref.finalize(self, _stop, self._process)
        atexit.register(self.stop)
        url = self._find()
        if url is None:
            self.stop()
            raise CurriculumError(f"{program} does not serve: {''.join(self._said[-5:]).strip() or 'it says nothing'}")
        self.url = url

    def _find(self) -> str | None:
        found = threading.Event()
        urls: list[str] = []

        def read() -> None:
            for text in self._process.stdout or ():
                del self._said[:-50]
                self._said.append(text)
                at = re.search(r"serves at (http://\S+?)[.,]?(?:\s|$)", text)
                if at and not urls:
                    urls.append(at[1])
                    found.set()
            found.set()

        self._reader = threading.Thread(target=read, daemon=True, name="sparring-server")
        self._reader.start()
        found.wait(60)
        return urls[0] if urls else None

    def stop(self) -> None:
        """Stops it, and forgets its folder."""
        atexit.unregister(self.stop)
        self._finalizer()
        self._reader.join(10)
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        self._forget()

    def _forget(self) -> None:
        if self._folder is not None:
            self._folder.cleanup()


def _stop(process: subprocess.Popen[str]) -> None:
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(30)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            warnings.warn("the server did not stop by itself and was killed", ResourceWarning, stacklevel=2)
