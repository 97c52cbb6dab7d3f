"""Policy version that a trainer's process writes and its spawned workers read, in a temporary file."""

from __future__ import annotations

import os
import struct
import tempfile
import weakref

_FORMAT = struct.Struct("<Q")


class SharedPolicyVersion:
    """Policy version in a file. The file is deleted with this object, or at the end of the program.

    Args:
        version: Version to begin with.
    """

    def __init__(self, version: int) -> None:
        descriptor, self.path = tempfile.mkstemp(prefix="sparring-policy-version-")
        self._descriptor = descriptor
        self._delete = weakref.finalize(self, _close_and_delete, descriptor, self.path, os.getpid())
        self.write(version)

    def write(self, version: int) -> None:
        """Writes the version in one operation, so that a reader never sees a part of it."""
        if self._delete.alive:
            os.pwrite(self._descriptor, _FORMAT.pack(version), 0)

    def delete(self) -> None:
        """Deletes the file; workers keep the last version."""
        self._delete()


def read_policy_version(path: str) -> int | None:
    """Returns the version in the file; None if the trainer has deleted the file."""
    try:
        with open(path, "rb") as file:
            return int(_FORMAT.unpack(file.read(_FORMAT.size))[0])
    except FileNotFoundError:
        return None


def _close_and_delete(descriptor: int, path: str, pid: int) -> None:
    os.close(descriptor)
    # A forked process has a copy of the object, but the file belongs to its parent.
    if os.getpid() == pid:
        os.unlink(path)
