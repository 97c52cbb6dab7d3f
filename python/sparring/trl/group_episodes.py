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

    def __init__(self, curriculum: Curriculum | None, group_size: int) -> None:
        self._curriculum = curriculum
        self._group_size = group_size
        self._lock = threading.Lock()
        self._unassigned: dict[str, list[GroupMember]] = {}
        #: Policy version with which the unassigned episodes of each group have begun.
        self._versions: dict[str, int] = {}
        self._idle: list[Environment] = []

    def acquire(self, group_id: str) -> GroupMember:
        """Returns an environment whose episode has begun for the next member of a group.

        The episode has the policy version of this moment: another version than earlier members of the group if the policy
        has changed meanwhile.

        Raises:
            CurriculumError: No episode is ready, and the server is unreachable or failed.
        """
        with self._lock:
            curriculum = self._open()
            version = curriculum.policy_version
            if group_id not in self._unassigned:
                self._unassigned[group_id] = self._begin_group(curriculum)
            elif self._versions[group_id] != version:
                self._unassigned[group_id] = self._begin_again(curriculum, self._unassigned[group_id])
            self._versions[group_id] = version
            members = self._unassigned[group_id]
            member = members.pop()
            if not members:
                del self._unassigned[group_id], self._versions[group_id]
            return member

    def release(self, environment: Environment, *, is_over: bool) -> None:
        """Releases an environment for later episodes; abandons its episode unless that is over."""
        with self._lock:
            if is_over:
                self._idle.append(environment)
            else:
                self._abandon(environment)

    def _open(self) -> Curriculum:
        """Returns the curriculum, with the current policy version."""
        assert self._curriculum is not None
        return self._curriculum

    def _begin_group(self, curriculum: Curriculum) -> list[GroupMember]:
        group: list[GroupMember] = []
        try:
            while len(group) < self._group_size:
                environment = self._idle.pop() if self._idle else Environment(curriculum=curriculum, axes="world")
                _, info = environment.reset()
                # Episodes of a group are consecutive. After an interrupt in the middle of one, the next group begins here.
                if group and info["scenario"] != group[0].environment.scenario:
                    self._abandon_group(group)
                group.append(GroupMember(environment, info["train"]))
        except BaseException:
            self._abandon_group(group)
            raise
        return group

    def _begin_again(self, curriculum: Curriculum, members: list[GroupMember]) -> list[GroupMember]:
        """Begins the episodes of members that have no action yet once more, with the current policy version."""
        for member in members:
            # A closed environment returns its episode to the curriculum, which offers it before all others.
            member.environment.close()
        return [self._begin_returned(curriculum, member) for member in members]

    def _begin_returned(self, curriculum: Curriculum, member: GroupMember) -> GroupMember:
        environment = Environment(curriculum=curriculum, axes="world")
        environment.reset()
        return member._replace(environment=environment)

    def _abandon_group(self, group: list[GroupMember]) -> None:
        for member in group:
            self._abandon(member.environment)
        group.clear()

    def _abandon(self, environment: Environment) -> None:
        # An episode that is released instead would be offered again in the middle of another group.
        environment.abandon()
        self._idle.append(environment)
