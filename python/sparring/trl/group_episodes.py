"""Assignment of the curriculum's episodes to the members of GRPO groups."""

from __future__ import annotations

import threading
from typing import NamedTuple

from ..curriculum import Curriculum
from ..single import Environment


class GroupMember(NamedTuple):
    """Environment of one member of a group, whose episode has begun."""

    environment: Environment
    #: True if the trainer should learn from the episode.
    train: bool


class GroupEpisodes:
    """Assigns episodes of one scenario of the curriculum to all members of a group. Its methods are thread-safe."""

    def __init__(self, curriculum: Curriculum, group_size: int) -> None:
        self._curriculum = curriculum
        self._group_size = group_size
        self._lock = threading.Lock()
        self._unassigned: dict[str, list[GroupMember]] = {}
        self._idle: list[Environment] = []

    def acquire(self, group_id: str) -> GroupMember:
        """Returns an environment whose episode has begun for the next member of a group.

        Raises:
            CurriculumError: No episode is ready, and the server is unreachable or failed.
        """
        with self._lock:
            if group_id not in self._unassigned:
                self._unassigned[group_id] = self._begin_group()
            members = self._unassigned[group_id]
            member = members.pop()
            if not members:
                del self._unassigned[group_id]
            return member

    def release(self, environment: Environment, *, is_over: bool) -> None:
        """Releases an environment for later episodes; abandons its episode unless that is over."""
        with self._lock:
            if is_over:
                self._idle.append(environment)
            else:
                self._abandon(environment)

    def _begin_group(self) -> list[GroupMember]:
        group: list[GroupMember] = []
        try:
            while len(group) < self._group_size:
                environment = self._idle.pop() if self._idle else Environment(curriculum=self._curriculum, axes="world")
                _, info = environment.reset()
                # Episodes of a group are consecutive. After an interrupt in the middle of one, the next group begins here.
                if group and info["scenario"] != group[0].environment.scenario:
                    self._abandon_group(group)
                group.append(GroupMember(environment, info["train"]))
        except BaseException:
            self._abandon_group(group)
            raise
        return group

    def _abandon_group(self, group: list[GroupMember]) -> None:
        for member in group:
            self._abandon(member.environment)
        group.clear()

    def _abandon(self, environment: Environment) -> None:
        # An episode that is released instead would be offered again in the middle of another group.
        environment.abandon()
        self._idle.append(environment)
