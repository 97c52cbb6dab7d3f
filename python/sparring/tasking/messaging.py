"""Payloads of messages, under the names of `Basilisk.architecture.messaging`.

Messages of a satellite's models are read by `read()`. A payload that is written to one replaces
its content until the next run of the simulation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .unsupported import sentence


class Payload:
    """Content of a message; its fields are attributes."""

    _defaults: dict[str, Any] = {}

    def __init__(self, **fields: Any) -> None:
        own = self.__dict__
        for name, value in self._defaults.items():
            if name not in fields:
                own[name] = list(value) if isinstance(value, list) else value
        own.update(fields)

    def __repr__(self) -> str:
        fields = ", ".join(f"{name}={value!r}" for name, value in vars(self).items())
        return f"{type(self).__name__}({fields})"

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise NotImplementedError(sentence(f"The field {name} of {type(self).__name__}", "use a property of the satellite"))


class PowerStorageStatusMsgPayload(Payload):
    """State of a battery: level and capacity in W·s, net power in W."""

    _defaults = {"storageLevel": 0.0, "storageCapacity": 0.0, "currentNetPower": 0.0}


class DataStorageStatusMsgPayload(Payload):
    """State of a storage unit: level and capacity in bits, bits by partition."""

    _defaults = {
        "storageLevel": 0.0,
        "storageCapacity": 0.0,
        "storedData": [],
        "storedDataName": [],
    }


class SCStatesMsgPayload(Payload):
    """State of a satellite: inertial position (m) and velocity (m/s), MRP, body rate (rad/s)."""

    _defaults = {
        "r_BN_N": [0.0] * 3,
        "v_BN_N": [0.0] * 3,
        "r_CN_N": [0.0] * 3,
        "v_CN_N": [0.0] * 3,
        "sigma_BN": [0.0] * 3,
        "omega_BN_B": [0.0] * 3,
    }


class RWSpeedMsgPayload(Payload):
    """Speeds of the wheels, rad/s."""

    _defaults = {"wheelSpeeds": [0.0] * 36}


class SpicePlanetStateMsgPayload(Payload):
    """State of the Sun or the Earth: position relative to the Earth (m) and orientation."""

    _defaults = {"PositionVector": [0.0] * 3, "PlanetName": ""}


class EclipseMsgPayload(Payload):
    """Share of the Sun's disc that a satellite sees."""

    _defaults = {"illuminationFactor": 0.0}

    @property
    def shadowFactor(self) -> float:
        """Illumination factor under its older name."""
        return float(self.illuminationFactor)


class Message:
    """Message that the simulation writes; a written payload holds until its next run."""

    def __init__(self, build: Callable[[], Payload], owner: Any = None) -> None:
        self._build = build
        self._owner = owner
        self._written: Payload | None = None
        self._written_run = -1

    def read(self) -> Any:
        """Returns the content of the message."""
        if self._written is not None:
            if self._written_run == self._owner.simulator.run_count:
                return self._written
            self._written = None
        return self._build()

    def write(self, payload: Payload, *times: int) -> Message:
        """Replaces the content of the message until the next run of the simulation."""
        if self._owner is None:
            raise NotImplementedError(sentence("Writing this message", "write a satellite's message"))
        if not isinstance(payload, Payload):
            raise TypeError(f"A message has a payload of `messaging`, got {type(payload).__name__}.")
        self._written = payload
        self._written_run = self._owner.simulator.run_count
        self._owner.written_run = self._written_run
        return self

    def recorder(self, *args: Any) -> Any:
        """Records a message in Basilisk; not supported."""
        raise NotImplementedError(sentence("Recording messages", "read properties of the satellite after each step"))


def __getattr__(name: str) -> Any:
    if name.endswith(("Payload", "Msg", "Msg_C")):
        raise NotImplementedError(sentence(f"messaging.{name}", "use properties of the satellite's models"))
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
