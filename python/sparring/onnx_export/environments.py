"""Environment of a policy: its settings, found through wrappers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium
from gymnasium.vector import VectorActionWrapper, VectorObservationWrapper

from ..errors import invalid
from ..settings import DEBRIS_ROWS, DEFAULT_LOOK_AHEAD, DEFAULT_THREATS, SATELLITE_VALUES, ObservationLayout, Settings
from ..single import Environment
from ..vector import VectorEnvironment

#: Wrappers of Gymnasium that change observations or actions in a way that the file does not have.
CHANGING_WRAPPERS = (gymnasium.ObservationWrapper, gymnasium.ActionWrapper, VectorObservationWrapper, VectorActionWrapper)


@dataclass(frozen=True)
class PolicyEnvironment:
    """Settings and layout of the environments of a policy."""

    settings: Settings
    layout: ObservationLayout

    @property
    def is_telemetry(self) -> bool:
        """True if observations have the parts of *telemetry*."""
        return self.layout.mode == "telemetry"

    @property
    def agents(self) -> int:
        """Number of agents of an environment."""
        return self.layout.num_agents

    @property
    def values(self) -> int:
        """Number of values of an agent's row, except with *telemetry*."""
        return self.layout.size // self.layout.num_agents

    @property
    def threats(self) -> int:
        """Number of pieces of debris in *tracks*."""
        return DEFAULT_THREATS if self.settings.threats is None else self.settings.threats

    @property
    def look_ahead(self) -> int:
        """Number of steps over which *tracks* predicts close approaches."""
        return DEFAULT_LOOK_AHEAD if self.settings.look_ahead is None else self.settings.look_ahead

    def telemetry_shapes(self) -> dict[str, tuple[int, ...]]:
        """Returns the shape of each part of *telemetry*."""
        if not self.layout.is_kessler:
            return {self.layout.agents_part: (self.agents, self.values)}
        bodies = self.layout.bodies
        return {"satellites": (self.agents, SATELLITE_VALUES), "debris": (len(DEBRIS_ROWS), bodies), "mask": (bodies,)}

    def tasks(self) -> list[str]:
        """Returns the ids of the tasks: those of the curriculum's run, or the one of the environments."""
        curriculum = self.settings.curriculum
        return [self.settings.spec.id] if curriculum is None else list(curriculum.tasks)


def find_environment(envs: Any) -> PolicyEnvironment:
    """Returns the environment inside wrappers of Gymnasium and Stable-Baselines3.

    Raises:
        ValueError: No environment of this package is found, or a wrapper changes observations or actions.
    """
    inner = envs
    while not isinstance(inner, (VectorEnvironment, Environment)):
        if isinstance(inner, CHANGING_WRAPPERS) or type(inner).__name__ == "VecFrameStack":
            raise ValueError(
                f"`envs` must have no wrapper that changes observations or actions, except VecNormalize, got"
                f" {type(inner).__name__}: train without it"
            )
        inner = _unwrap(inner)
        if inner is None:
            raise invalid("envs", "environments of sparring, or wrappers around them", envs)
    return PolicyEnvironment(inner._settings, inner._layout)


def _unwrap(envs: Any) -> Any:
    """Returns the environment that a wrapper has, or the first of several; None if there is none."""
    for name in ("venv", "env", "envs"):
        inner = getattr(envs, name, None)
        if inner is not None:
            return inner[0] if isinstance(inner, list) and inner else inner
    # Environments in other processes are copied with their settings.
    return envs.get_attr("unwrapped", [0])[0] if hasattr(envs, "remotes") else None
