"""The trainer callback that sets the policy version and logs the curriculum's metrics."""

from __future__ import annotations

import os
from typing import Any

try:
    from transformers import TrainerCallback
except ImportError as error:
    raise ImportError("sparring.trl needs TRL: pip install 'sparring[trl]'") from error

from ..curriculum import Curriculum
from ..errors import invalid
from ..metrics import read_metrics
from ..trainer_metrics import TrainerReport
from .environments import Environments
from .factory import EnvironmentFactory


class CurriculumCallback(TrainerCallback):
    """Increments the policy version with the trainer's steps, and logs the curriculum's metrics with the trainer's.

    The trainer's log gets `curriculum/…`: mastery, level, params, skill and the share of zero-variance groups. With
    `report_to="tensorboard"` they are also a run `curriculum` in addition to the trainer's own. The trainer calls the callbacks
    of `report_to` before this one. For other trackers, such as Weights & Biases, use `report_to="none"` and
    `callbacks=[CurriculumCallback(envs), WandbCallback()]`.

    The numbers of the trainer's log are sent to the curriculum's run, at most once a second.

    Args:
        source: The trainer's `environment_factory`; or a curriculum, with other environments.
        report: False to send no numbers of the trainer to the server.

    The policy version is the trainer's step whose weights generate. `AsyncGRPOTrainer` sends weights to its server every
    `weight_sync_steps` steps; the callback sets the version just before.
    """

    def __init__(self, source: EnvironmentFactory | Environments | Curriculum, report: bool = True) -> None:
        self.source = source
        self._report = TrainerReport(source if report else None)
        self._first_version = 0
        self._writer: Any = None

    def on_train_begin(self, args: Any, state: Any, control: Any, **_: Any) -> None:
        """Checks the trainer's settings and sets the policy version.

        Raises:
            ValueError: With these settings the members of a group would run in different processes, or evaluation episodes
                would count as training.
        """
        if isinstance(self.source, (EnvironmentFactory, Environments)):
            _check_arguments(args, self.source.group_size)
        # A resumed run already has versions: a new training continues from the newest.
        self._first_version = max(0, self.source.policy_version - state.global_step)
        self.source.policy_version = self._first_version + state.global_step
        if state.is_world_process_zero and "tensorboard" in args.report_to:
            from torch.utils.tensorboard import SummaryWriter

            runs = os.environ.get("TENSORBOARD_LOGGING_DIR") or os.path.join(args.output_dir, "runs")
            self._writer = SummaryWriter(os.path.join(runs, "curriculum"))

    def on_step_end(self, args: Any, state: Any, control: Any, **_: Any) -> None:
        """Sets the policy version after an update of the weights that generate."""
        if state.global_step % getattr(args, "weight_sync_steps", 1) == 0:
            self.source.policy_version = self._first_version + state.global_step

    def on_log(self, args: Any, state: Any, control: Any, logs: dict[str, Any] | None = None, **_: Any) -> None:
        """Adds the metrics to the logs."""
        if not state.is_world_process_zero or logs is None:
            return
        self._report.add(state.global_step, logs)
        metrics = read_metrics(self.source)
        logs.update(metrics)
        if state.log_history:
            state.log_history[-1].update(metrics)
        if self._writer is not None:
            for name, value in metrics.items():
                self._writer.add_scalar(name, value, state.global_step)
            self._writer.flush()

    def on_train_end(self, args: Any, state: Any, control: Any, **_: Any) -> None:
        """Sends the last numbers, and closes the writer of TensorBoard."""
        self._report.finish()
        if self._writer is not None:
            self._writer.close()
            self._writer = None


def _check_arguments(args: Any, group_size: int) -> None:
    if args.num_generations != group_size:
        raise invalid("num_generations", f"the group size of the environments, {group_size}", args.num_generations)
    # The groups of AsyncGRPOTrainer run in one process, independently of the trainer's batches.
    is_async = hasattr(args, "weight_sync_steps")
    per_process = group_size if is_async else args.per_device_train_batch_size * args.steps_per_generation
    if per_process % group_size:
        requirement = f"a multiple of the group size {group_size}, because a group runs in one process"
        raise invalid("per_device_train_batch_size * steps_per_generation", requirement, per_process)
    if args.eval_strategy != "no":
        requirement = "'no', because episodes of the trainer's evaluation would count as training; use sparring.evaluate"
        raise invalid("eval_strategy", requirement, args.eval_strategy)
