"""Networks of Stable-Baselines3's algorithms, without their sampling."""

from __future__ import annotations

from typing import Any

import numpy.typing as npt
import torch
from gymnasium import spaces
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.dqn.policies import DQNPolicy
from stable_baselines3.sac.policies import SACPolicy
from stable_baselines3.td3.policies import TD3Policy
from torch import nn

from ..errors import invalid
from .interface import ActionShape
from .source_policy import SourcePolicy, evaluating


def is_algorithm(model: Any) -> bool:
    """Returns True for an algorithm of Stable-Baselines3."""
    return isinstance(model, BaseAlgorithm)


def read_algorithm(model: Any) -> SourcePolicy:
    """Reads a trained algorithm.

    Raises:
        ValueError: Its policy is recurrent or of an unknown kind.
    """
    policy = model.policy

    def predict(observations: Any) -> npt.NDArray[Any]:
        with evaluating(policy):
            actions: npt.NDArray[Any] = policy.predict(observations, deterministic=True)[0]
        return actions

    space = policy.observation_space
    is_dict = isinstance(space, spaces.Dict)
    return SourcePolicy(
        _network(policy),
        {key: part.shape for key, part in space.spaces.items()} if is_dict else space.shape,
        _action(policy.action_space),
        is_squashed=bool(policy.squash_output) and isinstance(policy.action_space, spaces.Box),
        envs=model.get_env(),
        predict=predict,
    )


def _network(policy: Any) -> nn.Module:
    if isinstance(policy, ActorCriticPolicy) and not hasattr(policy, "lstm_actor"):
        return _ActorCriticNetwork(policy)
    if isinstance(policy, DQNPolicy):
        return _ValueNetwork(policy.q_net)
    if isinstance(policy, SACPolicy):
        return _SquashedNetwork(policy.actor)
    if isinstance(policy, TD3Policy):
        return _DeterministicNetwork(policy.actor)
    raise invalid("model", "a PPO, A2C, DQN, SAC or TD3 whose policy is not recurrent", type(policy).__name__)


def _action(space: Any) -> ActionShape:
    if isinstance(space, spaces.Discrete):
        return ActionShape((), int(space.n))
    if isinstance(space, spaces.MultiDiscrete) and len(set(space.nvec.tolist())) == 1:
        return ActionShape((len(space.nvec),), int(space.nvec[0]))
    if isinstance(space, spaces.Box):
        return ActionShape(tuple(space.shape), None)
    raise invalid("model", "trained on the actions of an environment of sparring", space)


class _ActorCriticNetwork(nn.Module):
    """Mean of the actions, or logits, of PPO and A2C."""

    def __init__(self, policy: Any) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, observations: Any) -> Any:
        policy = self.policy
        features = BasePolicy.extract_features(policy, observations, policy.pi_features_extractor)
        output = policy.action_net(policy.mlp_extractor.forward_actor(features))
        return torch.tanh(output) if policy.squash_output else output


class _ValueNetwork(nn.Module):
    """Action values of DQN: the largest is chosen, as of logits."""

    def __init__(self, q_net: Any) -> None:
        super().__init__()
        self.q_net = q_net

    def forward(self, observations: Any) -> Any:
        return self.q_net(observations)


class _SquashedNetwork(nn.Module):
    """Squashed mean of the actions of SAC."""

    def __init__(self, actor: Any) -> None:
        super().__init__()
        self.actor = actor

    def forward(self, observations: Any) -> Any:
        actor = self.actor
        return torch.tanh(actor.mu(actor.latent_pi(actor.extract_features(observations, actor.features_extractor))))


class _DeterministicNetwork(nn.Module):
    """Actions of TD3, which its last layer squashes."""

    def __init__(self, actor: Any) -> None:
        super().__init__()
        self.actor = actor

    def forward(self, observations: Any) -> Any:
        return self.actor(observations)
