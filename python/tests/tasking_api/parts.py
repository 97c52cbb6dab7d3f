"""Satellites that several programs use, and a driver with a random policy."""

from __future__ import annotations

import numpy as np
from peer import act, data, dyn, fsw, obs, orbital, sats, scene

ORBIT_S = 5700.0
IMAGER_ARGS = {
    "imageAttErrorRequirement": 0.01,
    "imageRateErrorRequirement": 0.01,
    "batteryStorageCapacity": 1e6,
    "storedCharge_Init": 8e5,
    "dataStorageCapacity": 1e12,
    "u_max": 0.4,
    "K1": 0.25,
    "K3": 3.0,
    "omega_max": 0.087,
    "servo_Ki": 5.0,
    "servo_P": 30.0,
}
SCANNER_ARGS = {
    "dataStorageCapacity": 5000 * 8e6,
    "storageInit": lambda: int(np.random.uniform(0.0, 0.8) * 5000 * 8e6),
    "instrumentBaudRate": 0.5 * 8e6,
    "transmitterBaudRate": -50 * 8e6,
    "batteryStorageCapacity": 200 * 3600,
    "storedCharge_Init": lambda: np.random.uniform(0.3, 1.0) * 200 * 3600,
    "basePowerDraw": -10.0,
    "instrumentPowerDraw": -30.0,
    "transmitterPowerDraw": -25.0,
    "thrusterPowerDraw": -80.0,
    "panelArea": 0.25,
    "imageAttErrorRequirement": 0.1,
    "imageRateErrorRequirement": 0.1,
    "disturbance_vector": lambda: np.random.normal(scale=0.0001, size=3),
    "maxWheelSpeed": 6000.0,
    "wheelSpeeds": lambda: np.random.uniform(-3000, 3000, 3),
    "desatAttitude": "nadir",
}


class Imager(sats.ImagingSatellite):
    observation_spec = [
        obs.OpportunityProperties(dict(prop="priority"), dict(prop="opportunity_open", norm=ORBIT_S), n_ahead_observe=3)
    ]
    action_spec = [act.Image(n_ahead_image=4)]
    dyn_type = dyn.FullFeaturedDynModel
    fsw_type = fsw.SteeringImagerFSWModel


class ScanningDynamics(dyn.ContinuousImagingDynModel, dyn.GroundStationDynModel):
    pass


class Scanner(sats.AccessSatellite):
    observation_spec = [
        obs.SatProperties(dict(prop="storage_level_fraction"), dict(prop="battery_charge_fraction")),
        obs.OpportunityProperties(
            dict(prop="opportunity_open", norm=ORBIT_S),
            dict(prop="opportunity_close", norm=ORBIT_S),
            type="ground_station",
            n_ahead_observe=1,
        ),
        obs.Eclipse(norm=ORBIT_S),
        obs.Time(),
    ]
    action_spec = [act.Scan(duration=180.0), act.Charge(duration=120.0), act.Downlink(duration=60.0), act.Desat(duration=60.0)]
    dyn_type = ScanningDynamics
    fsw_type = fsw.ContinuousImagingFSWModel


def imagers(count, cls=Imager, obs_type=np.ndarray, **args):
    """Returns imagers of a class, with arguments that replace the usual ones."""
    return [cls(f"EO_{number}", IMAGER_ARGS | args, obs_type=obs_type) for number in range(1, count + 1)]


def train(spacing=None, planes=1):
    """Returns the randomizer of satellites in planes, or of a train with a spacing in degrees."""
    cluster = {} if spacing is None else {"clustersize": 3, "clusterspacing": spacing}
    return orbital.walker_delta_args(altitude=800.0, inc=60.0, n_planes=planes, **cluster)


def constellation(kind, satellites, communicator=None, targets=800, rewarder=None, scenario=None, **settings):
    """Returns an environment of imagers."""
    return kind(
        satellites=satellites,
        scenario=scene.UniformTargets(targets) if scenario is None else scenario,
        rewarder=data.UniqueImageReward() if rewarder is None else rewarder,
        communicator=communicator,
        log_level="CRITICAL",
        **settings,
    )


def fly(env, seed, steps, note=None):
    """Steps an environment with random actions for satellites that need one, and returns what it returned."""
    rng = np.random.default_rng(seed)
    observation, info = env.reset(seed=seed)
    records = [[observation, info]]
    for _ in range(steps):
        chosen = {}
        for satellite in env.unwrapped.satellites:
            action = int(rng.integers(satellite.action_space.n))
            chosen[satellite.name] = action if satellite.requires_retasking else None
        if hasattr(env, "agents"):
            actions = {name: action for name, action in chosen.items() if action is not None and name in env.agents}
        elif isinstance(observation, tuple):
            actions = list(chosen.values())
        else:
            actions = next(iter(chosen.values()))
        observation, reward, terminated, truncated, info = env.step(actions)
        record = [actions, observation, reward, terminated, truncated, info, env.unwrapped.simulator.sim_time]
        records.append(record if note is None else [*record, note(env)])
        is_over = not env.agents if hasattr(env, "agents") else terminated or truncated
        if is_over:
            break
    return records


def images(env):
    """Returns the counters of images by satellite."""
    return {item.name: [item.imaged, item.missed, len(item.data_store.data.imaged)] for item in env.satellites}
