"""The RLModule of `sparring.rllib`: one policy for every satellite or deputy."""

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

from .tasks import task as find


class AgentsModule(TorchRLModule, ValueFunctionAPI, InferenceOnlyAPI):
    """One policy that flies every satellite (or deputy) from its own row of observations, in `TEAM` and in `AGENTS` alike: a
    team's action is the actions of all, its value the mean of their values. `module` makes its spec."""

    def setup(self) -> None:
        """Builds an actor and a critic beside each other."""
        wish, acts = self.model_config, self.action_space
        self._continuous = isinstance(acts, spaces.Box)
        if self._continuous:
            outputs = wish["values"]
            self._agents = int(np.prod(acts.shape)) // outputs
            self.log_std = nn.Parameter(torch.full((outputs,), float(wish["log_std"])))
        elif isinstance(acts, spaces.MultiDiscrete):
            outputs, self._agents = int(acts.nvec[0]), len(acts.nvec)
            self.action_dist_cls = TorchMultiCategorical.get_partial_dist_cls(input_lens=list(map(int, acts.nvec)))
        else:
            outputs, self._agents = int(acts.n), 1
        self._cells = int(np.prod(self.observation_space.shape)) // self._agents
        self.actor = _layers(self._cells, wish["hidden"], outputs, 0.01)
        self.critic = _layers(self._cells, wish["hidden"], 1, 1.0)

    def _rows(self, batch: Mapping[str, Any]) -> torch.Tensor:
        seen: torch.Tensor = batch[Columns.OBS]
        return seen.reshape(*seen.shape[:-1], self._agents, self._cells)

    def _forward(self, batch: Mapping[str, Any], **_: Any) -> dict[str, Any]:
        means = self.actor(self._rows(batch)).flatten(-2)
        if not self._continuous:
            return {Columns.ACTION_DIST_INPUTS: means}
        spread = self.log_std.repeat(self._agents).expand_as(means)
        return {Columns.ACTION_DIST_INPUTS: torch.cat([means, spread], -1)}

    def compute_values(self, batch: Mapping[str, Any], embeddings: Any = None) -> torch.Tensor:
        """What is still to be earned."""
        values: torch.Tensor = self.critic(self._rows(batch)).squeeze(-1).mean(-1)
        return values

    def get_non_inference_attributes(self) -> list[str]:
        """What env runners do without."""
        return ["critic"]


def _layers(inputs: int, hidden: Sequence[int], outputs: int, gain: float) -> nn.Sequential:
    sizes = [inputs, *hidden, outputs]
    layers: list[nn.Module] = []
    for ins, outs in pairwise(sizes):
        last = len(layers) == 2 * len(hidden)
        layer = nn.Linear(ins, outs)
        nn.init.orthogonal_(layer.weight, gain if last else 2.0**0.5)
        nn.init.zeros_(layer.bias)
        layers += [layer] if last else [layer, nn.Tanh()]
    return nn.Sequential(*layers)


def module(task: str, *, hidden: Sequence[int] = (128, 128), log_std: float = -1.5) -> RLModuleSpec:
    """An RLModule with one policy for all satellites or deputies: `config.rl_module(rl_module_spec=…)`, in `AGENTS` that of the
    one policy all are mapped to.

    Args:
        task: The task that is flown, or one of them.
        hidden: Units of each hidden layer.
        log_std: Logarithm of the spread that continuous actions are explored with at the beginning: their range is -1 to 1, and
            most of it is much too far. It is learned.

    Raises:
        ValueError: No such task.
    """
    config = {"values": len(find(task).action), "hidden": list(hidden), "log_std": log_std}
    return RLModuleSpec(module_class=AgentsModule, model_config=config)


def act(rl_module: TorchRLModule) -> Callable[[npt.NDArray[np.float32]], npt.NDArray[Any]]:
    """Actions of all agents of all environments by a module that was trained in `TEAM` or `AGENTS`, without exploring: for
    `sparring.evaluate`. Connectors of your own that change what a module sees are not asked."""
    cells = int(np.prod(rl_module.observation_space.shape))
    spread = rl_module.get_inference_action_dist_cls()

    def of(seen: npt.NDArray[np.float32]) -> npt.NDArray[Any]:
        told = rl_module.forward_inference({Columns.OBS: torch.from_numpy(np.ascontiguousarray(seen).reshape(-1, cells))})
        actions: npt.NDArray[Any] = spread.from_logits(told[Columns.ACTION_DIST_INPUTS]).to_deterministic().sample().numpy()
        if not isinstance(rl_module.action_space, spaces.Box):
            return actions.reshape(seen.shape[:2])
        return actions.clip(-1.0, 1.0).reshape(*seen.shape[:2], -1)

    return of
