"""Environments in which agents learn to control satellites, and the curriculum that trains them.

The worlds are compiled. This package gives them the interfaces of Gymnasium and PettingZoo:

    import sparring

    envs = sparring.make_vec("kessler/survival", num_envs=1024)        # a gymnasium.vector.VectorEnv
    env = gymnasium.make("sparring/Survival-v0")                       # one environment, one action for all satellites
    env = sparring.parallel_env("docking/multiagent")                  # a PettingZoo ParallelEnv

`sparring.bracket` measures a scenario between a floor and a reference; `sparring.critique` explains an episode.
"""

from typing import TYPE_CHECKING

from . import discounting, feed
from ._native import __version__
from .curriculum import Curriculum, CurriculumError
from .evaluation import EvaluationResult, evaluate
from .parallel import ParallelEnvironment, parallel_env
from .policies import Policy, policy
from .registration import ENVIRONMENTS, register
from .scenario import Bracket, EpisodeOutcome, Scenario, bracket, critique, replay, rollout
from .single import Environment
from .tasks import Param, Task, levels, parameter_space, task, tasks
from .vector import VectorEnvironment, make_vec

if TYPE_CHECKING:
    # Not in `__all__`, so that `from sparring import *` works without the optional dependencies of clients and exports.
    from .client import ApiError as ApiError
    from .client import AsyncClient as AsyncClient
    from .client import Client as Client
    from .client import ServerUnreachableError as ServerUnreachableError
    from .onnx_export import export_onnx as export_onnx

__all__ = [
    "ENVIRONMENTS",
    "Bracket",
    "Curriculum",
    "CurriculumError",
    "Environment",
    "EpisodeOutcome",
    "EvaluationResult",
    "ParallelEnvironment",
    "Param",
    "Policy",
    "Scenario",
    "Task",
    "VectorEnvironment",
    "__version__",
    "bracket",
    "critique",
    "discounting",
    "evaluate",
    "feed",
    "levels",
    "make_vec",
    "parallel_env",
    "parameter_space",
    "policy",
    "register",
    "replay",
    "rollout",
    "task",
    "tasks",
]

register()


def __getattr__(name: str) -> object:
    # The clients and exports have optional dependencies and are slow to import.
    if name in ("Client", "AsyncClient", "ApiError", "ServerUnreachableError"):
        from . import client

        return getattr(client, name)
    if name == "export_onnx":
        from .onnx_export import export_onnx

        return export_onnx
    raise AttributeError(f"module 'sparring' has no attribute {name!r}")
