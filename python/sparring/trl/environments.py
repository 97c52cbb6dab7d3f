"""Environments by name: `environment_factory={name: factory}` of TRL, with the dataset that selects them."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any, SupportsFloat

from datasets import Dataset

from ..errors import invalid
from .factory import EnvironmentFactory


class Environments(dict[str, EnvironmentFactory]):
    """Environments by name, each with a curriculum of its own: `GRPOTrainer(environment_factory=…)`.

    A row of the dataset names its environment, and the model is offered the tools of this environment only.

    Args:
        factories: An `EnvironmentFactory` for each name. All have the same group size.

    Raises:
        ValueError: There is no factory, or their group sizes differ.
    """

    def __init__(self, factories: Mapping[str, EnvironmentFactory]) -> None:
        super().__init__(factories)
        if not self:
            raise invalid("factories", "a dict of at least one sparring.trl.EnvironmentFactory", factories)
        sizes = {name: factory.group_size for name, factory in self.items()}
        if len(set(sizes.values())) > 1:
            raise invalid("group_size", "equal in all factories, because the trainer has one num_generations", sizes)

    @property
    def group_size(self) -> int:
        """Number of members of a group."""
        return next(iter(self.values())).group_size

    def dataset(self, groups: int | Mapping[str, int], prompts: Mapping[str, str] | None = None) -> Dataset:
        """Makes a dataset with one prompt, one `group_id` and the name of the `environment` per group.

        Args:
            groups: Number of groups of each environment, or a number for each name. Rows of all environments alternate in
                this ratio.
            prompts: Prompts before the first observation by name; the others have the prompt of their world.

        Raises:
            ValueError: A name is unknown or missing.
        """
        counts = dict.fromkeys(self, groups) if isinstance(groups, int) else dict(groups)
        prompts = prompts or {}
        for field, names in (("groups", counts), ("prompts", prompts)):
            unknown = sorted(set(names) - set(self))
            if unknown:
                raise invalid(field, f"a dict with keys among {', '.join(self)}", ", ".join(unknown))
        missing = [name for name in self if name not in counts]
        if missing:
            raise invalid("groups", "a dict with a number for each environment", f"none for {', '.join(missing)}")
        rows: list[tuple[float, dict[str, Any]]] = []
        for name, factory in self.items():
            for number, row in enumerate(factory.rows(counts[name], prompts.get(name))):
                place = (number + 0.5) / counts[name]
                rows.append((place, {**row, "group_id": f"{name}-{number}", "environment": name}))
        return Dataset.from_list([row for _, row in sorted(rows, key=lambda item: item[0])])

    @property
    def policy_version(self) -> int:
        """Policy version of the episodes that begin from now on, at least that of each run; the callback sets it."""
        return max(factory.policy_version for factory in self.values())

    @policy_version.setter
    def policy_version(self, version: int) -> None:
        for factory in self.values():
            factory.policy_version = version

    def metrics(self) -> dict[str, float]:
        """Returns `EnvironmentFactory.metrics` of each environment as `<environment>/<metric>`.

        Raises:
            CurriculumError: A server is unreachable.
        """
        return {f"{name}/{key}": value for name, factory in self.items() for key, value in factory.metrics().items()}

    def log_metrics(self, step: int, metrics: Mapping[str, SupportsFloat]) -> None:
        """Sends the trainer's metrics to the run of each environment, as `EnvironmentFactory.log_metrics`."""
        for factory in self.values():
            factory.log_metrics(step, metrics)

    def stats(self) -> dict[str, dict[str, Any]]:
        """Returns `Curriculum.stats` of each environment by name."""
        return {name: factory.stats() for name, factory in self.items()}

    def flush(self, timeout_s: float = 60.0) -> None:
        """Waits until all results are submitted.

        Raises:
            CurriculumError: The results of an environment are not submitted in time, or its server refused some.
        """
        for factory in self.values():
            factory.flush(timeout_s)

    def close(self, timeout_s: float = 60.0) -> None:
        """Closes all factories, also after an error of one.

        Raises:
            CurriculumError: Results could not be submitted, or were refused.
        """
        with contextlib.ExitStack() as stack:
            for factory in self.values():
                stack.callback(factory.close, timeout_s)

    def __enter__(self) -> Environments:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
