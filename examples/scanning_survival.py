"""Survival of a policy in the scanning environment of the paper on BSK-RL, for scanning_sb3.py and scanning_rllib.py.

Episodes are those of the paper (Stephenson and Schaub 2024): five orbits, twelve observations, four actions. The paper's policy
survives 94.5 % of them after 50 million steps.
"""

import json
import time
from collections.abc import Callable

import numpy as np

import sparring

TASK = "tasking/scanning"
#: Share of episodes that the paper's policy survives after 50 million steps, with the params that the task has by default.
PAPER_SURVIVAL = 0.945
#: An episode has about 250 steps, and a death costs as much as all scanning earns: so nearly no discount.
GAMMA = 0.999
#: Seed of the first episode of an evaluation; environments for training have smaller ones.
FIRST_SEED = 1_000_000


class SurvivalCurve:
    """Flies fresh episodes with a policy, prints a line for each evaluation, and plots them.

    A line has the share of episodes that the policy survives, and the mean return, which is the scanned share of the time, less 1
    for a death. `scenarios` are arguments of `sparring.make_vec`, such as `level`.
    """

    def __init__(self, trainer: str, scenarios: dict, episodes: int, plot_file: str | None) -> None:
        self.trainer, self.scenarios, self.episodes, self.plot_file = trainer, scenarios, episodes, plot_file
        self.rows: list[dict] = []
        self.started = time.monotonic()

    def evaluate(self, steps: int, act: Callable[[np.ndarray], np.ndarray]) -> None:
        """Evaluates a policy, a function from observations to actions, after a number of steps of training."""
        envs = sparring.make_vec(TASK, self.episodes, **self.scenarios)
        observations, _ = envs.reset(seed=FIRST_SEED)
        returns, running = np.zeros(self.episodes), np.ones(self.episodes, np.bool_)
        survived = np.zeros(self.episodes, np.bool_)
        while running.any():
            observations, rewards, terminated, truncated, _ = envs.step(act(observations))
            returns[running] += rewards[running]
            survived |= running & truncated
            running &= ~(terminated | truncated)
        envs.close()
        row = {
            "steps": steps,
            "survived": float(survived.mean()),
            "return": round(float(returns.mean()), 4),
            "seconds": round(time.monotonic() - self.started, 1),
        }
        self.rows.append(row)
        print(json.dumps(row), flush=True)
        if self.plot_file:
            self.plot(self.plot_file)

    def plot(self, file: str) -> None:
        """Plots survival and return over steps, and the paper's survival."""
        from matplotlib.figure import Figure
        from matplotlib.ticker import EngFormatter

        figure = Figure(figsize=(8, 3.4), layout="constrained")
        left, right = figure.subplots(1, 2)
        steps = [row["steps"] for row in self.rows]
        left.plot(steps, [row["survived"] for row in self.rows], "o-", label=self.trainer)
        left.axhline(PAPER_SURVIVAL, linestyle="--", color="gray", label="paper, after 50 M steps")
        left.set(ylabel="share of episodes that survive five orbits", ylim=(0, 1.02))
        left.legend(frameon=False)
        right.plot(steps, [row["return"] for row in self.rows], "o-")
        right.set(ylabel="mean return of an episode")
        for axis in (left, right):
            axis.set_xlabel("steps")
            axis.xaxis.set_major_formatter(EngFormatter(sep=""))
            axis.grid(alpha=0.3)
        figure.savefig(file, metadata={"Date": None} if file.endswith(".svg") else None)
