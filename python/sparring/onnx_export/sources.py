"""Models that can be exported, and the normalisation of their observations."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import numpy.typing as npt
from torch import nn

from ..errors import invalid
from .interface import ActionShape
from .source_policy import SourcePolicy


def read_model(model: Any) -> SourcePolicy:
    """Reads a model of Stable-Baselines3, a policy of `sparring.experiments.ppo`, or a module of torch.

    Raises:
        ValueError: The model is of another kind.
    """
    if "stable_baselines3" in sys.modules:
        from . import sb3_networks

        if sb3_networks.is_algorithm(model):
            return sb3_networks.read_algorithm(model)
    # A policy exists only if its module was imported.
    ppo = sys.modules.get("sparring.experiments.ppo")
    if ppo is not None and isinstance(model, ppo.Policy):
        observations, choices = model.sizes
        return SourcePolicy(model.actor, (observations,), ActionShape((), choices))
    if isinstance(model, nn.Module):
        return SourcePolicy(model)
    kinds = "an algorithm of Stable-Baselines3, a sparring.experiments.ppo.Policy or a torch.nn.Module"
    raise invalid("model", kinds, type(model))


def check_normalization(normalize: Any) -> None:
    """Checks that an argument is a `VecNormalize` of Stable-Baselines3.

    Raises:
        ValueError: It is not.
    """
    sb3 = sys.modules.get("stable_baselines3.common.vec_env")
    if sb3 is None or not isinstance(normalize, sb3.VecNormalize):
        raise invalid("normalize", "a VecNormalize of Stable-Baselines3", normalize)


def find_normalization(envs: Any) -> Any:
    """Returns the `VecNormalize` among the wrappers of environments that normalises observations; None without one.

    Raises:
        ValueError: There are two of them.
    """
    sb3 = sys.modules.get("stable_baselines3.common.vec_env")
    found: Any = None
    while sb3 is not None and isinstance(envs, sb3.VecEnvWrapper):
        if isinstance(envs, sb3.VecNormalize) and envs.norm_obs:
            if found is not None:
                raise ValueError("`envs` must have at most one VecNormalize that normalises observations, got two")
            found = envs
        envs = envs.venv
    return found


def moments(normalize: Any) -> dict[str, tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]]:
    """Returns mean and variance of each normalised part of observations; the key of a Box is empty."""
    if not normalize.norm_obs:
        return {}
    statistics = normalize.obs_rms if isinstance(normalize.obs_rms, dict) else {"": normalize.obs_rms}
    return {key: (np.asarray(part.mean, np.float64), np.asarray(part.var, np.float64)) for key, part in statistics.items()}
