"""Episodes whose access windows depend on BSK-RL's search: low and high elevations, blocks of any length, long durations."""

from __future__ import annotations

from typing import Any

from bsk_rl.utils.orbital import random_orbit

from bsk_record.episodes.common import ORBIT_S, UNIQUE_IMAGES, imager, radians, stations_observed, targets_observed
from bsk_record.policies import ScriptPolicy
from bsk_record.specs import Component, Episode, component

EARTH_RADIUS_KM = 6378.1366

# Stations around both poles, with different elevations.
POLAR_STATIONS = [
    {"name": f"P{index}", "lat": latitude, "long": 50.0 * index, "gsMinimumElevation": radians(elevation)}
    for index, (latitude, elevation) in enumerate(
        [(89.9, 1.0), (-89.5, 5.0), (85.0, 10.0), (-82.0, 30.0), (78.0, 60.0), (-70.0, 5.0), (66.0, 20.0)]
    )
]

# Stations on a coarse grid.
GRID = [
    {"name": f"{latitude}_{longitude}", "lat": float(latitude), "long": float(longitude)}
    for latitude in (-60, -30, 0, 30, 60)
    for longitude in range(0, 360, 60)
]


def windows_episode(
    name: str,
    *,
    altitude_km: float = 500.0,
    eccentricity: float = 0.0,
    inclination: float = 60.0,
    station_elevation: float = 10.0,
    target_elevation: float = 45.0,
    targets: int = 200,
    time_limit: float = float("inf"),
    steps: int = 2,
    observes: tuple[Component, ...] | None = None,
    stations: list[dict[str, Any]] | None = None,
    seed: int = 0,
    **options: Any,
) -> Episode:
    """Returns an episode of a charging satellite that observes its windows; angles in degrees, `altitude_km` of the perigee."""
    orbit = random_orbit(
        a=(EARTH_RADIUS_KM + altitude_km) / (1.0 - eccentricity),
        e=eccentricity,
        i=inclination,
        Omega=40.0 + 67.0 * seed,
        omega=25.0 + 31.0 * seed,
        f=10.0 + 113.0 * seed,
    )
    rest = {"wheelSpeeds": [0.0, 0.0, 0.0], "sigma_init": [0.0, 0.0, 0.0], "omega_init": [0.0, 0.0, 0.0]}
    args = {"oe": orbit, "imageTargetMinimumElevation": radians(target_elevation)} | rest
    world = {"gsMinimumElevation": radians(station_elevation), "utc_init": "2012 JUN 01 12:00:00.000 (UTC)"}
    if stations is not None:
        world["groundStationsData"] = stations
    observed = (targets_observed(3), stations_observed(), component("Eclipse", norm=ORBIT_S))
    return Episode(
        name=name,
        seed=seed,
        cls="SatelliteTasking",
        satellites=(
            imager(
                "EO",
                args=args,
                actions=(component("Charge", duration=300.0),),
                observations=observed if observes is None else observes,
                options=options,
            ),
        ),
        scenario=component("UniformTargets", n_targets=targets),
        rewarders=UNIQUE_IMAGES,
        policy=ScriptPolicy((0,)),
        max_steps=steps,
        env={"time_limit": time_limit},
        world_args=world,
    )


TIME_ONLY = (component("Time"),)

EPISODES = (
    windows_episode("windows_low", station_elevation=5.0, altitude_km=800.0, time_limit=3 * ORBIT_S, seed=1),
    windows_episode("windows_horizon", station_elevation=1.0, time_limit=2 * ORBIT_S, observes=TIME_ONLY, seed=2),
    windows_episode("windows_horizon_blocks", station_elevation=1.0, steps=4, stations=GRID, seed=3),
    windows_episode("windows_high", station_elevation=30.0, altitude_km=400.0, time_limit=17_100.0, seed=4),
    windows_episode("windows_far", altitude_km=2000.0, target_elevation=30.0, time_limit=2 * ORBIT_S, seed=5),
    windows_episode("windows_elliptic", eccentricity=0.05, time_limit=3 * ORBIT_S, seed=6),
    windows_episode("windows_elliptic_blocks", eccentricity=0.01, steps=6, station_elevation=5.0, seed=7),
    windows_episode("windows_nearly_circular", eccentricity=0.001, inclination=97.4, time_limit=5715.0, seed=8),
    windows_episode("windows_poles", inclination=90.0, targets=600, time_limit=ORBIT_S, stations=POLAR_STATIONS, seed=9),
    windows_episode("windows_polar_blocks", inclination=82.0, stations=POLAR_STATIONS, steps=5, generation_duration=330.0, seed=10),
    windows_episode("windows_odd_blocks", generation_duration=37.5, steps=8, seed=11),
    windows_episode("windows_uneven_blocks", generation_duration=601.7, steps=6, seed=12),
    windows_episode("windows_short_blocks", generation_duration=45.0, steps=4, altitude_km=800.0, stations=GRID, seed=13),
    windows_episode("windows_long", time_limit=40_000.0, targets=100, seed=14),
    windows_episode("windows_long_blocks", steps=70, targets=100, stations=GRID, altitude_km=600.0, seed=15),
    windows_episode("windows_grazing", target_elevation=80.0, targets=600, altitude_km=400.0, time_limit=17_100.0, seed=16),
    windows_episode("windows_wide", target_elevation=10.0, targets=60, altitude_km=800.0, steps=3, seed=17),
    windows_episode(
        "windows_initial", initial_generation_duration=1234.5, generation_duration=1000.0, steps=6, target_elevation=20.0, seed=18
    ),
)
