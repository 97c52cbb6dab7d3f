"""Held-out scenarios of a task, and policies measured on them in this process."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
import torch

import sparring

from ..experiment import write_json
from ..ppo import SUCCESS_REWARD, LearnerConfig, environment_settings
from .protocol import HELD_OUT_SCENARIOS, HELD_OUT_SEED

#: Environments that fly the scenarios, a few at a time.
ENVS = 50


class SampledPolicy(Protocol):
    """Policy of a learner that samples its actions, as evaluations use it."""

    #: Values of an agent's observation, and number of actions.
    sizes: tuple[int, int]

    @property
    def config(self) -> LearnerConfig:
        """Settings of its observations and actions."""

    def sample(self, observations: npt.NDArray[np.float32]) -> npt.NDArray[np.int64]:
        """Samples actions of all agents of all environments."""


@dataclass(frozen=True)
class HeldOut:
    """Contested scenarios of a task, as many of each level, with their brackets."""

    scenarios: list[sparring.Scenario]
    floors: npt.NDArray[np.float64]
    references: npt.NDArray[np.float64]


def load(folder: Path, task: str, scenarios: int = HELD_OUT_SCENARIOS, first_seed: int = HELD_OUT_SEED) -> HeldOut:
    """Reads the held-out scenarios of a task; draws them if the folder does not have them yet."""
    file = folder / f"{task.replace('/', '-')}.json"
    rows = json.loads(file.read_text()) if file.exists() else []
    if len(rows) != scenarios:
        rows = _draw(task, scenarios, first_seed)
        folder.mkdir(parents=True, exist_ok=True)
        write_json(file, rows)
    return HeldOut(
        [sparring.Scenario(task, level=row["level"], seed=row["seed"]) for row in rows],
        np.array([row["floor"] for row in rows]),
        np.array([row["reference"] for row in rows]),
    )


def _draw(task: str, scenarios: int, first_seed: int) -> list[dict[str, Any]]:
    """Draws contested scenarios, one level after the other, whose seeds follow the first."""
    rows: list[dict[str, Any]] = []
    seed, levels = first_seed, len(sparring.levels(task))
    while len(rows) < scenarios:
        level = len(rows) % levels
        bracket = sparring.bracket(sparring.Scenario(task, level=level, seed=seed))
        if bracket.contested and bracket.skill(bracket.reference.score) is not None:
            rows.append({"level": level, "seed": seed, "floor": bracket.floor, "reference": bracket.reference.score})
        seed += 1
    return rows


class RecordedEpisode(NamedTuple):
    """Complete episode: its scenario, and its actions as `sparring.replay` reads them."""

    scenario: sparring.Scenario
    #: Steps × agents × values.
    actions: npt.NDArray[np.float32]


@dataclass(frozen=True)
class Measured:
    """Results of a policy, episodes × scenarios."""

    #: In docking, true if all deputies docked; in other worlds, if no agent was lost.
    success: npt.NDArray[np.bool_]
    skill: npt.NDArray[np.float64]
    #: Scenario and action log of each episode, in the order of the episodes; empty unless they were recorded.
    recorded: list[RecordedEpisode] = field(default_factory=list)

    def mean(self, measure: str) -> float:
        """Returns the mean of `success` or `skill`."""
        return float(getattr(self, measure).mean())

    def worst_tenth(self, measure: str) -> float:
        """Returns the mean of the worst tenth of the scenarios.

        Even episodes rank the scenarios and odd ones are averaged, so that chance does not choose what it is measured by.
        """
        values = np.asarray(getattr(self, measure), np.float64)
        rank = np.argsort(values[::2].mean(axis=0), kind="stable")
        return float(values[1::2].mean(axis=0)[rank[: max(1, len(rank) // 10)]].mean())


def measure(policy: SampledPolicy, held_out: HeldOut, episodes: int, seed: int, record: bool = False) -> Measured:
    """Flies every scenario some times by a policy that samples its actions; does not change the state of torch.

    Args:
        policy: Policy of a learner.
        held_out: The scenarios.
        episodes: Number of episodes of each scenario.
        seed: Seed of the actions.
        record: Whether to record the actions.
    """
    flights = Flights(policy, held_out.scenarios * episodes, record)
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        flights.run()
    shape = (episodes, len(held_out.scenarios))
    gaps = held_out.references - held_out.floors
    skill = np.clip((flights.returns.reshape(shape) - held_out.floors) / gaps, -1.0, 1.0)
    return Measured(flights.success.reshape(shape), skill, flights.recorded())


class Flights:
    """Flies scenarios in some environments, each of which takes the next one when its episode ends."""

    def __init__(self, policy: SampledPolicy, scenarios: list[sparring.Scenario], record: bool = False) -> None:
        self.policy, self.scenarios, self.record = policy, scenarios, record
        # Actions of all environments in each decision, and the recorded actions of each scenario.
        self._decisions: list[npt.NDArray[np.float32]] = []
        self._logs: dict[int, npt.NDArray[np.float32]] = {}
        self.returns = np.zeros(len(scenarios))
        self.success = np.zeros(len(scenarios), np.bool_)
        task, config = scenarios[0].task, policy.config
        self.is_docking = task.startswith("docking/")
        # Environments have room for as many agents as their first recipe has.
        largest = max(scenarios, key=lambda scenario: scenario.agents)
        envs = min(ENVS, len(scenarios))
        settings = {"params": largest.params, **environment_settings(config)}
        self.envs = sparring.make_vec(task, envs, autoreset_mode="disabled", threads=1, **settings)

    def run(self) -> None:
        """Flies all scenarios once."""
        count = self.envs.num_envs
        current, following = np.arange(count), count
        observations = self._reset(current, np.ones(count, np.bool_))
        docked, returns, is_open = self._absent(), np.zeros(count), np.ones(count, np.bool_)
        begins = np.zeros(count, np.int64)
        while is_open.any():
            actions = self.policy.sample(observations)
            next_observations, rewards, terminations, truncations, infos = self.envs.step(
                actions, repeat=self.policy.config.decision_steps
            )
            if self.record:
                self._decisions.append(self.envs.last_actions())
            observations = self._rows(next_observations)
            returns += rewards
            results = self.envs.agent_results()
            docked |= results.terminations & (results.rewards > SUCCESS_REWARD)
            ended = terminations | truncations
            if not ended.any():
                continue
            for env in np.flatnonzero(ended & is_open):
                self.returns[current[env]] = returns[env]
                self.success[current[env]] = docked[env].all() if self.is_docking else not results.terminations[env].any()
                if self.record:
                    self._logs[current[env]] = self._log(int(env), int(current[env]), begins[env], infos["episode"]["l"][env])
                is_open[env] = following < len(self.scenarios)
                current[env], following = min(following, len(self.scenarios) - 1), following + 1
            observations = self._reset(current, ended)
            returns[ended], docked[ended] = 0.0, self._absent()[ended]
            begins[ended] = len(self._decisions)
        self.envs.close()

    def recorded(self) -> list[RecordedEpisode]:
        """Returns the episodes in the order of the scenarios; none unless they were recorded."""
        return [RecordedEpisode(self.scenarios[number], self._logs[number]) for number in sorted(self._logs)]

    def _log(self, env: int, number: int, begin: int, steps: int) -> npt.NDArray[np.float32]:
        """Returns the actions of the agents of a scenario, which an environment has flown since a decision."""
        agents = self.scenarios[number].agents
        actions = np.stack([decision[env, :agents] for decision in self._decisions[begin:]])
        return np.repeat(actions, self.policy.config.decision_steps, axis=0)[:steps]

    def _reset(self, current: npt.NDArray[np.int64], mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.float32]:
        scenarios = [self.scenarios[index] for index in current]
        return self._rows(self.envs.reset(options={"scenario": scenarios, "reset_mask": mask})[0])

    def _rows(self, observations: Any) -> npt.NDArray[np.float32]:
        """Returns the observations of all agents, envs × agents × values."""
        return np.asarray(observations).reshape(self.envs.num_envs, -1, self.policy.sizes[0])

    def _absent(self) -> npt.NDArray[np.bool_]:
        return self.envs.absent_agents().copy()
