"""Names of BSK-RL that are left out: access raises an error that says what to use instead."""

from __future__ import annotations

from collections.abc import Callable, Mapping


def sentence(feature: str, instead: str) -> str:
    """Returns the sentence of the error for a feature that is left out."""
    return f"{feature} is not supported; {instead}."


def rso(name: str) -> str:
    """Returns the sentence for a name that belongs to resident space objects."""
    return sentence(f"{name} (inspection or imaging of space objects)", "use ground targets")


def missing_names(module: str, names: Mapping[str, str]) -> Callable[[str], object]:
    """Returns the `__getattr__` of a module: names that are left out raise NotImplementedError."""

    def get_attribute(name: str) -> object:
        if name in names:
            raise NotImplementedError(names[name])
        raise AttributeError(f"module {module!r} has no attribute {name!r}")

    return get_attribute
