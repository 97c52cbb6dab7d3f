"""Which environments the compiled batch can step whole, and the set-ups of their episodes."""

from __future__ import annotations

import inspect
import math
from typing import Any

import numpy as np

from .act.actions import ActionBuilder
from .data import NoReward, ScanningTimeReward, UniqueImageReward
from .data.composition import ComposedReward
from .data.unique_image_data import own_priority
from .general import GeneralSatelliteTasking
from .sats import Satellite
from .sim.model_names import defining_class, has_own_checks

_PACKAGE = __name__.rsplit(".", 1)[0]
#: Attributes that a user's class of satellites may set, beside its methods for pickling.
_SPECS = {"observation_spec", "action_spec", "dyn_type", "fsw_type", "_dyn_type", "_fsw_type", "_abc_impl"}


def _is_from_package(cls: type) -> bool:
    return cls.__module__.startswith(_PACKAGE + ".")


def python_part(env: GeneralSatelliteTasking) -> str | None:
    """Returns the name of a part of an environment that must run in Python at each step, or None."""
    for satellite in env.satellites:
        part = _python_part_of(satellite)
        if part is not None:
            return f"{part} of {satellite.name}"
    if env.generate_obs_retasking_only:
        return "generate_obs_retasking_only"
    if not math.isfinite(env.failure_penalty):
        return "failure_penalty"
    for hook in ("after_step", "reset_pre_sim_init", "reset_during_sim_init", "reset_post_sim_init"):
        owner = defining_class(type(env.scenario), hook)
        if owner is not None and not _is_from_package(owner):
            return f"{owner.__name__}.{hook}"
    return next((name for rewarder in _rewarders(env) if (name := _own_reward(rewarder))), None)


def _python_part_of(satellite: Satellite) -> str | None:
    """Name of the part of a satellite that must run in Python at each step."""
    for base in type(satellite).__mro__:
        if base is object or _is_from_package(base) or base.__module__ == "abc":
            continue
        for name, member in vars(base).items():
            if name not in _SPECS and not name.startswith("__") and not inspect.isclass(member):
                return f"{base.__name__}.{name}"
    for model in (satellite.dyn_type, satellite.fsw_type):
        if not has_own_checks(model):
            return f"an aliveness checker of {model.__name__}"
    if satellite.observation_builder.obs_type is not np.ndarray:
        return "observations that are no arrays"
    if satellite.observation_builder.dtype != np.float64:
        return "another dtype of observations"
    actions: ActionBuilder = satellite.action_builder
    for item in actions.action_spec:
        if not _is_from_package(type(item)):
            return f"the action {item.name}"
    satellite.observation_builder.native_items()
    if any(not isinstance(part, slice) for part in satellite.observation_builder.parts):
        return "an observation"
    filters = getattr(satellite, "access_filter_functions", [])
    return "an access filter" if filters else None


def _rewarders(env: GeneralSatelliteTasking) -> tuple[Any, ...]:
    rewarder = env.rewarder
    return rewarder.rewarders if isinstance(rewarder, ComposedReward) else (rewarder,)


def _own_reward(rewarder: Any) -> str | None:
    """Name of a rewarder that the simulation does not know."""
    is_known = (
        type(rewarder) is NoReward
        or (type(rewarder) is ScanningTimeReward and rewarder.is_linear)
        or (type(rewarder) is UniqueImageReward and rewarder.reward_fn is own_priority)
    )
    return None if is_known else f"the rewarder {type(rewarder).__name__}"


def draw_setup(env: GeneralSatelliteTasking, seed: int | None) -> str:
    """Draws an episode of an environment without a part in Python, and returns its set-up as JSON text."""
    described = [{"type": type(rewarder).__name__} for rewarder in _rewarders(env)]
    return env.draw_setup(seed, described, getattr(env.scenario, "value_per_second", 0.0))
