"""Models of a class, by the names that the compiled simulation knows."""

from __future__ import annotations

import inspect
from functools import lru_cache

from ..unsupported import sentence
from ..utils.functional import aliveness_checker_names

_DYNAMICS = (
    "BasicDynamicsModel",
    "ImagingDynModel",
    "ContinuousImagingDynModel",
    "GroundStationDynModel",
    "LOSCommDynModel",
)
_SOFTWARE = (
    "BasicFSWModel",
    "ImagingFSWModel",
    "ContinuousImagingFSWModel",
    "SteeringFSWModel",
)
_PACKAGE = __name__.rsplit(".", 1)[0]
#: Methods of models that build the simulation's modules in BSK-RL: prefixes and names.
_BUILDER_PREFIXES = ("setup_", "_setup_")
_BUILDERS = (
    "_make_task_list",
    "_set_messages",
    "_set_config_msgs",
    "_set_gateway_msgs",
    "_zero_gateway_msgs",
)


def is_own(cls: type) -> bool:
    """Returns whether a class belongs to this package."""
    return cls.__module__ == _PACKAGE or cls.__module__.startswith(_PACKAGE + ".")


def defining_class(cls: type, name: str) -> type | None:
    """Returns the class in which a class finds an attribute."""
    return next((base for base in cls.__mro__ if name in vars(base)), None)


_HAS_OWN_CHECKS: dict[type, bool] = {}


def has_own_checks(cls: type) -> bool:
    """Returns whether all aliveness checks of a model's class are those of this package."""
    if cls not in _HAS_OWN_CHECKS:
        names = ("is_alive", *aliveness_checker_names(cls))
        owners = [defining_class(cls, name) for name in names]
        _HAS_OWN_CHECKS[cls] = all(owner is not None and is_own(owner) for owner in owners)
    return _HAS_OWN_CHECKS[cls]


def dynamics_names(cls: type) -> list[str]:
    """Returns the dynamics models of a class."""
    return _names(cls, _DYNAMICS, "BasicDynamicsModel")


def software_names(cls: type) -> list[str]:
    """Returns the flight software models of a class."""
    return _names(cls, _SOFTWARE, "BasicFSWModel")


@lru_cache(maxsize=256)
def _names(cls: type, known: tuple[str, ...], basic: str) -> list[str]:
    own = {base.__name__ for base in cls.__mro__ if is_own(base)}
    if basic not in own:
        raise NotImplementedError(sentence(f"The model {cls.__name__} without {basic}", f"inherit from {basic}"))
    return [name for name in known if name in own]


def check_model(cls: type) -> None:
    """Raises NotImplementedError if a user's class changes modules or actions of a model."""
    for base in cls.__mro__:
        if is_own(base):
            continue
        for name, member in vars(base).items():
            if name.startswith(_BUILDER_PREFIXES) or name in _BUILDERS:
                feature = f"{base.__name__}.{name}, a module of Basilisk,"
            elif hasattr(member, "is_action"):
                feature = f"{base.__name__}.{name}, an action of the flight software,"
            elif inspect.isclass(member) and hasattr(member, "is_software_task"):
                feature = f"{base.__name__}.{name}, a task of the flight software,"
            else:
                continue
            instead = "use the built-in models, their arguments, properties and aliveness checkers"
            raise NotImplementedError(sentence(feature, instead))
