"""Orbits, epochs and frames, under the names of `bsk_rl.utils.orbital`.

Random functions draw from numpy's global generator, in BSK-RL's order.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from .elements import (
    MU_EARTH as MU_EARTH,
)
from .elements import (
    REQ_EARTH as REQ_EARTH,
)
from .elements import (
    ClassicElements as ClassicElements,
)
from .elements import (
    Vector,
    elem2rv,
    rv2elem,
)

logger = logging.getLogger(__name__)

MONTHS = ["JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC"]
#: Radius of the Earth to which altitudes of orbits refer, km.
_ORBIT_RADIUS_KM = 6371

SatelliteArgs = dict[Any, dict[str, Any]]


def random_unit_vector() -> Vector:
    """Draws a direction that is uniform over the sphere."""
    vector = np.random.randn(3)
    return vector / np.linalg.norm(vector)


def random_orbit(
    i: float | None = None,
    a: float | None = _ORBIT_RADIUS_KM + 500,
    e: float = 0,
    Omega: float | None = None,
    omega: float | None = None,
    f: float | None = None,
    alt: float | None = None,
    r_body: float = _ORBIT_RADIUS_KM,
) -> ClassicElements:
    """Returns orbital elements; angles in degrees are drawn where they are None.

    `a` is in km. `alt`, in km above `r_body`, is the older form of a circular orbit.
    """
    if alt is not None:
        logger.warning(
            "Ignoring a, e, and omega and using alt and r_body to generate a circular orbit."
            "random_circular_orbit is preferred for this use case."
        )
        return random_circular_orbit(i=i, alt=alt, r_body=r_body, Omega=Omega, f=f)
    assert a is not None

    def angle(degrees: float | None, low: float, high: float) -> float:
        return np.random.uniform(low, high) if degrees is None else np.radians(degrees)

    elements = ClassicElements()
    elements.a = a * 1e3
    elements.e = e
    elements.i = angle(i, -np.pi, np.pi)
    elements.Omega = angle(Omega, 0, 2 * np.pi)
    elements.omega = angle(omega, 0, 2 * np.pi)
    elements.f = angle(f, 0, 2 * np.pi)
    return elements


def random_circular_orbit(
    i: float | None = None,
    alt: float = 500,
    r_body: float = _ORBIT_RADIUS_KM,
    Omega: float | None = None,
    f: float | None = None,
) -> ClassicElements:
    """Returns elements of a circular orbit `alt` km high; angles in degrees are drawn if None."""
    return random_orbit(i=i, a=r_body + alt, e=0, Omega=Omega, omega=0, f=f)


def random_epoch(start: int = 2000, end: int = 2022) -> str:
    """Draws an epoch from `start` up to the year before `end`, as `2018 SEP 29 21:00:00.000 (UTC)`.

    Days are 1 to 27, and the last hour, minute, second and millisecond never occur, as in BSK-RL.
    """
    year = np.random.randint(start, end)
    # The same draw as a choice of a month, and faster.
    month = MONTHS[np.random.randint(0, len(MONTHS))]
    day = np.random.randint(1, 28)
    hours = np.random.randint(0, 23)
    minutes = np.random.randint(0, 59)
    seconds = np.random.randint(0, 59)
    milliseconds = np.random.randint(0, 999)
    time = f"{hours:02d}:{minutes:02d}:{seconds:02d}.{milliseconds:03d}"
    return f"{year} {month} {day:02d} {time} (UTC)"


def elevation(r_sat: npt.NDArray[Any], r_target: npt.NDArray[Any]) -> Any:
    """Returns the elevation of one or several satellites seen from a target, rad."""
    line = r_sat - r_target
    range_m = np.linalg.norm(line, axis=-1)
    cosine = np.sum(r_target * line, axis=-1) / (np.linalg.norm(r_target) * range_m)
    return np.pi / 2 - np.arccos(cosine)


def walker_delta(
    n_spacecraft: int,
    n_planes: int,
    rel_phasing: float,
    altitude: float,
    inc: float,
    clustersize: int = 1,
    clusterspacing: float = 0,
) -> list[ClassicElements]:
    """Returns the orbits of a Walker-delta constellation.

    `altitude` is in m above 6 371 km; `inc`, `rel_phasing` and `clusterspacing`, the distance of
    neighbours in a cluster of `clustersize`, are in degrees.
    """
    if n_spacecraft == 0:
        return []
    per_plane = n_spacecraft / n_planes
    spacing = 360.0 / (per_plane / clustersize)
    orbits = []
    for index in range(n_spacecraft):
        plane = float(int(index / per_plane))
        cluster = int((index % per_plane) / clustersize)
        orbit = ClassicElements()
        orbit.a = _ORBIT_RADIUS_KM * 1000.0 + altitude
        orbit.e = 0.0
        orbit.i = np.radians(inc)
        orbit.Omega = np.radians(plane * 360.0 / n_planes % 360)
        orbit.omega = np.radians(plane * rel_phasing * 360.0 / n_planes)
        orbit.f = np.radians(cluster * spacing + clusterspacing * (index % clustersize))
        orbits.append(orbit)
    return orbits


def walker_delta_args(
    n_planes: int,
    rel_phasing: float = 0.0,
    altitude: float = 500,
    inc: float = 45.0,
    randomize_true_anomaly: bool = True,
    randomize_lan: bool = True,
    **walker_delta_kwargs: Any,
) -> Callable[[list[Any]], SatelliteArgs]:
    """Returns a `sat_arg_randomizer` that places satellites in a Walker-delta constellation.

    `altitude` is in km, `inc` in degrees. Each call draws a true anomaly and a node for all.
    """

    def place(satellites: list[Any]) -> SatelliteArgs:
        orbits = walker_delta(
            n_spacecraft=len(satellites),
            n_planes=n_planes,
            rel_phasing=rel_phasing,
            altitude=altitude * 1e3,
            inc=inc,
            **walker_delta_kwargs,
        )
        turned = [("f", randomize_true_anomaly), ("Omega", randomize_lan)]
        for name, is_random in turned:
            if is_random:
                offset = np.random.uniform(0, 2 * np.pi)
                for orbit in orbits:
                    setattr(orbit, name, np.mod(getattr(orbit, name) + offset, 2 * np.pi))
        return {item: {"oe": orbit} for item, orbit in zip(satellites, orbits, strict=True)}

    return place


def relative_to_chief(
    chief_name: str,
    chief_orbit: ClassicElements | Callable[[], ClassicElements],
    deputy_relative_state: dict[str, Any],
) -> Callable[[list[Any]], SatelliteArgs]:
    """Returns a `sat_arg_randomizer` that places deputies relative to a chief.

    `deputy_relative_state` maps names to position and velocity in the chief's Hill frame, six
    numbers in m and m/s, or to functions that return them.
    """

    def place(satellites: list[Any]) -> SatelliteArgs:
        args: SatelliteArgs = {satellite: {} for satellite in satellites}
        by_name = {satellite.name: satellite for satellite in reversed(satellites)}
        chief = by_name[chief_name]
        mu = chief.sat_args_generator["mu"]
        is_fixed = isinstance(chief_orbit, ClassicElements)
        orbit = chief_orbit if is_fixed else chief_orbit()  # type: ignore[operator]
        args[chief]["oe"] = orbit
        position, velocity = elem2rv(mu, orbit)  # type: ignore[arg-type]
        for name, state in deputy_relative_state.items():
            relative = state() if callable(state) else state
            deputy = hill2cd(position, velocity, relative[0:3], relative[3:6])
            args[by_name[name]]["oe"] = rv2elem(mu, *deputy)
        return args

    return place


def lla2ecef(lat: float, long: float, radius: float) -> Vector:
    """Returns the planet-fixed position at a latitude and longitude, degrees, and a radius."""
    latitude, longitude = np.radians(lat), np.radians(long)
    cosine = np.cos(latitude)
    return radius * np.array([cosine * np.cos(longitude), cosine * np.sin(longitude), np.sin(latitude)])


def rv2HN(r_N: Any, v_N: Any) -> Vector:
    """Returns the rotation from the inertial frame to the Hill frame of a position and velocity."""
    radial = np.asarray(r_N) / np.linalg.norm(r_N)
    normal = np.cross(r_N, v_N)
    normal = normal / np.linalg.norm(normal)
    return np.array([radial, np.cross(normal, radial), normal])


def rv2omega(r_N: Any, v_N: Any) -> Vector:
    """Returns the angular velocity of the Hill frame in the inertial frame, rad/s."""
    hill = rv2HN(r_N, v_N)
    rate: Vector = hill[2] * np.dot(v_N, hill[1]) / np.linalg.norm(r_N)
    return rate


def _hill_rate(r_N: Any, v_N: Any) -> Vector:
    """Angular velocity of the Hill frame in that frame, rad/s."""
    rate = np.linalg.norm(np.cross(r_N, v_N)) / np.linalg.norm(r_N) ** 2
    return np.array([0.0, 0.0, rate])


def cd2hill(rc_N: Any, vc_N: Any, rd_N: Any, vd_N: Any) -> tuple[Vector, Vector]:
    """Converts the inertial state of a deputy to one relative to a chief in its Hill frame."""
    hill = rv2HN(rc_N, vc_N)
    position = hill @ (np.asarray(rd_N) - rc_N)
    turning = np.cross(_hill_rate(rc_N, vc_N), position)
    return position, hill @ (np.asarray(vd_N) - vc_N) - turning


def hill2cd(rc_N: Any, vc_N: Any, rho_H: Any, rho_deriv_H: Any) -> tuple[Vector, Vector]:
    """Converts a state relative to a chief in its Hill frame to the inertial one of a deputy."""
    hill = rv2HN(rc_N, vc_N)
    turning = np.cross(_hill_rate(rc_N, vc_N), rho_H)
    return rc_N + hill.T @ rho_H, vc_N + hill.T @ (rho_deriv_H + turning)


def fibonacci_sphere(n_points: int) -> Vector:
    """Returns points that are spread evenly over the unit sphere, one a row."""
    angle = (3 - np.sqrt(5)) * np.pi * np.arange(n_points)
    z = np.linspace(1 / n_points - 1, 1 - 1 / n_points, n_points)
    radius = np.sqrt(1 - z * z)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


class TrajectorySimulator:
    """Separate propagation of an orbit, which BSK-RL's users can construct; not supported."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        raise NotImplementedError("TrajectorySimulator is not supported; use the satellite's trajectory in an episode.")
