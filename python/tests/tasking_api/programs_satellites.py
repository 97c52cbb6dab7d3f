"""Programs with satellites, scenarios and opportunities of their own."""

from __future__ import annotations

import numpy as np
from parts import IMAGER_ARGS, Imager, constellation, fly, imagers, images
from peer import (
    ConstellationTasking,
    GeneralSatelliteTasking,
    SatelliteTasking,
    Target,
    act,
    aliveness_checker,
    comm,
    data,
    dyn,
    fsw,
    messaging,
    obs,
    orbital,
    sats,
    scene,
)


def heterogeneous_satellites(seed):
    class Slow(sats.ImagingSatellite):
        observation_spec = [obs.SatProperties(dict(prop="wheel_speeds")), obs.Time(norm=100.0)]
        action_spec = [act.Charge(duration=90.0), act.Image(n_ahead_image=2)]
        dyn_type = (dyn.ImagingDynModel, dyn.LOSCommDynModel)
        fsw_type = fsw.ImagingFSWModel

    satellites = [Imager("eye", IMAGER_ARGS), Slow("slow", {"u_max": 0.4}), Imager("eye", IMAGER_ARGS)]
    env = constellation(ConstellationTasking, satellites, comm.LOSCommunication(), time_limit=2000.0)
    return [*fly(env, seed, 20, images), [item.name for item in env.satellites]]


class Northern(dyn.FullFeaturedDynModel):
    @aliveness_checker
    def is_not_north(self):
        """Returns whether the satellite is south of a latitude."""
        return self.r_BN_P[2] / np.linalg.norm(self.r_BN_P) < 0.6


def own_aliveness_checker(seed):
    class Mortal(sats.ImagingSatellite):
        observation_spec = Imager.observation_spec
        action_spec = Imager.action_spec
        dyn_type = Northern
        fsw_type = fsw.SteeringImagerFSWModel

    env = constellation(ConstellationTasking, imagers(3, Mortal), comm.FreeCommunication(), time_limit=2500.0)
    return fly(env, seed, 60, images)


def empty_batteries(seed):
    args = {"batteryStorageCapacity": 3e4, "basePowerDraw": -40.0, "storedCharge_Init": lambda: np.random.uniform(1e4, 3e4)}
    env = constellation(ConstellationTasking, imagers(3, **args), comm.FreeCommunication(), failure_penalty=-3.0)
    return fly(env, seed, 40, images)


def written_message(seed):
    env = SatelliteTasking(Imager("k", IMAGER_ARGS), scenario=scene.UniformTargets(800), log_level="CRITICAL")
    env.reset(seed=seed)
    records = [env.step(2)]
    message = messaging.PowerStorageStatusMsgPayload()
    message.storageLevel = 0.0
    dynamics = env.satellite.dynamics
    dynamics.powerMonitor.batPowerOutMsg.write(message)
    records.append([dynamics.battery_charge, env.satellite.is_alive(), env.satellite.time_of_death])
    return [*records, env.step(1), env.satellite.requires_retasking, dynamics.battery_charge]


class Hooked(sats.ImagingSatellite):
    observation_spec = Imager.observation_spec
    action_spec = Imager.action_spec
    dyn_type = dyn.FullFeaturedDynModel
    fsw_type = fsw.SteeringImagerFSWModel

    def reset_pre_sim_init(self):
        super().reset_pre_sim_init()
        self.sat_args["mass"] *= 1.2
        self.places = []

    def reset_post_sim_init(self):
        super().reset_post_sim_init()
        self.places.append(list(self.dynamics.r_BN_N))

    def is_alive(self, log_failure=True):
        return super().is_alive(log_failure) and self.simulator.sim_time < 400.0


class Grid(scene.UniformTargets):
    def regenerate_targets(self):
        self.targets = [
            Target(f"x{number}", orbital.lla2ecef(np.random.uniform(-60, 60), 0.5 * number, self.radius), number % 5)
            for number in range(self.n_targets)
        ]


