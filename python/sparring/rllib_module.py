"""The RLModule of `sparring.rllib`: one policy for all satellites or deputies."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from gymnasium import spaces
from ray.rllib.core.columns import Columns
from ray.rllib.core.distribution.torch.torch_distribution import TorchMultiCategorical
from ray.rllib.core.rl_module.apis import InferenceOnlyAPI, ValueFunctionAPI
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.core.rl_module.torch import TorchRLModule
from torch import nn

from .tasks import task as find_task


def module_spec(task: str, *, hidden: Sequence[int] = (128, 128), log_std: float = -1.5) -> RLModuleSpec:
    """Makes the spec of a module with one policy for all satellites or deputies: `config.rl_module(rl_module_spec=…)`.

    With `AGENTS` it is the spec of the policy that all agents are mapped to.

    Args:
        task: A task of the run.
        hidden: Units of each hidden layer.
        log_std: Initial logarithm of the standard deviation of continuous actions; it is learned. Actions are from -1 to 1,
            and useful actions are much smaller.

    Raises:
        ValueError: The task is unknown.
    """
    config = {"values": len(find_task(task).action_columns), "hidden": list(hidden), "log_std": log_std}
    return RLModuleSpec(module_class=AgentsModule, model_config=config)


def policy_fn(rl_module: TorchRLModule) -> Callable[[npt.NDArray[np.float32]], npt.NDArray[Any]]:
    """Returns a function from observations to deterministic actions of all agents, for `sparring.evaluate`.

    Args:
        rl_module: Module that was trained in `TEAM` or `AGENTS`. Custom connectors are not applied.
    """
    size = int(np.prod(rl_module.observation_space.shape))
    distribution = rl_module.get_inference_action_dist_cls()

    def act(observations: npt.NDArray[np.float32]) -> npt.NDArray[Any]:
        rows = torch.from_numpy(np.ascontiguousarray(observations).reshape(-1, size))
        outputs = rl_module.forward_inference({Columns.OBS: rows})
        mode = distribution.from_logits(outputs[Columns.ACTION_DIST_INPUTS]).to_deterministic().sample()
        actions: npt.NDArray[Any] = mode.numpy()
        if not isinstance(rl_module.action_space, spaces.Box):
            return actions.reshape(observations.shape[:2])
        return actions.clip(-1.0, 1.0).reshape(*observations.shape[:2], -1)

    return act


class AgentsModule(TorchRLModule, ValueFunctionAPI, InferenceOnlyAPI):
    """One policy that controls every satellite or deputy from its own row of observations, in `TEAM` and in `AGENTS`.

    The action of a team is the actions of all agents, its value is the mean of their values. `module_spec` makes its spec.
    """

    def setup(self) -> None:
        """Builds an actor and a critic that share no weights."""
        config, action_space = self.model_config, self.action_space
        self._continuous = isinstance(action_space, spaces.Box)
        if self._continuous:
            outputs = config["values"]
            self._agents = int(np.prod(action_space.shape)) // outputs
            self.log_std = nn.Parameter(torch.full((outputs,), float(config["log_std"])))
        elif isinstance(action_space, spaces.MultiDiscrete):
            outputs, self._agents = int(action_space.nvec[0]), len(action_space.nvec)
            self.action_dist_cls = TorchMultiCategorical.get_partial_dist_cls(input_lens=list(map(int, action_space.nvec)))
        else:
            outputs, self._agents = int(action_space.n), 1
        self._row_size = int(np.prod(self.observation_space.shape)) // self._agents
        self.actor = _layers(self._row_size, config["hidden"], outputs, 0.01)
        self.critic = _layers(self._row_size, config["hidden"], 1, 1.0)

    def _rows(self, batch: Mapping[str, Any]) -> torch.Tensor:
        observations: torch.Tensor = batch[Columns.OBS]
        return observations.reshape(*observations.shape[:-1], self._agents, self._row_size)

    def _forward(self, batch: Mapping[str, Any], **_: Any) -> dict[str, Any]:
        means = self.actor(self._rows(batch)).flatten(-2)
        if not self._continuous:
            return {Columns.ACTION_DIST_INPUTS: means}
        log_std = self.log_std.repeat(self._agents).expand_as(means)
        return {Columns.ACTION_DIST_INPUTS: torch.cat([means, log_std], -1)}

    def compute_values(self, batch: Mapping[str, Any], embeddings: Any = None) -> torch.Tensor:
        """Returns the estimated returns."""
        values: torch.Tensor = self.critic(self._rows(batch)).squeeze(-1).mean(-1)
        return values

    def get_non_inference_attributes(self) -> list[str]:
        """Returns the attributes that env runners do not need."""
        return ["critic"]


def _layers(inputs: int, hidden: Sequence[int], outputs: int, gain: float) -> nn.Sequential:
    sizes = [inputs, *hidden, outputs]
    layers: list[nn.Module] = []
    for layer_inputs, layer_outputs in pairwise(sizes):
        is_last = len(layers) == 2 * len(hidden)
        layer = nn.Linear(layer_inputs, layer_outputs)
        nn.init.orthogonal_(layer.weight, gain if is_last else 2.0**0.5)
        nn.init.zeros_(layer.bias)
        layers += [layer] if is_last else [layer, nn.Tanh()]
    return nn.Sequential(*layers)
