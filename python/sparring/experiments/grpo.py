"""Group relative policy optimisation in one file: a policy that learns from groups of episodes alone, without a critic.

    python -m sparring.experiments evidence --out groups --problems kessler/survival-groups --arms uniform-levels

A group has some episodes of one scenario, as a run with a `group_size` above 1 leases them. An agent's advantage is its return
less the mean of its returns in the group (Shao et al. 2024, equation 4, without the critic of PPO). An agent whose returns are
all equal in a group learns nothing from it: its group has zero variance. Policies, rewards and the clipped objective are those of
`ppo`. As the episodes of a group end at different times, the newest of them may be of a newer policy than the oldest; the ratio
of probabilities corrects for that.
"""

from __future__ import annotations

import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import nn

import sparring

from ..errors import invalid
from ..trainer_metrics import TrainerReport
from .ppo import Actor, LearnerConfig, agent_rewards, environment_settings, option, policy_loss, tuned_settings


@dataclass(frozen=True)
class Config(LearnerConfig):
    """Hyperparameters of a training by groups. `Config.tuned` returns those of a task."""

    groups: int = option(16, "groups per update")
    epochs: int = option(8, "passes over the groups of an update")
    scale_by_std: bool = option(True, "divide advantages by the standard deviation of the group")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.groups < 1:
            raise invalid("groups", ">= 1", self.groups)

    @staticmethod
    def tuned(task: str, **changes: Any) -> Config:
        """Returns the policy and the rewards that were tuned for a task with PPO, with the other defaults and some changes."""
        names = {each.name for each in fields(Config)}
        return Config(
            **{"task": task, **{name: value for name, value in tuned_settings(task).items() if name in names}, **changes}
        )


class Decisions(NamedTuple):
    """Decisions of all agents, rows × agents. The rows are environments, or the steps of one environment."""

    observations: npt.NDArray[np.float32]
    actions: npt.NDArray[np.int64]
    log_probs: npt.NDArray[np.float32]
    rewards: npt.NDArray[np.float32]
    #: True for agents that took part.
    active: npt.NDArray[np.bool_]


class Episode(Decisions):
    """Decisions of a complete episode of one environment, whose rows are steps."""

    __slots__ = ()

    def returns(self) -> npt.NDArray[np.float64]:
        """Returns the sum of the rewards of each agent."""
        total: npt.NDArray[np.float64] = self.rewards.sum(axis=0, dtype=np.float64)
        return total


class GroupCollector:
    """Steps environments, and collects the episodes of each scenario until its group is complete."""

    def __init__(self, envs: sparring.VectorEnvironment, group_size: int, config: Config) -> None:
        self.envs, self.group_size, self.config = envs, group_size, config
        #: Returns of the team in the episodes that ended since the caller cleared it.
        self.team_returns: list[float] = []
        self._observations = np.asarray(envs.reset(seed=config.seed)[0])
        self._absent = envs.absent_agents().copy()
        # Decisions of the running episodes: those of environment k begin at the k-th index, counted from the first decision.
        self._steps: deque[Decisions] = deque()
        self._dropped = 0
        self._begins = np.zeros(envs.num_envs, np.int64)
        self._scenarios = [envs.scenario(env) for env in range(envs.num_envs)]
        self._trains = envs.train.copy()
        self._open: defaultdict[sparring.Scenario | None, list[Episode]] = defaultdict(list)

    def collect(self, policy: Actor, groups: int, max_steps: int) -> list[list[Episode]]:
        """Steps the environments until some groups are complete, or they have made a number of steps in total."""
        complete: list[list[Episode]] = []
        while len(complete) < groups and self.envs.total_steps < max_steps:
            complete += self._step(policy)
        return complete

    def _step(self, policy: Actor) -> Iterator[list[Episode]]:
        """Runs a decision of all environments; yields the groups that it completes."""
        observations = self._observations.reshape(self.envs.num_envs, -1, policy.sizes[0])
        with torch.no_grad():
            actions, log_probs = (tensor.numpy() for tensor in policy.draw(torch.from_numpy(observations)))
        self._observations, *_, infos = self.envs.step(actions, repeat=self.config.decision_steps)
        results = self.envs.agent_results()
        # The end of an agent that has left is repeated in each later step.
        rewards = np.where(self._absent, np.float32(0.0), agent_rewards(results, self.config))
        self._steps.append(Decisions(observations, actions, log_probs, rewards, ~self._absent))
        self._absent = self._absent | results.terminations | results.truncations
        if "_episode" not in infos:
            return
        over = np.flatnonzero(infos["_episode"])
        self.team_returns += infos["episode"]["r"][over].tolist()
        steps, trains = list(self._steps), self.envs.train
        for env in over:
            if self._trains[env]:
                group, episode = self._open[self._scenarios[env]], steps[self._begins[env] - self._dropped :]
                group.append(Episode(*(np.stack([array[env] for array in arrays]) for arrays in zip(*episode, strict=True))))
                if len(group) == self.group_size:
                    yield self._open.pop(self._scenarios[env])
            self._begins[env], self._scenarios[env] = self._dropped + len(steps), self.envs.scenario(int(env))
        self._absent[over], self._trains[over] = self.envs.absent_agents()[over], trains[over]
        for _ in range(self._begins.min() - self._dropped):
            self._steps.popleft()
        self._dropped = int(self._begins.min())


