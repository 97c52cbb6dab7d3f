"""Attitudes, under the names of `bsk_rl.utils.attitude`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from .elements import Vector
from .orbital import rv2HN


def random_tumble(maxSpinRate: float = 0.001) -> tuple[Vector, Vector]:
    """Draws an attitude (MRP) and a body rate of at most `maxSpinRate` rad/s about each axis."""
    sigma = np.random.uniform(0, 1.0, [3])
    omega = np.random.uniform(-maxSpinRate, maxSpinRate, [3])
    return sigma, omega


def MRP2C(sigma: Iterable[float]) -> Vector:
    """Returns the rotation matrix of an MRP (Schaub and Junkins, Analytical Mechanics)."""
    x, y, z = sigma
    squared = x * x + y * y + z * z
    tilde = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    scale = 1.0 / (1.0 + squared) ** 2
    rotation: Vector = np.eye(3) + scale * (8.0 * tilde @ tilde - 4.0 * (1.0 - squared) * tilde)
    return rotation


def C2MRP(C: Any) -> Vector:
    """Returns the MRP of a rotation matrix, with a norm of at most 1 (Sheppard's method)."""
    matrix = np.asarray(C, dtype=float)
    trace = np.trace(matrix)
    squares = np.array([1 + trace, *(1 + 2 * np.diag(matrix) - trace)]) / 4.0
    largest = int(np.argmax(squares))
    q = np.zeros(4)
    q[largest] = np.sqrt(squares[largest])
    skew = np.array([matrix[1, 2] - matrix[2, 1], matrix[2, 0] - matrix[0, 2], matrix[0, 1] - matrix[1, 0]])
    if largest == 0:
        q[1:] = skew / (4.0 * q[0])
    else:
        axis = largest - 1
        q[0] = skew[axis] / (4.0 * q[largest])
        for other in {0, 1, 2} - {axis}:
            q[1 + other] = (matrix[axis, other] + matrix[other, axis]) / (4.0 * q[largest])
    if q[0] < 0:
        q = -q
    sigma: Vector = q[1:] / (1.0 + q[0])
    return sigma


_SPIN = {"type": "fixed", "rate": 0.0, "axis": "radial"}
_NAMED_AXES = {
    "radial": [1.0, 0.0, 0.0],
    "tangential": [0.0, 1.0, 0.0],
    "normal": [0.0, 0.0, 1.0],
}


def hill_frame_attitude(
    r_N: Iterable[float], v_N: Iterable[float], spin_config: dict[str, Any] | None = None
) -> tuple[Vector, Vector]:
    """Returns the attitude (MRP) aligned with the Hill frame and the body rate, rad/s.

    `spin_config` adds a rate relative to that frame: `type` is "fixed" with a `rate`, or "uniform"
    with `low` and `high`, in degrees/s; `axis` is "radial", "tangential", "normal", "velocity",
    "random" or a vector in the Hill frame.
    """
    position, velocity = np.asarray(r_N, dtype=float), np.asarray(v_N, dtype=float)
    if position.shape != (3,) or velocity.shape != (3,):
        raise ValueError("r_N and v_N must be three-element vectors")
    momentum = np.cross(position, velocity)
    radius = np.linalg.norm(position)
    if np.isclose(radius, 0.0) or np.isclose(np.linalg.norm(momentum), 0.0):
        raise ValueError("r_N and v_N must define a valid Hill frame")
    hill = rv2HN(position, velocity)
    config: dict[str, Any] = _SPIN | (spin_config or {})
    unknown = set(config) - {"type", "rate", "low", "high", "axis"}
    if unknown:
        raise ValueError(f"Unknown spin configuration keys: {unknown}")
    rate = np.radians(_spin_rate(config))
    axis = _spin_axis(config["axis"], hill @ velocity)
    omega = hill @ momentum / radius**2 + rate * axis / np.linalg.norm(axis)
    return C2MRP(hill), omega


def _spin_rate(config: dict[str, Any]) -> float:
    """Spin rate of a configuration, degrees/s; a uniform one is drawn."""
    if config["type"] == "fixed":
        return float(config["rate"])
    if config["type"] != "uniform":
        raise ValueError(f"Unknown spin type: {config['type']}")
    if "low" not in config or "high" not in config:
        raise ValueError("Uniform spin requires low and high rate bounds")
    if config["low"] > config["high"]:
        raise ValueError("Uniform spin low bound must not exceed high bound")
    return float(np.random.uniform(config["low"], config["high"]))


def _spin_axis(axis: Any, velocity_H: Vector) -> Vector:
    """Spin axis in the Hill frame; a random one is drawn."""
    if isinstance(axis, str):
        if axis == "random":
            axis = np.random.normal(size=3)
        elif axis == "velocity":
            axis = velocity_H
        elif axis in _NAMED_AXES:
            axis = _NAMED_AXES[axis]
        else:
            raise ValueError(f"Unknown spin axis: {axis}")
    vector = np.asarray(axis, dtype=float)
    if vector.shape != (3,):
        raise ValueError("Spin axis must be a three-element vector")
    if np.isclose(np.linalg.norm(vector), 0.0):
        raise ValueError("Spin axis must be nonzero")
    return vector
