"""Policy to export, in a form that does not depend on its library."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy.typing as npt
from torch import nn

from .interface import ActionShape


@dataclass(frozen=True)
class SourcePolicy:
    """Policy to export, from any library."""

    #: Network from observations to actions, or to a logit for each choice.
    network: nn.Module
    #: Shape of observations, of each part in a Dict; None if the network does not say.
    observation_shape: tuple[int, ...] | dict[str, tuple[int, ...]] | None = None
    #: Action of a row; None if the network does not say.
    action: ActionShape | None = None
    #: True if the network's actions are from -1 to 1 and are scaled to the action space.
    is_squashed: bool = False
    #: Environments of the training; None if the model has none.
    envs: Any = None
    #: Function of the library from normalised observations to deterministic actions or choices.
    predict: Callable[[Any], npt.NDArray[Any]] | None = None


@contextlib.contextmanager
def evaluating(module: nn.Module) -> Iterator[None]:
    """Sets all parts of a module to evaluation, and restores them."""
    modes = [(part, part.training) for part in module.modules()]
    module.eval()
    try:
        yield
    finally:
        for part, is_training in modes:
            part.training = is_training
