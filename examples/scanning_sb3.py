"""Stable-Baselines3's PPO learns to keep a scanning satellite alive, as in the paper on BSK-RL (Stephenson and Schaub 2024).

    pip install 'sparring[sb3]' matplotlib
    python examples/scanning_sb3.py --steps 2000000 --plot scanning.svg

The environment is the paper's, and no curriculum takes part. At intervals the policy acts in fresh episodes, and a line tells how
many of them it survives, and their mean return. The paper reports 94.5 % after 50 million steps. With --level 9 the scenarios are
the hardest ones.
"""

import argparse

import torch
from scanning_survival import GAMMA, TASK, SurvivalCurve
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import LinearSchedule

import sparring.sb3

SETTINGS = {"n_steps": 128, "batch_size": 2048, "n_epochs": 5, "gamma": GAMMA, "gae_lambda": 0.95, "ent_coef": 0.005}
LEARNING_RATE = 5e-4


class SurvivalCallback(BaseCallback):
    """Evaluates the policy every `every` steps, at the start and at the end."""

    def __init__(self, curve: SurvivalCurve, every: int) -> None:
        super().__init__()
        self.curve, self.every, self.next = curve, every, 0

    def _evaluate(self) -> None:
        self.curve.evaluate(self.num_timesteps, sparring.sb3.policy_fn(self.model))

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= self.next:
            self.next += self.every
            self._evaluate()

    def _on_step(self) -> bool:
        return True

    def _on_training_end(self) -> None:
        self._evaluate()


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=2_000_000, help="steps of all environments (%(default)s)")
    parser.add_argument("--envs", type=int, default=64, help="environments (%(default)s)")
    parser.add_argument("--level", type=int, help="level of the task (default: the paper's params)")
    parser.add_argument("--evaluations", type=int, default=20, help="evaluations beside the last (%(default)s)")
    parser.add_argument("--episodes", type=int, default=200, help="episodes of an evaluation (%(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the policy and its sampling (%(default)s)")
    parser.add_argument("--plot", help="file for a plot of the evaluations (needs matplotlib)")
    parser.add_argument("--save", help="file for the model")
    args = parser.parse_args()
    if min(args.steps, args.envs, args.evaluations, args.episodes, args.seed) < 1:
        parser.error("--steps, --envs, --evaluations, --episodes and --seed must be >= 1")
    return args, parser


def main() -> None:
    args, parser = parse_arguments()
    torch.set_num_threads(1)
    scenarios = {} if args.level is None else {"level": args.level}
    try:
        envs = sparring.sb3.vec_env(args.envs, TASK, **scenarios)
    except ValueError as error:
        parser.error(str(error))
    envs.seed(args.seed)
    rate = LinearSchedule(LEARNING_RATE, 0.1 * LEARNING_RATE, end_fraction=1.0)
    policy = {"net_arch": [128, 128]}
    active = sparring.sb3.active_only(envs)
    model = PPO("MlpPolicy", envs, **SETTINGS, **active, policy_kwargs=policy, learning_rate=rate, seed=args.seed, device="cpu")
    curve = SurvivalCurve("Stable-Baselines3, PPO", scenarios, args.episodes, args.plot)
    model.learn(args.steps, SurvivalCallback(curve, max(1, args.steps // args.evaluations)))
    envs.close()
    if args.save:
        model.save(args.save)


if __name__ == "__main__":
    main()
