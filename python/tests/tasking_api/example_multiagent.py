"""Prints what three imaging satellites return by the tuple API and by PettingZoo's; one is killed by a message."""

import numpy as np

from sparring.tasking import ConstellationTasking, GeneralSatelliteTasking, act, comm, data, messaging, obs, sats, scene
from sparring.tasking.sim import dyn, fsw
from sparring.tasking.utils.orbital import walker_delta_args


class ImagingSatellite(sats.ImagingSatellite):
    observation_spec = [
        obs.OpportunityProperties(dict(prop="priority"), dict(prop="opportunity_open", norm=5700.0), n_ahead_observe=10)
    ]
    action_spec = [act.Image(n_ahead_image=10)]
    dyn_type = dyn.FullFeaturedDynModel
    fsw_type = fsw.SteeringImagerFSWModel


sat_args = dict(
    imageAttErrorRequirement=0.01,
    imageRateErrorRequirement=0.01,
    batteryStorageCapacity=1e9,
    storedCharge_Init=1e9,
    dataStorageCapacity=1e12,
    u_max=0.4,
    K1=0.25,
    K3=3.0,
    omega_max=0.087,
    servo_Ki=5.0,
    servo_P=150 / 5,
)


def make(kind):
    return kind(
        satellites=[ImagingSatellite(f"EO_{n}", dict(sat_args)) for n in (1, 2, 3)],
        scenario=scene.UniformTargets(1000),
        rewarder=data.UniqueImageReward(),
        communicator=comm.LOSCommunication(),
        sat_arg_randomizer=walker_delta_args(altitude=800.0, inc=60.0, n_planes=1),
        log_level="WARNING",
    )


def die(satellite):
    def is_alive(log_failure=False):
        message = messaging.PowerStorageStatusMsgPayload()
        message.storageLevel = 0.0
        satellite.dynamics.powerMonitor.batPowerOutMsg.write(message)
        return satellite.dynamics.is_alive(log_failure=log_failure) and satellite.fsw.is_alive(log_failure=log_failure)

    satellite.is_alive = is_alive


env = make(GeneralSatelliteTasking)
observation, info = env.reset(seed=3)
print("tuple", [s.shape for s in env.observation_space], env.action_space)
observation, reward, terminated, truncated, info = env.step([7, 9, 8])
for step in range(8):
    names = [satellite.name for satellite in env.unwrapped.satellites]
    print(
        step, round(float(reward), 6), terminated, truncated, info["d_ts"], [info[name]["requires_retasking"] for name in names]
    )
    actions = [step % 10 if info[name]["requires_retasking"] else None for name in names]
    observation, reward, terminated, truncated, info = env.step(actions)
die(env.unwrapped.satellites[0])
observation, reward, terminated, truncated, info = env.step([6, 7, 9])
print("killed", round(float(reward), 6), terminated, truncated)

env = make(ConstellationTasking)
observation, info = env.reset(seed=4)
print("parallel", env.agents, {name: tuple(space.shape) for name, space in env.observation_spaces.items()})
observation, reward, terminated, truncated, info = env.step({env.agents[0]: 7, env.agents[1]: 9, env.agents[2]: 8})
print({name: np.round(seen[:4], 5).tolist() for name, seen in observation.items()}, reward)
die(env.unwrapped.satellites[0])
observation, reward, terminated, truncated, info = env.step({env.agents[0]: 7, env.agents[1]: 9})
print("killed", reward, terminated, env.agents)
observation, reward, terminated, truncated, info = env.step({name: 1 for name in env.agents})
print("goes on", sorted(observation), reward, env.agents)
