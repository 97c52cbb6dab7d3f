"""Proximal policy optimisation in one file, in the manner of CleanRL: read it, copy it, change it.

    python -m sparring.experiments ppo --task kessler/survival --steps 300000

One policy controls every satellite (or deputy) from its own row of observations. Environments write into the rollout's arrays, so
no observation is copied on the way to the learner. Rows of agents that have left, and of episodes that the curriculum only
measures, are not learned from. The clipped objective and the generalised advantages follow Schulman et al. (2017, equations 7 and
11), the details of the losses Huang et al. (2022, "The 37 implementation details of PPO").
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

try:
    import torch
    from torch import nn
except ImportError as error:
    raise ImportError("sparring.experiments needs torch: pip install 'sparring[experiments]'") from error

import sparring

from ..errors import invalid
from ..trainer_metrics import TrainerReport


def _option(default: Any, help: str) -> Any:
    return field(default=default, metadata={"help": help})


@dataclass(frozen=True)
class Config:
    """Hyperparameters of a training."""

    task: str | None = _option(None, "id of a task (default: kessler/survival, or the tasks of the run)")
    level: int | None = _option(None, "level, 0 to 9, if there is no curriculum (default: the default params)")
    steps: int = _option(300_000, "total env-steps; a step of an environment counts once, for any number of agents")
    num_envs: int = _option(64, "number of environments")
    rollout: int = _option(50, "steps of each environment per update; 50 is an episode of kessler")
    threads: int = _option(1, "threads of environments and of torch")
    learning_rate: float = _option(5e-4, "learning rate of Adam")
    gamma: float = _option(0.97, "discount factor")
    gae_lambda: float = _option(0.9, "lambda of generalised advantage estimation")
    epochs: int = _option(8, "passes over a rollout")
    minibatches: int = _option(4, "minibatches of a rollout, with one update each")
    clip: float = _option(0.2, "clip range of the probability ratio")
    value_weight: float = _option(0.5, "weight of the critic's loss")
    entropy_weight: float = _option(0.0, "weight of the entropy bonus")
    max_grad_norm: float = _option(0.5, "maximum norm of gradients")
    hidden: int = _option(128, "units of each of the two hidden layers")
    log_std: float = _option(-1.5, "initial logarithm of the standard deviation of actions, which are from -1 to 1")
    seed: int = _option(1, "seed of weights, exploration and, without a curriculum, scenarios")

    def __post_init__(self) -> None:
        for name in ("steps", "num_envs", "rollout", "threads", "epochs", "minibatches", "hidden"):
            if getattr(self, name) < 1:
                raise invalid(name, ">= 1", getattr(self, name))
        if not 0 <= self.seed < 2**32:
            raise invalid("seed", "from 0 to 4294967295", self.seed)
        for name in ("learning_rate", "clip", "max_grad_norm"):
            if not getattr(self, name) > 0.0:
                raise invalid(name, "> 0", getattr(self, name))
        for name in ("gamma", "gae_lambda"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise invalid(name, "from 0 to 1", getattr(self, name))


class Policy(nn.Module):
    """Actor and critic of one agent, without shared weights."""

    def __init__(self, observation_size: int, action_size: int, config: Config) -> None:
        super().__init__()
        self.sizes, self.config = (observation_size, action_size), config
        self.actor = _layers(observation_size, config.hidden, action_size, 0.01)
        self.critic = _layers(observation_size, config.hidden, 1, 1.0)
        self.log_std = nn.Parameter(torch.full((action_size,), config.log_std))

    def save(self, file: str) -> None:
        """Saves the weights and the configuration."""
        torch.save({"config": asdict(self.config), "sizes": self.sizes, "weights": self.state_dict()}, file)

    @staticmethod
    def load(file: str) -> Policy:
        """Loads a saved policy.

        Raises:
            ValueError: The file has no saved policy.
        """
        saved = torch.load(file)
        if not isinstance(saved, dict) or not {"sizes", "config", "weights"} <= saved.keys():
            raise invalid("file", "a file that Policy.save wrote", file)
        observation_size, action_size = saved["sizes"]
        policy = Policy(observation_size, action_size, Config(**saved["config"]))
        policy.load_state_dict(saved["weights"])
        return policy

    def distribution(self, rows: torch.Tensor) -> torch.distributions.Normal:
        """Returns the distribution of each value of an action."""
        return torch.distributions.Normal(self.actor(rows), self.log_std.exp())

    def act(self, observations: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Returns the most likely actions of all agents of all environments, for `sparring.evaluate`."""
        with torch.no_grad():
            actions: npt.NDArray[np.float32] = self.actor(torch.from_numpy(np.ascontiguousarray(observations))).numpy()
        return actions

    def sample(self, observations: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """Samples actions of all agents of all environments, for `sparring.evaluate` with `stochastic=True`."""
        with torch.no_grad():
            rows = torch.from_numpy(np.ascontiguousarray(observations))
            actions: npt.NDArray[np.float32] = self.distribution(rows).sample().numpy()
        return actions


def _layers(inputs: int, hidden: int, outputs: int, gain: float) -> nn.Sequential:
    def layer(layer_inputs: int, layer_outputs: int, gain: float) -> nn.Linear:
        linear = nn.Linear(layer_inputs, layer_outputs)
        nn.init.orthogonal_(linear.weight, gain)
        nn.init.zeros_(linear.bias)
        return linear

    root = 2.0**0.5
    return nn.Sequential(
        layer(inputs, hidden, root), nn.Tanh(), layer(hidden, hidden, root), nn.Tanh(), layer(hidden, outputs, gain)
    )


class Rollout:
    """Transitions of some steps of all environments, in arrays that the environments write."""

    def __init__(self, envs: sparring.VectorEnvironment, steps: int) -> None:
        row = envs.single_observation_space.shape or ()
        shape = (steps, envs.num_envs, (row or (1,))[0])
        #: Observations; one more than steps, since the last values need the observation after the last step.
        self.observations = np.zeros((steps + 1, envs.num_envs, *row), np.float32)
        #: The same memory in the shape that environments write.
        self.out = self.observations.reshape(steps + 1, *envs.empty_observations().shape)
        self.actions = np.zeros((*shape, *(envs.agent_action_space.shape or ())), np.float32)
        self.log_probs = np.zeros(shape, np.float32)
        self.values = np.zeros((steps + 1, *shape[1:]), np.float32)
        self.rewards = np.zeros(shape, np.float32)
        self.dones = np.zeros(shape, np.bool_)
        #: True for rows that are learned from.
        self.active = np.zeros(shape, np.bool_)
        self._team = (np.zeros(envs.num_envs), np.zeros(envs.num_envs, np.bool_), np.zeros(envs.num_envs, np.bool_))

    def collect(self, envs: sparring.VectorEnvironment, policy: Policy, absent: npt.NDArray[np.bool_]) -> list[float]:
        """Steps the environments by the policy; returns the returns of the episodes that ended.

        Args:
            envs: The environments.
            policy: The policy, which samples actions.
            absent: Agents that take no part, envs × agents; updated in place.
        """
        returns: list[float] = []
        train = envs.train if envs.curriculum else np.ones(envs.num_envs, np.bool_)
        for step in range(len(self.rewards)):
            with torch.no_grad():
                rows = torch.from_numpy(self.observations[step])
                distribution = policy.distribution(rows)
                actions = distribution.sample()
                self.log_probs[step] = distribution.log_prob(actions).sum(-1).numpy()
                self.values[step] = policy.critic(rows).squeeze(-1).numpy()
            self.actions[step] = actions.numpy()
            self.active[step] = ~absent & train[:, None]
            *_, infos = envs.step(self.actions[step], out=(self.out[step + 1], *self._team))
            results = envs.agent_results()
            self.rewards[step] = results.rewards
            self.dones[step] = results.terminations | results.truncations
            absent[:] = self.dones[step]
            if "_episode" in infos:
                ended = infos["_episode"]
                returns += infos["episode"]["r"][ended].tolist()
                self.dones[step, ended] = True
                absent[ended] = envs.absent_agents()[ended]
                train = envs.train if envs.curriculum else train
        with torch.no_grad():
            self.values[-1] = policy.critic(torch.from_numpy(self.observations[-1])).squeeze(-1).numpy()
        return returns

    def advantages(self, gamma: float, gae_lambda: float) -> npt.NDArray[np.float32]:
        """Returns generalised advantages. An episode ends at its horizon, since the score counts no later reward."""
        advantages = np.zeros_like(self.rewards)
        last = np.zeros(self.rewards.shape[1:], np.float32)
        for step in reversed(range(len(self.rewards))):
            continues = 1.0 - self.dones[step]
            delta = self.rewards[step] + gamma * self.values[step + 1] * continues - self.values[step]
            last = delta + gamma * gae_lambda * continues * last
            advantages[step] = last
        return advantages


def learn(policy: Policy, optimizer: torch.optim.Optimizer, rollout: Rollout, config: Config) -> dict[str, float]:
    """Runs all epochs on a rollout; returns metrics of the last minibatch."""
    advantages = rollout.advantages(config.gamma, config.gae_lambda)
    active = rollout.active.reshape(-1)

    def rows(array: npt.NDArray[np.float32]) -> torch.Tensor:
        return torch.from_numpy(array.reshape(active.size, *array.shape[3:])[active])

    observations, actions = rows(rollout.observations[:-1]), rows(rollout.actions)
    old_log_probs, row_advantages = rows(rollout.log_probs), rows(advantages)
    targets = row_advantages + rows(rollout.values[:-1])
    metrics: dict[str, float] = {}
    for _ in range(config.epochs):
        for batch in torch.randperm(len(observations)).chunk(config.minibatches):
            if len(batch) < 2:
                continue
            distribution = policy.distribution(observations[batch])
            ratio = (distribution.log_prob(actions[batch]).sum(-1) - old_log_probs[batch]).exp()
            advantage = row_advantages[batch]
            advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
            clipped = ratio.clamp(1 - config.clip, 1 + config.clip)
            policy_loss = -torch.min(ratio * advantage, clipped * advantage).mean()
            value_loss = 0.5 * (policy.critic(observations[batch]).squeeze(-1) - targets[batch]).pow(2).mean()
            entropy = distribution.entropy().sum(-1).mean()
            optimizer.zero_grad()
            (policy_loss + config.value_weight * value_loss - config.entropy_weight * entropy).backward()
            nn.utils.clip_grad_norm_(policy.parameters(), config.max_grad_norm)
            optimizer.step()
            metrics = {
                "policy_loss": policy_loss.item(),
                "value_loss": value_loss.item(),
                "std": policy.log_std.exp().mean().item(),
            }
    return metrics


def make_envs(config: Config, curriculum: sparring.Curriculum | None) -> sparring.VectorEnvironment:
    """Makes the environments of a training."""
    level = None if curriculum else config.level
    return sparring.make_vec(
        config.task, config.num_envs, curriculum=curriculum, level=level, autoreset_mode="same_step", threads=config.threads
    )


def train(
    config: Config,
    curriculum: sparring.Curriculum | None = None,
    report: Callable[[int, Policy, dict[str, float]], None] | None = None,
    report_metrics: bool = True,
) -> Policy:
    """Trains a policy and returns it.

    Args:
        config: Hyperparameters.
        curriculum: Source of the scenarios.
        report: Called after each rollout with the number of steps, the policy and metrics.
        report_metrics: False to send no metrics to the curriculum's run; otherwise they are sent at most once a second.
    """
    server_report = TrainerReport(curriculum if report_metrics else None)
    torch.manual_seed(config.seed)
    torch.set_num_threads(config.threads)
    envs = make_envs(config, curriculum)
    try:
        rollout = Rollout(envs, config.rollout)
        policy = Policy(rollout.observations.shape[-1], rollout.actions.shape[-1], config)
        optimizer = torch.optim.Adam(policy.parameters(), config.learning_rate, eps=1e-5)
        envs.reset(seed=config.seed, out=rollout.out[0])
        absent = envs.absent_agents()
        steps_per_rollout = config.rollout * config.num_envs
        steps = 0
        while steps < config.steps:
            started = time.perf_counter()
            returns = rollout.collect(envs, policy, absent)
            collected = time.perf_counter()
            metrics = learn(policy, optimizer, rollout, config)
            rollout.observations[0] = rollout.observations[-1]
            steps += steps_per_rollout
            if curriculum:
                curriculum.policy_version += 1
            metrics["steps_per_s"] = steps_per_rollout / (time.perf_counter() - started)
            metrics["rollout_steps_per_s"] = steps_per_rollout / (collected - started)
            metrics |= {"return": float(np.mean(returns))} if returns else {}
            levels = envs.levels[envs.levels >= 0]
            metrics |= {"level": float(levels.mean())} if levels.size else {}
            server_report.add(steps, metrics)
            if report:
                report(steps, policy, metrics)
    finally:
        server_report.finish()
        envs.close()
    return policy


def measure_speed(config: Config, seconds: float = 2.0) -> float:
    """Returns the environment steps per second without a policy."""
    envs = make_envs(config, None)
    flags = (np.zeros(envs.num_envs, np.bool_), np.zeros(envs.num_envs, np.bool_))
    out = (envs.empty_observations(), np.zeros(envs.num_envs), *flags)
    actions = np.zeros(envs.action_space.shape or (), np.float32)
    envs.reset(seed=config.seed, out=out[0])
    steps, started = 0, time.perf_counter()
    while time.perf_counter() - started < seconds:
        for _ in range(20):
            envs.step(actions, out=out)
        steps += 20 * envs.num_envs
    speed = steps / (time.perf_counter() - started)
    envs.close()
    return speed
