"""Preset wheels and thrusters, under the names of `bsk_rl.utils.actuator_primitives`.

Wheels and thrusters are descriptions: the simulation has these actuators built in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

#: Momentum of an HR16 wheel at its largest speed, N·m·s.
_MAX_MOMENTUM = 50.0
#: Offsets of the thrusters from the body axes, m.
_THRUSTER_X, _THRUSTER_Y, _THRUSTER_Z = 3.874945160902288e-2, 1.206182747348013, 0.85245


@dataclass(frozen=True)
class ReactionWheel:
    """Wheel: spin axis in body axes, initial speed in rpm, momentum and torque limits in SI."""

    gsHat_B: list[float]
    Omega: float
    maxMomentum: float = _MAX_MOMENTUM
    u_max: float = 0.2


@dataclass
class ReactionWheels:
    """Wheels by name; stands for Basilisk's factory and state effector."""

    rwList: dict[str, ReactionWheel] = field(default_factory=dict)
    rwSpeedOutMsg: Any = None

    def getNumOfDevices(self) -> int:
        """Returns the number of wheels."""
        return len(self.rwList)


@dataclass(frozen=True)
class Thruster:
    """Thruster: position in m and direction of the force in body axes."""

    thrLoc_B: list[float]
    thrDir_B: list[float]


@dataclass
class Thrusters:
    """Thrusters by name; stands for Basilisk's factory and effector."""

    thrList: dict[str, Thruster] = field(default_factory=dict)


def balancedHR16Triad(
    useRandom: bool = False,
    randomBounds: tuple[float, float] = (-400, 400),
    wheelSpeeds: Sequence[float] = (500, 500, 500),
) -> tuple[ReactionWheels, ReactionWheels, Sequence[float]]:
    """Returns three HR16 wheels along the body axes twice, and their speeds in rpm.

    With `useRandom`, the speeds are drawn between the bounds.
    """
    if useRandom:
        wheelSpeeds = list(np.random.uniform(randomBounds[0], randomBounds[1], 3))
    wheels = ReactionWheels()
    for axis, speed in enumerate(wheelSpeeds):
        direction = [float(axis == other) for other in range(3)]
        wheels.rwList[f"RW{axis + 1}"] = ReactionWheel(direction, speed)
    return wheels, wheels, wheelSpeeds


def idealMonarc1Octet() -> tuple[Thrusters, Thrusters]:
    """Returns eight Monarc-1 thrusters, twice."""
    thrusters = Thrusters()
    diagonal = np.sqrt(0.5)
    for side in (-1.0, 1.0):
        for along in (side, -side):
            for height in (1.0, -1.0):
                place = [-along * _THRUSTER_X, side * _THRUSTER_Y, height * _THRUSTER_Z]
                direction = [along * diagonal, -side * diagonal, 0.0]
                name = f"thruster{len(thrusters.thrList) + 1}"
                thrusters.thrList[name] = Thruster(place, direction)
    return thrusters, thrusters
