"""Proximal policy optimisation in one file, in the manner of CleanRL: read it, copy it, change it.

    python -m sparring.experiments ppo --task kessler/survival --steps 300000

One policy controls every satellite (or deputy) from its own row of observations, and chooses among a few actions. Environments
write into the rollout's arrays, so no observation is copied on the way to the learner. Rows of agents that have left, and of
episodes that the curriculum only measures, are not learned from. The clipped objective and the generalised advantages follow
Schulman et al. (2017, equations 7 and 11), the details of the losses Huang et al. (2022, "The 37 implementation details of PPO").
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
from ..vector_results import AgentResults

#: Reward of an agent from which its end counts as a success: a deputy that docks gets more, any other end costs something.
SUCCESS_REWARD = 0.5


def option(default: Any, help: str) -> Any:
    """Returns a field of a config with its description."""
    return field(default=default, metadata={"help": help})


@dataclass(frozen=True)
class LearnerConfig:
    """Hyperparameters of policies, their rewards and the clipped objective, which learners share."""

    task: str | None = option(None, "id of a task (default: kessler/survival, or the tasks of the run)")
    steps: int = option(300_000, "total env-steps; a step of an environment counts once, for any number of agents")
    num_envs: int = option(128, "number of environments")
    decision_steps: int = option(1, "env-steps for which an action is repeated")
    observation: str | None = option(None, "observation mode (default: that of the world)")
    actions: str = option("few", "`few` actions, or the larger grid of `discrete` ones")
    hold_logit: float = option(3.0, "initial logit of hold; a policy that first does little learns sooner what acting changes")
    reward_weight: float = option(0.0, "weight of the environment's rewards")
    loss_cost: float = option(1.0, "cost of an agent's own loss: its end before the horizon without a success")
    success_reward: float = option(0.0, "reward of an agent that ends with success, as a deputy that docks")
    threads: int = option(1, "threads of environments and of torch")
    learning_rate: float = option(2e-3, "learning rate of Adam at the start; it falls linearly to a tenth")
    epochs: int = option(4, "passes over a rollout")
    minibatch: int = option(1024, "rows of a minibatch, with one update each")
    clip: float = option(0.2, "clip range of the probability ratio")
    entropy_weight: float = option(0.0, "weight of the entropy bonus")
    max_grad_norm: float = option(0.5, "maximum norm of gradients")
    hidden: int = option(64, "units of each of the two hidden layers")
    seed: int = option(1, "seed of weights, exploration and, without a curriculum, scenarios")

    def __post_init__(self) -> None:
        for name in ("steps", "num_envs", "decision_steps", "threads", "epochs", "minibatch", "hidden"):
            if getattr(self, name) < 1:
                raise invalid(name, ">= 1", getattr(self, name))
        if not 0 <= self.seed < 2**32:
            raise invalid("seed", "from 0 to 4294967295", self.seed)
        for name in ("learning_rate", "clip", "max_grad_norm"):
            if not getattr(self, name) > 0.0:
                raise invalid(name, "> 0", getattr(self, name))

    def learning_rate_at(self, steps: int) -> float:
        """Returns the learning rate after some env-steps, a tenth of the first one from the end of the training on."""
        return self.learning_rate * (1.0 - 0.9 * min(steps, self.steps) / self.steps)


@dataclass(frozen=True)
class Config(LearnerConfig):
    """Hyperparameters of a training by PPO. `Config.tuned` returns those of a task."""

    level: int | None = option(None, "level, 0 to 9, if there is no curriculum (default: the default params)")
    rollout: int = option(50, "decisions of each environment per update; 50 is an episode of kessler")
    gamma: float = option(0.98, "discount factor of a decision")
    gae_lambda: float = option(0.8, "lambda of generalised advantage estimation")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rollout < 1:
            raise invalid("rollout", ">= 1", self.rollout)
        for name in ("gamma", "gae_lambda"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise invalid(name, "from 0 to 1", getattr(self, name))

    @staticmethod
    def tuned(task: str, **changes: Any) -> Config:
        """Returns the settings that were tuned for a task under uniform levels, with some changes."""
        return Config(**{"task": task, **tuned_settings(task), **changes})


#: Settings of each world and task that differ from the defaults. They were tuned under uniform levels.
TUNED: dict[str, dict[str, Any]] = {
    "docking": {
        "rollout": 64,
        "decision_steps": 5,
        "observation": "extended_state",
        "hold_logit": 2.0,
        "reward_weight": 1.0,
        "loss_cost": 0.0,
        "learning_rate": 1.5e-3,
        "gamma": 0.99,
        "gae_lambda": 0.95,
        "entropy_weight": 0.002,
    },
    "kessler/rendezvous": {"reward_weight": 4.0},
    "kessler/eco_station": {"reward_weight": 2.0},
    "kessler/formation": {"reward_weight": 4.0},
    "tasking": {"reward_weight": 1.0, "hold_logit": 0.0, "gamma": 0.997, "gae_lambda": 0.95, "entropy_weight": 0.002},
}


def tuned_settings(task: str) -> dict[str, Any]:
    """Returns the settings of a task that differ from the defaults."""
    return {**TUNED.get(task.split("/")[0], {}), **TUNED.get(task, {})}


class Actor(nn.Module):
    """Policy of one agent, with a logit for each action."""

    def __init__(self, observation_size: int, choices: int, config: LearnerConfig) -> None:
        super().__init__()
        self.sizes, self.config = (observation_size, choices), config
        self.actor = _layers(observation_size, config.hidden, choices, 0.01)
        with torch.no_grad():
            self.actor[-1].bias[0] = config.hold_logit

    def act(self, observations: npt.NDArray[np.float32]) -> npt.NDArray[np.int64]:
        """Returns the most likely actions of all agents of all environments, for `sparring.evaluate`."""
        with torch.no_grad():
            actions: npt.NDArray[np.int64] = self.actor(torch.from_numpy(np.ascontiguousarray(observations))).argmax(-1).numpy()
        return actions

    def sample(self, observations: npt.NDArray[np.float32]) -> npt.NDArray[np.int64]:
        """Samples actions of all agents of all environments, for `sparring.evaluate` with `stochastic=True`."""
        with torch.no_grad():
            actions: npt.NDArray[np.int64] = self.draw(torch.from_numpy(np.ascontiguousarray(observations)))[0].numpy()
        return actions

    def draw(self, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Draws an action for each row; returns the actions and their log-probabilities."""
        log_probs = self.actor(rows).log_softmax(-1)
        # The largest of the logits plus Gumbel noise is a sample (Gumbel 1954).
        actions = (log_probs - torch.empty_like(log_probs).exponential_().log()).argmax(-1)
        return actions, log_probs.gather(-1, actions.unsqueeze(-1)).squeeze(-1)