def hooks_of_satellite_and_scenario(seed):
    second = IMAGER_ARGS | {"oe": None, "rN": lambda: np.array([7e6, 0.0, 0.0]), "vN": [0.0, 5300.0, 5600.0]}
    stations = [dict(lat=10.0, long=20.0), dict(lat=-30.0, long=50.0, elev=100.0, name="Z", gsMinimumElevation=0.3)]
    env = ConstellationTasking(
        [Hooked("a", IMAGER_ARGS), Hooked("a", second)],
        scenario=Grid(700),
        rewarder=data.UniqueImageReward(),
        world_args={
            "utc_init": "2018 SEP 29 21:00:00.000 (UTC)",
            "groundStationsData": stations,
            "gsMinimumElevation": lambda: np.random.uniform(0.1, 0.2),
        },
        log_level="CRITICAL",
    )
    records = [*fly(env, seed, 15), *fly(env, seed + 1, 3)]
    return [*records, [item.places for item in env.satellites], env.world_args["gsMinimumElevation"]]


def opportunities_and_filters(seed):
    env = SatelliteTasking(
        Imager("f", IMAGER_ARGS, initial_generation_duration=1800.0, generation_duration=900.0),
        scenario=scene.CityTargets(300, location_offset=1e4),
        rewarder=data.UniqueImageReward(),
        log_level="CRITICAL",
    )
    env.satellite.add_access_filter(lambda item: item["object"].priority > 0.4, types="target")

    def note(env):
        satellite = env.satellite
        low = satellite.find_next_opportunities(4, types="target", filter=lambda item: item["object"].priority < 0.2)
        stations = satellite.next_opportunities_dict(types="ground_station")
        return [
            len(satellite.opportunities),
            len(satellite.upcoming_opportunities),
            [[item["object"].name, *item["window"]] for item in low],
            sorted(stations),
            len(satellite.opportunities_dict(types="target")),
            len(satellite.upcoming_opportunities_dict()),
            satellite.window_calculation_time,
        ]

    return fly(env, seed, 8, note)


def satellites_relative_to_a_chief(seed):
    deputies = {
        "EO_1": lambda: np.random.uniform(-500, 500, 6) * np.array([1, 1, 1, 1e-3, 1e-3, 1e-3]),
        "EO_3": np.array([1e4, 2e4, 0.0, 0.0, 0.0, 0.0]),
    }
    randomizer = orbital.relative_to_chief("EO_2", lambda: orbital.random_orbit(e=0.001), deputies)
    env = constellation(GeneralSatelliteTasking, imagers(3), comm.LOSCommunication(), sat_arg_randomizer=randomizer)
    return [*fly(env, seed, 6, images), [item.dynamics.r_BN_N for item in env.satellites]]


def platform_alone(seed):
    class Platform(sats.Satellite):
        observation_spec = [obs.SatProperties(dict(prop="wheel_speeds"), dict(prop="omega_BH_H", norm=0.03)), obs.Eclipse()]
        action_spec = [
            act.Charge(duration=100.0),
            act.NadirPoint(duration=60.0),
            act.Desat(duration=40.0),
            act.Drift(duration=30.0),
        ]
        dyn_type = dyn.BasicDynamicsModel
        fsw_type = fsw.BasicFSWModel

    spin = data.ResourceReward(-0.01, lambda item: np.abs(item.dynamics.wheel_speeds).sum())
    env = GeneralSatelliteTasking(Platform("p"), rewarder=spin, time_limit=1500.0, log_level="CRITICAL")
    return [*fly(env, seed, 25), sorted(Platform.default_sat_args()), sorted(env.world_args)]


PROGRAMS = [
    heterogeneous_satellites,
    own_aliveness_checker,
    empty_batteries,
    written_message,
    hooks_of_satellite_and_scenario,
    opportunities_and_filters,
    satellites_relative_to_a_chief,
    platform_alone,
]
