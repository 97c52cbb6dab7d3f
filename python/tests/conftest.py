"""Fixtures and helpers of all tests."""

import os

import gymnasium
import numpy as np
import pytest

import sparring

#: Program of the server that tests start.
BINARY = os.environ.get("SPARRING_BINARY") or os.environ.get("SPARRING_BIN")
#: Skips a test without a server program. `make test-python` builds the program, so it runs all tests.
needs_server = pytest.mark.skipif(not BINARY, reason="SPARRING_BINARY is not set: build the program, or run make test-python")
#: True for the long forms of tests, which `make test-heavy` runs.
LONG_TESTS = "SPARRING_LONG_TESTS" in os.environ


#: Ids of environments with each kind of actions that they have; tasks with named actions have discrete ones only.
IDS_AND_ACTIONS = [
    (id, actions)
    for id, task in sorted(sparring.ENVIRONMENTS.items())
    for actions in ("continuous", "discrete")
    if actions == "discrete" or not sparring.task(task).action_names
]


@pytest.fixture(params=sorted(sparring.ENVIRONMENTS))
def id(request):
    return request.param


@pytest.fixture(params=sorted(sparring.ENVIRONMENTS.values()))
def task(request):
    return request.param


def bitwise_equal(a, b):
    """Returns True if observations or infos are equal to the bit."""
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(bitwise_equal(a[key], b[key]) for key in a)
    a, b = np.asarray(a), np.asarray(b)
    if a.dtype == object:
        return a.shape == b.shape and all(
            (x is None and y is None) or bitwise_equal(x, y) for x, y in zip(a.ravel(), b.ravel(), strict=True)
        )
    return a.shape == b.shape and a.dtype == b.dtype and a.tobytes() == b.tobytes()


def short_episode_params(task):
    """Returns params with which some episodes end early, so that tests see resets."""
    if task.startswith("docking"):
        return {"start_radius": 10.0, "time_limit_s": 60.0}
    if task == "tasking/scanning":
        return {"time_limit_s": 1200.0}
    if task.startswith("tasking"):
        return {"time_limit_s": 1200.0, "targets": 100.0}
    return {"debris": 120.0, "spread": 1.0}


def random_actions(space, rng, envs, scale=0.3):
    """Returns small random actions of a single environment's space for some environments, as float32 or integers."""
    if isinstance(space, gymnasium.spaces.MultiDiscrete):
        return rng.integers(0, space.nvec, (envs, *space.shape))
    if isinstance(space, gymnasium.spaces.Discrete):
        return rng.integers(0, space.n, envs)
    return rng.uniform(-scale, scale, (envs, *space.shape)).astype(np.float32)


def hold_action(space):
    """Returns the action of one agent that holds."""
    return np.zeros_like(space.low) if isinstance(space, gymnasium.spaces.Box) else -1


__all__ = [
    "BINARY",
    "IDS_AND_ACTIONS",
    "LONG_TESTS",
    "bitwise_equal",
    "gymnasium",
    "hold_action",
    "needs_server",
    "random_actions",
    "short_episode_params",
]