class Policy(Actor):
    """Actor and critic of one agent, without shared weights."""

    def __init__(self, observation_size: int, choices: int, config: LearnerConfig) -> None:
        super().__init__(observation_size, choices, config)
        self.critic = _layers(observation_size, config.hidden, 1, 1.0)

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
        observation_size, choices = saved["sizes"]
        policy = Policy(observation_size, choices, Config(**saved["config"]))
        policy.load_state_dict(saved["weights"])
        return policy


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


def agent_rewards(results: AgentResults, config: LearnerConfig) -> npt.NDArray[np.float32]:
    """Returns the rewards of all agents for a step: the environment's with a weight, for a success, and for an own loss."""
    success = results.terminations & (results.rewards > SUCCESS_REWARD)
    lost = results.terminations & ~results.truncations & ~success
    total: npt.NDArray[np.float32] = (
        config.reward_weight * results.rewards + config.success_reward * success - config.loss_cost * lost
    ).astype(np.float32)
    return total


class Rollout:
    """Transitions of some decisions of all environments, in arrays that the environments write."""

    def __init__(self, envs: sparring.VectorEnvironment, config: Config) -> None:
        self.config = config
        steps, row = config.rollout, envs.single_observation_space.shape or ()
        shape = (steps, envs.num_envs, row[0])
        #: Observations; one more than decisions, since the last values need the observation after the last decision.
        self.observations = np.zeros((steps + 1, envs.num_envs, *row), np.float32)
        #: The same memory in the shape that environments write.
        self.out = self.observations.reshape(steps + 1, *envs.empty_observations().shape)
        self.actions = np.zeros(shape, np.int64)
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
        for step in range(len(self.rewards)):
            train = envs.train if envs.curriculum else np.ones(envs.num_envs, np.bool_)
            self.active[step] = ~absent & train[:, None]
            with torch.no_grad():
                actions, log_probs = policy.draw(torch.from_numpy(self.observations[step]))
            self.actions[step], self.log_probs[step] = actions.numpy(), log_probs.numpy()
            out = (self.out[step + 1], *self._team)
            *_, infos = envs.step(self.actions[step], out, self.config.decision_steps)
            results = envs.agent_results()
            self.rewards[step] = agent_rewards(results, self.config)
            self.dones[step] = results.terminations | results.truncations
            absent |= self.dones[step]
            if "_episode" in infos:
                over = infos["_episode"]
                returns += infos["episode"]["r"][over].tolist()
                self.dones[step, over] = True
                absent[over] = envs.absent_agents()[over]
        with torch.no_grad():
            self.values[:] = policy.critic(torch.from_numpy(self.observations)).squeeze(-1).numpy()
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


