"""`python -m sparring.experiments ppo`: trains a policy by PPO."""

from __future__ import annotations

import argparse
import csv
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

import sparring

from ..metrics import read_metrics
from . import ppo


def main(arguments: list[str] | None = None) -> None:
    """Runs the command line."""
    parser = _parser()
    args = parser.parse_args(arguments)
    if args.run and not args.url:
        parser.error(f"--run must be omitted without --url, got {args.run}; pass the address of the server that has the run")
    if args.level is not None and (args.url or args.local):
        parser.error("--level must be omitted with --url or --local: the curriculum chooses the scenarios")
    for name, file in (("save", args.save), ("csv", args.csv)):
        if file and not Path(file).resolve().parent.is_dir():
            parser.error(f"--{name} must be a file in an existing folder, got {file}: create {Path(file).resolve().parent}")
    try:
        given = {option.name: getattr(args, option.name) for option in fields(ppo.Config)}
        given = {name: value for name, value in given.items() if value is not None}
        config = ppo.Config.tuned(**given) if args.task else ppo.Config(**given)
        ppo.make_envs(config, None).close()
    except ValueError as error:
        parser.error(str(error))
    try:
        _run(args, config)
    except (sparring.CurriculumError, OSError) as error:
        print(error, file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("Stopped.", file=sys.stderr)
        sys.exit(130)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m sparring.experiments ppo",
        description=ppo.__doc__,
        epilog="With --task, options that are left out have the values that were tuned for the task, where they differ from the "
        "defaults in brackets.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    for option in fields(ppo.Config):
        kind = {"task": str, "level": int, "observation": str}.get(option.name, type(option.default))
        help = option.metadata["help"] + ("" if option.default is None else f" ({option.default})")
        parser.add_argument(f"--{option.name.replace('_', '-')}", type=kind, help=help)
    server = parser.add_mutually_exclusive_group()
    server.add_argument("--url", help="address of a running server (`sparring serve`), whose curriculum chooses the scenarios")
    server.add_argument(
        "--local", action="store_true", help="start a server for this training, which needs the package sparring-server"
    )
    parser.add_argument("--run", help="id of a run of the server at --url (default: create one)")
    parser.add_argument("--save", help="file to save the policy to; `Policy.load` reads it")
    parser.add_argument("--csv", help="CSV file for the metrics of each rollout")
    parser.add_argument(
        "--tensorboard", help="folder for TensorBoard, which shows the metrics of the learner and of the curriculum"
    )
    return parser


def _run(args: argparse.Namespace, config: ppo.Config) -> None:
    print(f"{ppo.measure_speed(config):,.0f} env-steps/s without a policy, on {config.threads} thread(s)")
    curriculum = _open_curriculum(args)
    log = _TrainingLog(args, config, curriculum)
    try:
        policy = ppo.train(config, curriculum, log.report)
        if curriculum:
            curriculum.flush()
            settings = {"decision_steps": config.decision_steps, **ppo.environment_settings(config)}
            result = sparring.evaluate(curriculum, policy.sample, policy="ppo", stochastic=True, **settings)
            for task in curriculum.tasks:
                skill = result.mean(task)
                skill_text = "no" if skill is None else format(skill, ".3f")
                print(f"{task}: {skill_text} skill on held-out contested scenarios ({result.id})")
    finally:
        log.close()
        if curriculum:
            curriculum.close()


def _open_curriculum(args: argparse.Namespace) -> sparring.Curriculum | None:
    if not (args.url or args.local):
        return None
    return sparring.Curriculum.open(args.url, args.run, settings={"tasks": [args.task or "kessler/survival"]})


class _TrainingLog:
    """Metrics on the terminal, in a CSV file and in TensorBoard; saves the policy at the end."""

    def __init__(self, args: argparse.Namespace, config: ppo.Config, curriculum: sparring.Curriculum | None) -> None:
        self._args, self._config, self._curriculum = args, config, curriculum
        self._rows: list[dict[str, float]] = []
        self._policy: ppo.Policy | None = None
        self._writer: Any = None
        if args.tensorboard:
            from torch.utils.tensorboard import SummaryWriter

            self._writer = SummaryWriter(args.tensorboard)

    def report(self, steps: int, policy: ppo.Policy, metrics: dict[str, float]) -> None:
        """Records a rollout; prints every tenth one and the last."""
        self._policy = policy
        self._rows.append({"steps": steps, **metrics})
        if len(self._rows) % 10 != 1 and steps < self._config.steps:
            return
        if self._writer:
            curriculum_metrics = read_metrics(self._curriculum) if self._curriculum else {}
            for name, value in {**metrics, **curriculum_metrics}.items():
                self._writer.add_scalar(name, value, steps)
        print(
            f"{steps:>10,} steps  return {metrics.get('return', float('nan')):7.3f}  "
            f"{metrics['steps_per_s']:>9,.0f} env-steps/s with learning ({metrics['rollout_steps_per_s']:,.0f} without)",
            flush=True,
        )

    def close(self) -> None:
        """Saves the policy and the metrics, also after an error or an interrupt."""
        if self._args.save and self._policy:
            self._policy.save(self._args.save)
        if self._writer:
            self._writer.close()
        if self._args.csv and self._rows:
            with open(self._args.csv, "w", newline="") as file:
                writer = csv.DictWriter(file, list(dict.fromkeys(name for row in self._rows for name in row)))
                writer.writeheader()
                writer.writerows(self._rows)


if __name__ == "__main__":
    main()
