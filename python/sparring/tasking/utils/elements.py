"""Orbital elements and their conversion, under the names of Basilisk's `orbitalMotion`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

#: Equatorial radius of the Earth, km.
REQ_EARTH = 6378.1366
#: Gravitational parameter of the Earth, km³/s².
MU_EARTH = 398600.436
#: Eccentricities and inclinations (rad) below this count as zero.
_EPSILON = 1e-11

Vector = npt.NDArray[np.float64]


class ClassicElements:
    """Elements of an orbit: `a` in the unit of length, angles `i`, `Omega`, `omega`, `f` in rad."""

    def __init__(
        self,
        a: float | None = None,
        e: float | None = None,
        i: float | None = None,
        Omega: float | None = None,
        omega: float | None = None,
        f: float | None = None,
    ) -> None:
        self.a: Any = a
        self.e: Any = e
        self.i: Any = i
        self.Omega: Any = Omega
        self.omega: Any = omega
        self.f: Any = f

    def __repr__(self) -> str:
        names = ("a", "e", "i", "Omega", "omega", "f")
        values = ", ".join(f"{name}={getattr(self, name)!r}" for name in names)
        return f"ClassicElements({values})"


def elem2rv(mu: float, elements: ClassicElements) -> tuple[Vector, Vector]:
    """Converts the elements of an elliptic orbit to position and velocity.

    `mu` is the gravitational parameter in units that fit those of `elements.a`.
    """
    parameter = elements.a * (1.0 - elements.e**2)
    radius = parameter / (1.0 + elements.e * np.cos(elements.f))
    angle = elements.omega + elements.f
    momentum = np.sqrt(mu * parameter)
    node, inclination = elements.Omega, elements.i
    cos_node, sin_node = np.cos(node), np.sin(node)
    cos_i, sin_i = np.cos(inclination), np.sin(inclination)

    def rotate(along: float, across: float) -> Vector:
        return np.array(
            [
                cos_node * along - sin_node * across * cos_i,
                sin_node * along + cos_node * across * cos_i,
                across * sin_i,
            ]
        )

    position = radius * rotate(np.cos(angle), np.sin(angle))
    along = np.sin(angle) + elements.e * np.sin(elements.omega)
    across = np.cos(angle) + elements.e * np.cos(elements.omega)
    velocity = -mu / momentum * rotate(along, -across)
    return position, velocity


def rv2elem(mu: float, rVec: Iterable[float], vVec: Iterable[float]) -> ClassicElements:
    """Converts position and velocity to the elements of an elliptic orbit.

    A circular orbit has its periapsis at the ascending node, an equatorial one its node on the
    x axis.
    """
    position = np.asarray(rVec, dtype=float)
    velocity = np.asarray(vVec, dtype=float)
    radius = float(np.linalg.norm(position))
    momentum = np.cross(position, velocity)
    size = float(np.linalg.norm(momentum))
    eccentricity = np.cross(velocity, momentum) / mu - position / radius
    e = float(np.linalg.norm(eccentricity))
    normal = momentum / size
    elements = ClassicElements()
    elements.a = 1.0 / (2.0 / radius - float(velocity @ velocity) / mu)
    elements.e = e
    elements.i = float(np.arccos(np.clip(normal[2], -1.0, 1.0)))
    node = np.array([-normal[1], normal[0], 0.0])
    is_equatorial = float(np.linalg.norm(node)) < _EPSILON
    node = np.array([1.0, 0.0, 0.0]) if is_equatorial else node / np.linalg.norm(node)
    elements.Omega = float(np.arctan2(node[1], node[0])) % (2 * np.pi)
    is_circular = e < _EPSILON
    periapsis = node if is_circular else eccentricity / e
    elements.omega = 0.0 if is_circular else _angle(node, periapsis, normal)
    elements.f = _angle(periapsis, position / radius, normal)
    return elements


def _angle(start: Vector, end: Vector, normal: Vector) -> float:
    """Angle from one unit vector to another about a normal, from 0 to 2π."""
    return float(np.arctan2(normal @ np.cross(start, end), start @ end)) % (2 * np.pi)
