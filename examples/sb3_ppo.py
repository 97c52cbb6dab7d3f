"""Stable-Baselines3's PPO learns survival and eco_station through the curriculum.

    pip install 'sparring[sb3]' sparring-server matplotlib
    python examples/sb3_ppo.py --steps 1000000 --tensorboard runs --plot sb3.svg

One policy flies every satellite. The curriculum says what is flown and is told how it went; the policy is flown on held-out
scenarios now and then, which move nothing.
"""

import argparse
import json
import sys

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback, CallbackList
from stable_baselines3.common.utils import LinearSchedule

import sparring
import sparring.sb3

TASKS = ["kessler/survival", "kessler/eco_station"]
# Score is the whole episode's, fifty steps, and fuel that is left counts at its end: nothing is discounted.
SETTINGS = {"n_steps": 50, "batch_size": 2400, "n_epochs": 8, "gamma": 1.0, "gae_lambda": 0.95}
LEARNING_RATE = 5e-4
# Burning is rarely right and always costs fuel. Who burns at every step, as noise on continuous actions does, learns first of all
# what that costs; so directions are discrete here, and the policy begins by holding (action 0) some half of the time.
ACTIONS = "discrete"
HOLDING = 3.0


class Looks(BaseCallback):
    """Flies the held-out suite every so many steps, before the first and behind the last, too, and draws what there is by then."""

    def __init__(self, curriculum: sparring.Curriculum, every: int, picture: str | None) -> None:
        super().__init__()
        self.curriculum, self.every, self.picture = curriculum, every, picture
        self.next, self.curve = 0, []

    def look(self) -> None:
        found = sparring.evaluate(self.curriculum, sparring.sb3.act(self.model), policy="sb3-ppo", actions=ACTIONS, chance=False)
        skill = {task: found.of(task) for task in TASKS}
        level = {task: self.curriculum.numbers().get(f"{task}/level") for task in TASKS}
        self.curve.append({"steps": self.num_timesteps, "skill": skill, "level": level})
        print(json.dumps(self.curve[-1]), flush=True)
        if self.picture:
            plot(self.curve, self.picture)

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= self.next:
            self.next += self.every
            self.look()

    def _on_step(self) -> bool:
        return True

    def _on_training_end(self) -> None:
        self.look()


def train(args: argparse.Namespace, curriculum: sparring.Curriculum) -> None:
    """Trains, and says what it learned on the way."""
    torch.set_num_threads(1)
    envs = sparring.sb3.vec_env(args.envs, curriculum=curriculum, actions=ACTIONS)
    how = {**SETTINGS, **sparring.sb3.flown_only(envs), "policy_kwargs": {"net_arch": [128, 128]}, "seed": args.seed}
    rate = LinearSchedule(LEARNING_RATE, 0.1 * LEARNING_RATE, end_fraction=1.0)
    model = PPO("MlpPolicy", envs, **how, learning_rate=rate, device="cpu", tensorboard_log=args.tensorboard)
    with torch.no_grad():
        model.policy.action_net.bias[0] = HOLDING
    looks = Looks(curriculum, max(1, args.steps // args.looks), args.plot)
    # The rows of an environment are its satellites: three steps of the model's are one of the world's.
    try:
        model.learn(args.steps, callback=CallbackList([looks, sparring.sb3.CurriculumCallback(curriculum)]))
    except KeyboardInterrupt:
        print("stopped: what was learned so far is kept", file=sys.stderr)
    envs.close()
    curriculum.flush()
    if args.save:
        model.save(args.save)


def plot(curve: list, file: str) -> None:
    """Held-out skill over steps, and level where the strategy knows levels."""
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
    parser.add_argument("--url", help="a server that is there; one is started otherwise")
    parser.add_argument("--steps", type=int, default=1_000_000, help="of satellites, as Stable-Baselines3 counts (%(default)s)")
    parser.add_argument("--envs", type=int, default=64, help="environments of three satellites each (%(default)s)")
    parser.add_argument("--looks", type=int, default=10, help="at the held-out suite (%(default)s)")
    parser.add_argument("--strategy", default="uniform", help="of the curriculum (%(default)s): the suite asks for all levels")
    parser.add_argument("--seed", type=int, default=1, help="of the policy and its draws (%(default)s)")
    parser.add_argument("--tensorboard", help="a folder for TensorBoard")
    parser.add_argument("--plot", help="a picture of what was learned, drawn at every look (needs matplotlib)")
    parser.add_argument("--save", help="where the model is kept")
    args = parser.parse_args()
    if min(args.steps, args.envs, args.looks, args.seed) < 1:
        parser.error("--steps, --envs, --looks and --seed are 1 at least")
    settings = {"tasks": TASKS, "name": "sb3", "strategy": args.strategy}
    try:
        curriculum = sparring.Curriculum.find(args.url, settings=settings, form="groups")
    except (sparring.CurriculumError, ValueError) as error:
        parser.error(str(error))
    with curriculum:
        train(args, curriculum)


if __name__ == "__main__":
    main()
