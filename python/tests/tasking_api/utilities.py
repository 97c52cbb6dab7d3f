"""Values of the utilities, from draws of a seed."""

from __future__ import annotations

import numpy as np
from peer import attitude, elem2rv, functional, orbital, rv2elem

MU = 3.986e14


def listed(elements):
    """Returns orbital elements as a list."""
    return [elements.a, elements.e, elements.i, elements.Omega, elements.omega, elements.f]


def utilities(seed):
    """Returns values by the name of the function."""
    np.random.seed(seed)
    position, velocity = np.array([7e6, 1e5, 2e5]), np.array([100.0, 5000.0, 5500.0])
    spins = [
        None,
        dict(rate=1.0, axis="normal"),
        dict(type="uniform", low=0.0, high=2.0, axis="random"),
        dict(rate=2.0, axis="velocity"),
        dict(rate=2.0, axis=[1, 2, 3]),
    ]
    states = []
    for eccentricity, inclination in ((0.0, 0.5), (0.01, 0.5), (0.3, 2.0)):
        orbit = orbital.random_orbit(i=np.degrees(inclination), e=eccentricity)
        state = elem2rv(MU, orbit)
        states.append([*state, listed(rv2elem(MU, *state))])
    return {
        "random_unit_vector": orbital.random_unit_vector(),
        "random_orbit": [listed(orbital.random_orbit()), listed(orbital.random_orbit(i=30, f=20, e=0.1))],
        "random_circular_orbit": [listed(orbital.random_circular_orbit()), listed(orbital.random_orbit(alt=600))],
        "random_epoch": [orbital.random_epoch(), orbital.random_epoch(2010, 2012)],
        "walker_delta": [listed(orbit) for orbit in orbital.walker_delta(7, 3, 1.0, 5e5, 50.0, 2, 3.0)],
        "rv2HN": orbital.rv2HN(position, velocity),
        "rv2omega": orbital.rv2omega(position, velocity) * 1e3,
        "cd2hill": orbital.cd2hill(position, velocity, position + 100, velocity + 1),
        "hill2cd": orbital.hill2cd(position, velocity, np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.3])),
        "fibonacci_sphere": orbital.fibonacci_sphere(10),
        "lla2ecef": orbital.lla2ecef(10, 20, 6378e3),
        "elevation": [
            orbital.elevation(position, position / 2 + 1e5),
            orbital.elevation(np.array([position, position + 1e5]), position / 2),
        ],
        "random_tumble": [attitude.random_tumble(), attitude.random_tumble(0.01)],
        "hill_frame_attitude": [attitude.hill_frame_attitude(position, velocity, spin) for spin in spins],
        "elements": states,
        "valid_func_name": functional.valid_func_name("1a-b c"),
        "vectorize_nested_dict": functional.vectorize_nested_dict({"a": 1.0, "b": {"c": np.arange(3.0), "d": [1.0, 2.0]}}),
    }