def advantages(returns: npt.NDArray[np.float64], scale_by_std: bool) -> npt.NDArray[np.float64]:
    """Returns the advantages of a group: its returns, episodes × agents, less their means.

    With `scale_by_std` they are divided by the standard deviation (Shao et al. 2024), which gives scenarios that are nearly
    always won or lost the same weight as others; without it they are not (Liu et al. 2025).
    """
    differences: npt.NDArray[np.float64] = returns - returns.mean(axis=0)
    differences[:, (returns == returns[0]).all(axis=0)] = 0.0  # a mean may be rounded
    if scale_by_std:
        differences /= returns.std(axis=0) + 1e-6
    return differences


def learn(
    policy: Actor, optimizer: torch.optim.Optimizer, groups: Sequence[Sequence[Episode]], config: Config
) -> dict[str, float]:
    """Runs all epochs on some groups; returns metrics, without a loss if no group has returns that differ."""
    rows: list[list[npt.NDArray[Any]]] = []
    zero_variance = 0
    for group in groups:
        differences = advantages(np.stack([episode.returns() for episode in group]), config.scale_by_std)
        zero_variance += not differences.any()
        for episode, agents in zip(group, differences, strict=True):
            # Rows without an advantage do not change the policy.
            used = episode.active & (agents != 0.0)
            row_advantages = np.broadcast_to(agents.astype(np.float32), used.shape)
            rows.append([array[used] for array in (episode.observations, episode.actions, episode.log_probs, row_advantages)])
    metrics = {"zero_variance": zero_variance / len(groups)} if groups else {}
    if zero_variance == len(groups):
        return metrics
    arrays = [torch.from_numpy(np.concatenate(parts)) for parts in zip(*rows, strict=True)]
    observations, actions, old_log_probs, row_advantages_ = arrays
    actions = actions.unsqueeze(-1)
    for _ in range(config.epochs):
        for batch in torch.randperm(len(observations)).chunk(max(1, len(observations) // config.minibatch)):
            log_probs = policy.actor(observations[batch]).log_softmax(-1)
            loss = policy_loss(log_probs, actions[batch], old_log_probs[batch], row_advantages_[batch], config)
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(policy.parameters(), config.max_grad_norm)
            optimizer.step()
    with torch.no_grad():
        hold = log_probs[:, 0].exp().mean()
    return {**metrics, "policy_loss": loss.item(), "hold": hold.item(), "rows": float(len(observations))}


def train(
    config: Config,
    curriculum: sparring.Curriculum,
    report: Callable[[int, Actor, dict[str, float]], None] | None = None,
    report_metrics: bool = True,
) -> Actor:
    """Trains a policy and returns it.

    Args:
        config: Hyperparameters.
        curriculum: Source of the groups.
        report: Called after each update with the number of steps, the policy and metrics.
        report_metrics: False to send no metrics to the curriculum's run; otherwise they are sent at most once a second.

    Raises:
        ValueError: The curriculum's groups have one episode.
    """
    if curriculum.group_size < 2:
        raise invalid("curriculum.group_size", ">= 2: a policy learns from the differences within a group", curriculum.group_size)
    server_report = TrainerReport(curriculum if report_metrics else None)
    torch.manual_seed(config.seed)
    torch.set_num_threads(config.threads)
    settings = {"threads": config.threads, **environment_settings(config)}
    envs = sparring.make_vec(config.task, config.num_envs, curriculum=curriculum, autoreset_mode="same_step", **settings)
    try:
        collector = GroupCollector(envs, curriculum.group_size, config)
        policy = Actor((envs.single_observation_space.shape or ())[-1], int(envs.agent_action_space.n), config)  # type: ignore[union-attr]
        optimizer = torch.optim.Adam(policy.parameters(), config.learning_rate, eps=1e-5)
        while envs.total_steps < config.steps:
            started, steps = time.perf_counter(), envs.total_steps
            optimizer.param_groups[0]["lr"] = config.learning_rate_at(steps)
            groups = collector.collect(policy, config.groups, config.steps)
            metrics = learn(policy, optimizer, groups, config)
            curriculum.policy_version += 1
            metrics["steps_per_s"] = (envs.total_steps - steps) / (time.perf_counter() - started)
            metrics |= {"return": float(np.mean(collector.team_returns))} if collector.team_returns else {}
            collector.team_returns.clear()
            server_report.add(envs.total_steps, metrics)
            if report:
                report(envs.total_steps, policy, metrics)
    finally:
        server_report.finish()
        envs.close()
    return policy
