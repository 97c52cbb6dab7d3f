"""Parameters of the compiled simulation that programs read, and that cannot change in an episode."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..unsupported import sentence

_INSTEAD = "set it in the arguments of the satellite or environment before a reset"


class Parameters:
    """Read-only attributes of a module of the simulation."""

    def __init__(self, **values: Any) -> None:
        self.__dict__.update(values)

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...

    def __setattr__(self, name: str, value: Any) -> None:
        raise NotImplementedError(sentence(f"A change of {name} in an episode", _INSTEAD))


class FixedAttribute:
    """Attribute of a model that is set once."""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __get__(self, instance: Any, owner: type) -> Any:
        if instance is None:
            return self
        try:
            return instance.__dict__[self.name]
        except KeyError:
            raise AttributeError(f"'{owner.__name__}' object has no attribute '{self.name}'") from None

    def __set__(self, instance: Any, value: Any) -> None:
        known = instance.__dict__
        if self.name in known and known[self.name] is not value and known[self.name] != value:
            raise NotImplementedError(sentence(f"A change of {self.name} in an episode", _INSTEAD))
        known[self.name] = value
