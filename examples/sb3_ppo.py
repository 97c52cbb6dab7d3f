"""Stable-Baselines3's PPO learns survival and eco_station with a curriculum.

    pip install 'sparring[sb3]' sparring-server matplotlib
    python examples/sb3_ppo.py --steps 1000000 --tensorboard runs --plot sb3.svg

One policy controls every satellite. The curriculum chooses the scenarios and receives the outcomes. The policy is evaluated on
held-out scenarios at intervals, which does not affect the curriculum.
"""

import argparse
import json
import sys
from dataclasses import replace

import torch
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import LinearSchedule

import sparring
import sparring.sb3
from sparring.experiments.ppo import Config, environment_settings
from sparring.experiments.sb3_ppo import make_envs, make_model

TASKS = ["kessler/survival", "kessler/eco_station"]
# Settings that were tuned for eco_station: a decision holds or makes one of four burns, at first it nearly always holds, a lost
# satellite costs 1, and the team's rewards count double. Those of survival differ in the last point only.
CONFIG = replace(Config.tuned("kessler/eco_station"), task=None)


class EvaluationCallback(BaseCallback):
    """Evaluates the policy on the held-out suite every `every` steps, at the start and at the end, and plots the results."""

    def __init__(self, curriculum: sparring.Curriculum, every: int, plot_file: str | None) -> None:
        super().__init__()
        self.curriculum, self.every, self.plot_file = curriculum, every, plot_file
        self.next, self.curve = 0, []

    def evaluate(self) -> None:
        policy, settings = sparring.sb3.policy_fn(self.model), environment_settings(CONFIG)
        result = sparring.evaluate(self.curriculum, policy, policy="sb3-ppo", stochastic=False, **settings)
        skill = {task: result.mean(task) for task in TASKS}
        metrics = self.curriculum.metrics()
        level = {task: metrics.get(f"{task}/level") for task in TASKS}
        self.curve.append({"steps": self.num_timesteps, "skill": skill, "level": level})
        print(json.dumps(self.curve[-1]), flush=True)
        if self.plot_file:
            plot(self.curve, self.plot_file)

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= self.next:
            self.next += self.every
            self.evaluate()

    def _on_step(self) -> bool:
        return True

    def _on_training_end(self) -> None:
        self.evaluate()


def train(args: argparse.Namespace, curriculum: sparring.Curriculum) -> None:
    """Trains a model and evaluates it at intervals."""
    torch.set_num_threads(1)
    config = replace(CONFIG, num_envs=args.envs, seed=args.seed)
    envs = make_envs(config, curriculum)
    rate = LinearSchedule(config.learning_rate, 0.1 * config.learning_rate, end_fraction=1.0)
    model = make_model(config, envs, rate)
    model.tensorboard_log = args.tensorboard
    evaluations = EvaluationCallback(curriculum, max(1, args.steps // args.evaluations), args.plot)
    # The model counts a step per satellite: three for a step of an environment.
    try:
        model.learn(args.steps, callback=[evaluations, sparring.sb3.CurriculumCallback(curriculum)])
    except KeyboardInterrupt:
        print("Stopped. The model has the weights of its last update.", file=sys.stderr)
    envs.close()
    curriculum.flush()
    if args.save:
        model.save(args.save)


def plot(curve: list, file: str) -> None:
    """Plots held-out skill over steps, and the level if the strategy has levels."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import EngFormatter

    labels = {"skill": "skill on held-out contested scenarios", "level": "level"}
    names = [name for name in labels if any(value is not None for row in curve for value in row[name].values())]
    figure = Figure(figsize=(2 + 3.5 * len(names), 3.4), layout="constrained")
    for axis, name in zip(figure.subplots(1, len(names), squeeze=False)[0], names, strict=True):
        for task in TASKS:
            axis.plot([row["steps"] for row in curve], [row[name][task] for row in curve], "o-", label=task)
        axis.set_xlabel("steps of a satellite")
        axis.xaxis.set_major_formatter(EngFormatter(sep=""))
        axis.set_ylabel(labels[name])
        axis.grid(alpha=0.3)
        axis.legend(frameon=False)
    figure.savefig(file, metadata={"Date": None} if file.endswith(".svg") else None)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--url", help="address of a running server (default: start one)")
    parser.add_argument("--steps", type=int, default=1_000_000, help="steps of satellites, as the model counts (%(default)s)")
    parser.add_argument("--envs", type=int, default=128, help="environments with three satellites each (%(default)s)")
    parser.add_argument("--evaluations", type=int, default=10, help="evaluations on the held-out suite (%(default)s)")
    parser.add_argument("--strategy", help="strategy of the curriculum (default: that of the server)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the policy and its sampling (%(default)s)")
    parser.add_argument("--tensorboard", help="folder for TensorBoard")
    parser.add_argument("--plot", help="file for a plot of the evaluations (needs matplotlib)")
    parser.add_argument("--save", help="file for the model")
    args = parser.parse_args()
    if min(args.steps, args.envs, args.evaluations, args.seed) < 1:
        parser.error("--steps, --envs, --evaluations and --seed must be >= 1")
    settings = {"tasks": TASKS, "name": "sb3"} | ({"strategy": args.strategy} if args.strategy else {})
    try:
        curriculum = sparring.Curriculum.open(args.url, settings=settings, form="groups")
    except (sparring.CurriculumError, ValueError) as error:
        parser.error(str(error))
    with curriculum:
        train(args, curriculum)


if __name__ == "__main__":
    main()
