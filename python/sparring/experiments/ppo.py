"""Proximal policy optimisation in one file, in the manner of CleanRL: read it, copy it, change it.

    python -m sparring.experiments ppo --task kessler/survival --steps 300000

One policy flies every satellite (or deputy) from its own row of observations. Environments write into the rollout's own arrays,
so nothing is copied on the way to the learner; rows of agents that have left, and of episodes that the curriculum only wants to
know the outcome of, are not learned from. The clipped objective and the generalised advantages are those of Schulman et al.
(2017, equations 7 and 11), the losses' details those of Huang et al. (2022, "The 37 implementation details of PPO").
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

try:
    import torch
    from torch import nn
except ImportError as error:
    raise ImportError("sparring.experiments needs torch: pip install 'sparring[experiments]'") from error

import sparring


def _said(default: Any, help: str) -> Any:
    return field(default=default, metadata={"help": help})


@dataclass(frozen=True)
class Config:
    """What a training is made of."""

    task: str | None = _said(None, "the task: kessler/survival unless told, and with a curriculum what its run is over")
    level: int | None = _said(None, "the level that is flown, without a curriculum: 0 to 9")
    steps: int = _said(300_000, "environment steps in all; those of one environment count as one, however many agents it has")
    num_envs: int = _said(64, "environments")
    rollout: int = _said(50, "steps of each between two updates: an episode of kessler")
    threads: int = _said(1, "threads of environments, and of torch")
    learning_rate: float = _said(5e-4, "Adam's")
    gamma: float = _said(0.97, "discount of what is earned a step later")
    gae_lambda: float = _said(0.9, "of generalised advantage estimation")
    epochs: int = _said(8, "passes over a rollout")
    minibatches: int = _said(4, "parts of a rollout, each of which is one update")
    clip: float = _said(0.2, "how far from 1 the ratio of new to old probability pays")
    value_weight: float = _said(0.5, "of the critic's loss")
    entropy_weight: float = _said(0.0, "of entropy, in favour of exploring")
    max_grad_norm: float = _said(0.5, "gradients are cut to this norm")
    hidden: int = _said(128, "units of each of two hidden layers")
    log_std: float = _said(-1.5, "logarithm of the spread that actions, from -1 to 1, are explored with at the beginning")
    seed: int = _said(1, "of weights, exploration and, without a curriculum, scenarios")

    def __post_init__(self) -> None:
        for name in ("steps", "num_envs", "rollout", "threads", "epochs", "minibatches", "hidden"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: at least one")
        if not 0 <= self.seed < 2**32:
            raise ValueError("seed: from 0 to 4294967295")
        for name in ("learning_rate", "clip", "max_grad_norm"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name}: more than nothing")
        for name in ("gamma", "gae_lambda"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name}: from 0 to 1")


class Policy(nn.Module):
    """An actor and a critic beside each other, for one agent's row."""

    def __init__(self, cells: int, values: int, config: Config) -> None:
        super().__init__()
        self.sizes, self.config = (cells, values), config
        self.actor = _layers(cells, config.hidden, values, 0.01)
        self.critic = _layers(cells, config.hidden, 1, 1.0)
        self.log_std = nn.Parameter(torch.full((values,), config.log_std))

    def save(self, file: str) -> None:
        """Keeps its weights, and what it is made of."""
        torch.save({"config": asdict(self.config), "sizes": self.sizes, "weights": self.state_dict()}, file)

    @staticmethod
    def load(file: str) -> Policy:
        """One that was kept.

        Raises:
            ValueError: A file of something else.
        """
        kept = torch.load(file)
        if not isinstance(kept, dict) or not {"sizes", "config", "weights"} <= kept.keys():
            raise ValueError(f"file: {file} is no policy that was saved here")
        cells, values = kept["sizes"]
        policy = Policy(cells, values, Config(**kept["config"]))
        policy.load_state_dict(kept["weights"])
        return policy

    def spread(self, rows: torch.Tensor) -> torch.distributions.Normal:
        """The distribution of each value of an action."""
        return torch.distributions.Normal(self.actor(rows), self.log_std.exp())

    def act(self, seen: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """What it would do without exploring, for all agents of all environments: for `sparring.evaluate`."""
        with torch.no_grad():
            actions: npt.NDArray[np.float32] = self.actor(torch.from_numpy(np.ascontiguousarray(seen))).numpy()
        return actions

    def draw(self, seen: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        """What it does while it explores: an evaluation of this has chance in it."""
        with torch.no_grad():
            actions: npt.NDArray[np.float32] = self.spread(torch.from_numpy(np.ascontiguousarray(seen))).sample().numpy()
        return actions


def _layers(inputs: int, hidden: int, outputs: int, gain: float) -> nn.Sequential:
    def layer(ins: int, outs: int, gain: float) -> nn.Linear:
        made = nn.Linear(ins, outs)
        nn.init.orthogonal_(made.weight, gain)
        nn.init.zeros_(made.bias)
        return made

    root = 2.0**0.5
    return nn.Sequential(
        layer(inputs, hidden, root), nn.Tanh(), layer(hidden, hidden, root), nn.Tanh(), layer(hidden, outputs, gain)
    )


class Rollout:
    """What was seen, done and earned in some steps of all environments; environments write here."""

    def __init__(self, envs: sparring.VectorEnvironment, steps: int) -> None:
        rows = (steps, envs.num_envs, (envs.single_observation_space.shape or (1,))[0])
        # One row more than steps: what is seen behind the last.
        row = envs.single_observation_space.shape or ()
        self.seen = np.zeros((steps + 1, envs.num_envs, *row), np.float32)
        #: The same memory in the shape that environments write.
        self.written = self.seen.reshape(steps + 1, *envs.empty().shape)
        self.actions = np.zeros((*rows, *(envs.agent_action_space.shape or ())), np.float32)
        self.log_probs = np.zeros(rows, np.float32)
        self.values = np.zeros((steps + 1, *rows[1:]), np.float32)
        self.rewards = np.zeros(rows, np.float32)
        self.over = np.zeros(rows, np.bool_)
        #: Rows that are learned from.
        self.counts = np.zeros(rows, np.bool_)
        self._team = (np.zeros(envs.num_envs), np.zeros(envs.num_envs, np.bool_), np.zeros(envs.num_envs, np.bool_))

    def fill(self, envs: sparring.VectorEnvironment, policy: Policy, absent: npt.NDArray[np.bool_]) -> list[float]:
        """Flies; `absent` says who has left, before and after. Returns of the episodes that ended."""
        returns: list[float] = []
        learns = envs.train if envs.curriculum else np.ones(envs.num_envs, np.bool_)
        for step in range(len(self.rewards)):
            with torch.no_grad():
                rows = torch.from_numpy(self.seen[step])
                spread = policy.spread(rows)
                actions = spread.sample()
                self.log_probs[step] = spread.log_prob(actions).sum(-1).numpy()
                self.values[step] = policy.critic(rows).squeeze(-1).numpy()
            self.actions[step] = actions.numpy()
            self.counts[step] = ~absent & learns[:, None]
            out = (self.written[step + 1], *self._team)
            *_, infos = envs.step(self.actions[step], out=out)
            rewards, terminated, truncated = envs.agents()
            self.rewards[step] = rewards
            self.over[step] = terminated | truncated
            absent[:] = self.over[step]
            if "_episode" in infos:
                ended = infos["_episode"]
                returns += infos["episode"]["r"][ended].tolist()
                self.over[step, ended] = True
                absent[ended] = envs.absent()[ended]
                learns = envs.train if envs.curriculum else learns
        with torch.no_grad():
            self.values[-1] = policy.critic(torch.from_numpy(self.seen[-1])).squeeze(-1).numpy()
        return returns

    def advantages(self, gamma: float, gae_lambda: float) -> npt.NDArray[np.float32]:
        """Generalised advantages. What is cut off by the horizon is over: score is what was earned within it."""
        advantages = np.zeros_like(self.rewards)
        last = np.zeros(self.rewards.shape[1:], np.float32)
        for step in reversed(range(len(self.rewards))):
            goes_on = 1.0 - self.over[step]
            surprise = self.rewards[step] + gamma * self.values[step + 1] * goes_on - self.values[step]
            last = surprise + gamma * gae_lambda * goes_on * last
            advantages[step] = last
        return advantages


def learn(policy: Policy, optimizer: torch.optim.Optimizer, rollout: Rollout, config: Config) -> dict[str, float]:
    """Some epochs on one rollout; numbers of the last minibatch."""
    advantages = rollout.advantages(config.gamma, config.gae_lambda)
    counts = rollout.counts.reshape(-1)

    def rows(array: npt.NDArray[np.float32]) -> torch.Tensor:
        return torch.from_numpy(array.reshape(counts.size, *array.shape[3:])[counts])

    seen, actions = rows(rollout.seen[:-1]), rows(rollout.actions)
    old, gains = rows(rollout.log_probs), rows(advantages)
    targets = gains + rows(rollout.values[:-1])
    told: dict[str, float] = {}
    for _ in range(config.epochs):
        for batch in torch.randperm(len(seen)).chunk(config.minibatches):
            if len(batch) < 2:
                continue
            spread = policy.spread(seen[batch])
            ratio = (spread.log_prob(actions[batch]).sum(-1) - old[batch]).exp()
            gain = gains[batch]
            gain = (gain - gain.mean()) / (gain.std() + 1e-8)
            clipped = ratio.clamp(1 - config.clip, 1 + config.clip)
            loss = -torch.min(ratio * gain, clipped * gain).mean()
            value_loss = 0.5 * (policy.critic(seen[batch]).squeeze(-1) - targets[batch]).pow(2).mean()
            entropy = spread.entropy().sum(-1).mean()
            optimizer.zero_grad()
            (loss + config.value_weight * value_loss - config.entropy_weight * entropy).backward()
            nn.utils.clip_grad_norm_(policy.parameters(), config.max_grad_norm)
            optimizer.step()
            told = {"policy_loss": loss.item(), "value_loss": value_loss.item(), "std": policy.log_std.exp().mean().item()}
    return told


def make_envs(config: Config, curriculum: sparring.Curriculum | None) -> sparring.VectorEnvironment:
    """The environments that are learned in."""
    level = None if curriculum else config.level
    return sparring.make_vec(
        config.task, config.num_envs, curriculum=curriculum, level=level, autoreset_mode="same_step", threads=config.threads
    )


def train(
    config: Config,
    curriculum: sparring.Curriculum | None = None,
    report: Callable[[int, Policy, dict[str, float]], None] | None = None,
) -> Policy:
    """Trains a policy; `report` is told after each rollout how many steps were taken, and numbers."""
    torch.manual_seed(config.seed)
    torch.set_num_threads(config.threads)
    envs = make_envs(config, curriculum)
    try:
        rollout = Rollout(envs, config.rollout)
        policy = Policy(rollout.seen.shape[-1], rollout.actions.shape[-1], config)
        optimizer = torch.optim.Adam(policy.parameters(), config.learning_rate, eps=1e-5)
        envs.reset(seed=config.seed, out=rollout.written[0])
        absent = envs.absent()
        taken = 0
        while taken < config.steps:
            began = time.perf_counter()
            returns = rollout.fill(envs, policy, absent)
            flown = time.perf_counter()
            told = learn(policy, optimizer, rollout, config)
            rollout.seen[0] = rollout.seen[-1]
            taken += config.rollout * config.num_envs
            if curriculum:
                curriculum.policy_version += 1
            if report:
                now = time.perf_counter()
                steps = config.rollout * config.num_envs
                told |= {"steps_per_s": steps / (now - began), "flying_steps_per_s": steps / (flown - began)}
                told |= {"return": float(np.mean(returns))} if returns else {}
                levels = envs.levels[envs.levels >= 0]
                told |= {"level": float(levels.mean())} if levels.size else {}
                report(taken, policy, told)
    finally:
        envs.close()
    return policy


def speed(config: Config, seconds: float = 2.0) -> float:
    """Steps a second of the environments alone, by actions that are there already."""
    envs = make_envs(config, None)
    out = (envs.empty(), np.zeros(envs.num_envs), np.zeros(envs.num_envs, np.bool_), np.zeros(envs.num_envs, np.bool_))
    actions = np.zeros(envs.action_space.shape or (), np.float32)
    envs.reset(seed=config.seed, out=out[0])
    steps, began = 0, time.perf_counter()
    while time.perf_counter() - began < seconds:
        for _ in range(20):
            envs.step(actions, out=out)
        steps += 20 * envs.num_envs
    told = steps / (time.perf_counter() - began)
    envs.close()
    return told


def _options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m sparring.experiments ppo", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for one in fields(Config):
        kind = {"task": str, "level": int}.get(one.name, type(one.default))
        said = one.metadata["help"] + ("" if one.default is None else " (%(default)s)")
        parser.add_argument(f"--{one.name.replace('_', '-')}", type=kind, default=one.default, help=said)
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--url", help="a server whose curriculum is flown (`sparring serve`)")
    where.add_argument("--local", action="store_true", help="start one for as long as this runs (pip install sparring-server)")
    parser.add_argument("--run", help="a run of that server; one is created otherwise")
    parser.add_argument("--save", help="where the policy is kept: a file of torch's, to be read by `Policy.load`")
    parser.add_argument("--csv", help="where numbers of each rollout are written")
    parser.add_argument("--tensorboard", help="a folder for TensorBoard, with the curriculum's numbers")
    return parser


def _curriculum(args: argparse.Namespace) -> sparring.Curriculum | None:
    if not (args.url or args.local):
        return None
    return sparring.Curriculum.find(args.url, args.run, settings={"tasks": [args.task or "kessler/survival"]})


def _numbers(curriculum: sparring.Curriculum | None) -> dict[str, float]:
    try:
        return {f"curriculum/{name}": value for name, value in curriculum.numbers().items()} if curriculum else {}
    except sparring.CurriculumError:
        return {}  # a server that is away costs a point of the curves, not the training


def main(arguments: list[str] | None = None) -> None:
    """The command line."""
    parser = _options()
    args = parser.parse_args(arguments)
    if args.run and not args.url:
        parser.error("--run is of a server that is there: say which by --url")
    if args.level is not None and (args.url or args.local):
        parser.error("--level: the curriculum says what is flown")
    for name, file in (("save", args.save), ("csv", args.csv)):
        if file and not Path(file).resolve().parent.is_dir():
            parser.error(f"--{name}: there is no folder {Path(file).resolve().parent}")
    try:
        config = Config(**{name: getattr(args, name) for name in asdict(Config())})
        make_envs(config, None).close()
    except ValueError as error:
        parser.error(str(error))
    try:
        _run(args, config)
    except (sparring.CurriculumError, OSError) as error:
        print(error, file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        sys.exit(130)


def _run(args: argparse.Namespace, config: Config) -> None:
    print(f"{speed(config):,.0f} env-steps/s of the environments alone, on {config.threads} thread(s)")
    curriculum = _curriculum(args)
    board: Any = None
    if args.tensorboard:
        from torch.utils.tensorboard import SummaryWriter

        board = SummaryWriter(args.tensorboard)
    lines: list[dict[str, float]] = []

    newest: list[Policy] = []

    def report(taken: int, policy: Policy, told: dict[str, float]) -> None:
        newest[:] = [policy]
        lines.append({"steps": taken, **told})
        if len(lines) % 10 == 1 or taken >= config.steps:
            if board:
                told |= _numbers(curriculum)
                for name, value in told.items():
                    board.add_scalar(name, value, taken)
            print(
                f"{taken:>10,} steps  return {told.get('return', float('nan')):7.3f}  "
                f"{told['steps_per_s']:>9,.0f} env-steps/s with learning ({told['flying_steps_per_s']:,.0f} flying)",
                flush=True,
            )

    try:
        policy = train(config, curriculum, report)
        if curriculum:
            curriculum.flush()
            told = sparring.evaluate(curriculum, policy.act, policy="ppo", chance=False)
            for task in curriculum.tasks:
                skill = told.of(task)
                print(
                    f"{task}: {'no' if skill is None else format(skill, '.3f')} skill on held-out contested scenarios ({told.id})"
                )
    finally:
        # What was learned is kept, however it ended.
        if args.save and newest:
            newest[0].save(args.save)
        if board:
            board.close()
        if args.csv and lines:
            with open(args.csv, "w", newline="") as file:
                writer = csv.DictWriter(file, list(dict.fromkeys(name for line in lines for name in line)))
                writer.writeheader()
                writer.writerows(lines)
        if curriculum:
            curriculum.close()


if __name__ == "__main__":
    main()
