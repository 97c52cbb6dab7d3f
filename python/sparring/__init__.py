"""Environments in which agents learn to fly satellites through debris.

The worlds are compiled; what is here makes them feel native to Gymnasium and PettingZoo:

    import sparring

    envs = sparring.make_vec("kessler/survival", num_envs=1024)        # a gymnasium.vector.VectorEnv
    env = gymnasium.make("sparring/Survival-v0")                       # one environment, all satellites by one action
    env = sparring.parallel_env("docking/multiagent")                  # a PettingZoo ParallelEnv

and what a scenario is worth is asked by `sparring.bracket`, what an episode shows by `sparring.critique`.
"""

from typing import TYPE_CHECKING

from ._native import __version__
from .curriculum import Curriculum, CurriculumError
from .evaluation import Evaluated, evaluate
from .parallel import ParallelEnvironment, parallel_env
from .policies import Policy, policy
from .registration import ENVIRONMENTS, register
from .scenario import Bracket, Flown, Scenario, bracket, critique, fly, replay
from .single import Environment
from .tasks import Param, Task, levels, parameter_space, task, tasks
from .vector import VectorEnvironment, make_vec

if TYPE_CHECKING:
    # Not among `__all__`: `from sparring import *` works without what they need.
    from .client import ApiError as ApiError
    from .client import AsyncClient as AsyncClient
    from .client import Client as Client
    from .client import Unreachable as Unreachable

__all__ = [
    "ENVIRONMENTS",
    "Bracket",
    "Curriculum",
    "CurriculumError",
    "Environment",
    "Evaluated",
    "Flown",
    "ParallelEnvironment",
    "Param",
    "Policy",
    "Scenario",
    "Task",
    "VectorEnvironment",
    "__version__",
    "bracket",
    "critique",
    "evaluate",
    "fly",
    "levels",
    "make_vec",
    "parallel_env",
    "parameter_space",
    "policy",
    "register",
    "replay",
    "task",
    "tasks",
]

register()


def __getattr__(name: str) -> object:
    # Clients need what not everybody has, and take a while to be imported.
    if name in ("Client", "AsyncClient", "ApiError", "Unreachable"):
        from . import client

        return getattr(client, name)
    raise AttributeError(f"module 'sparring' has no attribute {name!r}")
