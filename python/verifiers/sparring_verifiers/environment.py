"""The environment, and `load_environment` for programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import verifiers.v1 as vf
from pydantic import ValidationError

from sparring.curriculum import DEFAULT_URL

from .taskset import SparringConfig

#: Id of the package for verifiers.
PACKAGE_ID = "sparring-verifiers"
#: Default number of answers of the model. The remaining steps hold.
MAX_TURNS = 50


class SparringEnvConfig(vf.EnvConfig):
    """Configuration of the environment: one agent, whose conversation runs in the process of the environment."""

    agent: vf.AgentConfig = vf.AgentConfig(runtime=vf.SubprocessConfig(), max_turns=MAX_TURNS)


class SparringEnv(vf.Env[SparringEnvConfig]):
    """Environment with one agent, which runs the episode of a row."""

    async def run(self, task: vf.Task, agents: vf.Agents) -> None:
        """Runs the agent on a row."""
        await agents.agent.run(task)


def load_environment(
    url: str = DEFAULT_URL,
    run: str | None = None,
    suite: str | None = None,
    task: str | Sequence[str] = (),
    *,
    agent: Mapping[str, Any] | None = None,
    **settings: Any,
) -> vf.Env:
    """Loads the environment: for training on the curriculum of a run, or for an evaluation on a suite.

    Args:
        url: Address of the server.
        run: Id of the run to train on; without it a run is created.
        suite: Name of the suite to evaluate on.
        task: Id or ids of the tasks of the new run, or of the suite.
        agent: Fields of `verifiers.v1.AgentConfig` that differ from the defaults of this environment, such as `max_turns`.
        settings: Other fields of `SparringConfig`.

    Raises:
        ValueError: A value is invalid; the message names the field.
    """
    tasks = [task] if isinstance(task, str) else list(task)
    try:
        taskset = SparringConfig(id=PACKAGE_ID, url=url, run=run, suite=suite, tasks=tasks, **settings)
    except ValidationError as error:
        raise ValueError(_first_fault(error)) from error
    return vf.load_environment(SparringEnvConfig(taskset=taskset, agent=dict(agent or {})))


def _first_fault(error: ValidationError) -> str:
    """Returns one sentence about the first invalid field."""
    fault = error.errors()[0]
    message = fault["msg"].removeprefix("Value error, ")
    if not fault["loc"]:
        return message
    return f"`{'.'.join(map(str, fault['loc']))}`: {message}, got {fault['input']!r}"