def policy_loss(
    log_probs: torch.Tensor, actions: torch.Tensor, old_log_probs: torch.Tensor, advantages: torch.Tensor, config: LearnerConfig
) -> torch.Tensor:
    """Returns the negative clipped objective of some rows, with the entropy bonus.

    `log_probs` are those of all actions now, rows × actions; `old_log_probs` those of the taken `actions` (rows × 1) then.
    """
    ratio = (log_probs.gather(-1, actions).squeeze(-1) - old_log_probs).exp()
    clipped = ratio.clamp(1 - config.clip, 1 + config.clip)
    loss = -torch.min(ratio * advantages, clipped * advantages).mean()
    if config.entropy_weight:
        loss = loss + config.entropy_weight * (log_probs.exp() * log_probs).sum(-1).mean()
    return loss


def learn(policy: Policy, optimizer: torch.optim.Optimizer, rollout: Rollout, config: Config) -> dict[str, float]:
    """Runs all epochs on a rollout; returns metrics of the last minibatch, none if there is nothing to learn from."""
    advantages = rollout.advantages(config.gamma, config.gae_lambda)
    active = torch.from_numpy(rollout.active.reshape(-1)).nonzero().squeeze(-1)

    def rows(array: npt.NDArray[Any]) -> torch.Tensor:
        flat = torch.from_numpy(array.reshape(rollout.active.size, *array.shape[3:]))
        return flat if len(active) == rollout.active.size else flat[active]

    # A spread needs two rows. There may be none: some strategies only measure for a while.
    if len(active) < 2:
        return {}
    observations, actions = rows(rollout.observations[:-1]), rows(rollout.actions).unsqueeze(-1)
    old_log_probs, row_advantages = rows(rollout.log_probs), rows(advantages)
    targets = row_advantages + rows(rollout.values[:-1])
    row_advantages = (row_advantages - row_advantages.mean()) / (row_advantages.std() + 1e-6)
    parameters = list(policy.parameters())
    for _ in range(config.epochs):
        for batch in torch.randperm(len(observations)).chunk(max(1, len(observations) // config.minibatch)):
            batch_rows, advantage = observations[batch], row_advantages[batch]
            log_probs = policy.actor(batch_rows).log_softmax(-1)
            loss = policy_loss(log_probs, actions[batch], old_log_probs[batch], advantage, config)
            value_loss = (policy.critic(batch_rows).squeeze(-1) - targets[batch]).pow(2).mean()
            optimizer.zero_grad()
            (loss + 0.5 * value_loss).backward()
            nn.utils.clip_grad_norm_(parameters, config.max_grad_norm)
            optimizer.step()
    with torch.no_grad():
        hold = log_probs[:, 0].exp().mean()
    return {"policy_loss": loss.item(), "value_loss": value_loss.item(), "hold": hold.item()}


def make_envs(config: Config, curriculum: sparring.Curriculum | None) -> sparring.VectorEnvironment:
    """Makes the environments of a training."""
    return sparring.make_vec(
        config.task,
        config.num_envs,
        curriculum=curriculum,
        level=None if curriculum else config.level,
        autoreset_mode="same_step",
        threads=config.threads,
        **environment_settings(config),
    )


def environment_settings(config: LearnerConfig) -> dict[str, Any]:
    """Returns the arguments of `sparring.make_vec` for the observations and actions of a policy."""
    return {"observation": config.observation, "actions": config.actions}


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
        rollout = Rollout(envs, config)
        policy = Policy(rollout.observations.shape[-1], int(envs.agent_action_space.n), config)  # type: ignore[union-attr]
        optimizer = torch.optim.Adam(policy.parameters(), config.learning_rate, eps=1e-5)
        envs.reset(seed=config.seed, out=rollout.out[0])
        absent = envs.absent_agents()
        steps = 0
        while steps < config.steps:
            started = time.perf_counter()
            optimizer.param_groups[0]["lr"] = config.learning_rate_at(steps)
            returns = rollout.collect(envs, policy, absent)
            collected = time.perf_counter()
            metrics = learn(policy, optimizer, rollout, config)
            rollout.observations[0] = rollout.observations[-1]
            steps_per_rollout, steps = envs.total_steps - steps, envs.total_steps
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
    actions = np.zeros(envs.action_space.shape or (), np.int64)
    envs.reset(seed=config.seed, out=out[0])
    steps, started = 0, time.perf_counter()
    while time.perf_counter() - started < seconds:
        for _ in range(20):
            envs.step(actions, out=out)
        steps += 20 * envs.num_envs
    speed = steps / (time.perf_counter() - started)
    envs.close()
    return speed
