"""Helpers of the classes in `sparring.tasking`, under BSK-RL's names."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from copy import deepcopy
from functools import wraps
from types import new_class
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

_Function = TypeVar("_Function", bound=Callable[..., Any])


def valid_func_name(name: str) -> str:
    """Replaces characters that an identifier cannot have, and prefixes a leading digit."""
    identifier = re.sub(r"\W+", "_", name)
    return "_" + identifier if identifier[0].isdigit() else identifier


def safe_dict_merge(updates: dict[str, Any], base: dict[str, Any]) -> dict[str, Any]:
    """Adds copies of the entries of `updates` to `base`, and warns of entries that differ."""
    for key, value in updates.items():
        if key in base and base[key] != value:
            text = f"Conflicting values for {key}: overwriting {base[key]} with {value}"
            warnings.warn(text, stacklevel=2)
    base.update(deepcopy(updates))
    return base


def default_args(**defaults: Any) -> Callable[[_Function], _Function]:
    """Decorates a function with default arguments that `collect_default_args` finds."""

    def decorate(function: _Function) -> _Function:
        function.defaults = dict(defaults)  # type: ignore[attr-defined]
        return function

    return decorate


def collect_default_args(object: Any) -> dict[str, Any]:
    """Returns the default arguments of all decorated functions of an object, by function name."""
    defaults: dict[str, Any] = {}
    for name in dir(object):
        if not name.startswith("__"):
            found = getattr(getattr(object, name), "defaults", None)
            if isinstance(found, dict):
                safe_dict_merge(found, defaults)
    return defaults


def vectorize_nested_dict(dictionary: dict[str, Any]) -> tuple[list[str], npt.NDArray[Any]]:
    """Flattens nested dictionaries of scalars, lists and arrays into keys and a vector."""
    keys: list[list[str]] = []
    values: list[Any] = []
    for key, value in dictionary.items():
        if isinstance(value, dict):
            inner_keys, vector = vectorize_nested_dict(value)
            keys.append([f"{key}.{inner}" for inner in inner_keys])
            values.append(vector)
        elif isinstance(value, np.ndarray):
            values.append(value.flatten())
            keys.append([f"{key}[{index}]" for index in range(value.size)])
        elif isinstance(value, list):
            values.append(value)
            keys.append([f"{key}[{index}]" for index in range(len(value))])
        else:
            values.append([value])
            keys.append([key])
    # Keys have numpy's type of texts, which programs of BSK-RL print.
    return list(np.concatenate(keys)), np.concatenate(values)


def aliveness_checker(func: Callable[..., bool]) -> Callable[..., bool]:
    """Decorates a method of a model that returns whether the satellite is alive."""

    @wraps(func)
    def checker(self: Any, *args: Any, log_failure: bool = False, **kwargs: Any) -> bool:
        alive = func(self, *args, **kwargs)
        if not alive and log_failure:
            self.satellite.logger.warning(f"failed {func.__name__} check")
        return alive

    checker.is_aliveness_checker = True  # type: ignore[attr-defined]
    return checker


_CHECKERS: dict[type, tuple[str, ...]] = {}


def aliveness_checker_names(model_type: type) -> tuple[str, ...]:
    """Returns the names of the aliveness checkers of a class, in alphabetical order."""
    if model_type not in _CHECKERS:
        names = (name for name in dir(model_type) if not name.startswith("__"))
        _CHECKERS[model_type] = tuple(name for name in names if hasattr(getattr(model_type, name, None), "is_aliveness_checker"))
    return _CHECKERS[model_type]


def check_aliveness_checkers(model: Any, log_failure: bool = False) -> bool:
    """Returns whether all aliveness checkers of a model pass; stops at the first that fails."""
    names = aliveness_checker_names(type(model))
    return all(getattr(model, name)(log_failure=log_failure) for name in names)


def is_property(obj: Any, attr_name: str) -> bool:
    """Returns whether an object's class has a property of a name, without reading it."""
    return isinstance(getattr(type(obj), attr_name, None), property)


def compose_types(*types: type, name: str = "") -> type:
    """Returns a class that inherits from all given classes that no other one inherits from."""
    unique = tuple(dict.fromkeys(types))
    bases = tuple(base for base in unique if not any(other is not base and issubclass(other, base) for other in unique))
    return new_class(f"{name}({', '.join(item.__name__ for item in types)})", bases=bases)


class AbstractClassProperty:
    """Class attribute that subclasses must set."""

    def __init__(self) -> None:
        self.__isabstractmethod__ = True

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, instance: Any, owner: type) -> AbstractClassProperty:
        if instance is None:
            return self
        raise NotImplementedError(f"AbstractClassProperty '{self.name}' must be set in subclass")


class Resetable:
    """Object with the four hooks of a reset, which an environment calls in this order."""

    def reset_overwrite_previous(self) -> None:
        """Overwrites attributes of the previous episode."""

    def reset_pre_sim_init(self) -> None:
        """Prepares an episode before its simulation is created."""

    def reset_during_sim_init(self) -> None:
        """Prepares an episode when its models exist and its simulation has not started."""

    def reset_post_sim_init(self) -> None:
        """Prepares an episode after its simulation has started."""
