"""Environments of a process that a trainer spawns, as TRL's `AsyncGRPOTrainer` does for its rollouts."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
import time
import weakref
from dataclasses import dataclass
from multiprocessing import util
from typing import Any

from ..curriculum import EXIT_TIMEOUT_S, Curriculum, CurriculumError
from ..text_episode import Reward
from .group_episodes import GroupEpisodes
from .shared_version import read_policy_version
from .tool_environment import GroupEnvironment, make_environment

#: Maximum time to submit results after a termination signal, seconds. TRL kills the process after five.
TERMINATION_TIMEOUT_S = 4.0
#: Priority of closing at the end of a process: before the queues of `multiprocessing`, which have at most 10.
_EXIT_PRIORITY = 20


@dataclass(frozen=True)
class WorkerSettings:
    """Plain data from which a spawned process makes the environments of an `EnvironmentFactory`."""

    #: Address of the server.
    url: str
    #: Id of the run.
    run: str
    #: Token; None if the process finds it in `SPARRING_TOKEN`.
    token: str | None
    #: Tools of the run's tasks.
    tools: str
    reward: Reward
    max_debris: int
    group_size: int
    lease_groups: int
    ttl_s: int
    max_wait_s: float
    #: File of the policy version that the trainer writes.
    version_file: str


class WorkerEpisodes(GroupEpisodes):
    """Episodes of groups from a connection of this process, which the first reset opens."""

    def __init__(self, settings: WorkerSettings) -> None:
        super().__init__(None, settings.group_size)
        self.settings = settings
        self._closed = False

    def _open(self) -> Curriculum:
        settings = self.settings
        if self._curriculum is None:
            self._check_open()
            self._curriculum = Curriculum(
                settings.url,
                settings.run,
                token=settings.token,
                form="groups",
                group_size=settings.group_size,
                lease_groups=settings.lease_groups,
                ttl_s=settings.ttl_s,
                max_wait_s=settings.max_wait_s,
            )
        # A process that is closed meanwhile must not lease more.
        self._check_open()
        version = read_policy_version(settings.version_file)
        if version is not None and version != self._curriculum.policy_version:
            self._curriculum.policy_version = version
        return self._curriculum

    def _check_open(self) -> None:
        if self._closed:
            raise CurriculumError("the environments are closed: make others from the factory of the trainer")

    def close(self, timeout_s: float) -> None:
        """Submits results and releases unfinished episodes. It takes no lock: a signal handler may call it.

        Raises:
            CurriculumError: Results could not be submitted, or were refused.
        """
        self._closed = True
        if self._curriculum is not None:
            self._curriculum.close(timeout_s)


class WorkerFactory:
    """`EnvironmentFactory` of a spawned process: it has the address of the run instead of connections and threads.

    Pickling an `EnvironmentFactory` makes it. The first reset connects to the server and leases groups for this process. The
    policy version is the trainer's. At the end of the process, also by SIGTERM, finished episodes are submitted and
    unfinished ones return to the run. The process ends with its parent.

    Args:
        settings: Address and arguments of the trainer's factory.
    """

    def __init__(self, settings: WorkerSettings) -> None:
        self.settings = settings
        self._episodes = WorkerEpisodes(settings)

    def __call__(self) -> GroupEnvironment:
        """Makes one environment for the trainer."""
        _close_at_exit(self._episodes)
        return make_environment(self.settings.tools, self._episodes, self.settings.reward, self.settings.max_debris)

    def close(self, timeout_s: float = 60.0) -> None:
        """Submits results and releases unfinished episodes.

        Raises:
            CurriculumError: Results could not be submitted, or were refused.
        """
        self._episodes.close(timeout_s)

    def __reduce__(self) -> tuple[Any, ...]:
        return WorkerFactory, (self.settings,)


#: Episodes of this process, which are closed at its end.
_open_episodes: weakref.WeakSet[WorkerEpisodes] = weakref.WeakSet()
_exit_pid: int | None = None


def _close_at_exit(episodes: WorkerEpisodes) -> None:
    global _exit_pid
    _open_episodes.add(episodes)
    if _exit_pid == os.getpid():
        return
    _exit_pid = os.getpid()
    util.Finalize(None, _close_all, args=(EXIT_TIMEOUT_S,), exitpriority=_EXIT_PRIORITY)
    parent, is_main = multiprocessing.parent_process(), threading.current_thread() is threading.main_thread()
    if parent is not None and is_main and signal.getsignal(signal.SIGTERM) == signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _terminate)
        threading.Thread(target=_end_with_parent, args=(parent,), name="sparring-parent", daemon=True).start()


def _end_with_parent(parent: Any) -> None:
    """Terminates this process after its parent: the weights of a killed trainer do not change any more."""
    parent.join()
    for episodes in list(_open_episodes):
        # A killed trainer has not deleted its file.
        with contextlib.suppress(FileNotFoundError):
            os.unlink(episodes.settings.version_file)
    os.kill(os.getpid(), signal.SIGTERM)


def _close_all(timeout_s: float) -> None:
    until = time.monotonic() + timeout_s
    for episodes in list(_open_episodes):
        try:
            episodes.close(max(0.0, until - time.monotonic()))
        except CurriculumError as error:
            print(f"sparring: cannot submit the results of a worker: {error}", file=sys.stderr)


def _terminate(number: int, _: Any) -> None:
    """Submits and releases all episodes, then ends the process as without a handler."""
    _close_all(TERMINATION_TIMEOUT_S)
    signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)
