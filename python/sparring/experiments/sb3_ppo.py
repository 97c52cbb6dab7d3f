"""PPO of Stable-Baselines3 with the settings, the policy's actions and the rewards of `ppo`: a second learner of the same agents.

The implementation is that of Raffin et al. (2021). It differs from `ppo` in details: it normalises advantages in each minibatch,
and adds the estimated value of the last observation where the horizon ends an episode.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import torch

import sparring

from .. import sb3
from .ppo import Config, agent_rewards, environment_settings

# `sb3` says how to install it.
from stable_baselines3 import PPO  # isort: skip
from stable_baselines3.common.callbacks import BaseCallback  # isort: skip

#: Decisions of agents after which `learn` would stop by itself.
UNLIMITED = 2**62


class ModelPolicy:
    """Policy of a model of Stable-Baselines3, with what evaluations need."""

    def __init__(self, model: PPO, config: Config) -> None:
        self.model, self.config = model, config
        #: Values of an agent's observation, and number of actions.
        self.sizes: tuple[int, int] = (model.observation_space.shape[0], int(model.action_space.n))
        self._sample = sb3.policy_fn(model, deterministic=False)

    def sample(self, observations: npt.NDArray[np.float32]) -> npt.NDArray[np.int64]:
        """Samples actions of all agents of all environments."""
        actions: npt.NDArray[np.int64] = self._sample(observations)
        return actions


def make_model(config: Config, envs: sb3.AgentsVecEnv, learning_rate: Callable[[float], float] | float) -> PPO:
    """Makes a model with the hyperparameters of a config. At first it holds with the config's `hold_logit`."""
    model = PPO(
        "MlpPolicy",
        envs,
        learning_rate=learning_rate,
        n_steps=config.rollout,
        batch_size=config.minibatch,
        n_epochs=config.epochs,
        gamma=config.gamma,
        gae_lambda=config.gae_lambda,
        clip_range=config.clip,
        ent_coef=config.entropy_weight,
        max_grad_norm=config.max_grad_norm,
        policy_kwargs={"net_arch": [config.hidden, config.hidden]},
        seed=config.seed,
        device="cpu",
        **sb3.active_only(envs),
    )
    with torch.no_grad():
        model.policy.action_net.bias[0] = config.hold_logit
    return model


def make_envs(config: Config, curriculum: sparring.Curriculum | None) -> sb3.AgentsVecEnv:
    """Makes the environments of a training, with the rewards of a config."""
    return sb3.vec_env(
        config.num_envs,
        config.task,
        curriculum=curriculum,
        decision_steps=config.decision_steps,
        reward=lambda results: agent_rewards(results, config),
        threads=config.threads,
        **environment_settings(config),
    )


def train(
    config: Config,
    curriculum: sparring.Curriculum,
    report: Callable[[int, ModelPolicy, dict[str, float]], None] | None = None,
    report_metrics: bool = True,
) -> ModelPolicy:
    """Trains a policy and returns it.

    Args:
        config: Hyperparameters.
        curriculum: Source of the scenarios.
        report: Called after each update with the number of steps, the policy and metrics.
        report_metrics: False to send no metrics to the curriculum's run; otherwise they are sent at most once a second.
    """
    torch.set_num_threads(config.threads)
    envs = make_envs(config, curriculum)
    # Stable-Baselines3 counts decisions of agents, and a config steps of environments.
    model = make_model(config, envs, lambda _: config.learning_rate_at(envs.envs.total_steps))
    policy = ModelPolicy(model, config)
    stop = _StopAtBudget(config.steps, lambda steps, metrics: report(steps, policy, metrics) if report else None)
    try:
        model.learn(UNLIMITED, [stop, sb3.CurriculumCallback(curriculum, report=report_metrics)])
    finally:
        envs.close()
    return policy


class _StopAtBudget(BaseCallback):
    """Reports each update, and ends the training at the beginning of the first rollout after a number of environment steps."""

    def __init__(self, budget: int, report: Callable[[int, dict[str, float]], None]) -> None:
        super().__init__()
        self._budget, self._report = budget, report
        self._is_complete = False

    def _on_rollout_start(self) -> None:
        steps = self.training_env.envs.total_steps
        if steps > 0:
            values = self.logger.name_to_value
            self._report(steps, {name: float(value) for name, value in values.items() if isinstance(value, (int, float))})
        self._is_complete = steps >= self._budget

    def _on_step(self) -> bool:
        return not self._is_complete
