"""Results of a step of vector environments."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

#: Arrays that a step can write: observations (as `VectorEnvironment.empty_observations` makes them), rewards, terminations
#: and truncations.
StepArrays = tuple[npt.NDArray[np.float32], npt.NDArray[np.float64], npt.NDArray[np.bool_], npt.NDArray[np.bool_]]


class AgentResults(NamedTuple):
    """Results of a step by agent, envs × agents."""

    rewards: npt.NDArray[np.float32]
    #: True for agents that terminated by the rules of the task.
    terminations: npt.NDArray[np.bool_]
    #: True for agents that the horizon truncated.
    truncations: npt.NDArray[np.bool_]


class StepTimes(NamedTuple):
    """Times of a step."""

    #: Duration of the step, s; in kessler steps, of one time unit each. It is 0 after a reset.
    d_ts: npt.NDArray[np.float64]
    #: True for agents that need an action in the next step, envs × agents. The others go on with theirs.
    requires_retasking: npt.NDArray[np.bool_]
